"""`--help`: options in groups; what many commands share is explained once, by `qsf --help`.

Commands of installed packages stand beside its own: each is loaded when it is asked for.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from qsframework.cli.declared import expanded
from qsframework.cli.options import SHARED
from qsframework.errors import InputError, PluginError, Problem
from qsframework.installed import COMMANDS, entries, label, lacking, load
from qsframework.terminal import folded, paragraphs, width

_VALUES = {"int": "N", "float": "X", "path": "FILE", "file": "FILE", "Path": "FILE"}
"""What stands for a value of a type; TEXT for others."""
_LEFT = 28
"""Columns of the names; a longer one has a line of its own."""

Row = tuple[str, str]


def _rows(rows: Iterable[Row], room: int) -> Iterator[str]:
    """Names with their words beside them."""
    for name, words in rows:
        if len(name) > _LEFT - 4:
            yield f"  {name}"
            name = ""
        yield folded(f"  {name.ljust(_LEFT - 3)} {words}", room, " " * _LEFT)


def _option(option: Any, ctx: Any) -> Row:
    """An option's names with its value, and its help with its default."""
    kind = re.split(r"\W", option.display_type(ctx).replace("list[", "").strip("<"))[0]
    value = "" if option.is_flag else f" {option.metavar or _VALUES.get(kind, 'TEXT')}"
    words = option.help or ""
    default = option.default
    if not (default in (None, "") or isinstance(default, bool) or callable(default) or option.show_default is False):
        words += f" [{default:g}]" if isinstance(default, float) else f" [{default}]"
    return ", ".join((*option.opts, *option.secondary_opts)) + value, words


def argument_name(argument: Any) -> str:
    """How usage writes an argument."""
    name = argument.metavar or argument.name.upper() + ("..." if argument.nargs == -1 else "")
    return name if argument.required or argument.metavar else f"[{name}]"


def _shared(option: Any) -> bool:
    """Whether `qsf --help` explains the option."""
    own = SHARED.get(option.opts[0])
    return own is not None and option.help == own.help


def _groups(options: Iterable[Any], ctx: Any, room: int) -> Iterator[str]:
    """Options under the titles of their groups: a title holds for the options that follow."""
    groups: dict[str, list[Row]] = {}
    title = "Options"
    for option in options:
        title = option.rich_help_panel or title
        groups.setdefault(title, []).append(_option(option, ctx))
    for title, rows in groups.items():
        yield from ("", f"{title}:")
        yield from _rows(rows, room)


def _options(command: Any) -> list[Any]:
    return [p for p in command.params if p.param_type_name == "option" and not p.hidden]


class Command(TyperCommand):
    """A command with its help."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Usage, what the command does, its arguments, its options in groups, the names of shared ones."""
        room = width()
        named: list[Any] = [p for p in self.params if p.param_type_name == "argument"]
        arguments = [(argument_name(p), p.help or "") for p in named]
        usage = " ".join([ctx.command_path, "[OPTIONS]", *(name for name, _ in arguments)])
        lines = [*paragraphs(f"Usage: {usage}", room), *paragraphs(" ".join((self.help or "").split()), room)]
        lines += ["", *_rows(arguments, room)] if arguments else []
        options = _options(self)
        lines += _groups((o for o in options if not _shared(o)), ctx, room)
        names = [o.opts[0] for o in options if _shared(o)]
        if names:
            lines += ["", *paragraphs(f"Also {', '.join([*names, '--help'])}: see `qsf --help`.", room)]
        formatter.write("\n".join(lines) + "\n")


class CommandGroup(TyperGroup):
    """`qsf` with its help, and the commands of installed packages beside its own."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names of commands, its own first."""
        return [*super().list_commands(ctx), *entries(COMMANDS)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of a name; None where there is none. PluginError where two have it, or it cannot be imported."""
        own = super().get_command(ctx, cmd_name)
        if own is None:
            return installed_command(cmd_name, Command)
        check_clash(cmd_name)
        return own

    def _help_of(self, ctx: Any, name: str) -> str:
        try:
            return self.get_command(ctx, name).help or ""
        except PluginError as error:
            return f"Cannot be used: {error}"

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Usage, the commands, and the options that many of them share."""
        room = width()
        commands = [(name, self._help_of(ctx, name)) for name in self.list_commands(ctx)]
        shared = [(name, one.help or "") for name, one in SHARED.items() if one is not None]
        lines = ["Usage: qsf [OPTIONS] COMMAND ...", *paragraphs(self.help or "", room), "", "Commands:"]
        lines += [folded(f"  {name:<13}{words}", room, " " * 15) for name, words in commands]
        lines += ["", "Options of many commands:", *_rows(shared, room)]
        lines += _groups((o for o in _options(self) if not _shared(o)), ctx, room)
        formatter.write("\n".join(lines) + "\n")


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
