"""Which share of the readings had been taken at each state: what drift and sudden changes go by."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.experiment import Experiment, make_plan, make_rows, read_readings, simulate, write_readings
from qsframework.experiment.readings import joined
from qsframework.fits import identify
from qsframework.hypotheses.catalogue.causes import find_causes
from qsframework.plugin import Array, Conditions, Poses, build_effects
from qsframework.plugin.facts import came_from
from tests.identify.arm import random_poses

COUNT = 8


def table(m900ib: Experiment, path: Path, time: Array | None = None) -> Path:
    """A file of displacements, with the times of the loaded states or without."""
    at = random_poses(m900ib, 1, COUNT)
    readings = simulate(m900ib, make_plan(at, ["pull"] * COUNT), seed=1).readings
    write_readings(path, readings, m900ib)
    if time is not None:
        lines = path.read_text().splitlines()
        first = next(i for i, line in enumerate(lines) if line.startswith("pose"))
        markers = len(m900ib.markers)
        lines[first] += ",time_s"
        for i, line in enumerate(lines[first + 1 :]):
            lines[first + 1 + i] = f"{line},{time[i // markers]:g}"
        path.write_text("\n".join(lines) + "\n")
    return path


def test_by_the_rows_where_no_time_is_recorded(m900ib: Experiment, tmp_path: Path) -> None:
    states = read_readings(table(m900ib, tmp_path / "r.csv"), m900ib).states
    order = states.poses.loaded.order
    assert order is not None
    assert np.allclose(order[states.loaded], (np.arange(COUNT) + 0.5) / COUNT)
    assert np.allclose(order[~states.loaded], np.arange(COUNT) / COUNT)


def test_in_the_pace_of_time_s_alone(m900ib: Experiment, tmp_path: Path) -> None:
    """No time_unloaded_s: `tracker_drift` cannot be tested, a drift by order is, and knows of the break."""
    time = np.array([0.0, 60, 120, 180, 7200, 7260, 7320, 7380])
    readings = read_readings(table(m900ib, tmp_path / "r.csv", time), m900ib)
    order = readings.states.poses.loaded.order
    assert order is not None
    after = order[readings.states.loaded]
    assert np.allclose(np.diff(after), np.diff(time) / 7380.0 * (1 - 1 / COUNT))
    known, untested = find_causes(m900ib, m900ib.fit_names(), make_rows(readings))
    assert "reading_drift" in {c.name for c in known}
    assert {u.name: u.needs for u in untested}["tracker_drift"] == ("time_unloaded",)


def test_one_file_is_read_after_the_other(m900ib: Experiment, tmp_path: Path) -> None:
    parts = [read_readings(table(m900ib, tmp_path / f"{k}.csv"), m900ib) for k in range(2)]
    order = joined(parts).states.poses.loaded.order
    assert order is not None
    assert order[: 2 * COUNT].max() < 0.5 <= order[2 * COUNT :].min()


def test_each_joint_came_by_the_way_from_the_pose_before(m900ib: Experiment, tmp_path: Path) -> None:
    """Both states of a pose came the same way; the clock decides which pose was before, where it is recorded."""
    time = np.array([300.0, 60, 120, 180, 240, 0, 360, 420])
    for given, visited in ((None, np.arange(COUNT)), (time, np.argsort(time))):
        states = read_readings(table(m900ib, tmp_path / "r.csv", given), m900ib).states
        came, q = states.poses.loaded.came, states.poses.q
        assert came is not None
        for state in (states.loaded, ~states.loaded):
            here, stood = came[state][visited], q[state][visited]
            assert np.abs(np.diff(stood, axis=0)).max() > 0.1
            assert np.array_equal(here, np.diff(stood, axis=0, prepend=stood[:1]))


def test_an_arm_that_stays_stands_as_it_came() -> None:
    q = np.array([[0.0, 1.0], [0.5, 1.0], [0.5, 1.0], [0.2, 0.7]])
    shuffled = np.array([2, 0, 3, 1])
    want = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 0.0], [-0.3, -0.3]])
    assert np.allclose(came_from(q[shuffled], np.array([0.2, 0.0, 0.3, 0.1])), want[shuffled])


def test_a_drift_is_found_where_references_are_old(m900ib: Experiment) -> None:
    """One unloaded reading at the start, loads all day: what drifts meanwhile is found by order alone."""
    (drift,) = build_effects({"effect": "reading_drift"}, m900ib.robot.facts)
    own = drift.parameters(m900ib.robot.facts)
    wide = m900ib.with_(effects=(drift,), parameters=own, fit=("joint_compliance", "reading_drift"))
    at = random_poses(m900ib, 1, 30)
    at = replace(at, unloaded=Conditions(order=np.zeros(30)), loaded=Conditions(order=np.linspace(0.0, 1.0, 30)))
    model = wide.model()
    x = model.nominal
    true = np.array([2e-4, -1e-4, 3e-4])
    x[model.index([p.name for p in own])] = true
    blank = simulate(wide, make_plan(at, ["pull"] * 30), seed=2).readings
    moved = model.predict(at, x) + 3e-5 * np.random.default_rng(2).standard_normal((30, 3, 3))
    order = np.concatenate([np.linspace(0.0, 1.0, 30), np.zeros(30)])
    known = Conditions(order=order)
    readings = blank.with_values(moved.reshape(-1, 3))
    readings = readings.with_poses(replace(readings.poses, unloaded=known, loaded=known))
    found = {e.name: e for e in identify(wide, readings).estimates}
    for p, value in zip(own, true, strict=True):
        assert abs(found[p.name].value - value) < 4.0 * found[p.name].sd
        assert found[p.name].sd < 0.2 * abs(value)


@pytest.mark.parametrize("linear", [True, False])
def test_what_warms_up_between_two_states_grows_between_them(m900ib: Experiment, linear: bool) -> None:
    """At 206fc34 the tangent model took the loaded state's temperature for both."""
    (heat,) = build_effects({"effect": "thermal_expansion"}, m900ib.robot.facts)
    model = m900ib.with_(effects=(heat,), parameters=heat.parameters(m900ib.robot.facts)).model()
    x = model.nominal
    x[model.index(["thermal_expansion"])] = 1.2e-5
    at = random_poses(m900ib, 1, 5)
    states = [Conditions(temperature=np.full(5, 293.15 + t)) for t in (0.0, 10.0)]
    warm = replace(at, unloaded=states[0], loaded=states[1])
    level = replace(at, unloaded=states[0], loaded=states[0])

    def moved(poses: Poses) -> Array:
        return model.predict(poses, x, linear)

    grown = np.linalg.norm(moved(warm) - moved(level), axis=2)
    reach = np.linalg.norm(model.positions(level), axis=2)
    assert (grown > 1.2e-5 * 10.0 * 0.7 * reach).all()
    assert (grown < 1.2e-5 * 10.0 * 1.3 * reach).all()
