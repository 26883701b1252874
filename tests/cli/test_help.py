"""Help fits a screen: at most 45 lines at 80 and at 100 columns, common options explained once."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app, every_command
from qsframework.cli.options import SHARED

EVERY = every_command()


def help_of(*words: str, columns: int) -> list[str]:
    """The lines of a help."""
    result = CliRunner(env={"COLUMNS": str(columns)}).invoke(app, [*words, "--help"])
    assert result.exit_code == 0
    return result.stdout.splitlines()


@pytest.mark.parametrize("columns", [80, 100])
@pytest.mark.parametrize("command", [[], *([name] for name in EVERY)], ids=" ".join)
def test_fits(command: list[str], columns: int) -> None:
    lines = help_of(*command, columns=columns)
    assert len(lines) <= 45
    assert max(map(len, lines)) <= columns
    assert not any(line.strip() in ("Options:", "Arguments:") and not lines[i + 1] for i, line in enumerate(lines[:-1]))


@pytest.mark.parametrize("command", EVERY)
def test_names_every_option(command: str) -> None:
    text = "\n".join(help_of(command, columns=100))
    assert all(p.opts[0] in text for p in EVERY[command].params if p.param_type_name == "option")


def test_common_options_are_explained_once() -> None:
    whole = "\n".join(help_of(columns=100))
    assert all(f"  {name}" in whole for name in SHARED)
    design = "\n".join(help_of("design", columns=100))
    assert "Also --jobs, --dask, --seed, --json, --report, --trust, --help: see `qsf --help`." in design
    assert [t in design for t in ("\nPlan:\n", "\nCriterion:\n", "\nSearch:\n", "\nOutput:\n")] == [True] * 4


def test_choices_show_as_choices() -> None:
    """An option that has a few values shows them in the place of its value."""
    shown = CliRunner().invoke(app, ["design", "--help"]).output
    assert "--criterion I|D|A|O3|Ds|L" in shown
    assert "--solver columns|cvxpy" in shown
