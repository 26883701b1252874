"""Slips in a table are named with their row, what stands there and what was meant; right tables are left alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clean_tables import loaded, write_clean
from independent import Campaign, Mount, Setting, add_mounts, forces, noisy, write_campaign
from independent_arm import ARMS
from independent_effects import SHOWN, hide

from qsframework.cli.check import check_files
from qsframework.diagnoses import diagnose
from qsframework.experiment import Experiment, LoadCase, Readings
from qsframework.plugin import Array
from qsframework.report.result_json import diagnosis_json
from qsframework.screening import Mistake, adopted, find_mistakes


def found(experiment: Experiment, readings: Readings) -> tuple[Mistake, ...]:
    return adopted(find_mistakes(experiment, readings, gross=False))


def turned(readings: Readings, experiment: Experiment, pose: str, k: int, angle: float) -> Readings:
    """Angle k of a pose in the table other by `angle` rad."""
    pendant = readings.poses.pendant.copy()
    pendant[[p == pose for p in readings.states.pose], k] += angle
    q = experiment.robot.controller.to_joints(pendant)
    return readings.with_poses(replace(readings.poses, pendant=pendant, q=q))


def pulled(readings: Readings, pose: str, wrench: Array) -> Readings:
    """Times so much of the force of a pose, of each axis."""
    force = readings.poses.wrench.copy()
    force[[p == pose for p in readings.states.pose]] *= wrench
    return readings.with_poses(replace(readings.poses, wrench=force))


def lines_of(readings: Readings, pose: str) -> tuple[int, ...]:
    return tuple(int(n) for n, p in zip(readings.line, readings.pose, strict=True) if p == pose)


@pytest.mark.parametrize("kind", ["displacements", "positions"])
def test_right_tables_are_left_alone(folder: Path, kind: str) -> None:
    assert found(*loaded(folder / kind)) == ()


@pytest.mark.parametrize(
    ("stem", "factor"), [("q2", np.pi / 180.0), ("dz", 0.1), ("fy", 1.0 / 9.80665), ("fy", 1e-3), ("dx", 1.0 / 25.4)]
)
def test_units_of_a_column(folder: Path, stem: str, factor: float) -> None:
    experiment, right = loaded(folder / "displacements")
    axis = "xyz".find(stem[-1])
    if stem[0] == "q":
        pendant = right.poses.pendant * np.where(np.arange(6) == 1, factor, 1.0)
        q = experiment.robot.controller.to_joints(pendant)
        wrong = right.with_poses(replace(right.poses, pendant=pendant, q=q))
    elif stem[0] == "f":
        wrench = right.poses.wrench * np.where(np.arange(6) == axis, factor, 1.0)
        wrong = right.with_poses(replace(right.poses, wrench=wrench))
    else:
        wrong = right.with_values(right.value * np.where(np.arange(3) == axis, factor, 1.0))
    (one,) = found(experiment, wrong)
    assert (one.name, one.column) == ("column_unit", stem)
    assert np.isclose(one.value * factor, 1.0)
    assert np.allclose(one.readings.poses.q, right.poses.q)
    assert one.rms < 1.1 * 3e-5 < one.rms_given


def test_the_angle_of_one_pose(folder: Path) -> None:
    """6 deg off in displacements, where nothing but its torques tells, and 2 deg in positions."""
    for kind, angle in (("displacements", 6.0), ("positions", 2.0)):
        experiment, right = loaded(folder / kind)
        (one,) = found(experiment, turned(right, experiment, "p07", 1, np.deg2rad(angle)))
        assert one.name == "angle[p07/q2]"
        assert one.rows == lines_of(right, "p07")
        assert np.isclose(np.rad2deg(one.found - one.meant), angle, rtol=0.3)
        assert one.rms < 1.1 * 3e-5


@pytest.mark.parametrize(("factor", "said"), [(10.0, "the decimal is shifted"), (-1.0, "reversed"), (0.0, "missing")])
def test_the_force_of_one_pose(folder: Path, factor: float, said: str) -> None:
    experiment, right = loaded(folder / "displacements")
    (one,) = found(experiment, pulled(right, "p08", np.array([1, 1, factor, 1, 1, 1])))
    assert one.name == "force[p08/fz]"
    assert said in one.words
    true = float(right.poses.wrench[right.states.pose.index("p08"), 2])
    assert np.isclose(one.meant, true, rtol=0.05)
    assert np.isclose(one.found, factor * true)


def test_one_cell_and_three_mistakes_at_once(folder: Path) -> None:
    experiment, right = loaded(folder / "displacements")
    value = right.value.copy()
    row = int(np.flatnonzero([p == "p03" for p in right.pose])[1])
    value[row, 2] *= 10.0
    wrong = pulled(turned(right.with_values(value), experiment, "p12", 1, 0.3), "p20", np.full(6, 10.0))
    said = {one.name: one for one in found(experiment, wrong)}
    assert set(said) == {"value[p03/dz]", "angle[p12/q2]", "force[p20]"}
    assert said["value[p03/dz]"].rows == (int(right.line[row]),)
    last = found(experiment, wrong)[-1]
    assert np.allclose(last.readings.value, right.value)


def test_two_poses_and_repeated_readings(folder: Path) -> None:
    experiment, right = loaded(folder / "displacements")
    a, b = (np.flatnonzero([p == name for p in right.pose]) for name in ("p05", "p16"))
    value = right.value.copy()
    value[a], value[b] = right.value[b], right.value[a]
    (one,) = found(experiment, right.with_values(value))
    assert set(one.name.removeprefix("poses_exchanged[").removesuffix("]").split("/")) == {"p05", "p16"}
    assert np.allclose(one.readings.poses.q[np.unique(right.plus[a])], right.poses.q[np.unique(right.plus[b])])
    value = right.value.copy()
    value[a] = right.value[b]
    (one,) = found(experiment, right.with_values(value))
    assert one.name == "repeated_readings[p05]"
    assert not one.readings.use[a].any()
    both = found(experiment, turned(right.with_values(value), experiment, "p16", 1, np.deg2rad(20.0)))
    assert {m.name for m in both} == {"repeated_readings[p05]", "angle[p16/q2]"}


def test_loaded_and_unloaded_and_mirrored_axes(folder: Path) -> None:
    experiment, right = loaded(folder / "positions")
    value = right.value.copy()
    loaded_ = right.states.loaded[right.plus]
    here = np.array([p == "p09" for p in right.pose])
    value[here & loaded_], value[here & ~loaded_] = right.value[here & ~loaded_], right.value[here & loaded_]
    (one,) = found(experiment, right.with_values(value))
    assert one.name == "states_exchanged[p09]"
    (one,) = found(experiment, right.with_values(right.value * [1.0, -1.0, 1.0]))
    assert one.name == "position_axes"


def test_a_block_of_another_setting(folder: Path) -> None:
    """Six poses in a row under half the force that the table says."""
    experiment, right = loaded(folder / "displacements")
    wrong = right
    for k in range(10, 16):
        wrong = pulled(wrong, f"p{k}", np.full(6, 2.0))
    (one,) = found(experiment, wrong)
    assert one.name.startswith("block")
    assert set(one.rows) == {line for k in range(10, 16) for line in lines_of(right, f"p{k}")}
    assert np.allclose(one.readings.poses.wrench, right.poses.wrench, rtol=0.05, atol=20.0)


def test_displacements_along_the_axes_of_the_tracker(folder: Path) -> None:
    experiment, right = loaded(folder / "displacements")
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    (one,) = found(experiment, right.with_values(right.value @ turn.T))
    assert one.name == "tracker_axes"
    assert np.allclose(one.readings.value, right.value, atol=5e-5)
    assert diagnose(experiment, one.readings, repeats=1).verdict == "none"


def test_an_effect_at_one_pose_is_not_undone(folder: Path) -> None:
    """A push of 0.3 mm at one pose, all markers alike, is no slip: no number in the table leads to it."""
    experiment, right = loaded(folder / "displacements")
    value = right.value.copy()
    value[[p == "p11" for p in right.pose]] += [2e-4, -1.5e-4, 1.7e-4]
    assert found(experiment, right.with_values(value)) == ()


def test_diagnosis_and_check_name_the_mistake_and_no_cause(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One pose's force ten times too large was named as a cause, with p = 4e-189."""
    experiment, right = loaded(folder / "displacements")
    wrong = pulled(right, "p08", np.full(6, 10.0))
    told = diagnose(experiment, wrong, repeats=1)
    assert [f.name for f in told.findings] == ["force[p08]"]
    (one,) = diagnosis_json(told)["mistakes"]
    assert one["applied"]
    assert one["rows"] == list(lines_of(right, "p08"))
    assert np.isclose(one["found"], 10.0 * one["meant"], rtol=1e-6)
    path = folder / "displacements" / "weights.csv"
    text = path.read_text()
    cells = [line.split(",") for line in text.splitlines()]
    fx = cells[0].index("fx_N")
    for row in cells[1:]:
        if row[0] == "p08":
            row[fx : fx + 3] = [str(10.0 * float(c)) for c in row[fx : fx + 3]]
    path.write_text("\n".join(",".join(row) for row in cells) + "\n")
    check_files([folder / "displacements" / "experiment.yaml"], None)
    path.write_text(text)
    assert "force[p08]: rows" in capsys.readouterr().out


