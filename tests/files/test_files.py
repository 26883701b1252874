"""Units, YAML, models and writing."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from hypothesis import given, strategies as st
from typer.testing import CliRunner

from qsframework import units
from qsframework.cli.app import app
from qsframework.errors import InputError, Problem, nearest
from qsframework.experiment import load_experiment
from qsframework.files import (
    FileModel,
    FileRecord,
    Lists,
    Named,
    Unit,
    as_file,
    null,
    read_yaml,
    validate,
    write_text,
)


class Inner(FileModel):
    limits: Annotated[list[float], Unit("rad")]
    note: str = ""


class Sample(FileModel):
    name: str
    lever: Annotated[float, Unit("m")]
    joints: dict[str, Inner] = {}  # noqa: RUF012
    ranges: Annotated[dict[str, list[float]], Unit("rad")] = {}  # noqa: RUF012
    parts: list[Inner] = []  # noqa: RUF012


def load(tmp_path: Path, text: str) -> Sample:
    path = tmp_path / "sample.yaml"
    path.write_text(text)
    return validate(read_yaml(path), Sample)


def test_units_are_converted_at_every_depth(tmp_path: Path) -> None:
    text = "name: a\nlever_mm: 750\njoints:\n  j: {limits_deg: [-180, 180]}\n"
    text += "ranges_deg: {j: [0, 90]}\nparts:\n- {limits_rad: [0, 1]}\n"
    sample = load(tmp_path, text)
    assert sample.lever == 0.75
    assert np.allclose(sample.joints["j"].limits, [-np.pi, np.pi])
    assert np.allclose(sample.ranges["j"], [0, np.pi / 2])
    assert sample.parts[0].limits == [0.0, 1.0]


def test_every_problem_has_its_line(tmp_path: Path) -> None:
    text = "name: 3\nlever: 1\nfoo: 1\njoints:\n  j: {limits_kg: [0, 1]}\n"
    text += "  k: {limits_deg: [a, .inf], nota: x}\nparts:\n- {}\n"
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    lines = [p.line for p in caught.value.problems]
    assert lines == [1, 2, 3, 5, 6, 6, 6, 8]
    assert all(p.file and p.file.endswith("sample.yaml") for p in caught.value.problems)
    assert "Did you mean 'note'?" in str(caught.value)


def test_numbers_as_people_write_them(tmp_path: Path) -> None:
    assert load(tmp_path, "name: a\nlever_m: 1e-3\n").lever == 1e-3
    assert load(tmp_path, "name: a\nlever_m: 2\n").lever == 2.0
    with pytest.raises(InputError, match="must be a finite number"):
        load(tmp_path, "name: a\nlever_m: yes\n")
    with pytest.raises(InputError, match="lever is given twice"):
        load(tmp_path, "name: a\nlever_m: 1\nlever_mm: 1\n")


@pytest.mark.parametrize(("text", "value"), [("010", 10), ("-1.5E1", -15.0), ("+2", 2), (".5", 0.5), ("5.", 5.0)])
def test_numbers_are_decimal(tmp_path: Path, text: str, value: float) -> None:
    assert load(tmp_path, f"name: a\nlever_m: {text}\n").lever == value


@pytest.mark.parametrize("text", ["1:30", "0x1F", "0b1", "1_000", "'5'", "nan", ".nan", "1e999", "true", "2026-01-01"])
def test_what_is_no_decimal_number_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match="line 2: lever_m must be a finite number"):
        load(tmp_path, f"name: a\nlever_m: {text}\n")


def test_a_name_that_looks_like_a_number_stays_loud(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name: must be text; found 5"):
        load(tmp_path, "name: 5\nlever_m: 1\n")
    assert load(tmp_path, "name: infinity\nlever_m: 1\n").name == "infinity"


def test_a_path_that_is_too_long_is_an_input_error() -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_yaml("x" * 5000)


def test_expansion_bombs_and_depth_are_refused(tmp_path: Path) -> None:
    bomb = "a: &a [1]\nb: &b [*a, *a]\nname: *b\n"
    with pytest.raises(InputError, match="aliases"):
        load(tmp_path, bomb)
    with pytest.raises(InputError, match="too deeply"):
        load(tmp_path, "name: " + "[" * 500 + "]" * 500 + "\n")
    with pytest.raises(InputError, match="larger than"):
        load(tmp_path, "# " + "x" * 6_000_000)


FACTORS = {
    "deg": np.pi / 180.0,
    "arcmin": np.pi / 10800.0,
    "mm": 1e-3,
    "kN": 1e3,
    "Nm": 1.0,
    "urad/(N m)": 1e-6,
    "degC": 1.0,
    "N/m": 1.0,
    "percent": 0.01,
}


@given(st.sampled_from(sorted(FACTORS)), st.floats(-1e6, 1e6))
def test_units_are_what_they_say(unit: str, value: float) -> None:
    expected = value * FACTORS[unit] + (273.15 if unit == "degC" else 0.0)
    assert np.isclose(units.to_si(value, unit), expected, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize(
    ("unit", "si", "same"),
    [
        ("deg", "rad", True),
        ("percent", "rad", False),
        ("mm", "m", True),
        ("N", "m", False),
        ("Nm", "N m", True),
        ("degC", "K", True),
        ("urad/(N m)", "rad/(N m)", True),
        ("1/(N m)", "rad/(N m)", False),
        ("percent", "", True),
    ],
)
def test_angles_are_a_dimension(unit: str, si: str, same: bool) -> None:
    assert units.same_dimension(unit, si) is same


@pytest.mark.parametrize("unit", ["", "parsnip", "m m m m)", "(" * 200, "mm" * 100, "__import__('os')", "m**9**9"])
def test_odd_units_do_no_harm(unit: str) -> None:
    assert units.known(unit) in (True, False)


def test_temperatures_have_an_offset() -> None:
    assert np.isclose(units.to_si(20.0, "degC"), 293.15)


def test_writing_is_all_or_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_text(tmp_path / "a" / "f.txt", "old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(InputError, match="No space left on device"):
        write_text(path, "new")
    assert path.read_text() == "old"
    assert list(path.parent.iterdir()) == [path]


def test_problems_read_as_sentences() -> None:
    problem = Problem("is wrong", "f.csv", 3, "q1_deg", found="'x'", allowed="a number", hint="Mend it.")
    assert str(problem) == "f.csv, line 3, column q1_deg: is wrong; found 'x'; allowed: a number. Mend it."
    assert nearest("joint_complance", ["joint_compliance"]) == "Did you mean 'joint_compliance'?"
    assert nearest("zzz", ["joint_compliance"]) is None


@dataclass(frozen=True)
class Part(FileRecord):
    name: str
    size: Annotated[float, Unit("m"), null(math.inf)]


@dataclass(frozen=True, eq=False)
class Whole(FileRecord):
    parts: Annotated[tuple[Part, ...], Named("name")]
    rows: tuple[int, ...]
    matrix: Annotated[np.ndarray, Lists(2)]
    share: float = 0.5


@given(st.floats(-99.0, 99.0).filter(lambda v: v == 0.0 or abs(v) > 1e-300), st.booleans())
def test_a_record_is_read_back_bit_for_bit(tmp_path_factory: pytest.TempPathFactory, value: float, known: bool) -> None:
    one = Whole((Part("a", value if known else math.inf), Part("b.c", -value)), (1, 2), np.array([[value, 1.0]]), value)
    content = as_file(one)
    assert set(content["parts"]["a"]) == {"size_m"}
    path = write_text(tmp_path_factory.mktemp("record") / "w.json", json.dumps(content, allow_nan=False))
    other = validate(read_yaml(path), Whole)
    assert (other.parts, other.rows, repr(other.share)) == (one.parts, one.rows, repr(one.share))
    assert other.matrix.tobytes() == one.matrix.tobytes()


def test_all_problems_of_a_record_with_their_lines(tmp_path: Path) -> None:
    text = "parts:\n  a: {size_m: null}\n  b: {size: 1}\n  c: 3\nrows: [1, 2.5]\n"
    text += "matrix:\n  - [1, 2]\n  - [1]\nshare: null\n"
    with pytest.raises(InputError) as caught:
        validate(read_yaml(write_text(tmp_path / "w.yaml", text)), Whole)
    told = {(p.line, p.message) for p in caught.value.problems}
    assert told == {
        (3, "key 'size' does not say its unit"),
        (4, "parts.c: must be a mapping"),
        (5, "rows.1: must be a whole number"),
        (6, "matrix: rows of different lengths"),
        (9, "share: must be a number"),
    }


def test_a_file_that_is_written_again_keeps_its_mode(tmp_path: Path) -> None:
    out = tmp_path / "robots.json"
    for mode in (0o600, 0o640):
        out.touch()
        out.chmod(mode)
        assert CliRunner().invoke(app, ["robots", "--json", str(out)]).exit_code == 0
        assert out.stat().st_mode & 0o777 == mode
        assert out.stat().st_size > 0


def test_the_same_name_is_never_offered(tmp_path: Path) -> None:
    loop = tmp_path / "loop1.yaml"
    loop.symlink_to(tmp_path / "loop2.yaml")
    (tmp_path / "loop2.yaml").symlink_to(loop)
    with pytest.raises(InputError, match="no such file") as refused:
        load_experiment(loop)
    assert "'loop1.yaml'?" not in str(refused.value)
