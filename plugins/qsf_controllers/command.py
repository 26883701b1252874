"""`qsf export`: what it is asked."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from qsf_controllers.options import ExportOptions
from qsframework.cli import Json, Trust
from qsframework.option import Option


def export(
    files: Annotated[
        list[Path], typer.Argument(metavar="EXPERIMENT PLAN", help="experiment.yaml and plan.csv.", show_default=False)
    ],
    options: ExportOptions,
    output: Annotated[Path, Option("The file; krl makes .src and .dat.", short="o", group="Programme")],
    json: Json = None,
    trust: Trust = False,
) -> None:
    """Write a plan as a robot programme, checked for collisions."""
    from qsf_controllers.run import run_export
    from qsframework.cli import sorted_out
    from qsframework.errors import InputError, Problem

    given = sorted_out(files, ("experiment", "targets"), "plan")
    for targets in given["targets"]:
        hint = "Teach them in a programme: qsf compensate EXPERIMENT FIT PROGRAMME corrects it."
        raise InputError(Problem("these are targets, no plan of measurements", str(targets), hint=hint))
    if len(given["experiment"]) != 1 or len(given["plan"]) != 1:
        raise InputError(Problem("an experiment and a plan are needed", found=" ".join(map(str, files))))
    run_export(given["plan"][0], given["experiment"][0], output, options, json)
