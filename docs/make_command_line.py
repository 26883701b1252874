"""Write docs/command-line.md from the commands themselves: python docs/make_command_line.py"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer.main

PAGE = Path(__file__).parent / "command-line.md"
HEAD = """# The command line

Made from the commands by `python docs/make_command_line.py`. Exit codes: 0 done; 2 wrong input, with file, row and
column; another number where the work itself failed, with its reason.
"""


def page() -> str:
    """The page, one section per command."""
    from qsframework.cli.main import app

    group: Any = typer.main.get_command(app)
    return HEAD + "".join(_section(name, command) for name, command in group.commands.items())


def _section(name: str, command: Any) -> str:
    asked = [p for p in command.params if p.param_type_name == "argument"]
    usage = " ".join(["qsf", name, *(_argument(p) for p in asked), "[OPTIONS]"])
    rows = [(f"`{_argument(p)}`", _words(p)) for p in asked]
    rows += [
        (", ".join(f"`{o}`" for o in (*p.opts, *p.secondary_opts)), _words(p))
        for p in command.params
        if p not in asked and p.name != "help" and not p.hidden
    ]
    table = "".join(f"| {left} | {right} |\n" for left, right in rows)
    doc = " ".join((command.help or "").split())
    return f"\n## `qsf {name}`\n\n{_escaped(doc)}\n\n```\n{usage}\n```\n\n| | |\n|---|---|\n{table}"


def _argument(parameter: Any) -> str:
    text = parameter.name.upper() + ("..." if parameter.nargs == -1 else "")
    return text if parameter.required else f"[{text}]"


def _words(parameter: Any) -> str:
    """The help, and the default where there is one to tell."""
    words = [" ".join((getattr(parameter, "help", None) or "").split())]
    value = parameter.default
    if value not in (None, False, "", (), []) and not callable(value) and not parameter.required:
        words.append(f"Default: {value}.")
    if getattr(parameter, "multiple", False):
        words.append("May be given more than once.")
    return _escaped(" ".join(w for w in words if w))


def _escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;").replace("[", "\\[")


if __name__ == "__main__":
    PAGE.write_text(page())
