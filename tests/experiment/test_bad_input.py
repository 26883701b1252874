"""Wrong files: each gives one clear message that says where and what is allowed, and nothing is written."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from qsframework.errors import InputError
from qsframework.experiment import example, load_experiment, read_plan, read_readings

Edit = Callable[[list[str]], list[str]]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of both examples that a test may spoil."""
    shutil.copytree(example("r2000ic"), tmp_path / "r2000ic")
    shutil.copytree(example("m900ib"), tmp_path / "m900ib")
    return tmp_path


def replace(old: str, new: str, count: int = 1) -> Edit:
    def edit(lines: list[str]) -> list[str]:
        text = "\n".join(lines)
        assert old in text, f"the test looks for {old!r}, which the file does not hold"
        return text.replace(old, new, count).split("\n")

    return edit


def cell(row: int, column: int, value: str) -> Edit:
    """Change a cell; row 0 is the header (line 3 of the file)."""

    def edit(lines: list[str]) -> list[str]:
        parts = lines[2 + row].split(",")
        parts[column] = value
        return [*lines[: 2 + row], ",".join(parts), *lines[3 + row :]]

    return edit


def append(line: str) -> Edit:
    return lambda lines: [*lines, line]


HEADER = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N,marker,dx_mm,dy_mm,dz_mm"
FIRST = "1,-59.991000025,-16.692999998,-28.9300000228,3.78799999624,-62.929999984,144.919000017"
# columns: 0 pose, 1-6 angles, 7-9 force, 10 marker, 11-13 displacement
READINGS: dict[str, tuple[Edit, tuple[str, ...]]] = {
    "no unit on an angle": (
        replace("q3_deg", "q3"),
        ("line 3", "column q3", "does not say its unit", "q3_deg, q3_rad"),
    ),
    "no unit on a force": (replace("fx_N", "fx"), ("column fx", "fx_N, fx_kN")),
    "no unit on a displacement": (replace("dy_mm", "dy"), ("column dy", "dy_mm, dy_m")),
    "unknown unit": (replace("dx_mm", "dx_parsnips"), ("column dx_parsnips", "'parsnips' is no unit", "dx_mm")),
    "unit of another kind": (replace("dx_mm", "dx_deg"), ("column dx_deg", "is no unit of this kind", "dx_mm")),
    "a mass for a force": (replace("fx_N", "fx_kg"), ("column fx_kg", "fx_N, fx_kN", "1 kg weighs 9.80665 N")),
    "percent for an angle": (replace("q1_deg", "q1_percent"), ("column q1_percent", "q1_deg")),
    "millimetres called metres": (replace("dx_mm", "dx_m"), ("column dx_m", "line 4", "in mm?", "call it dx_mm")),
    "degrees called radians": (replace("q1_deg", "q1_rad"), ("column q1_rad", "looks like degrees", "q1_deg")),
    "angle outside its limits": (cell(1, 2, "150"), ("line 4", "q2_deg", "joint_2", "150 deg", "-60 to 76 deg")),
    "NaN angle": (cell(2, 1, "nan"), ("line 5", "q1_deg", "'nan'", "a finite number")),
    "NaN displacement": (cell(2, 12, "NaN"), ("line 5", "dy_mm", "a finite number")),
    "infinite force": (cell(3, 7, "inf"), ("line 6", "fx_N", "'inf'")),
    "text for a number": (cell(1, 13, "0,1x".replace(",", ".")), ("line 4", "dz_mm", "'0.1x'", "a finite number")),
    "empty cell": (cell(4, 8, ""), ("line 7", "fy_N", "''")),
    "empty pose": (cell(1, 0, ""), ("line 4", "column pose", "is empty")),
    "too few columns": (append("44,1,2,3"), ("line 47", "wrong number of columns", "found 4", "allowed: 14")),
    "too many columns": (append("44" + ",1" * 14), ("line 47", "found 15")),
    "decimal comma": (cell(1, 1, "-59,99"), ("line 4", "found 15", "allowed: 14")),
    "unknown column": (replace("marker", "reflector"), ("unknown column", "column reflector", "column marker")),
    "capital columns": (
        replace("q1_deg,q2_deg", "Q1_DEG,Q2_DEG"),
        ("column Q1_DEG: unknown columns Q1_DEG, Q2_DEG; allowed: pose, q1", "Did you mean 'q1_deg', 'q2_deg'?"),
    ),
    "a column unlike all": (replace("fx_N", "operator"), ("unknown column; allowed", "drive_state, use\n")),
    "misspelt column": (replace("fx_N", "fxx_N"), ("unknown column", "Did you mean 'fx_N'?", "column fx")),
    "missing column": (lambda lines: [",".join(x.split(",")[:-1]) for x in lines[2:]], ("column dz", "is missing")),
    "a column twice": (replace("dy_mm", "dx_mm"), ("column dx", "stands here twice")),
    "a seventh joint": (replace("q6_deg", "q6_deg,q7_deg"), ("column q7_deg", "The robot has 6 joints")),
    "the same reading twice": (lambda lines: [*lines, lines[3]], ("line 47", "stands here twice", "first in line 4")),
    "one pose, two loads": (
        append(f"{FIRST},1,2,3,tool,0,0,0"),
        ("line 47", "pose '1'", "another load than in line 4"),
    ),
    "unknown marker": (cell(1, 10, "tol"), ("line 4", "column marker", "'tol'", "Did you mean 'tool'?")),
    "another robot": (replace("fanuc_r2000ic", "fanuc_m900ib"), ("another robot", "fanuc_m900ib", "fanuc_r2000ic")),
    "no rows": (lambda lines: lines[:3], ("line 3", "a header and no rows")),
    "empty file": (lambda lines: [], ("is empty",)),
    "comments only": (lambda lines: lines[:2], ("is empty",)),
    "a NUL byte": (replace("tool", "to\0ol"), ("NUL",)),
    "an open quote": (append('"44,' + "1," * 13), ("line 47",)),
    "no load anywhere": (
        lambda lines: [
            *lines[:3],
            *(",".join([*x.split(",")[:7], "0,0,0", *x.split(",")[10:]]) for x in lines[3:] if x),
        ],
        ("every force is zero",),
    ),
    "sigma zero": (
        lambda lines: [*lines[:2], lines[2] + ",sigma_mm", *(x + ",0" for x in lines[3:] if x)],
        ("line 4", "sigma_mm", "must be positive"),
    ),
    "use is a word": (
        lambda lines: [*lines[:2], lines[2] + ",use", *(x + ",perhaps" for x in lines[3:] if x)],
        ("line 4", "column use", "'perhaps'", "1 or 0"),
    ),
    "approach is not a side": (
        lambda lines: [*lines[:2], lines[2] + ",approach", *(x + ",2" for x in lines[3:] if x)],
        ("column approach", "-1 or 1"),
    ),
    "repeat is a fraction": (
        lambda lines: [*lines[:2], lines[2] + ",repeat", *(x + ",1.5" for x in lines[3:] if x)],
        ("column repeat", "1, 2, 3"),
    ),
    "repeat is huge": (
        lambda lines: [*lines[:2], lines[2] + ",repeat", *(x + ",1e300" for x in lines[3:] if x)],
        ("line 4", "column repeat", "'1e300'", "up to 100000"),
    ),
    "one measurement, two times": (
        lambda lines: [lines[2] + ",time_s", lines[3] + ",1", lines[3] + ",2"],
        ("line 3", "times", "than in line 2"),
    ),
    "semicolons": (lambda lines: [x.replace(",", ";") for x in lines], ("line 3", "separated by ';'", "a comma")),
    "tabs": (lambda lines: [x.replace(",", "\t") for x in lines], ("line 3", "separated by a tab")),
    "a pose that looks like a comment": (cell(1, 0, "#1"), ("line 4", "starts with #", "column use")),
    "an endless cell": (cell(1, 0, "1" * 200_000), ("line 4", "cannot be split into columns")),
    "digits in groups": (cell(1, 11, "-0_686"), ("line 4", "dx_mm", "'-0_686'", "a finite number")),
    "a position": (cell(1, 11, "1500"), ("line 4", "dx_mm", "1.5 m", "is it a position?")),
    "a column without a name": (replace("dz_mm", "dz_mm,"), ("line 3", "column 15, which has no name")),
}


