"""What `qsf` says of itself, and of what was nearly typed right."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.cli.kinds import kind, sorted_out, the_fit
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


def test_h_help_version_and_completion() -> None:
    run = CliRunner().invoke
    whole = run(app, ["-h"])
    assert whole.exit_code == 0
    assert run(app, ["--help"]).stdout == whole.stdout
    assert "--install-completion" in whole.stdout
    assert "--criterion" in run(app, ["design", "-h"]).stdout

    asked = {"_QSF_COMPLETE": "complete_bash", "COMP_WORDS": "qsf ident", "COMP_CWORD": "1"}
    assert run(app, prog_name="qsf", env=asked).stdout.split() == ["identify"]


def test_files_are_known_by_what_stands_in_them(tmp_path: Path) -> None:
    for name, text in (
        ("a", '{"covariance": []}'),
        ("b", "# robot: ur10\npose,q1_deg,marker,dx_mm\n"),
        ("c", "# robot: ur10\npose,q1_deg,fx_N\n"),
        ("d", "target,q1_deg\n"),
        ("e", "# a campaign\nload: {mass_kg: 3}\nrobot: ur10\n"),
        ("f", "anything else"),
    ):
        (tmp_path / name).write_text(text)
    files = [tmp_path / name for name in "abcdef"]
    assert [kind(file) for file in files] == ["fit", "readings", "plan", "targets", "experiment", ""]
    assert kind(tmp_path / "missing.csv") == ""
    given = sorted_out([files[2], files[1], files[0], files[1]], ("fit", "plan"), "readings")
    assert given == {"fit": [files[0]], "plan": [files[2]], "readings": [files[1], files[1]]}
    with pytest.raises(InputError, match="none of the files is a fit"):
        the_fit(sorted_out(files[1:], ("fit",), "readings"), "validate")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["check", "gp18"], "unknown robot 'gp18'; allowed: abb_irb2400"),
        (["check", "fanuc_m900"], "Did you mean 'fanuc_m900ib'?"),
        (["check", "experimnt.yaml"], "experimnt.yaml: no such file. Did you mean 'experiment.yaml'?"),
        (["export", "experiment.yaml", "--to", "csv", "-o", "p.csv"], "an experiment and a plan are needed"),
        (["export", "experiment.yaml", "t.csv", "--to", "krl", "-o", "p"], "t.csv: these are targets, no plan"),
        (["design", "experiment.yaml", "--criterion", "d"], "Did you mean 'D'?"),
    ],
)
def test_what_is_nearly_right_is_suggested(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "experiment.yaml").write_text((example("m900ib") / "experiment.yaml").read_text())
    (tmp_path / "t.csv").write_text((example("m900ib") / "targets.csv").read_text())
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, arguments)
    assert isinstance(result.exception, InputError)
    assert said in str(result.exception)
