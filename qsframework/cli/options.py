"""Arguments and options that commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from qsframework.option import Option, Seed, option_of


def _trusted(context: typer.Context, value: bool) -> bool:
    """Trust files until the command ends."""
    if value:
        from qsframework.plugin.trusted import trusting

        context.with_resource(trusting())
    return value


_TRUST = typer.Option(
    "--trust", callback=_trusted, help="Allow Python code referenced by `file:` (runs with your rights)."
)
ExperimentFile = Annotated[Path, typer.Argument(help="experiment.yaml", show_default=False)]
Json = Annotated[Path | None, Option("Write the result as JSON.")]
Report = Annotated[Path | None, Option("Write a report: .html, or .pdf (needs Chromium).")]
Jobs = Annotated[int, Option("Processes on this machine; 0: one per core.", least=0)]
DaskAddress = Annotated[str | None, Option("Address of a Dask cluster, such as tcp://10.0.0.5:8786.")]
Trust = Annotated[bool, _TRUST]
"""An option of every command that loads robots or experiments; it takes effect by itself."""
Anyway = Annotated[bool, Option("Proceed with a rejected fit (prints the reason).")]
"""An option of every command that moves an arm by a fit, or writes its values."""

SHARED = {
    "--json": option_of(Json),
    "--report": option_of(Report),
    "--seed": option_of(Seed),
    "--jobs": option_of(Jobs),
    "--dask": option_of(DaskAddress),
    "--trust": _TRUST,
    "--anyway": option_of(Anyway),
}
"""Options that many commands have: `qsf --help` explains them."""
GONE = {
    "design --prior": "what is known before the readings counts always; --free counts nothing as known.",
    "design --worst": "--samples plans for the mean over the draws.",
    "identify --priors": "what is known before the readings counts always; --free counts nothing as known.",
    "identify --urdf": "qsf kinematics --urdf writes it.",
}
"""Options that a command has no longer, with what serves instead."""
