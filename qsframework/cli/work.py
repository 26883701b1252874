"""The commands of `qsf` for work on the real robot: compensate. Each imports the library when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

ExperimentFile = Annotated[Path, typer.Argument(help="experiment.yaml", show_default=False)]
Json = Annotated[Path | None, typer.Option("--json", help="Write the result as JSON.")]
Report = Annotated[Path | None, typer.Option("--report", help="Write an HTML report.")]


def compensate(
    experiment: ExperimentFile,
    fit: Annotated[Path, typer.Argument(help="fit.json, from qsf identify --json", show_default=False)],
    targets: Annotated[
        Path,
        typer.Argument(
            help="CSV: q1_deg, ... or x_mm, y_mm, z_mm, rx_deg, ry_deg, rz_deg; and fx_N, fy_N, fz_N.",
            show_default=False,
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The corrected targets.")] = Path("corrected.csv"),
    reference: Annotated[
        str,
        typer.Option(help="Wanted is where the 'commanded' angles would put a rigid arm, or the 'unloaded' real one."),
    ] = "commanded",
    json: Json = None,
    report: Report = None,
) -> None:
    """Correct targets so that the loaded tool stands where it is wanted, and say what error is left."""
    from qsframework.cli.compensate import CompensateFiles, run_compensate

    run_compensate(CompensateFiles(experiment, fit, targets, output, json, report), reference)


def add_commands(app: typer.Typer) -> None:
    """Register the commands."""
    for command in (compensate,):
        app.command()(command)
