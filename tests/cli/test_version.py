"""`qsf --version` and `qsf --help`."""

from __future__ import annotations

from importlib.metadata import version

from typer.testing import CliRunner

from qsframework.cli.main import app


def test_the_version_is_the_packages() -> None:
    result = CliRunner().invoke(app, ["--version"])
    assert result.exit_code == 0
    assert result.stdout == f"qsframework {version('qsframework')}\n"


def test_help_says_what_the_program_is_for_and_names_the_commands() -> None:
    result = CliRunner().invoke(app, ["--help"])
    assert result.exit_code == 0
    for words in ("Elastostatic calibration", "--version", "identify", "diagnose"):
        assert words in result.stdout
