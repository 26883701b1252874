"""`--trust` and `--anyway`: the only ways to have a command run code that files name, or obey a fit that is wrong."""

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

Anyway = Annotated[
    bool, typer.Option("--anyway", help="Use a fit that is not to be trusted; the output says why it is not.")
]
"""An option of every command that moves an arm by a fit, or writes its values."""