def test_a_slip_that_a_cause_hides_is_named_beside_it(tmp_path: Path) -> None:
    """Beside a soft bearing that moves every pose, 4 deg of one pose passed for a gross error without a name."""
    campaign = Campaign(Setting(ARMS["heavy"], 24, 3, "displacements", fit="springs", loads="many"))
    soft, size = hide(campaign, SHOWN["displacements"][0], 100.0, np.random.default_rng(1))
    write_campaign(campaign, noisy(campaign, campaign.clean(soft.make(size))), tmp_path)
    experiment, right = loaded(tmp_path)
    wrong = turned(right, experiment, "p07", 1, np.deg2rad(4.0))
    assert found(experiment, wrong) == ()
    told = diagnose(experiment, wrong, repeats=1)
    assert [f.name for f in told.sure] == ["angle[p07/q2]", soft.name]
    (one,) = adopted(told.conventions)
    assert (one.name, one.rows) == ("angle[p07/q2]", lines_of(right, "p07"))
    assert np.isclose(np.rad2deg(one.found - one.meant), 4.0, rtol=0.3)
    assert not len(told.outliers)
    assert adopted(diagnose(experiment, right, repeats=1).conventions) == ()


def test_a_load_far_over_the_payload(folder: Path) -> None:
    """15 kN passed on a robot that carries 500 kg: springs absorb it, so that it is told and not applied."""
    experiment, right = loaded(folder / "displacements")
    assert experiment.robot.payload is not None
    force = replace(right.poses, wrench=right.poses.wrench * 4.0)
    told = [c for c in find_mistakes(experiment, right.with_poses(force), gross=False) if c.name == "load_payload"]
    assert len(told) == 1
    assert "times what the robot carries" in told[0].words
    assert not told[0].compelling


