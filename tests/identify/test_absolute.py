"""Absolute positions: what made them is found again, with uncertainties that are true; real readings; bad input."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from qsframework.elastostatics.so3 import exponential, left_jacobian, rotation_vector
from qsframework.errors import InputError, NotIdentifiable
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Frame, Readings, load_experiment, observation_model, read_readings
from qsframework.experiment.frames import procrustes
from qsframework.fits import identify
from qsframework.information.selection import choose, identifiable_names
from qsframework.plugin import Array, Poses
from tests.identify.arm import position_readings, spoilt

UR10 = Path(__file__).parents[2] / "examples" / "ur10"
GEOMETRY = ["marker_offset", "joint_offset", "joint_placement"]
SPRINGS = ["joint_compliance[joint_2]", "joint_compliance[joint_3]"]
SIGMA = 3e-5
LINEAR = FitOptions(linear=True)
"""The readings here are made by the tangent model: their number, and that of the parameters, is what costs."""
KEEP = FitOptions(linear=True, keep_all=True)
EXPERIMENT = """
robot: ur10
load: {point_mm: [0, 0, 93]}
markers:
  a: {xyz_mm: [0, 0, 93]}
  b: {xyz_mm: [80, 0, 60]}
  c: {xyz_mm: [0, 80, 60]}
noise: {sigma_mm: 0.03}
effects:
  - {effect: marker_offset, markers: all}
  - {effect: joint_offset, joints: all}
  - {effect: joint_placement, joints: all}
"""
TRUE_FRAMES = {
    "morning": Frame("morning", exponential(np.array([0.3, -1.2, 2.0])), np.array([1.0, -2.0, 0.5])),
    "evening": Frame("evening", exponential(np.array([-0.1, 0.2, -0.4])), np.array([-3.0, 0.4, 1.5])),
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


def made_states(experiment: Experiment, x: Array, count: int, rng: np.random.Generator, noise: float) -> Readings:
    """Half of the poses in each tracker frame."""
    q = rng.uniform(-2.5, 2.5, (count, 6))
    poses = Poses(q, q, np.zeros((count, 6)))
    points = experiment.model().positions(poses, x)
    series = tuple("morning" if i < count // 2 else "evening" for i in range(count))
    seen = np.stack([TRUE_FRAMES[s].apply(p) for s, p in zip(series, points, strict=True)])
    return position_readings(
        poses, np.zeros(count, dtype=bool), seen + noise * rng.standard_normal(seen.shape), SIGMA, series=series
    )


def some(states: Readings, rows: npt.NDArray[Any]) -> Readings:
    return replace(states, use=np.isin(np.arange(len(states.use)), rows))


def test_without_noise_the_arm_is_found_to_the_last_micrometre(arm: Experiment) -> None:
    rng = np.random.default_rng(4)
    x = true_arm(arm, rng)
    states = made_states(arm, x, 80, rng, 0.0)
    fit = identify(arm, states, GEOMETRY + SPRINGS, KEEP)
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
    fit_names = [
        *SPRINGS,
        "joint_offset[joint_2]",
        "joint_offset[joint_3]",
        "joint_placement[joint_2].x",
        "joint_placement[joint_3].x",
        "marker_offset[a]",
    ]
    x = arm.model().nominal
    index = arm.model().index(names_of(arm, fit_names))
    x[index] += [
        0.5 * arm.model().parameters[i].typical * v for i, v in zip(index, rng.standard_normal(9), strict=False)
    ]
    x[arm.model().index(SPRINGS)] = 13e-6, 11e-6
    off: list[float] = []
    frames: list[float] = []
    for _ in range(20):
        fit = identify(arm, made_states(arm, x, 24, rng, SIGMA), fit_names, KEEP)
        assert not fit.not_estimated
        off += [(e.value - x[arm.model().index([e.name])[0]]) / e.sd for e in fit.estimates[12:]]
        for i, frame in enumerate(fit.frames):
            true = TRUE_FRAMES[frame.series]
            error = np.concatenate([frame.origin - true.origin, rotation_vector(frame.rotation @ true.rotation.T)])
            frames += [float(v) for v in error / [e.sd for e in fit.estimates[6 * i : 6 * i + 6]]]
        assert 0.7 < fit.chi2 / fit.dof < 1.3
    for z in (np.array(off), np.array(frames)):
        assert 0.92 < np.mean(np.abs(z) < 1.96) < 0.98
        assert np.abs(z).max() < 4.5
        assert np.abs(z.mean()) < 0.2


def test_what_cannot_be_told_is_named(arm: Experiment) -> None:
    """Without what is known before the readings: a fit that does not count it is refused."""
    rng = np.random.default_rng(5)
    states, names = made_states(arm, true_arm(arm, rng), 80, rng, SIGMA), names_of(arm, GEOMETRY)
    told, aside = identifiable_names(observation_model(arm, states, names, linear=True), KEEP, known=False)
    left = {entry.name: entry for entry in aside}
    assert left["joint_placement[joint_4].rz"].correlated_with == ("joint_offset[joint_4]",)
    assert left["joint_placement[joint_3].z"].correlated_with == ("joint_placement[joint_2].z",)
    assert "joint_offset[joint_1]" in left, "the frame's turn"
    assert not set(left) & set(told)
    assert set(left) | set(told) == set(names)
    assert "confounded with" in left["joint_placement[joint_4].rz"].words()
    words = r"identifiable: joint_offset\[joint_1\]: confounded with frame\[morning\]\.ry.* and 10 more\. Take them out"
    with pytest.raises(NotIdentifiable, match=words):
        identify(arm, states, GEOMETRY, replace(KEEP, free=True))


def test_what_only_a_combination_is_told_of_keeps_what_was_known_of_the_rest(arm: Experiment) -> None:
    """Four links along one another's axes: their sum is told, and of each the share of it, a quarter."""
    rng = np.random.default_rng(5)
    fit = identify(arm, made_states(arm, true_arm(arm, rng, springs=False), 80, rng, SIGMA), GEOMETRY, KEEP)
    assert not fit.not_estimated
    assert set(fit.names[12:]) == set(names_of(arm, GEOMETRY))
    found = {e.name: e for e in fit.estimates}
    along = [f"joint_placement[joint_{k}].{axis}" for k, axis in ((2, "z"), (3, "z"), (4, "z"), (5, "y"))]
    for e in (found[n] for n in along):
        assert e.share == pytest.approx(0.25, abs=1e-3)
        assert e.sd == pytest.approx(5e-4 * np.sqrt(0.75), rel=1e-3)
    turn = found["joint_offset[joint_1]"]
    assert turn.share == pytest.approx(0.0, abs=1e-3), "the frame's turn"
    assert abs(turn.value) < 1e-3 * turn.sd
    told, known = fit.directions
    assert known == 42
    assert 0 < told < known - 10
    assert 0.8 < fit.chi2 / fit.dof < 1.2
    assert fit.dof == 3 * 240 - 12 - 9, "as many as readings, less what nothing is known of before"


