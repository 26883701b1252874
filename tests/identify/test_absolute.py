"""Absolute positions: what made them is found again, with uncertainties that are true; real readings; bad input."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from qsframework.errors import InputError
from qsframework.experiment import Experiment, StateReadings, load_experiment, read_states
from qsframework.identify.absolute import PositionFit, identify_positions
from qsframework.identify.choice import choose
from qsframework.identify.frames import Frame, procrustes, rotation, rotation_vector, start, turning
from qsframework.identify.observations import Independent, Observations
from qsframework.identify.positions import joint_observations, make_positions, position_observations
from qsframework.plugin import Array, Poses

UR10 = Path(__file__).parents[2] / "examples" / "ur10"
GEOMETRY = ["tool_offset", "joint_offset", "joint_placement"]
SPRINGS = ["joint_compliance[joint_2]", "joint_compliance[joint_3]"]
SIGMA = 3e-5
EXPERIMENT = """
robot: ur10
load: {point_mm: [0, 0, 93]}
markers:
  a: {xyz_mm: [0, 0, 93]}
  b: {xyz_mm: [80, 0, 60]}
  c: {xyz_mm: [0, 80, 60]}
noise: {sigma_mm: 0.03}
effects:
  - {effect: tool_offset, markers: all}
  - {effect: joint_offset, joints: all}
  - {effect: joint_placement, joints: all}
"""
TRUE_FRAMES = {
    "morning": Frame("morning", rotation(np.array([0.3, -1.2, 2.0])), np.array([1.0, -2.0, 0.5])),
    "evening": Frame("evening", rotation(np.array([-0.1, 0.2, -0.4])), np.array([-3.0, 0.4, 1.5])),
}


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    file = tmp_path_factory.mktemp("arm") / "experiment.yaml"
    file.write_text(EXPERIMENT)
    return load_experiment(file)


def names_of(experiment: Experiment, fit: list[str]) -> tuple[str, ...]:
    return experiment.with_(fit=tuple(fit)).fit_names()


def true_arm(experiment: Experiment, rng: np.random.Generator, springs: bool = True) -> Array:
    """Errors of a real arm's size in everything that the tests fit."""
    model = experiment.model()
    x = model.nominal
    names = names_of(experiment, GEOMETRY)
    index = model.index(names)
    x[index] = [model.parameters[i].typical * v for i, v in zip(index, rng.standard_normal(len(index)), strict=True)]
    if springs:
        x[model.index(SPRINGS)] = 13e-6, 11e-6
    return x