@pytest.mark.parametrize("case", READINGS)
def test_readings(case: str, folder: Path) -> None:
    edit, words = READINGS[case]
    file = folder / "r2000ic" / "readings.csv"
    file.write_text("\n".join(edit(file.read_text().splitlines())))
    experiment = load_experiment(folder / "r2000ic" / "experiment.yaml")
    with pytest.raises(InputError) as caught:
        read_readings(file, experiment)
    for word in ("readings.csv", *words):
        assert word in str(caught.value), str(caught.value)


def test_all_problems_of_a_file_are_told_together(folder: Path) -> None:
    file = folder / "r2000ic" / "readings.csv"
    lines = file.read_text().splitlines()
    for edit in (cell(1, 2, "150"), cell(2, 1, "nan"), cell(3, 10, "nose"), append("44,1")):
        lines = edit(lines)
    file.write_text("\n".join(lines))
    with pytest.raises(InputError) as caught:
        read_readings(file, load_experiment(folder / "r2000ic" / "experiment.yaml"))
    assert len(caught.value.problems) == 4


EXPERIMENTS: dict[str, tuple[Edit, tuple[str, ...]]] = {
    "unknown robot": (
        replace("fanuc_m900ib", "fanuc_m900"),
        ("line 1", "'fanuc_m900'", "Did you mean 'fanuc_m900ib'?"),
    ),
    "unknown key": (replace("constraints:", "constrants:"), ("'constrants'", "Did you mean 'constraints'?")),
    "no unit": (replace("point_mm", "point"), ("line 2", "'point'", "point_mm, point_m")),
    "wrong unit": (replace("sigma_mm", "sigma_N"), ("'sigma_N'", "sigma_mm")),
    "no robot": (replace("robot: ", "# "), ("'robot' is missing",)),
    "no markers": (lambda lines: [x for x in lines if "xyz_mm" not in x], ("markers",)),
    "two numbers for a point": (replace("[150, 0, 200]", "[150, 0]"), ("load needs point_mm: [x, y, z]",)),
    "a word for a number": (replace("[150, 0, 200]", "[150, 0, high]"), ("line 2", "'high'", "finite number")),
    "NaN in a point": (replace("[150, 0, 200]", "[150, 0, .nan]"), ("line 2", "nan")),
    "noise zero": (replace("0.03", "0"), ("the noise must be positive", "noise: estimate")),
    "noise negative": (replace("0.03", "-0.1"), ("the noise must be positive",)),
    "a tab": (replace("  m1:", "\tm1:"), ("line 4", "a tab")),
    "a key twice": (append("robot: fanuc_r2000ic"), ("'robot' stands here twice",)),
    "an alias": (append("fit: &a [joint_compliance]"), ("anchors, aliases and tags are not allowed",)),
    "a tag": (append("data: !!python/name:os.system x"), ("tags are not allowed",)),
    "not YAML": (append("fit: [joint"), ("is not YAML",)),
    "a list": (lambda lines: ["- 1"], ("`key: value`",)),
    "empty": (lambda lines: [], ("empty",)),
    "unknown effect": (append("effects: [{effect: tracker_skale}]"), ("unknown effect 'tracker_skale'", "allowed")),
    "effect of another robot": (
        append("effects: [{effect: offaxis_compliance, joint: joint_7, axis: x}]"),
        ("no joint 'joint_7'", "joint_1"),
    ),
    "effect with a wrong axis": (
        append("effects: [{effect: offaxis_compliance, joint: joint_3, axis: w}]"),
        ("unknown axis", "x, y, z"),
    ),
    "an effect twice": (
        append("effects: [{effect: joint_compliance, joint: joint_3}]"),
        ("listed twice: joint_compliance[joint_3]",),
    ),
    "unknown parameter": (append("fit: [joint_complianse]"), ("fit: no parameter", "Did you mean 'joint_compliance'?")),
    "unknown link": (replace("m1: {", "m1: {link: elbow, "), ("marker 'm1'", "no link 'elbow'", "link_3")),
    "unknown constraint point": (replace("of: wrist_centre", "of: wrist"), ("'wrist'", "Did you mean 'wrist_centre'?")),
    "limits of an unknown joint": (
        replace("of: wrist_centre", "joint_limits_deg: {J2: [0, 1]}"),
        ("joint_limits: no joint 'J2'",),
    ),
    "limits the wrong way": (
        replace("of: wrist_centre", "joint_limits_deg: {joint_2: [9, 1]}"),
        ("joint_2 must be [lower, upper]",),
    ),
    "both numbers": (
        replace(", poses: 3", ", poses: 3, poses_min: 2"),
        ("poses_min must be 1 or more, and goes without",),
    ),
    "no cost": (replace(", poses: 3", ", poses: 3, cost: 0"), ("a cost is a positive number",)),
    "values outside": (
        replace("z_min_m: 0.5", "z_min_m: 0.5, joint_values_deg: {joint_2: [200]}"),
        ("joint_values of joint_2",),
    ),
    "a load twice": (replace("weight_and_side_pull", "weight"), ("load 'weight' stands here twice",)),
    "a zero load": (replace("fz_N: -4000", "fz_N: 0"), ("load 'weight' is zero", "fx_N")),
    "noise without unit": (replace("sigma_mm", "sigma"), ("line 7", "'sigma'", "sigma_mm, sigma_m")),
    "noise is a guess": (
        replace("{sigma_mm: 0.03}", "guess"),
        ("line 7", "noise: must be a mapping, or the word 'estimate'", "'guess'"),
    ),
    "a number of base 60": (replace("[150, 0, 200]", "[1:30, 0, 200]"), ("line 2", "point_mm[0]", "'1:30'")),
    "no load": (replace("{point_mm: [150, 0, 200]}", ""), ("line 2", "load: must be a mapping", "point_mm, mass_kg")),
    "two load points": (
        replace("{point_mm: [150, 0, 200]}", "{point_mm: [150, 0, 200], mass_kg: 9, centre_mm: [0, 0, 1]}"),
        ("line 2", "either the point or the mass"),
    ),
    "a mass beside loads": (
        replace("{point_mm: [150, 0, 200]}", "{mass_kg: 9, centre_mm: [0, 0, 1]}"),
        ("line 2", "not both"),
    ),
    "half a load": (replace("poses: 3", "poses: 2.5"), ("line 10", "poses: must be a whole number", "2.5")),
    "nothing to fit": (append("fit: []"), ("line 12", "fit", "leave it out")),
    "two unknown parameters": (
        append("fit:\n- joint_complianse\n- joint_compliance[joint_7]"),
        ("line 13", "line 14", "'joint_complianse'"),
    ),
    "effects by name": (append("effects: [joint_compliance]"), ("line 12", "effects.0: must be a mapping")),
    "limits out of reach": (
        replace("of: wrist_centre", "joint_limits_deg: {joint_2: [100, 120]}"),
        ("joint_2", "-64 to 90 deg"),
    ),
    "a word for a limit": (
        replace("of: wrist_centre", "joint_limits_deg: {joint_2: [a, 5]}"),
        ("joint_limits_deg.joint_2[0]", "'a'"),
    ),
    "a negative distance": (replace("min_m: 1.0", "min_m: -1.0"), ("axis1_distance_min", "is not negative", "-1.0")),
    "a load without unit": (replace("fz_N: -4000", "fz: -4000"), ("'fz'", "fz_N, fz_kN")),
}