def test_markers_that_one_turning_joint_shows_are_left_aside_and_named(arm: Experiment) -> None:
    """Of them nothing is known: what they and the frames share is not estimated, and the file says so."""
    q = np.tile([0.1, -1.0, 1.2, 0.4, 0.9, 0.2], (20, 1))
    q[:, 0] = np.linspace(-2.0, 2.0, 20)
    poses = Poses(q, q, np.zeros((20, 6)))
    states = position_readings(poses, np.zeros(20, dtype=bool), arm.model().positions(poses), SIGMA)
    fit = identify(arm, states, GEOMETRY, KEEP)
    assert fit.not_estimated
    assert all(entry.name.startswith("marker_offset") for entry in fit.not_estimated)
    assert not {entry.name for entry in fit.not_estimated} & set(fit.names)
    assert next(iter(fit.as_json()["not_estimated"])) == fit.not_estimated[0].name


def test_columns_are_chosen_in_their_order() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((2, 50))
    rows = np.stack([a, b, a - 2.0 * b, 1e-3 * rng.standard_normal(50), np.zeros(50)], axis=1)
    taken, left = choose(rows, ["a", "b", "sum", "weak", "none"])
    assert taken == [0, 1, 3]
    assert [entry.name for entry in left] == ["sum", "none"]
    assert left[0].correlated_with == ("b", "a")
    assert left[1].words() == "none: no reading depends on it"


def test_gross_errors_are_masked_and_named(arm: Experiment) -> None:
    rng = np.random.default_rng(6)
    states = made_states(arm, true_arm(arm, rng, springs=False), 60, rng, SIGMA)
    clean = identify(arm, states, GEOMETRY, LINEAR)
    wrong = spoilt(states, [10, 50, 100], np.array([[0.002, 0.0, 0.0], [0.0, -1.0, 0.5], [0.0, 0.0, 0.01]]))
    fit = identify(arm, wrong, GEOMETRY, LINEAR)
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
        assert rotation_vector(exponential(v)) == pytest.approx(v, abs=1e-8)
        J = np.stack(
            [rotation_vector(exponential(v + 1e-6 * d) @ exponential(v - 1e-6 * d).T) / 2e-6 for d in np.eye(3)], 1
        )
        assert left_jacobian(v) == pytest.approx(J, abs=1e-7)


