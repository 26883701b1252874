"""States with and without load: as differences with their covariance, and as absolute positions in one fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.cli.check import experiment_lines
from qsframework.cli.identify import FitFiles, run_identify
from qsframework.elastostatics.so3 import exponential, rotation_vector
from qsframework.errors import NotIdentifiable
from qsframework.estimation import FitOptions
from qsframework.experiment import (
    Experiment,
    Frame,
    Readings,
    differences,
    load_experiment,
    make_plan,
    make_rows,
    read_readings,
    simulate,
    write_readings,
)
from qsframework.fits import identify, read_fit
from qsframework.plugin import Array, Poses
from tests.identify.arm import arm_text, position_readings, settled, with_sigma

SIGMA = 0.02e-3
LOADS = np.array([[0, 0, 0, 0, 0, 0], [0, 0, -4000.0, 0, 0, 0], [0, 1500.0, -4000, 0, 0, 0]])
BASE = Frame("", np.eye(3), np.zeros(3))
TRACKER = Frame("", exponential(np.array([0.3, -1.2, 2.0])), np.array([1.0, -2.0, 0.5]))
KEEP = FitOptions(keep_all=True)


def measured(experiment: Experiment, x: Array, poses: int, frame: Frame, seed: int) -> Readings:
    """Each pose unloaded and under two loads, all markers."""
    rng = np.random.default_rng(seed)
    controller = experiment.robot.controller
    pendant = np.repeat(rng.uniform(controller.lower, controller.upper, (poses, 6)) * 0.7, 3, axis=0)
    loaded = np.tile([False, True, True], poses)
    all_ = Poses(pendant, controller.to_joints(pendant), np.tile(LOADS, (poses, 1)))
    seen = frame.apply(settled(experiment.model(), all_, loaded, x))
    seen = seen + SIGMA * rng.standard_normal(seen.shape)
    return position_readings(
        all_,
        loaded,
        seen,
        SIGMA,
        pose=[f"p{i // 3}" for i in range(3 * poses)],
        load_id=("", "weight", "side") * poses,
    )


def dense(readings: Readings) -> Array:
    """Covariance (m, m) of the readings' coordinates: L^-1 of the unit matrix, inverted."""
    rows = make_rows(readings)
    white = rows.noise.whiten(np.eye(len(rows.at)))
    return np.linalg.inv(white.T @ white)


def test_the_command_fits_differences_with_their_covariance(m900ib: Experiment, tmp_path: Path) -> None:
    x = m900ib.model().nominal
    write_readings(tmp_path / "s.csv", measured(m900ib, x, 8, BASE, 1), m900ib)
    files = FitFiles(
        experiment=m900ib.path, data=(tmp_path / "s.csv",), json=tmp_path / "fit.json", states="differences"
    )
    run_identify(files, None, FitOptions(), False)
    fit = read_fit(tmp_path / "fit.json")
    assert fit.sigma == pytest.approx(np.sqrt(2.0) * SIGMA)
    truth = x[m900ib.model().index(fit.names)]
    assert np.all(np.abs(fit.values - truth) < 4.0 * fit.sd)
    assert abs(fit.chi2 - fit.dof) < 4.0 * np.sqrt(2.0 * fit.dof)
    assert fit.dof == 8 * 2 * 3 * len(m900ib.markers) - len(fit.names)


ARM = arm_text(
    "0.02",
    more="""effects:
  - {effect: joint_offset, joints: [joint_2, joint_4]}
""",
)


def test_check_fits_states_as_identify_does(m900ib: Experiment, tmp_path: Path) -> None:
    """Poses that the arm reaches 3 mm off say nothing of differences: no residuals are large there."""
    readings = measured(m900ib, m900ib.model().nominal, 8, BASE, 1)
    off = np.repeat(3e-3 * np.random.default_rng(2).standard_normal((8, 3)), 9, axis=0)
    write_readings(tmp_path / "s.csv", readings.with_values(readings.value + off), m900ib)
    positions = read_readings(tmp_path / "s.csv", m900ib, "positions")
    said = {kind for good, kind, _ in experiment_lines(m900ib, positions) if good is False}
    assert "large residuals" not in said
    assert identify(m900ib, positions).chi2 > 100.0 * identify(m900ib, differences(positions, m900ib)).chi2


