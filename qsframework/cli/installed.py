"""The commands of installed packages, which `qsf` has beside its own: each is loaded when it is asked for."""

from __future__ import annotations

from typing import Any

import typer

from qsframework.cli.declared import expanded
from qsframework.errors import InputError, PluginError, Problem
from qsframework.installed import COMMANDS, entries, label, lacking, load


def installed_command(name: str, kind: type[Any]) -> Any:
    """The command of a name, of a kind of typer's; None where no package has one. PluginError where it cannot be
    imported, InputError where its package is gone."""
    if (package := lacking(COMMANDS).get(name)) is not None:
        hint = "Install qsframework again, as a whole."
        raise InputError(Problem(f"qsf {name} is a command of {package}, which is not there", hint=hint))
    if (entry := entries(COMMANDS).get(name)) is None:
        return None
    app = typer.Typer(rich_markup_mode=None, context_settings={"help_option_names": ["-h", "--help"]})
    app.command(name, cls=kind)(expanded(load(entry)))
    return typer.main.get_command(app)


def check_clash(name: str) -> None:
    """Raises PluginError where a package has a command of a name that is one of `qsf` itself."""
    if (entry := entries(COMMANDS).get(name)) is not None:
        raise PluginError(f"{label(entry)} has the name of a command of qsf; uninstall its package")