@pytest.mark.parametrize("case", EXPERIMENTS)
def test_experiments(case: str, folder: Path) -> None:
    edit, words = EXPERIMENTS[case]
    file = folder / "m900ib" / "experiment.yaml"
    file.write_text("\n".join(edit(file.read_text().splitlines())) + "\n")
    with pytest.raises(InputError) as caught:
        load_experiment(file)
    for word in ("experiment.yaml", *words):
        assert word in str(caught.value), str(caught.value)


PLANS: dict[str, tuple[Edit, tuple[str, ...]]] = {
    "pose twice": (replace("row02", "row01"), ("pose 'row01' stands here twice", "line 6")),
    "outside the limits": (replace("row01,0,90", "row01,0,99"), ("joint_2 is outside its limits", "99 deg")),
    "repeats zero": (replace("weight,1", "weight,0"), ("column repeats", "1, 2, 3")),
    "a pose twice under two names": (
        lambda lines: [*lines[:15], lines[14].replace("row11", "row13")],
        ("line 16", "'row13'", "of line 15", "repeats"),
    ),
    "nothing pulls": (lambda lines: [x.replace("-4000", "0") for x in lines], ("every force is zero",)),
    "no end of repeats": (replace("weight,1", "weight,1e12"), ("column repeats", "'1e12'", "up to 100000")),
    "no force": (replace("fz_N", "f_N"), ("column f_N", "Did you mean 'fz_N'?")),
}


