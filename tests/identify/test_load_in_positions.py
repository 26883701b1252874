"""The load's own error in fits of loaded positions, alone and with displacements: against a Monte Carlo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.experiment import (
    Experiment,
    LoadUncertainty,
    Readings,
    StateReadings,
    load_experiment,
    make_plan,
    simulate,
)
from qsframework.identify import Choices, PositionFit, identify_jointly, identify_positions
from qsframework.identify.frames import Frame, rotation, rotation_vector
from qsframework.identify.positions import make_positions
from qsframework.identify.uncertainty import position_columns
from qsframework.plugin import Array, Poses
from qsframework.report import fit_table
from tests.identify.arm import arm_text

SCALE, TURN = 0.01, np.deg2rad(0.3)
TRACKER = Frame("", rotation(np.array([0.3, -1.2, 2.0])), np.array([1.0, -2.0, 0.5]))
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


def positions(arm: Experiment, k: float, r: Array, rng: np.random.Generator, loaded: bool = True) -> StateReadings:
    """Each pose unloaded and loaded (or twice unloaded) with the believed wrench in the table."""
    poses = poses_of(arm, 3, COUNT)
    model, x, K = arm.model(), arm.model().nominal, 3
    two = [model.positions(acting(poses, k, r), x, state) for state in (False, loaded)]
    seen = TRACKER.apply(np.stack(two, axis=1).reshape(-1, 3))
    N = 2 * COUNT
    flags = np.tile([False, loaded], COUNT)
    wrench = np.repeat(poses.wrench, 2, axis=0) * flags[:, None]
    both = Poses(np.repeat(poses.pendant, 2, axis=0), np.repeat(poses.q, 2, axis=0), wrench)
    ones = np.ones(N, dtype=np.intp)
    return StateReadings(
        both, flags, tuple(f"p{i // 2}" for i in range(N)), ("",) * N, ("",) * N, ones, ones,
        np.repeat(np.arange(N), K), np.tile(np.arange(K), N), seen + 2e-5 * rng.standard_normal(seen.shape),
        np.full(N * K, np.nan), np.ones(N * K, dtype=bool), np.arange(2, 2 + N * K), None, None,
    )  # fmt: skip


def displacements(arm: Experiment, k: float, r: Array, seed: int) -> Readings:
    poses = poses_of(arm, 5, COUNT)
    readings = simulate(arm, make_plan(acting(poses, k, r), ["pull"] * COUNT), seed=seed).readings
    return replace(readings, poses=poses)  # the wrench that was believed


def fitted(kind: str, arm: Experiment, k: float, r: Array, seed: int) -> PositionFit:
    states = positions(arm, k, r, np.random.default_rng([9, seed]))
    if kind == "positions":
        return identify_positions(arm, states)
    if kind == "one-step":
        return identify_jointly(arm, states, how=Choices())
    return identify_jointly(arm, states, displacements=displacements(arm, k, r, seed))


def errors(fit: PositionFit) -> Array:
    """Errors of the estimates (p,), the six of the tracker's frame first."""
    truth = fit.model.nominal[fit.model.index(fit.names[6:])]
    frame = fit.frames[0]
    motion = np.concatenate([frame.origin - TRACKER.origin, rotation_vector(frame.rotation @ TRACKER.rotation.T)])
    return np.concatenate([motion, np.array([e.value for e in fit.estimates[6:]]) - truth])


def test_columns_against_finite_differences(arm: Experiment) -> None:
    states = positions(arm, 0.0, np.zeros(3), np.random.default_rng(0))
    fit = identify_positions(arm, states)
    used = make_positions(fit.model, states)
    columns = position_columns(used, fit.frames, fit.x)
    assert np.array_equal(np.abs(columns).max(axis=(1, 2)) > 0.0, used.loaded[used.state])
    h = 1e-4
    for i, (k, *r) in enumerate(np.eye(4)):
        ends = [replace(used, poses=acting(used.poses, s * k, s * np.array(r))).predict(fit.x, fit.frames)
                for s in (h, -h)]  # fmt: skip
        assert np.allclose(columns[..., i], (ends[0] - ends[1]) / (2 * h), rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize(("kind", "campaigns"), [("positions", 200), ("one-step", 60), ("joint", 60)])
def test_the_spread_of_estimates_is_the_total_sd(arm: Experiment, kind: str, campaigns: int) -> None:
    """Campaigns whose load errs in size and direction: mean square of error / total sd is 1, within 4 of its sds."""
    rng = np.random.default_rng(7)
    total, noise = [], []
    for seed in range(campaigns):
        k, r = SCALE * rng.standard_normal(), TURN * rng.standard_normal(3)
        fit = fitted(kind, arm, k, r, seed)
        assert not fit.masked
        total.append(errors(fit) / fit.sd_total)
        noise.append(errors(fit) / [e.sd for e in fit.estimates])
    square = np.mean(np.square(total), axis=0)
    assert np.all(np.abs(square - 1.0) < 4.0 * np.sqrt(2.0 / campaigns)), square
    assert np.mean(np.square(noise), axis=0).max() > 1.5, "the noise alone is too small"


def test_what_a_fit_says_of_it(arm: Experiment) -> None:
    fit = fitted("positions", arm, 0.0, np.zeros(3), 0)
    assert all(t >= e.sd for t, e in zip(fit.sd_total, fit.estimates, strict=True))
    content = fit.as_json()
    assert content["covariance_total"] is not None
    assert content["estimates"]["joint_compliance[joint_2]"]["sd_total"] == fit.sd_total[fit.names.index(
        "joint_compliance[joint_2]")]  # fmt: skip
    assert "with the load's stated uncertainty, of initial: " in fit_table(fit).caption
    exact = arm.with_(load_uncertainty=LoadUncertainty(0.0, 0.0))
    states = positions(arm, 0.0, np.zeros(3), np.random.default_rng([9, 0]))
    assert identify_positions(exact, states).total_covariance is None
    bare = positions(arm, 0.0, np.zeros(3), np.random.default_rng(0), loaded=False)
    frame_only = arm.with_(fit=("joint_compliance[joint_2]",))
    assert identify_positions(frame_only, bare).total_covariance is None, "no load acts"


def test_both_sds_are_shares_of_the_initial_value(arm: Experiment) -> None:
    """An estimate far above its initial value: the total share is not below that of the noise."""
    fit = fitted("positions", arm, 0.0, np.zeros(3), 0)
    i = fit.names.index("joint_compliance[joint_3]")
    estimates = list(fit.estimates)
    estimates[i] = replace(estimates[i], value=4.0 * estimates[i].initial)
    caption = fit_table(replace(fit, estimates=tuple(estimates))).caption
    share = 100 * fit.sd_total[i] / estimates[i].initial
    assert f"joint_compliance[joint_3] {share:.1f} %" in caption
