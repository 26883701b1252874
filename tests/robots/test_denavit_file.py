"""`qsf new --dh`: a robot from a table of Denavit and Hartenberg stands where the product of its matrices says."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from qsf_onboarding.dh_table import read_denavit
from qsf_onboarding.folder import Arm, new as new_robot
from qsf_onboarding.run import run_new
from qsframework.errors import InputError
from qsframework.robot import load_robot
from qsframework.robot.reference import reference_flange

HEAD = "joint,a_mm,alpha_deg,d_mm,theta_deg,min_deg,max_deg\n"
TABLE = """a1,350,-90,815,0,-185,185
a2,1200,0,0,-90,-130,20
a3,145,-90,0.5,3,-100,144
a4,0,90,1545,180,-350,350
a5,0,-90,0,90,-120,120
a6,0,180,170,12.5,-350,350
"""


def product(rows: np.ndarray, q: np.ndarray, modified: bool) -> np.ndarray:
    """The flange (4, 4) as textbooks write the matrix of a row: a mm, alpha deg, d mm, theta deg; q rad."""
    out = np.eye(4)
    for (a, alpha, d, theta), angle in zip(rows, q, strict=True):
        a, d = 1e-3 * a, 1e-3 * d
        ca, sa = np.cos(np.deg2rad(alpha)), np.sin(np.deg2rad(alpha))
        ct, st = np.cos(np.deg2rad(theta) + angle), np.sin(np.deg2rad(theta) + angle)
        if modified:
            step = [[ct, -st, 0, a], [st * ca, ct * ca, -sa, -sa * d], [st * sa, ct * sa, ca, ca * d], [0, 0, 0, 1]]
        else:
            step = [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]]
        out = out @ np.array(step)
    return out


def table(folder: Path, text: str) -> Path:
    (folder / "arm.csv").write_text(text)
    return folder / "arm.csv"


@pytest.mark.parametrize("modified", [False, True])
@pytest.mark.parametrize("kind", ["made", "random", "quarter turns"])
def test_the_arm_stands_where_its_table_says(modified: bool, kind: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    rows = np.array([[float(v) for v in line.split(",")[1:5]] for line in TABLE.splitlines()])
    if kind == "random":
        rows = rng.uniform(-180, 180, (7, 4))
    elif kind == "quarter turns":
        rows = rng.integers(-2, 3, (6, 4)) * 90.0
    lines = "".join(",".join(repr(float(v)) for v in row) + "\n" for row in rows)
    file = table(tmp_path, "a_mm,alpha_deg,d_mm,theta_deg\n" + lines)
    new_robot("arm", dh=file, folder=tmp_path / "arm", arm=Arm(modified=modified))
    robot = load_robot(tmp_path / "arm")
    q = rng.uniform(-np.pi, np.pi, (50, len(rows)))
    wanted = np.stack([product(rows, angles, modified) for angles in q])
    np.testing.assert_allclose(reference_flange(robot, q), wanted, rtol=0, atol=1e-12)


def test_limits_names_and_other_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_new("arm", None, table(tmp_path, "# of the manual\n" + HEAD + TABLE), tmp_path / "arm", Arm())
    robot = load_robot(tmp_path / "arm")
    assert robot.facts.joints == ("a1", "a2", "a3", "a4", "a5", "a6")
    assert np.rad2deg(robot.controller.lower[1]) == pytest.approx(-130)
    assert "masses: the table has none for link_1" in capsys.readouterr().out
    metres = TABLE.replace("350,-90,815,0", "0.35,-1.5707963267948966,0.815,0", 1).splitlines()[0]
    file = table(tmp_path, f"joint;a_m;alpha_rad;d_m;theta_deg;min_deg;max_deg\n{metres.replace(',', ';')}\n")
    other = read_denavit(file).joints[1].origin.xyz
    np.testing.assert_allclose(other, read_denavit(table(tmp_path, HEAD + TABLE)).joints[1].origin.xyz, atol=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            HEAD,
            HEAD.replace("d_mm,", ""),
            r"line 1: column missing: d_mm; found joint,.*allowed: a_mm, alpha_deg",
        ),
        ("alpha_deg", "alpha", r"line 1, column alpha: 'alpha' does not end in a unit of angle"),
        ("alpha_deg", "alpha_mm", r"line 1, column alpha_mm: 'alpha_mm' does not end in a unit of angle"),
        ("d_mm", "d_kg", r"column d_kg: 'd_kg' does not end in a unit of length"),
        ("min_deg", "d_m", "a second column for d"),
        (",min_deg", ",colour", "unknown column"),
        ("a2,1200", "a2,12O0", r"line 3, column a_mm: a_mm must be a number, with a decimal point; found '12O0'"),
        ("a2,1200", "a2,nan", "line 3, column a_mm"),
        ("a2,1200", "a2,1e9", "up to 100 m"),
        ("a2,1200", "a2,", "line 3, column a_mm"),
        ("a2,1200", "a1,1200", "'a1' stands here a second time"),
        ("-130,20", "-130", "line 3: has not as many cells"),
        ("-130,20", "20,-130", "lower limit must be below"),
        ("-130,20", "-130,", "line 3, column max: has one limit of two"),
        (TABLE, "", "holds no joint"),
        (TABLE, TABLE * 9, "54 joints"),
    ],
)
def test_wrong_tables(old: str, new: str, words: str, tmp_path: Path) -> None:
    text = HEAD + TABLE
    assert old in text
    with pytest.raises(InputError, match=words):
        new_robot("arm", dh=table(tmp_path, text.replace(old, new, 1)), folder=tmp_path / "arm")
    assert not (tmp_path / "arm").exists()


def test_one_description_is_asked_for(tmp_path: Path) -> None:
    file = table(tmp_path, HEAD + TABLE)
    for urdf, given, arm, words in (
        (None, None, Arm(), "give a URDF or a table"),
        (file, file, Arm(), "give a URDF or a table"),
        (file, None, Arm(modified=True), "can be a modified one"),
        (None, tmp_path / "none.csv", Arm(), "no such file"),
    ):
        with pytest.raises(InputError, match=re.escape(words)):
            new_robot("arm", urdf, given, arm=arm)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("a_mm", "a_m", "column a_m: a_m must be a number"),
        (
            "alpha_deg",
            "alpha_rad",
            "the numbers of alpha_rad look like deg; found up to 180 rad. Name the column alpha_deg",
        ),
        ("min_deg,max_deg", "min_rad,max_rad", "the numbers of max_rad look like deg"),
    ],
)
def test_numbers_of_another_unit_than_the_header_are_told(old: str, new: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read_denavit(table(tmp_path, HEAD.replace(old, new) + TABLE))
    assert words in str(error.value)


def test_metres_and_radians_under_millimetres_and_degrees_are_told(tmp_path: Path) -> None:
    rows = "1,0.35,-1.5708,0.815,0\n2,1.2,0,0,-1.5708\n3,-0.145,1.5708,0,0\n"
    with pytest.raises(InputError) as error:
        read_denavit(table(tmp_path, "joint,a_mm,alpha_deg,d_mm,theta_deg\n" + rows))
    assert "the numbers of a_mm look like m; found up to 1.2 mm. Name the column a_m" in str(error.value)
    assert "the numbers of alpha_deg look like rad; found up to 1.5708 deg. Name the column alpha_rad" in str(
        error.value
    )
