"""Texts of a file that would steer a terminal: refused, and shown harmlessly where an error speaks of them."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from qsframework.cli.main import main
from qsframework.errors import InputError
from qsframework.experiment import Experiment, example, load_experiment, read_plan
from qsframework.identify import read_fit

STEERING = ("\x1b[2J", "\x1b]0;owned\x07", "\x9b31m", "\x08", "\x7f", "\r")


@pytest.mark.parametrize("text", STEERING)
def test_names_and_titles_hold_no_control_characters(tmp_path: Path, text: str) -> None:
    whole = yaml.safe_load((example("m900ib") / "experiment.yaml").read_text())
    name = f"a{text}b"
    loads = [whole["loads"][0] | {"name": name}]
    markers = {name: whole["markers"]["m1"]}
    for change in ({"loads": loads}, {"markers": markers}, {"fit": [name]}, {"robot": name}):
        (tmp_path / "experiment.yaml").write_text(yaml.safe_dump(whole | change))
        with pytest.raises(InputError, match="a control character in a text"):
            load_experiment(tmp_path / "experiment.yaml")
    (tmp_path / "fit.json").write_text(yaml.safe_dump({"method": name}))
    with pytest.raises(InputError, match="a control character in a text"):
        read_fit(tmp_path / "fit.json")


@pytest.mark.parametrize("text", STEERING[:-1])
def test_tables_hold_no_control_characters(m900ib: Experiment, tmp_path: Path, text: str) -> None:
    table = (example("m900ib") / "table5.csv").read_text().replace("row01", f"row{text}01")
    (tmp_path / "plan.csv").write_text(table)
    with pytest.raises(InputError, match="line 5: a control character in a table"):
        read_plan(tmp_path / "plan.csv", m900ib)


@pytest.mark.parametrize("text", STEERING)
def test_errors_show_none(
    tmp_path: Path, text: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"a{text}b.yaml"
    path.write_text("robot: fanuc_m900ib\nx: 1\n")
    for words in (
        ["check", str(path)],
        ["check", f"no{text}ne"],
        ["stiffness", f"no{text}ne", "--pose", "1", "--load", "1"],
    ):
        monkeypatch.setattr("sys.argv", ["qsf", *words])
        with pytest.raises(SystemExit):
            main()
        said = capsys.readouterr().err
        assert said
        assert all(c.isprintable() or c == "\n" for c in said), repr(said)