def made_states(experiment: Experiment, x: Array, count: int, rng: np.random.Generator, noise: float) -> StateReadings:
    """Half of the poses in each tracker frame."""
    q = rng.uniform(-2.5, 2.5, (count, 6))
    poses = Poses(q, q, np.zeros((count, 6)))
    points = experiment.model().positions(poses, x)
    series = tuple("morning" if i < count // 2 else "evening" for i in range(count))
    seen = np.stack([TRUE_FRAMES[s].apply(p) for s, p in zip(series, points, strict=True)])
    markers, rows = points.shape[1], count * points.shape[1]
    position = (seen + noise * rng.standard_normal(seen.shape)).reshape(-1, 3)
    ones = np.ones(count, dtype=np.intp)
    return StateReadings(
        poses, np.zeros(count, dtype=bool), tuple(str(i) for i in range(count)), ("",) * count, series, ones, ones,
        np.repeat(np.arange(count), markers), np.tile(np.arange(markers), count), position, np.full(rows, np.nan),
        np.ones(rows, dtype=bool), np.arange(2, 2 + rows), None, None,
    )  # fmt: skip


def some(states: StateReadings, rows: npt.NDArray[Any]) -> StateReadings:
    return replace(states, use=np.isin(np.arange(len(states.use)), rows))


def test_without_noise_the_arm_is_found_to_the_last_micrometre(arm: Experiment) -> None:
    rng = np.random.default_rng(4)
    x = true_arm(arm, rng)
    states = made_states(arm, x, 80, rng, 0.0)
    fit = identify_positions(arm, states, GEOMETRY + SPRINGS)
    assert fit.error_of(fit.residuals) < 2e-6
    assert fit.error_of(fit.measured - fit.nominal) > 1e-3
    more = made_states(arm, x, 60, rng, 0.0)
    predicted, measured = fit.predict(more)
    assert fit.error_of(predicted - measured) < 5e-6, "other poses in the same frames"
    found = dict(zip(fit.names, [e.value for e in fit.estimates], strict=True))
    assert found["joint_compliance[joint_2]"] == pytest.approx(13e-6, rel=0.01)
    assert found["joint_compliance[joint_3]"] == pytest.approx(11e-6, rel=0.02)


def test_the_stated_uncertainty_is_the_scatter(arm: Experiment) -> None:
    """Coverage of 95 % intervals of the parameters whose truth is theirs alone; springs, and other poses."""
    rng = np.random.default_rng(11)
    fit_names = [*SPRINGS, "joint_offset[joint_2]", "joint_offset[joint_3]", "joint_placement[joint_2].x",
                 "joint_placement[joint_3].x", "tool_offset[a]"]  # fmt: skip
    x = arm.model().nominal
    index = arm.model().index(names_of(arm, fit_names))
    x[index] += [
        0.5 * arm.model().parameters[i].typical * v for i, v in zip(index, rng.standard_normal(9), strict=False)
    ]
    x[arm.model().index(SPRINGS)] = 13e-6, 11e-6
    off: list[float] = []
    frames: list[float] = []
    for _ in range(30):
        fit = identify_positions(arm, made_states(arm, x, 24, rng, SIGMA), fit_names)
        assert not fit.left_aside
        assert not fit.masked
        off += [(e.value - x[arm.model().index([e.name])[0]]) / e.sd for e in fit.estimates[12:]]
        for i, frame in enumerate(fit.frames):
            true = TRUE_FRAMES[frame.series]
            error = np.concatenate(
                [frame.origin - true.origin, rotation_vector(frame.rotation @ true.rotation.T)]
            )  # fmt: skip
            frames += [float(v) for v in error / [e.sd for e in fit.estimates[6 * i : 6 * i + 6]]]
        assert 0.7 < fit.chi2 / fit.dof < 1.3
    for z in (np.array(off), np.array(frames)):
        assert 0.92 < np.mean(np.abs(z) < 1.96) < 0.98
        assert np.abs(z).max() < 4.5
        assert np.abs(z.mean()) < 0.2


def test_what_cannot_be_told_is_left_aside_and_named(arm: Experiment) -> None:
    rng = np.random.default_rng(5)
    fit = identify_positions(arm, made_states(arm, true_arm(arm, rng), 80, rng, SIGMA), GEOMETRY)
    left = {entry.name: entry for entry in fit.left_aside}
    assert left["joint_placement[joint_4].rz"].absorbed_by == ("joint_offset[joint_4]",)
    assert left["joint_placement[joint_3].z"].absorbed_by == ("joint_placement[joint_2].z",)
    assert "joint_offset[joint_1]" in left, "the frame's turn"
    assert not set(left) & set(fit.names)
    assert set(left) | set(fit.names[12:]) == set(names_of(arm, GEOMETRY))
    assert fit.rank.full
    assert fit.rank.parameters == len(fit.names)
    assert "absorbed by" in left["joint_placement[joint_4].rz"].words()
    assert fit.as_json()["left_aside"][0] == fit.left_aside[0].words()


def test_columns_are_chosen_in_their_order() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((2, 50))
    rows = np.stack([a, b, a - 2.0 * b, 1e-3 * rng.standard_normal(50), np.zeros(50)], axis=1)
    taken, left = choose(rows, ["a", "b", "sum", "weak", "none"], np.array([10.0] * 5))
    assert taken == [0, 1]
    assert [entry.name for entry in left] == ["sum", "weak", "none"]
    assert left[0].absorbed_by == ("b", "a")
    assert np.isinf(left[0].sd)
    assert left[1].sd == pytest.approx(1e3 / np.sqrt(48), rel=0.3)
    assert left[2].words() == "none: no reading depends on it"
    taken, _ = choose(rows, ["a", "b", "sum", "weak", "none"], np.array([10.0, 10.0, 10.0, 1e4, 10.0]))
    assert taken == [0, 1, 3]


def test_gross_errors_are_masked_and_named(arm: Experiment) -> None:
    rng = np.random.default_rng(6)
    states = made_states(arm, true_arm(arm, rng, springs=False), 60, rng, SIGMA)
    clean = identify_positions(arm, states, GEOMETRY)
    position = states.position.copy()
    position[[10, 50, 100]] += [[0.002, 0.0, 0.0], [0.0, -1.0, 0.5], [0.0, 0.0, 0.01]]
    fit = identify_positions(arm, replace(states, position=position), GEOMETRY)
    assert fit.masked == (12, 52, 102)
    assert not clean.masked
    assert fit.as_json()["masked_rows"] == [12, 52, 102]
    for a, b in zip(fit.estimates, clean.estimates, strict=True):
        assert abs(a.value - b.value) < 1.5 * b.sd, a.name


def test_frames() -> None:
    rng = np.random.default_rng(2)
    points, frame = rng.standard_normal((9, 3)), TRUE_FRAMES["morning"]
    found = procrustes(points, frame.apply(points))
    assert found.rotation == pytest.approx(frame.rotation, abs=1e-12)
    assert found.origin == pytest.approx(frame.origin, abs=1e-12)
    flat = points * [1.0, 1.0, 0.0]
    assert np.linalg.det(procrustes(flat, frame.apply(flat)).rotation) == pytest.approx(1.0)
    for v in (np.array([0.3, -1.2, 2.0]), np.array([1e-6, 0.0, 2e-6]), np.array([np.pi - 1e-6, 0.0, 0.0])):
        assert rotation_vector(rotation(v)) == pytest.approx(v, abs=1e-8)
        J = np.stack([rotation_vector(rotation(v + 1e-6 * d) @ rotation(v - 1e-6 * d).T) / 2e-6 for d in np.eye(3)], 1)
        assert turning(v) == pytest.approx(J, abs=1e-7)
    offsets = np.stack([rotation(v) for v in rng.standard_normal((9, 3))])
    o = np.array([0.01, -0.02, 0.09])
    frames, got = start(points, offsets, frame.apply(points + offsets @ o), [("", np.arange(9))], np.full(3, 0.05))
    assert got == pytest.approx(o, abs=1e-6)
    assert frames[0].origin == pytest.approx(frame.origin, abs=1e-5)


def test_derivatives_against_differences(arm: Experiment) -> None:
    rng = np.random.default_rng(8)
    x = true_arm(arm, rng)
    states = made_states(arm, x, 6, rng, 0.0)
    positions = make_positions(arm.model(), states)
    names = names_of(arm, GEOMETRY + SPRINGS)
    frames, _ = positions.started(x, GEOMETRY, 20.0)
    observed = position_observations(positions, frames, x, names, np.full(len(positions.keep), SIGMA))
    z = np.concatenate([0.1 * rng.standard_normal(12), x[arm.model().index(names)]])
    J = observed.jacobian(z)
    for i, p in enumerate(observed.parameters):
        step = np.zeros(len(z))
        step[i] = 1e-3 * p.scale
        slope = (observed.predict(z + step) - observed.predict(z - step)) / (2.0 * step[i])
        assert J[:, i] == pytest.approx(slope, abs=2e-6 * max(np.abs(slope).max(), 1e-3)), p.name


def test_positions_and_displacements_in_one_fit(arm: Experiment) -> None:
    """Positions tell the geometry, displacements the springs; one fit of both finds all of it."""
    rng = np.random.default_rng(9)
    model, x = arm.model(), true_arm(arm, rng)
    positions = make_positions(model, made_states(arm, x, 40, rng, SIGMA))
    fit = identify_positions(arm, made_states(arm, x, 40, np.random.default_rng(1), SIGMA), GEOMETRY + SPRINGS)
    geometry = [n for n in fit.names[12:] if n not in SPRINGS]
    frames, _ = positions.started(x, GEOMETRY, 20.0)
    absolute = position_observations(positions, frames, x, [*geometry, *SPRINGS], np.full(len(positions.keep), SIGMA))
    q = rng.uniform(-2.5, 2.5, (10, 6))
    poses = Poses(q, q, np.tile([0.0, 0.0, -200.0, 0.0, 0.0, 0.0], (10, 1)))
    index = model.index(SPRINGS)

    def with_springs(z: Array) -> Array:
        values = x.copy()
        values[index] = z
        return values

    exact = model.predict(poses, x).ravel()
    displaced = Observations(
        exact + SIGMA * rng.standard_normal(exact.shape),
        lambda z: model.predict(poses, with_springs(z)).ravel(),
        lambda z: model.sensitivity(poses, with_springs(z), SPRINGS).reshape(-1, 2),
        tuple(model.parameters[i] for i in index), Independent(np.full(exact.size, SIGMA)),
        np.repeat(np.arange(10), 9), np.repeat(np.arange(10), 9),
    )  # fmt: skip
    joint = joint_observations([absolute, displaced])
    assert joint.names == absolute.names
    assert len(joint.measured) == len(absolute.measured) + len(displaced.measured)
    assert set(joint.block[-90:]) & set(joint.block[:-90]) == set()
    z: Array = np.concatenate([np.zeros(12), x[model.index(geometry)], [25e-6, 50e-6]])
    A = joint.noise.whiten(joint.jacobian(z))
    for _ in range(6):
        step = np.linalg.lstsq(A, joint.noise.whiten(joint.measured - joint.predict(z)), rcond=None)[0]
        z = np.asarray(z + step, dtype=np.float64)
        A = joint.noise.whiten(joint.jacobian(z))
    sd = np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    alone = absolute.noise.whiten(absolute.jacobian(z))
    sd_alone = np.sqrt(np.diag(np.linalg.inv(alone.T @ alone)))
    assert np.abs((z[-2:] - x[index]) / sd[-2:]).max() < 4.0
    assert np.all(sd <= sd_alone * (1.0 + 1e-9))
    assert np.all(sd[-2:] < 0.9 * sd_alone[-2:])
    assert joint.noise.log_det() == pytest.approx(2.0 * len(joint.measured) * np.log(SIGMA))


@pytest.mark.parametrize(("series", "fit", "goal"), [
    ("d", GEOMETRY, 0.41), ("d", GEOMETRY + SPRINGS, 0.355),
    ("d", [*GEOMETRY, "gravity_sag", "encoder_eccentricity"], 0.34),
    ("b", GEOMETRY, 0.46), ("b", [*GEOMETRY, "gravity_sag"], 0.42),
])  # fmt: skip
def test_real_readings_at_poses_that_were_not_fitted(series: str, fit: list[str], goal: float) -> None:
    """Held-out RMS of the distance, mm: median of five random halves."""
    experiment = load_experiment(UR10 / "experiment.yaml")
    states = read_states(UR10 / f"series_{series}.csv", experiment)
    errors = []
    for seed in range(5):
        order = np.random.default_rng(seed).permutation(len(states.use))
        half = len(order) // 2
        result = identify_positions(experiment, some(states, order[:half]), fit)
        predicted, measured = result.predict(some(states, order[half:]))
        errors.append(result.error_of(predicted - measured) * 1e3)
    assert np.median(errors) < goal


def test_the_bad_rows_of_series_b_are_found() -> None:
    experiment = load_experiment(UR10 / "experiment.yaml")
    states = read_states(UR10 / "series_b.csv", experiment)
    fit = identify_positions(experiment, states)
    poses = {states.pose[states.measurement[np.flatnonzero(states.rows == row)[0]]] for row in fit.masked}
    assert {"533", "855", "856"} <= poses
    assert len(fit.masked) <= 12


def changed(states: StateReadings, case: str) -> StateReadings:
    rows = np.arange(len(states.use))
    if case == "all masked":
        return some(states, rows[:0])
    if case == "few":
        return some(states, rows[:7])
    if case == "a lonely series":
        return some(states, np.concatenate([rows[:120], rows[120:122]]))
    if case == "some without series":
        return replace(states, series=("", *states.series[1:]))
    if case == "all poses equal":
        q = np.tile(states.poses.q[:1], (len(states.poses), 1))
        return replace(states, poses=Poses(q, q, np.zeros((len(q), 6))))
    if case == "some sigma":
        sigma = states.sigma.copy()
        sigma[0] = 1e-5
        return replace(states, sigma=sigma)
    raise AssertionError(case)


@pytest.mark.parametrize(("case", "words"), [
    ("all masked", "every reading is masked (use = 0)"),
    ("few", "7 readings give 21 numbers: too few for"),
    ("a lonely series", "cannot be found: 2 poses of series 'evening'"),
    ("some without series", "rows 2, 3, 4 name no series, others do"),
    ("all poses equal", "cannot be found: 120 poses of series 'morning' lie at one point"),
    ("some sigma", "239 readings have no sigma_mm"),
])  # fmt: skip
def test_bad_input(case: str, words: str, arm: Experiment, tmp_path: Path) -> None:
    file = tmp_path / "experiment.yaml"
    one_marker = re.sub(r"\n  [bc]: .*", "", EXPERIMENT)
    file.write_text(one_marker.replace("{sigma_mm: 0.03}", "estimate") if case == "some sigma" else one_marker)
    experiment = arm if case == "some without series" else load_experiment(file)
    rng = np.random.default_rng(3)
    count = 12 if case == "some without series" else 240
    states = changed(made_states(experiment, experiment.model().nominal, count, rng, SIGMA), case)
    with pytest.raises(InputError, match=re.escape(words)):
        identify_positions(experiment, states, GEOMETRY)


def test_a_fit_knows_only_its_own_frames(arm: Experiment) -> None:
    rng = np.random.default_rng(3)
    states = made_states(arm, arm.model().nominal, 40, rng, SIGMA)
    fit: PositionFit = identify_positions(arm, some(states, np.arange(60)), ["tool_offset"])
    with pytest.raises(InputError, match="no tracker frame of series evening"):
        fit.predict(states)
