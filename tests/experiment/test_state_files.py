"""State readings: what is written is read back, real files are read, wrong ones say what to do."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from qsframework.errors import InputError
from qsframework.experiment import (
    Experiment,
    StateReadings,
    is_states,
    load_experiment,
    read_readings,
    read_states,
    write_states,
)
from qsframework.plugin import Conditions, Poses

SAME_FOLDER = settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
def ur10(tmp_path: Path) -> Experiment:
    file = tmp_path / "experiment.yaml"
    file.write_text("robot: ur10\nload: {point_mm: [0, 0, 0]}\nmarkers:\n  tmac: {xyz_mm: [0, 0, 80]}\n"
                    "noise: {sigma_mm: 0.05}\n")  # fmt: skip
    return load_experiment(file)


def random_states(experiment: Experiment, count: int, seed: int, loads: bool) -> StateReadings:
    """Every pose once unloaded and, with loads, under two loads; where the arm puts its markers."""
    rng = np.random.default_rng(seed)
    controller, markers = experiment.robot.controller, len(experiment.markers)
    each = 3 if loads else 1
    pendant = np.repeat(rng.uniform(controller.lower, controller.upper, (count, len(controller.lower))), each, axis=0)
    loaded = np.tile([False, True, True][:each], count)
    wrench = np.where(loaded[:, None], rng.normal(0.0, 1e3, (count * each, 6)), 0.0)
    total = count * each
    recorded = Conditions(rng.uniform(0, 1e4, total), rng.uniform(280, 310, total), rng.choice([-1.0, 1.0], total))
    conditions = recorded if loads else Conditions()
    poses = Poses(pendant, controller.to_joints(pendant), wrench, conditions, conditions)
    rows, sigma = total * markers, np.full(total * markers, np.nan)
    sigma[:: 2 if loads else rows + 1] = rng.uniform(1e-6, 1e-4)
    position = experiment.model().positions(poses).reshape(rows, 3) @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + 3.0
    return StateReadings(
        poses, loaded, tuple(f'p{i // each}, "x"' for i in range(total)),
        tuple(("", "A", "B")[i % each] for i in range(total)), tuple("s" if loads else "" for _ in range(total)),
        np.ones(total, dtype=np.intp), np.ones(total, dtype=np.intp), np.repeat(np.arange(total), markers),
        np.tile(np.arange(markers), total), position, sigma, rng.random(rows) < 0.8, np.arange(3, 3 + rows),
        tuple(f"servo {i}" for i in range(rows)) if loads else None, None,
    )  # fmt: skip


@SAME_FOLDER
@given(st.integers(1, 5), st.integers(0, 10**6), st.booleans())
def test_what_is_written_is_read_back(m900ib: Experiment, tmp_path: Path, count: int, seed: int, loads: bool) -> None:
    before = random_states(m900ib, count, seed, loads)
    write_states(tmp_path / "states.csv", before, m900ib)
    after = read_states(tmp_path / "states.csv", m900ib)
    assert ("fx_N" in (tmp_path / "states.csv").read_text()) == loads
    for name in ("pose", "load_id", "series", "drive_state"):
        assert getattr(after, name) == getattr(before, name), name
    for name in ("repeat", "cycle", "measurement", "marker", "use", "rows", "loaded"):
        assert np.array_equal(getattr(after, name), getattr(before, name)), name
    for name in ("position", "sigma"):
        assert np.allclose(getattr(after, name), getattr(before, name), rtol=1e-9, atol=1e-15, equal_nan=True), name
    for name in ("pendant", "q", "wrench"):
        assert np.allclose(getattr(after.poses, name), getattr(before.poses, name), rtol=1e-9, atol=1e-15), name
    for field in dataclasses.fields(Conditions):
        values = [getattr(c, field.name) for c in (after.poses.unloaded, after.poses.loaded, before.poses.loaded)]
        assert values[2] is None or (np.allclose(values[0], values[2]) and np.allclose(values[1], values[2]))
        assert (values[0] is None) == (values[1] is None) == (values[2] is None)


@pytest.mark.parametrize(("series", "count"), [("b", 1495), ("d", 632)])
def test_the_real_positions_of_the_ur10_are_read(ur10: Experiment, root: Path, series: str, count: int) -> None:
    """In the tracker's frame; what Procrustes leaves onto the rigid arm is small, so poses and positions agree."""
    found = read_states(root / "examples" / "ur10" / f"series_{series}.csv", ur10)
    assert len(found.position) == len(found.poses) == count
    assert not found.loaded.any()
    assert set(found.series) == {series.upper()}
    assert found.poses.unloaded.temperature is not None
    assert 288 < found.poses.unloaded.temperature.min() < 303
    there = ur10.model().positions(found.poses)[found.measurement, found.marker]
    a, b = there - there.mean(axis=0), found.position - found.position.mean(axis=0)
    U, _, V = np.linalg.svd(a.T @ b)
    turned = a @ U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    assert np.sqrt(np.mean((b - turned) ** 2)) < 0.02


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
    found = read_states(write(tmp_path, list(ROWS)), ur10)
    assert found.loaded.tolist() == [False, True, True, False]
    assert found.load_id == ("", "A", "B", "")
    assert found.poses.wrench[:, 2].tolist() == [0.0, -50.0, -90.0, 0.0]
    assert found.series == ("",) * 4


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
    "other angles": (lambda rows: [*rows, "2,0,1,0,0,0,0,0,0,0,tmac,unloaded,0,0,0,,1"],
                     ("line 7", "stands here twice", "other angles")),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_row_is_named(ur10: Experiment, tmp_path: Path, case: str) -> None:
    edit, words = WRONG[case]
    with pytest.raises(InputError) as caught:
        read_states(write(tmp_path, edit(list(ROWS))), ur10)
    for word in words:
        assert word in str(caught.value), str(caught.value)


