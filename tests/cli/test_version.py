"""What `qsf` says of itself, and of what was nearly typed right."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import pytest
from typer.testing import CliRunner

from qsframework.cli.main import app
from qsframework.errors import InputError
from qsframework.experiment import example


def test_the_version_is_the_packages() -> None:
    result = CliRunner().invoke(app, ["--version"])
    assert result.exit_code == 0
    assert result.stdout == f"qsframework {version('qsframework')}\n"


def test_help_says_what_the_program_is_for_and_names_the_commands() -> None:
    result = CliRunner().invoke(app, ["--help"])
    assert result.exit_code == 0
    for words in ("Elastostatic calibration", "--version", "identify", "diagnose"):
        assert words in result.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["check", "gp18"], "unknown robot 'gp18'; allowed: abb_irb2400"),
        (["check", "fanuc_m900"], "Did you mean 'fanuc_m900ib'?"),
        (["check", "experimnt.yaml"], "experimnt.yaml: no such file. Did you mean 'experiment.yaml'?"),
        (["design", "experiment.yaml", "--criterion", "d"], "unknown criterion 'd'"),
        (["design", "experiment.yaml", "--criterion", "d"], "Did you mean 'D'?"),
    ],
)
def test_what_is_nearly_right_is_suggested(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "experiment.yaml").write_text((example("m900ib") / "experiment.yaml").read_text())
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, arguments)
    assert isinstance(result.exception, InputError)
    assert said in str(result.exception)
