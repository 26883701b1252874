"""Files of states: real ones are read, wrong ones say what to do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from qsframework.errors import InputError
from qsframework.experiment import (
    Experiment,
    Readings,
    load_experiment,
    read_readings,
    simulate_rows,
    write_readings,
)


@pytest.fixture
def ur10(tmp_path: Path) -> Experiment:
    file = tmp_path / "experiment.yaml"
    file.write_text(
        "robot: ur10\nload: {point_mm: [0, 0, 0]}\nmarkers:\n  tmac: {xyz_mm: [0, 0, 80]}\nnoise: {sigma_mm: 0.05}\n"
    )
    return load_experiment(file)


@pytest.mark.parametrize(("series", "count"), [("b", 1495), ("d", 632)])
def test_the_real_positions_of_the_ur10_are_read(ur10: Experiment, root: Path, series: str, count: int) -> None:
    """In the tracker's frame; what Procrustes leaves onto the rigid arm is small, so poses and positions agree."""
    found = read_positions(root / "examples" / "ur10" / f"series_{series}.csv", ur10)
    assert len(found) == len(found.states) == count
    assert found.is_position.all()
    assert not found.states.loaded.any()
    assert found.frames == (series.upper(),)
    assert set(found.states.series) == {series.upper()}
    assert found.poses.unloaded.temperature is not None
    assert 288 < found.poses.unloaded.temperature.min() < 303
    there = ur10.model().positions(found.poses)[found.plus, found.marker]
    a, b = there - there.mean(axis=0), found.value - found.value.mean(axis=0)
    U, _, V = np.linalg.svd(a.T @ b)
    turned = a @ U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    assert np.sqrt(np.mean((b - turned) ** 2)) < 0.02


def read_positions(path: Path, experiment: Experiment) -> Readings:
    return read_readings(path, experiment, states="positions")


HEADER = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N,marker,state,x_mm,y_mm,z_mm,load_id,use"
ROWS = (
    "1,0,-90,0,0,0,0,,,,tmac,unloaded,0,-256,1480,,1",
    "1,0,-90,0,0,0,0,0,0,-50,tmac,loaded,0,-256,1479,A,1",
    "1,0,-90,0,0,0,0,0,0,-90,tmac,loaded,0,-256,1478,B,1",
    "2,0,0,0,0,0,0,0,0,0,tmac,unloaded,-1264,-256,48,,1",
)


def write(folder: Path, rows: list[str], header: str = HEADER) -> Path:
    file = folder / "states.csv"
    file.write_text("\n".join(["# robot: ur10", header, *rows]) + "\n")
    return file


def test_several_loads_share_one_unloaded_state(ur10: Experiment, tmp_path: Path) -> None:
    found = read_positions(write(tmp_path, list(ROWS)), ur10)
    assert found.states.loaded.tolist() == [False, True, True, False]
    assert found.states.load_id == ("", "A", "B", "")
    assert found.poses.wrench[:, 2].tolist() == [0.0, -50.0, -90.0, 0.0]
    assert found.states.series == ("",) * 4
    assert found.frames == ("",)


def test_a_simulated_table_keeps_which_load_a_row_has(ur10: Experiment, tmp_path: Path) -> None:
    """Two loads at one pose: what is simulated of their rows is read again."""
    made = simulate_rows(ur10, read_readings(write(tmp_path, list(ROWS[:3])), ur10)).readings
    write_readings(tmp_path / "made.csv", made, ur10)
    again = read_readings(tmp_path / "made.csv", ur10)
    assert [again.states.load_id[s] for s in again.plus] == ["A", "B"]
    assert np.allclose(again.value, made.value)


def test_simulated_rows_share_the_error_of_their_unloaded_reading(ur10: Experiment, tmp_path: Path) -> None:
    """Two loads less one unloaded reading: of equal errors half of the variance is shared."""
    table = read_readings(write(tmp_path, list(ROWS[:3])), ur10)
    drawn = np.stack([simulate_rows(ur10, table, seed=seed).readings.value for seed in range(400)])
    errors = (drawn - drawn.mean(axis=0)) / table.sigma
    assert np.allclose(np.mean(errors**2, axis=0), 1.0, atol=0.3)
    assert np.mean(errors[:, 0] * errors[:, 1]) == pytest.approx(0.5, abs=0.1)


def cell(row: int, column: int, value: str) -> Callable[[list[str]], list[str]]:
    def edit(rows: list[str]) -> list[str]:
        parts = rows[row].split(",")
        parts[column] = value
        return [*rows[:row], ",".join(parts), *rows[row + 1 :]]

    return edit


