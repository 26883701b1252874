"""`check_command`: does a command keep the protocol? Run it on every command you write."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO

import typer

from qsframework.cli.declared import expanded
from qsframework.cli.help import Command
from qsframework.plugin.check import Report


def check_command(function: Callable[..., None], name: str) -> Report:
    """Does a command keep the protocol?

    Args:
        function: the command.
        name: the one of its entry point.

    Returns:
        The names of the checks that held, and what did not.
    """
    report = Report()
    first = (function.__doc__ or "").strip().splitlines()[:1]
    report.record("says in one line what it does", bool(first) and first[0].endswith("."), f"{first}")
    small = name.replace("-", "").isalnum() and name == name.lower()
    report.record("has a name of small letters, digits and -", small, name)
    app = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)
    made = report.attempt("declares its options", lambda: app.command(name, cls=Command)(expanded(function)))
    if made is None:
        return report
    command = typer.main.get_command(app)
    bare = [p.name for p in command.params if not getattr(p, "help", None)]
    report.record("says of each option what it is", not bare, f"not of {bare[:3]}")
    reserved = {"--help", "-h"}
    taken = [o for p in command.params if p.name != "help" for o in p.opts if o in reserved]
    report.record("leaves --help to qsf", not taken, f"{taken}")
    report.attempt("prints its help", lambda: _printed(command, name))
    return report


def _printed(command: Callable[..., object], name: str) -> str:
    with redirect_stdout(StringIO()) as out:
        command(["--help"], prog_name=f"qsf {name}", standalone_mode=False)
    return out.getvalue()
