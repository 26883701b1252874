"""Arguments and options that commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def _trusted(context: typer.Context, value: bool) -> bool:
    """Trust files until the command ends."""
    if value:
        from qsframework.plugin.trusted import trusting

        context.with_resource(trusting())
    return value


_JSON = typer.Option("--json", help="Write the result as JSON.")
_REPORT = typer.Option("--report", help="Write a report: .html, or .pdf (needs Chromium).")
_SEED = typer.Option("--seed", help="Random seed.", min=0)
_JOBS = typer.Option("--jobs", help="Processes on this machine; 0: one per core.", min=0)
_DASK = typer.Option("--dask", help="Address of a Dask cluster, such as tcp://10.0.0.5:8786.")
_TRUST = typer.Option(
    "--trust", callback=_trusted, help="Allow Python code referenced by `file:` (runs with your rights)."
)
_ANYWAY = typer.Option("--anyway", help="Proceed with a rejected fit (prints the reason).")
SHARED = {
    "--json": _JSON,
    "--report": _REPORT,
    "--seed": _SEED,
    "--jobs": _JOBS,
    "--dask": _DASK,
    "--trust": _TRUST,
    "--anyway": _ANYWAY,
}
"""Options that many commands have: `qsf --help` explains them."""

ExperimentFile = Annotated[Path, typer.Argument(help="experiment.yaml", show_default=False)]
Json = Annotated[Path | None, _JSON]
Report = Annotated[Path | None, _REPORT]
Seed = Annotated[int, _SEED]
Jobs = Annotated[int, _JOBS]
DaskAddress = Annotated[str | None, _DASK]
Trust = Annotated[bool, _TRUST]
"""An option of every command that loads robots or experiments; it takes effect by itself."""
Anyway = Annotated[bool, _ANYWAY]
"""An option of every command that moves an arm by a fit, or writes its values."""