@pytest.mark.parametrize("case", PLANS)
def test_plans(case: str, folder: Path) -> None:
    edit, words = PLANS[case]
    file = folder / "m900ib" / "table5.csv"
    file.write_text("\n".join(edit(file.read_text().splitlines())) + "\n")
    with pytest.raises(InputError) as caught:
        read_plan(file, load_experiment(folder / "m900ib" / "experiment.yaml"))
    for word in ("table5.csv", *words):
        assert word in str(caught.value), str(caught.value)


def test_missing_files_and_folders(folder: Path, m900ib, r2000ic) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match="no such file"):
        load_experiment(folder / "nothing.yaml")
    with pytest.raises(InputError, match="no such file"):
        read_readings(folder / "nothing.csv", r2000ic)
    with pytest.raises(InputError, match="is not a file"):
        read_readings(folder, r2000ic)
    with pytest.raises(InputError, match=r"no files of readings to read.*add `data:`"):
        read_readings([], r2000ic)
    binary = folder / "photo.csv"
    binary.write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(InputError, match="not UTF-8"):
        read_readings(binary, r2000ic)


def test_bad_input_ends_with_code_2_and_writes_nothing(folder: Path) -> None:
    file = folder / "r2000ic" / "readings.csv"
    file.write_text(file.read_text().replace("dx_mm", "dx_m"))
    before = sorted(folder.rglob("*"))
    command = [
        "identify",
        str(folder / "r2000ic" / "experiment.yaml"),
        "--json",
        str(folder / "fit.json"),
        "--report",
        str(folder / "r.html"),
    ]
    run = subprocess.run([sys.executable, "-m", "qsframework", *command], capture_output=True, text=True)
    assert run.returncode == 2
    assert "Traceback" not in run.stderr
    assert run.stderr.startswith("error: ")
    assert re.search(r"lines 4 to \d+", run.stderr)  # what is wrong in every row is said once
    assert run.stdout == ""
    assert sorted(folder.rglob("*")) == before