def test_positions_with_loaded_states_tell_springs_zeros_and_the_frame(tmp_path: Path) -> None:
    (tmp_path / "experiment.yaml").write_text(ARM)
    wide = load_experiment(tmp_path / "experiment.yaml")
    names = ["joint_compliance", "joint_offset"]
    model, x = wide.model(), wide.model().nominal
    index = model.index(wide.with_(fit=tuple(names)).fit_names())
    scale = np.array([model.parameters[i].scale for i in index])
    x[index] += 0.3 * scale * np.random.default_rng(7).uniform(-1, 1, len(index))
    squares, z, dof = [], [], 0
    for seed in range(6):
        fit = identify(wide, measured(wide, x, 12, TRACKER, seed), names, KEEP)
        assert not fit.not_estimated
        truth = x[model.index([e.name for e in fit.estimates[6:]])]
        z += [(e.value - t) / e.sd for e, t in zip(fit.estimates[6:], truth, strict=True)]
        frame = fit.frames[0]
        turn = rotation_vector(frame.rotation @ TRACKER.rotation.T)
        z += list(np.concatenate([frame.origin - TRACKER.origin, turn]) / [e.sd for e in fit.estimates[:6]])
        squares.append(fit.chi2)
        dof = fit.dof
    assert np.abs(z).max() < 4.0
    assert np.mean(np.square(z)) == pytest.approx(1.0, abs=0.5)
    assert abs(np.mean(squares) - dof) < 4.0 * np.sqrt(2.0 * dof / 6)


def test_the_experiments_sigma_is_that_of_one_position_however_states_are_read(tmp_path: Path) -> None:
    """One state file, the noise stated in the experiment only: chi-square is right as positions and as differences."""
    (tmp_path / "experiment.yaml").write_text(ARM)
    arm = load_experiment(tmp_path / "experiment.yaml")
    names = ["joint_compliance"]
    count = 8
    squares: dict[str, list[float]] = {"positions": [], "differences": []}
    dofs: dict[str, int] = {}
    for seed in range(count):
        states = measured(arm, arm.model().nominal, 8, BASE, 100 + seed)
        fits = {
            "positions": identify(arm, states, names, KEEP),
            "differences": identify(arm, differences(states, arm), names, KEEP),
        }
        for kind, fit in fits.items():
            assert fit.sigma_source == "stated"
            squares[kind].append(fit.chi2)
            dofs[kind] = fit.dof
        assert fits["positions"].sigma == pytest.approx(SIGMA)
        assert fits["differences"].sigma == pytest.approx(np.sqrt(2.0) * SIGMA)
    for kind, dof in dofs.items():
        assert abs(np.mean(squares[kind]) - dof) < 4.0 * np.sqrt(2.0 * dof / count), (kind, np.mean(squares[kind]), dof)


def test_poses_all_equal_are_refused_with_what_would_help(m900ib: Experiment) -> None:
    """Loaded by the weight alone: joint 1 is left aside by name, and six others from one pose are refused."""
    controller = m900ib.robot.controller
    pendant = np.tile(np.deg2rad([10.0, 20.0, -10.0, 30.0, -40.0, 20.0]), (8, 1))
    poses = Poses(pendant, controller.to_joints(pendant), np.tile(LOADS[1], (8, 1)))
    readings = simulate(m900ib, make_plan(poses, ["weight"] * 8), seed=0).readings
    for options in (FitOptions(), FitOptions(linear=True)):
        with pytest.raises(NotIdentifiable, match="all 8 measurements are of one pose") as caught:
            identify(m900ib, readings, options=options)
        assert "Measure more poses" in str(caught.value)
    with pytest.raises(NotIdentifiable, match=r"identify none of the parameters: .*joint_1.*add a side pull"):
        identify(m900ib, readings, ["joint_compliance[joint_1]"])


def one_pose(experiment: Experiment, jitter: float, count: int = 6) -> Readings:
    """A few visits to one random pose, each with angles that differ by `jitter` rad."""
    rng = np.random.default_rng(3)
    controller = experiment.robot.controller
    pendant = np.tile(rng.uniform(controller.lower, controller.upper, 6) * 0.6, (count, 1))
    pendant += jitter * rng.uniform(-0.5, 0.5, pendant.shape)
    poses = Poses(pendant, controller.to_joints(pendant), np.tile(LOADS[2], (count, 1)))
    return simulate(experiment, make_plan(poses, ["side"] * count), seed=0).readings


