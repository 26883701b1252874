"""Write docs/command-line.md from the commands themselves: python docs/make_command_line.py"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from qsframework.cli.help import argument_name

PAGE = Path(__file__).parent / "command-line.md"
HEAD = """# The command line

Made from the commands by `python docs/make_command_line.py`. Exit codes: 0 done; 2 wrong input, with file, row and
column; another number where the work itself failed, with its reason.
"""


SHARED = 2
"""From so many commands on an option or argument with the same words stands once, at the top, if it says so in most of
the commands that have it."""


def page() -> str:
    """The page: what many commands share, then one section per command."""
    from qsframework.cli.app import every_command

    commands = every_command()
    counts = Counter(row for command in commands.values() for row in (*_asked(command), *map(_row, _options(command))))
    named = Counter[str]()
    for (left, _), count in counts.items():
        named[left] += count
    shared = [row for row, count in counts.items() if count >= SHARED and 2 * count > named[row[0]]]
    head = HEAD + f"\n## What several commands share\n\n{_list(shared)}"
    return head + "".join(_section(name, command, shared) for name, command in commands.items())


def _options(command: Any) -> list[Any]:
    return [p for p in command.params if p.param_type_name != "argument" and p.name != "help" and not p.hidden]


def _row(option: Any) -> tuple[str, str]:
    names = ", ".join(f"`{o}`" for o in (*option.opts, *option.secondary_opts))
    return f"{names} {option.metavar}" if option.metavar else names, _words(option)


def _list(rows: list[tuple[str, str]]) -> str:
    return "".join(f"- {left}: {right}\n" for left, right in rows)


def _section(name: str, command: Any, shared: list[tuple[str, str]]) -> str:
    asked, rows = _asked(command), [_row(p) for p in _options(command)]
    usage = f"`{' '.join(['qsf', name, *(left.strip('`') for left, _ in asked)])}`: " if asked else ""
    own = [row for row in (*asked, *rows) if row not in shared]
    listed = f"\n{_list(own)}" if own else ""
    also = ", ".join(left.partition("` ")[0].rstrip("`") + "`" for left, right in rows if (left, right) in shared)
    more = f"\nAlso {also}.\n" if also else ""
    doc = " ".join((command.help or "").split())
    return f"\n## `qsf {name}`\n\n{usage}{_escaped(doc)}\n{listed}{more}"


def _asked(command: Any) -> list[tuple[str, str]]:
    """The arguments with their words."""
    return [(f"`{argument_name(p)}`", _words(p)) for p in command.params if p.param_type_name == "argument"]


def _words(parameter: Any) -> str:
    """The help, and the default where there is one to tell."""
    words = [" ".join((getattr(parameter, "help", None) or "").split())]
    value = parameter.default
    if value not in (None, False, "", (), []) and not callable(value) and not parameter.required:
        words.append(f"Default: {value}.")
    if getattr(parameter, "multiple", False) and "(repeat" not in words[0]:
        words.append("Repeatable.")
    return _escaped(" ".join(w for w in words if w))


def _escaped(text: str) -> str:
    return text.replace("<", "&lt;").replace("[", "\\[")


if __name__ == "__main__":
    PAGE.write_text(page())