@pytest.mark.parametrize("first", [16, 23])
def test_what_stands_still_and_moves_is_no_other_unit(first: int, tmp_path: Path) -> None:
    """A base that gives, which no fitted parameter explains: readings a thousand times smaller would fit, as would
    none. In the unit of a logger, the markers that do move tell it."""
    setting = Setting(ARMS["heavy"], 24, 3, fit="springs", loads="many")
    path = write_clean(setting, tmp_path / "given")
    rng = np.random.default_rng(0)
    moved = np.array([0.0, 0.0, -4e-4]) + 3e-5 * rng.standard_normal((24 - first, 1, 3))
    add_mounts(path, Campaign(setting), [Mount("bar", "base", (0, (0.9, 0.0, 0.0)))], moved, first)
    experiment, readings = loaded(path.parent)
    assert not [m for m in found(experiment, readings) if m.name.startswith(("block", "value"))]
    metres = readings.value.copy()
    metres[[int(p[1:]) > first for p in readings.pose]] *= 1e3
    named = found(experiment, readings.with_values(metres))
    assert [m.name.partition("[")[0] for m in named] == ["rows_unit" if first == 16 else "value"]
    assert (first == 23) != ("in um where the others are in mm" in named[0].words)


def test_a_run_under_another_load_of_the_experiment_is_named_with_it(tmp_path: Path) -> None:
    """The last poses say the load of the first one, and hung under another that the experiment lists."""
    setting = Setting(ARMS["heavy"], 24, 3, loads="many")
    pull = forces(setting)[np.arange(24) % 6]
    side = pull[0] + np.array([0.0, 0.7 * np.linalg.norm(pull[0]), 0.0])
    pull[20:] = side
    write_clean(replace(setting, pull=pull), tmp_path)
    experiment, readings = loaded(tmp_path)
    late = np.array([int(p[1:]) > 20 for p in readings.states.pose]) & readings.states.loaded
    said = np.where(late[:, None], readings.poses.wrench[readings.states.loaded][0], readings.poses.wrench)
    load = LoadCase("side", np.concatenate([side, np.zeros(3)]), None)
    spoiled = readings.with_poses(replace(readings.poses, wrench=said))
    (one,) = found(experiment.with_(loads=(load,)), spoiled)
    assert one.name == "block[p21/p24]"
    assert "the force there is that of load side" in one.words
