"""docs/command-line.md is what the commands say now."""

from __future__ import annotations

from pathlib import Path

import make_command_line


def test_the_page_is_current(root: Path) -> None:
    page = (root / "docs" / "command-line.md").read_text()
    assert make_command_line.page() == page, "run: python docs/make_command_line.py"


def test_it_names_every_command_and_option(root: Path) -> None:
    import typer.main

    from qsframework.cli.main import app

    page = (root / "docs" / "command-line.md").read_text()
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert len(commands) > 10
    for name, command in commands.items():
        section = page.split(f"## `qsf {name}`\n")[1].split("\n## ")[0]
        for parameter in command.params:
            if parameter.param_type_name == "option" and parameter.name != "help":
                told = not parameter.hidden  # old spellings are read with a note, and stand on no page
                assert all((f"`{o}`" in section) == told for o in parameter.opts)
