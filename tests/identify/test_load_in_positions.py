"""The load's own error in fits of loaded positions, alone and with displacements: columns and words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.elastostatics.so3 import exponential
from qsframework.estimation import FitOptions
from qsframework.experiment import (
    Experiment,
    Frame,
    LoadUncertainty,
    Readings,
    load_experiment,
    make_plan,
    observation_model,
    simulate,
)
from qsframework.experiment.readings import joined
from qsframework.identify import Fit, identify
from qsframework.identify.load_error import load_columns
from qsframework.plugin import Array, Poses
from qsframework.report import fit_table
from tests.identify.arm import arm_text, position_readings

LINEAR = FitOptions(linear=True, keep_all=True)
"""The campaigns are made and fitted by the tangent model: their number is what costs."""
TRACKER = Frame("", exponential(np.array([0.3, -1.2, 2.0])), np.array([1.0, -2.0, 0.5]))
ARM = arm_text(
    "0.02",
    more="""load_uncertainty: {scale_percent: 1, direction_deg: 0.3}
fit: [joint_compliance]
""",
)
COUNT = 10


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    file = tmp_path_factory.mktemp("arm") / "experiment.yaml"
    file.write_text(ARM)
    return load_experiment(file)


def poses_of(arm: Experiment, seed: int, count: int) -> Poses:
    controller = arm.robot.controller
    pendant = np.random.default_rng(seed).uniform(controller.lower, controller.upper, (count, 6)) * 0.7
    wrench = np.tile([0.0, 1500.0, -4000.0, 0.0, 0.0, 0.0], (count, 1))
    return Poses(pendant, controller.to_joints(pendant), wrench)


def acting(poses: Poses, k: float, r: Array) -> Poses:
    """The same poses with the load that really acts."""
    halves = poses.wrench.reshape(-1, 2, 3)
    return replace(poses, wrench=((1.0 + k) * (halves + np.cross(r, halves))).reshape(-1, 6))


def positions(arm: Experiment, k: float, r: Array, rng: np.random.Generator, loaded: bool = True) -> Readings:
    """Each pose unloaded and loaded (or twice unloaded) with the believed wrench in the table."""
    poses = poses_of(arm, 3, COUNT)
    model, x = arm.model(), arm.model().nominal
    two = [model.positions(acting(poses, k, r), x, state) for state in (False, loaded)]
    seen = TRACKER.apply(np.stack(two, axis=1).reshape(2 * COUNT, -1, 3))
    names = [f"p{i // 2}" for i in range(2 * COUNT)]
    flags = np.tile([False, loaded], COUNT)
    both = poses.take(np.repeat(np.arange(COUNT), 2))
    return position_readings(both, flags, seen + 2e-5 * rng.standard_normal(seen.shape), 2e-5, pose=names)


def displacements(arm: Experiment, k: float, r: Array, seed: int) -> Readings:
    poses = poses_of(arm, 5, COUNT)
    readings = simulate(arm, make_plan(acting(poses, k, r), ["pull"] * COUNT), seed=seed, linear=True).readings
    believed = np.concatenate([poses.wrench, np.zeros_like(poses.wrench)])
    return readings.with_poses(replace(readings.poses, wrench=believed))


def fitted(kind: str, arm: Experiment, k: float, r: Array, seed: int) -> Fit:
    states = positions(arm, k, r, np.random.default_rng([9, seed]))
    if kind == "positions":
        return identify(arm, states, options=LINEAR)
    return identify(arm, joined([states, displacements(arm, k, r, seed)]), options=LINEAR)


@pytest.mark.parametrize("linear", [True, False])
def test_columns_against_finite_differences(arm: Experiment, linear: bool) -> None:
    states = positions(arm, 0.0, np.zeros(3), np.random.default_rng(0))
    fit = identify(arm, states, options=LINEAR)
    seen = observation_model(arm, states, linear=linear, frames=fit.frames)
    columns = seen.rows.spread(load_columns(seen, fit.x))
    assert np.array_equal(np.abs(columns).max(axis=(1, 2)) > 0.0, states.states.loaded[states.plus])
    h = 1e-4
    for i, (k, *r) in enumerate(np.eye(4)):
        ends = []
        for s in (h, -h):
            turned = states.with_poses(acting(states.poses, s * k, s * np.array(r)))
            moved = observation_model(arm, turned, linear=linear, frames=fit.frames)
            ends.append(moved.rows.predict(fit.model, fit.x, fit.frames, linear))
        assert np.allclose(columns[..., i], (ends[0] - ends[1]) / (2 * h), rtol=1e-5, atol=1e-9)


def test_what_a_fit_says_of_it(arm: Experiment) -> None:
    fit = fitted("positions", arm, 0.0, np.zeros(3), 0)
    assert all(t >= e.sd for t, e in zip(fit.sd_total, fit.estimates, strict=True))
    content = fit.as_json()
    assert content["total_covariance"] is not None
    assert (
        content["estimates"]["joint_compliance[joint_2]"]["sd_total"]
        == fit.sd_total[fit.names.index("joint_compliance[joint_2]")]
    )
    assert "with the load's stated uncertainty, of initial: " in fit_table(fit).caption
    exact = arm.with_(load_uncertainty=LoadUncertainty(0.0, 0.0))
    states = positions(arm, 0.0, np.zeros(3), np.random.default_rng([9, 0]))
    assert identify(exact, states, options=LINEAR).total_covariance is None
    tool = arm.with_(fit=("joint_compliance",))
    mixed = fitted("joint", tool, 0.0, np.zeros(3), 0)
    assert mixed.total_covariance is not None


def test_both_sds_are_shares_of_the_initial_value(arm: Experiment) -> None:
    """An estimate far above its initial value: the total share is not below that of the noise."""
    fit = fitted("positions", arm, 0.0, np.zeros(3), 0)
    i = fit.names.index("joint_compliance[joint_3]")
    estimates = list(fit.estimates)
    estimates[i] = replace(estimates[i], value=4.0 * estimates[i].initial)
    caption = fit_table(replace(fit, estimates=tuple(estimates))).caption
    share = 100 * fit.sd_total[i] / estimates[i].initial
    assert f"joint_compliance[joint_3] {share:.1f} %" in caption
    estimates[i] = replace(estimates[i], initial=1e-30)
    row = next(r for r in fit_table(replace(fit, estimates=tuple(estimates))).rows if r[0].endswith("[joint_3]"))
    assert "> 999 %" in row, "shares of next to nothing have no digits"