# columns: 0 pose, 1-6 angles, 7-9 force, 10 marker, 11 state, 12-14 position, 15 load_id, 16 use
WRONG: dict[str, tuple[Callable[[list[str]], list[str]], tuple[str, ...]]] = {
    "unknown state": (cell(0, 11, "unloded"), ("line 3", "column state", "Did you mean 'unloaded'?")),
    "empty state": (cell(0, 11, ""), ("line 3", "column state", "is empty")),
    "loaded without force": (cell(1, 9, ""), ("line 4", "fz_N", "is empty, but the state is loaded")),
    "loaded with no force": (cell(1, 9, "0"), ("line 4", "fx_N", "every force is zero")),
    "unloaded with a force": (cell(3, 8, "70"), ("line 6", "fy_N", "an unloaded state has no force", "found 70")),
    "a force in words": (cell(1, 9, "much"), ("line 4", "fz_N", "'much'", "a finite number")),
    "too far": (cell(0, 12, "2e5"), ("line 3", "x_mm", "no tracker reads this far", "200 m")),
    "not a position": (cell(0, 14, "nan"), ("line 3", "z_mm", "a finite number")),
    "unknown marker": (cell(0, 10, "tmak"), ("line 3", "no such marker", "Did you mean 'tmac'?")),
    "outside the limits": (cell(2, 3, "500"), ("line 5", "joint_3 is outside its limits", "500 deg")),
    "twice": (lambda rows: [*rows, rows[1]], ("line 7", "pose '1', loaded, load 'A'", "first in line 4")),
    "other angles": (
        lambda rows: [*rows, "2,0,1,0,0,0,0,0,0,0,tmac,unloaded,0,0,0,,1"],
        ("line 7", "stands here twice", "other angles"),
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_row_is_named(ur10: Experiment, tmp_path: Path, case: str) -> None:
    edit, words = WRONG[case]
    with pytest.raises(InputError) as caught:
        read_positions(write(tmp_path, edit(list(ROWS))), ur10)
    for word in words:
        assert word in str(caught.value), str(caught.value)


def test_all_problems_are_told_at_once(ur10: Experiment, tmp_path: Path) -> None:
    rows = cell(0, 11, "heavy")(cell(1, 9, "")(cell(3, 12, "inf")(list(ROWS))))
    with pytest.raises(InputError) as caught:
        read_positions(write(tmp_path, rows), ur10)
    assert [p.line for p in caught.value.problems] == [3, 6, 4]


def test_a_wrong_header_is_named(ur10: Experiment, tmp_path: Path) -> None:
    short = [",".join(r.split(",")[:7] + r.split(",")[10:]) for r in ROWS]
    header = ",".join(HEADER.split(",")[:7] + HEADER.split(",")[10:])
    with pytest.raises(InputError, match=r"a loaded state needs its force.*fx_N, fy_N, fz_N"):
        read_positions(write(tmp_path, short, header), ur10)
    assert len(read_positions(write(tmp_path, [short[0], short[3]], header), ur10)) == 2
    with pytest.raises(InputError, match=r"does not say its unit"):
        read_positions(write(tmp_path, list(ROWS), HEADER.replace("y_mm", "y")), ur10)
    with pytest.raises(InputError, match=r"column stage.*Did you mean 'state'"):
        read_positions(write(tmp_path, list(ROWS), HEADER.replace("state", "stage")), ur10)


def test_a_wrong_unit_is_found(ur10: Experiment, tmp_path: Path) -> None:
    """Millimetres called metres and metres called millimetres, whatever the tracker's frame."""
    with pytest.raises(InputError, match=r"call it x_mm"):
        read_positions(write(tmp_path, list(ROWS), HEADER.replace("x_mm,y_mm,z_mm", "x_m,y_m,z_m")), ur10)
    angles = ("1,0,-90,0,0,0,0", "2,0,0,0,0,0,0")
    places = ("0,-0.256,1.480", "-1.264,-0.256,0.048")
    tiny = [f"{q},,,,tmac,unloaded,{xyz},,1" for q, xyz in zip(angles, places, strict=True)]
    with pytest.raises(InputError, match=r"do not fit the poses; is their unit right"):
        read_positions(write(tmp_path, tiny), ur10)


@pytest.mark.parametrize("value", ["", "nan", "lost beam", "1e9"])
def test_a_masked_row_may_hold_anything(ur10: Experiment, tmp_path: Path, value: str) -> None:
    rows = cell(2, 16, "0")(cell(2, 13, value)(list(ROWS)))
    found = read_positions(write(tmp_path, rows), ur10)
    assert found.use.tolist() == [True, True, False, True]
    used = write(tmp_path, cell(2, 13, value)(list(ROWS)))
    if value == "":  # an axis that was not measured; the others count
        assert np.isfinite(read_positions(used, ur10).value[2]).tolist() == [True, False, True]
        return
    with pytest.raises(InputError, match="y_mm"):
        read_positions(used, ur10)


UNLOADED = """robot: fanuc_m900ib
markers: {tool: {xyz_mm: [150, 0, 200]}}
noise: estimate
"""


def test_an_experiment_without_a_load_reads_unloaded_states_only(tmp_path: Path) -> None:
    file = tmp_path / "experiment.yaml"
    file.write_text(UNLOADED)
    experiment = load_experiment(file)
    head = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,"
    states = tmp_path / "states.csv"
    states.write_text(head + "marker,state,x_mm,y_mm,z_mm\nA,0,0,0,0,0,0,tool,unloaded,1,2,3\n")
    assert len(read_positions(states, experiment).use) == 1
    loaded = tmp_path / "loaded.csv"
    loaded.write_text(head + "fx_N,fy_N,fz_N,marker,state,x_mm,y_mm,z_mm\nA,0,0,0,0,0,0,0,0,-9,tool,loaded,1,2,3\n")
    displaced = tmp_path / "displaced.csv"
    displaced.write_text(head + "fx_N,fy_N,fz_N,marker,dx_mm,dy_mm,dz_mm\nA,0,0,0,0,0,0,0,0,-9,tool,1,2,3\n")
    for name, read in ((loaded, read_positions), (displaced, read_readings)):
        with pytest.raises(InputError, match="does not say where the load acts"):
            read(name, experiment)
    file.write_text(UNLOADED + "loads:\n  - {name: weight, fz_N: -4000}\n")
    with pytest.raises(InputError, match="say where with `load`"):
        load_experiment(file)
