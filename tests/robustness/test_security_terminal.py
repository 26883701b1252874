"""Texts of a file that would steer a terminal: refused, and shown harmlessly where an error speaks of them."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from qsframework.cli.app import main
from qsframework.cli.printing import print_folded, print_line, print_table
from qsframework.errors import InputError
from qsframework.experiment import Experiment, example, load_experiment, read_plan, write_plan
from qsframework.experiment.columns import table_text, unquoted
from qsframework.fits import read_fit

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


@pytest.mark.parametrize("text", STEERING)
def test_a_name_that_is_printed_shows_none(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A file that came into a watched folder, or the cells of a table."""
    print_folded(f"a{text}b.txt: not taken")
    print_line("file", f"a{text}b")
    print_table(["name"], [[f"a{text}b"]])
    said = capsys.readouterr().out
    assert all(c.isprintable() or c == "\n" for c in said), repr(said)


def test_what_a_spreadsheet_would_run_is_quoted_and_read_back() -> None:
    names = [
        "=cmd|' /C calc'!A0",
        "+1+1",
        "-A1",
        "@SUM(1)",
        "p01",
        "-1.5e3",
        "'=x",
        "it's",
        "a;=1+1",
        "\t=1",
        "'a",
        "=a'b",
    ]
    text = table_text(["pose", "z"], [[name, "-1"] for name in names])
    cells = [row[0] for row in csv.reader(text.splitlines())][1:]
    begun = [part for cell in cells for part in re.split("[;\t]", cell) if part[:1] in tuple("=+-@")]
    assert begun == ["-1.5e3"]
    assert [unquoted(cell) for cell in cells] == names


@pytest.mark.parametrize("text", ["=cmd|' /C calc'!A0", "+A1", "-A1", "@SUM(A1)"])
def test_poses_that_a_spreadsheet_would_run_stay_poses(m900ib: Experiment, tmp_path: Path, text: str) -> None:
    plan = read_plan(example("m900ib") / "table5.csv", m900ib)
    write_plan(tmp_path / "plan.csv", replace(plan, pose=(text, *plan.pose[1:])), m900ib)
    lines = (tmp_path / "plan.csv").read_text().splitlines()
    assert not [line for line in lines if line.startswith(("=", "+", "-", "@"))]
    assert read_plan(tmp_path / "plan.csv", m900ib).pose[0] == text