def test_all_problems_are_told_at_once(ur10: Experiment, tmp_path: Path) -> None:
    rows = cell(0, 11, "heavy")(cell(1, 9, "")(cell(3, 12, "inf")(list(ROWS))))
    with pytest.raises(InputError) as caught:
        read_states(write(tmp_path, rows), ur10)
    assert [p.line for p in caught.value.problems] == [6, 3, 4]


def test_a_wrong_header_is_named(ur10: Experiment, tmp_path: Path) -> None:
    short = [",".join(r.split(",")[:7] + r.split(",")[10:]) for r in ROWS]
    header = ",".join(HEADER.split(",")[:7] + HEADER.split(",")[10:])
    with pytest.raises(InputError, match=r"a loaded state needs its force.*fx_N, fy_N, fz_N"):
        read_states(write(tmp_path, short, header), ur10)
    assert len(read_states(write(tmp_path, [short[0], short[3]], header), ur10).position) == 2
    with pytest.raises(InputError, match=r"does not say its unit"):
        read_states(write(tmp_path, list(ROWS), HEADER.replace("y_mm", "y")), ur10)
    with pytest.raises(InputError, match=r"column state"):
        read_states(write(tmp_path, list(ROWS), HEADER.replace("state", "stage")), ur10)


def test_a_wrong_unit_is_found(ur10: Experiment, tmp_path: Path) -> None:
    """Millimetres called metres and metres called millimetres, whatever the tracker's frame."""
    with pytest.raises(InputError, match=r"call it x_mm"):
        read_states(write(tmp_path, list(ROWS), HEADER.replace("x_mm,y_mm,z_mm", "x_m,y_m,z_m")), ur10)
    angles = ("1,0,-90,0,0,0,0", "2,0,0,0,0,0,0")
    places = ("0,-0.256,1.480", "-1.264,-0.256,0.048")
    tiny = [f"{q},,,,tmac,unloaded,{xyz},,1" for q, xyz in zip(angles, places, strict=True)]
    with pytest.raises(InputError, match=r"do not fit the poses; is their unit right"):
        read_states(write(tmp_path, tiny), ur10)


@pytest.mark.parametrize("value", ["", "nan", "lost beam", "1e9"])
def test_a_masked_row_may_hold_anything(ur10: Experiment, tmp_path: Path, value: str) -> None:
    rows = cell(2, 16, "0")(cell(2, 13, value)(list(ROWS)))
    found = read_states(write(tmp_path, rows), ur10)
    assert found.use.tolist() == [True, True, False, True]
    with pytest.raises(InputError, match="y_mm"):
        read_states(write(tmp_path, cell(2, 13, value)(list(ROWS))), ur10)


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
    assert is_states(states)
    assert len(read_states(states, experiment).use) == 1
    loaded = tmp_path / "loaded.csv"
    loaded.write_text(head + "fx_N,fy_N,fz_N,marker,state,x_mm,y_mm,z_mm\nA,0,0,0,0,0,0,0,0,-9,tool,loaded,1,2,3\n")
    displaced = tmp_path / "displaced.csv"
    displaced.write_text(head + "fx_N,fy_N,fz_N,marker,dx_mm,dy_mm,dz_mm\nA,0,0,0,0,0,0,0,0,-9,tool,1,2,3\n")
    assert not is_states(displaced)
    for name, read in ((loaded, read_states), (displaced, read_readings)):
        with pytest.raises(InputError, match="does not say where the load acts"):
            read(name, experiment)
    file.write_text(UNLOADED + "loads:\n  - {name: weight, fz_N: -4000}\n")
    with pytest.raises(InputError, match="say where with `load`"):
        load_experiment(file)
