"""`--trust`: the one way in which a command runs code that a robot or an experiment names."""

from __future__ import annotations

from typing import Annotated

import typer


def _told(context: typer.Context, value: bool) -> bool:
    """Trust files until the command ends."""
    if value:
        from qsframework.plugin.trusted import trusting

        context.with_resource(trusting())
    return value


Trust = Annotated[
    bool,
    typer.Option("--trust", callback=_told, help="Run the code of effects that the files name by `file:`, as you."),
]
"""An option of every command that loads robots or experiments; it takes effect by itself."""