TABLE = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N,marker,dx_mm,dy_mm,dz_mm\n"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda q2, q3: (q2, q3 - q2), "with q3 + q2 in place of q3 (the axes are coupled)"),
        (lambda q2, q3: (q2, q3 + q2), "with q3 - q2 in place of q3 (the axes are coupled)"),
        (lambda q2, q3: (q2, -q3), "with the sign of q3 reversed"),
        (lambda q2, q3: (q2 - 90, q3), "with q2 + 90 deg (another zero)"),
    ],
)
def test_angles_outside_the_limits_are_told_once_with_the_convention_that_fits(
    change: Callable[[float, float], tuple[float, float]], words: str, folder: Path
) -> None:
    angles = [(80, 20), (-55, -120), (42, -32), (10, -90), (60, 25), (-50, -5)]
    rows = [
        f"p{k},0,{q2},{q3},0,0,0,0,0,-1000,m1,0.1,0.1,-1" for k, (q2, q3) in enumerate(change(*pair) for pair in angles)
    ]
    experiment = load_experiment(folder / "m900ib" / "experiment.yaml")
    marker = experiment.markers[0].name
    path = folder / "own.csv"
    path.write_text(TABLE + "\n".join(rows).replace("m1", marker) + "\n")
    with pytest.raises(InputError) as error:
        read_readings(path, experiment)
    (problem,) = error.value.problems
    assert "outside its limits" in problem.message
    assert words in str(problem)


def test_decimal_commas_between_commas_are_told_once(folder: Path) -> None:
    experiment = load_experiment(folder / "m900ib" / "experiment.yaml")
    path = folder / "own.csv"
    path.write_text(TABLE + "p1,0,5,20,1,-10,5,0,0,0,0,0,-1000,m1,0,1,0,1,-1,2\n" * 9)
    with pytest.raises(InputError) as error:
        read_readings(path, experiment)
    (problem,) = error.value.problems
    assert "wrong number of columns in 9 of 9 rows" in str(problem)
    assert "decimal commas" in str(problem)


def test_no_number_in_a_reading_says_to_leave_the_cell_empty(folder: Path) -> None:
    experiment = load_experiment(folder / "m900ib" / "experiment.yaml")
    path = folder / "own.csv"
    path.write_text(TABLE + f"p1,0,5,-20,0,10,0,0,0,-1000,{experiment.markers[0].name},NaN,0.1,-1\n")
    with pytest.raises(InputError, match="Leave the cell empty, or put 0 in the column use"):
        read_readings(path, experiment)