@pytest.mark.parametrize("linear", [True, False])
def test_derivatives_against_differences(arm: Experiment, linear: bool) -> None:
    rng = np.random.default_rng(8)
    x = true_arm(arm, rng)
    states = made_states(arm, x, 6, rng, 0.0)
    names = names_of(arm, GEOMETRY + SPRINGS)
    seen = observation_model(arm, states, names, linear=linear, x=x)
    observed = seen.observations()
    z = np.concatenate([0.1 * rng.standard_normal(12), x[arm.model().index(names)]])
    J = observed.jacobian(z)
    assert observed.predict(z) == pytest.approx(seen.predict(z), rel=1e-13, abs=1e-15)
    for i, p in enumerate(observed.parameters):
        step = np.zeros(len(z))
        step[i] = 1e-3 * p.scale
        slope = (observed.predict(z + step) - observed.predict(z - step)) / (2.0 * step[i])
        assert J[:, i] == pytest.approx(slope, abs=2e-6 * max(np.abs(slope).max(), 1e-3)), p.name


@pytest.mark.parametrize(
    ("series", "fit", "goal"),
    [
        ("d", GEOMETRY, 0.41),
        ("d", GEOMETRY + SPRINGS, 0.355),
        ("d", [*GEOMETRY, "gravity_sag", "encoder_eccentricity"], 0.34),
        ("b", GEOMETRY, 0.46),
        ("b", [*GEOMETRY, "gravity_sag"], 0.42),
    ],
)
def test_real_readings_at_poses_that_were_not_fitted(series: str, fit: list[str], goal: float) -> None:
    """Held-out RMS of the distance, mm: median of three random halves."""
    experiment = load_experiment(UR10 / "experiment.yaml")
    states = read_readings(UR10 / f"series_{series}.csv", experiment, "positions")
    errors = []
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(states.use))
        half = len(order) // 2
        result = identify(experiment, some(states, order[:half]), fit, LINEAR)
        predicted, measured = result.predict(some(states, order[half:]))
        errors.append(result.error_of(predicted - measured) * 1e3)
    assert np.median(errors) < goal


def test_the_bad_rows_of_series_b_are_found() -> None:
    experiment = load_experiment(UR10 / "experiment.yaml")
    states = read_readings(UR10 / "series_b.csv", experiment, "positions")
    fit = identify(experiment, states, options=LINEAR)
    poses = {states.pose[np.flatnonzero(states.line == row)[0]] for row in fit.masked}
    assert {"533", "855", "856"} <= poses
    assert len(fit.masked) <= 12


def changed(states: Readings, case: str) -> Readings:
    rows = np.arange(len(states.use))
    if case == "all masked":
        return some(states, rows[:0])
    if case == "few":
        return some(states, rows[:3])
    if case == "a lonely series":
        return some(states, np.concatenate([rows[:120], rows[120:122]]))
    q = np.tile(states.poses.q[:1], (len(states.poses), 1))
    return states.with_poses(Poses(q, q, np.zeros((len(q), 6))))


@pytest.mark.parametrize(
    ("case", "words"),
    [
        ("all masked", "every reading is masked (use = 0)"),
        ("few", "3 readings give 9 numbers: too few for 9 parameters (six of them each tracker frame)"),
        ("a lonely series", "cannot be found: 2 poses of series 'evening'"),
        ("all poses equal", "cannot be found: 120 poses of series 'morning' lie at one point"),
    ],
)
def test_bad_input(case: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "experiment.yaml"
    file.write_text(re.sub(r"\n  [bc]: .*", "", EXPERIMENT))
    experiment = load_experiment(file)
    made = made_states(experiment, experiment.model().nominal, 240, np.random.default_rng(3), SIGMA)
    with pytest.raises((InputError, NotIdentifiable), match=re.escape(words)):
        identify(experiment, changed(made, case), GEOMETRY)


def test_a_fit_knows_only_its_own_frames(arm: Experiment) -> None:
    rng = np.random.default_rng(3)
    states = made_states(arm, arm.model().nominal, 40, rng, SIGMA)
    fit = identify(arm, some(states, np.arange(60)), ["marker_offset"], KEEP)
    with pytest.raises(InputError, match="no tracker frame of series 'evening'"):
        fit.predict(states)
