"""Where a command would write is tried before it works: a folder, a place in a file, a place without permission."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.cli.commands import distinct_outputs
from qsframework.errors import InputError
from qsframework.experiment import example

M900IB, TABLE5 = str(example("m900ib") / "experiment.yaml"), str(example("m900ib") / "table5.csv")
WORK = ["--pose", "0,20,-20,0,-60,0", "--load", "0,0,-2000"]
COMMANDS = {
    "design": (["design", M900IB, "-n", "8"], ("-o", "--json", "--report"), "qsframework.cli.design.design"),
    "simulate": (["simulate", M900IB, TABLE5], ("-o", "--json", "--report"), "qsframework.experiment.simulate"),
    "protocol": (["protocol", M900IB, TABLE5], ("-o", "--readings"), "qsf_day.run_protocol.make_protocol"),
    "export": (
        ["export", M900IB, TABLE5, "--to", "csv"],
        ("-o", "--json"),
        "qsf_controllers.run.make_programme",
    ),
    "compensate": (
        ["compensate", M900IB, "fit.json", "targets.csv"],
        ("-o", "--json", "--report"),
        "qsframework.cli.compensate.read_fit",
    ),
    "kinematics": (
        ["kinematics", M900IB, "fit.json"],
        ("--urdf", "--dh", "--offsets", "--json"),
        "qsframework.cli.kinematics.read_fit",
    ),
    "stiffness": (
        ["stiffness", "fanuc_m900ib", *WORK],
        ("--json", "--report"),
        "qsframework.cli.stiffness.stiffness_at",
    ),
    "demo": (["demo"], ("--json",), "qsframework.cli.demo.real_readings"),
}
"""Arguments, options that name files, and where the work begins."""
CASES = [(name, option) for name, (_, options, _) in COMMANDS.items() for option in options]
BAD = [
    ("adir", "adir: cannot be written: this is a folder. Name a file"),
    ("afile/x.csv", "afile is a file, not a folder"),
    (".", "this is a folder"),
    ("afile/deeper/x.csv", "afile is a file, not a folder"),
]
"""Of every option the first two; of the first option of every command all."""
FIRST = [(name, options[0]) for name, (_, options, _) in COMMANDS.items()]


def begun(name: str, option: str, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The arguments of a command whose work raises when it begins."""
    arguments, _, begins = COMMANDS[name]

    def work(*_: object, **__: object) -> None:
        raise AssertionError("the work has begun")

    monkeypatch.setattr(begins, work)
    return [*arguments, "-o", "w.csv"] if name == "export" and option != "-o" else arguments


@pytest.mark.parametrize(
    ("name", "option", "target", "words"),
    [(*case, *bad) for case in CASES for bad in (BAD if case in FIRST else BAD[:2])],
)
def test_before_the_work(
    name: str, option: str, target: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "adir").mkdir()
    (tmp_path / "afile").write_text("mine")
    run = CliRunner().invoke(app, [*begun(name, option, monkeypatch), option, target])
    assert isinstance(run.exception, InputError), run.exception
    assert words in str(run.exception)
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["adir", "afile"]
    assert (tmp_path / "afile").read_text() == "mine"


@pytest.mark.parametrize(("name", "option"), CASES)
def test_a_folder_that_can_be_made_is_made(
    name: str, option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    good = CliRunner().invoke(app, [*begun(name, option, monkeypatch), option, "new/deep/x.csv"])
    assert "the work has begun" in str(good.exception)


def test_a_place_without_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Path] = []

    def refuse(path: Path, mode: int) -> bool:
        asked.append(path)
        return False

    monkeypatch.setattr(os, "access", refuse)
    with pytest.raises(InputError, match=rf"x.csv: cannot be written: nothing may be written in {tmp_path}"):
        distinct_outputs([tmp_path / "a" / "x.csv", None], [])
    assert asked == [tmp_path]


def test_only_ordinary_files_and_folders_where_they_belong(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="pipe: cannot be written: this is no ordinary file"):
        distinct_outputs([tmp_path / "pipe"], [])
    distinct_outputs([], [], folder=tmp_path)
    with pytest.raises(InputError, match="this is a folder") as both:
        distinct_outputs([tmp_path, tmp_path / "pipe"], [])
    assert len(both.value.problems) == 2
