"""docs/command-line.md is what the commands say now."""

from __future__ import annotations

from pathlib import Path

import make_command_line
import make_pictures

from qsframework.cli.app import every_command


def test_the_page_is_current(root: Path) -> None:
    page = (root / "docs" / "command-line.md").read_text()
    assert make_command_line.page() == page, "run: python docs/make_command_line.py"


def test_it_names_every_command_and_option(root: Path) -> None:
    page = (root / "docs" / "command-line.md").read_text()
    commands = every_command()
    assert len(commands) > 10
    for name, command in commands.items():
        section = page.split(f"## `qsf {name}`\n")[1].split("\n## ")[0]
        for parameter in command.params:
            if parameter.param_type_name == "option" and parameter.name != "help":
                told = not parameter.hidden  # old spellings are read with a note, and stand on no page
                assert all((f"`{o}`" in section) == told for o in parameter.opts)


def test_the_pictures_of_a_terminal_show_every_command() -> None:
    """docs/make_pictures.py runs them at 80 and 100 columns, with files that are there."""
    commands = every_command()
    assert set(commands) == {line.split()[1] for line in make_pictures.SESSION.splitlines()} - {"--help"}
    for path in make_pictures.EXAMPLES.values():
        assert (make_pictures.HERE.parent / path).exists(), path