def test_one_pose_that_could_be_fitted_is_refused_too(m900ib: Experiment) -> None:
    """Three markers at one random pose have full rank: without a second pose nothing could contradict the fit."""
    for options in (FitOptions(), FitOptions(linear=True)):
        with pytest.raises(NotIdentifiable, match="of one pose: 6 parameters would rest"):
            identify(m900ib, one_pose(m900ib, 1e-5), options=options)
    assert identify(m900ib, one_pose(m900ib, 0.1)).rank.full
    names = m900ib.fit_names()
    fit = identify(m900ib, one_pose(m900ib, 0.0), fit=names[1:2])
    assert "Only one pose was measured" in fit.notes[0]
    fixed = identify(m900ib, one_pose(m900ib, 0.0), options=FitOptions(fixed=names[1:]))
    assert any("Only one pose was measured" in n for n in fixed.notes)
    pivots = [f"gravity_compensator[joint_2].{side}" for side in ("lc", "l2")]
    known = identify(m900ib, one_pose(m900ib, 0.0), fit=[*names[1:2], *pivots])
    assert all(e.share is not None for e in known.estimates[1:]), "of these something is known before"
    assert any("Only one pose was measured" in n for n in known.notes)
    several = one_pose(m900ib, 0.1)
    with pytest.raises(NotIdentifiable, match="the only measurement is of one pose"):
        identify(m900ib, replace(several, use=several.plus == 2))


def test_positions_at_one_pose_are_refused(tmp_path: Path) -> None:
    (tmp_path / "experiment.yaml").write_text(ARM)
    wide = load_experiment(tmp_path / "experiment.yaml")
    states = measured(wide, wide.model().nominal, 8, TRACKER, 1)
    rows = np.isin(states.plus, np.arange(3))  # the three states of one pose
    with pytest.raises(NotIdentifiable, match=r"are of one pose.*beside the tracker's frame"):
        identify(wide, replace(states, use=rows), ["joint_compliance"])


def test_unequal_sigmas_of_the_two_states_give_the_exact_covariance(m900ib: Experiment) -> None:
    """cov(l1 - u, l2 - u) is the variance of the unloaded position, and that of another pose is zero."""
    states = measured(m900ib, m900ib.model().nominal, 2, BASE, 1)
    sigma = np.where(states.states.loaded[states.plus], 3.0 * SIGMA, SIGMA)
    readings = differences(with_sigma(states, sigma), m900ib)
    assert readings.sigma == pytest.approx(np.full((len(readings), 3), np.sqrt(10.0) * SIGMA))
    cov = dense(readings)
    m, K = len(cov), 3 * len(m900ib.markers)
    assert np.diag(cov) == pytest.approx(np.full(m, 10.0 * SIGMA**2))
    assert np.diag(cov[:K, K : 2 * K]) == pytest.approx(np.full(K, SIGMA**2))
    assert np.abs(cov[:K, 2 * K : 3 * K]).max() < 1e-9 * SIGMA**2


def test_differences_of_states_and_their_covariance(m900ib: Experiment) -> None:
    """Against the definition: displacements are T times positions, their covariance T T' sigma^2."""
    given = measured(m900ib, m900ib.model().nominal, 4, BASE, 5)
    K = len(m900ib.markers)
    readings = differences(given, m900ib)
    T = np.zeros((8 * K, 12 * K))
    for row in range(8 * K):
        m, k = divmod(row, K)
        pose, load = divmod(m, 2)
        T[row, (3 * pose + 1 + load) * K + k] = 1.0
        T[row, 3 * pose * K + k] = -1.0
    T3 = np.kron(T, np.eye(3))
    assert np.allclose(readings.value, T @ given.value, atol=1e-15)
    assert np.allclose(dense(readings), T3 @ T3.T * SIGMA**2, rtol=1e-9, atol=1e-9 * SIGMA**2)
    assert np.allclose(readings.sigma, SIGMA * np.sqrt(2.0))
    assert readings.line.tolist() == given.line[given.states.loaded[given.plus]].tolist()
