"""States with and without load: as differences with their covariance, and as absolute positions in one fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.cli.identify import FitFiles, How, run_identify
from qsframework.errors import InputError, NotIdentifiable
from qsframework.experiment import (
    Experiment,
    Readings,
    StateReadings,
    load_experiment,
    make_plan,
    simulate,
    write_states,
)
from qsframework.identify import identify, identify_positions
from qsframework.identify.differences import differences
from qsframework.identify.fit_files import read_fit
from qsframework.identify.frames import Frame, rotation, rotation_vector
from qsframework.identify.linear import fit_rows
from qsframework.plugin import Array, Conditions, Poses
from tests.identify.arm import arm_text

SIGMA = 0.02e-3
LOADS = np.array([[0, 0, 0, 0, 0, 0], [0, 0, -4000.0, 0, 0, 0], [0, 1500.0, -4000, 0, 0, 0]])
BASE = Frame("", np.eye(3), np.zeros(3))
TRACKER = Frame("", rotation(np.array([0.3, -1.2, 2.0])), np.array([1.0, -2.0, 0.5]))


def measured(experiment: Experiment, x: Array, poses: int, frame: Frame, seed: int) -> StateReadings:
    """Each pose unloaded and under two loads, all markers."""
    rng = np.random.default_rng(seed)
    controller = experiment.robot.controller
    pendant = np.repeat(rng.uniform(controller.lower, controller.upper, (poses, 6)) * 0.7, 3, axis=0)
    wrench = np.tile(LOADS, (poses, 1))
    loaded = np.tile([False, True, True], poses)
    N, K = 3 * poses, len(experiment.markers)
    all_ = Poses(pendant, controller.to_joints(pendant), wrench, Conditions(), Conditions())
    model = experiment.model()
    points = np.where(loaded[:, None, None], model.positions(all_, x, True), model.positions(all_, x, False))
    seen = frame.apply(points.reshape(-1, 3)) + SIGMA * rng.standard_normal((N * K, 3))
    ones = np.ones(N, dtype=np.intp)
    return StateReadings(
        all_, loaded, tuple(f"p{i // 3}" for i in range(N)), ("", "weight", "side") * poses, ("",) * N, ones, ones,
        np.repeat(np.arange(N), K), np.tile(np.arange(K), N), seen, np.full(N * K, SIGMA),
        np.ones(N * K, dtype=bool), np.arange(2, 2 + N * K), None, None,
    )  # fmt: skip


def test_the_command_fits_differences_with_their_covariance(m900ib: Experiment, tmp_path) -> None:  # type: ignore[no-untyped-def]
    x = m900ib.model().nominal
    write_states(tmp_path / "s.csv", measured(m900ib, x, 8, BASE, 1), m900ib)
    run_identify(FitFiles(m900ib.path, tmp_path / "s.csv", tmp_path / "fit.json"), How(differences=True))
    fit = read_fit(tmp_path / "fit.json")
    assert fit.sigma == pytest.approx(np.sqrt(2.0) * SIGMA)
    truth = x[m900ib.model().index(fit.names)]
    assert np.all(np.abs(fit.values - truth) < 4.0 * fit.sd)
    assert abs(fit.chi2 - fit.dof) < 4.0 * np.sqrt(2.0 * fit.dof)
    assert fit.dof == 8 * 2 * 3 * len(m900ib.markers) - len(fit.names)
    with pytest.raises(InputError, match="count as displacements with --differences"):
        run_identify(FitFiles(m900ib.path, tmp_path / "s.csv"), How(shared_error=True))


ARM = arm_text(
    "0.02",
    more="""effects:
  - {effect: joint_offset, joints: [joint_2, joint_4]}
""",
)


def test_positions_with_loaded_states_tell_springs_zeros_and_the_frame(tmp_path: Path) -> None:
    (tmp_path / "experiment.yaml").write_text(ARM)
    wide = load_experiment(tmp_path / "experiment.yaml")
    names = ["joint_compliance", "joint_offset"]
    model, x = wide.model(), wide.model().nominal
    index = model.index(wide.with_(fit=tuple(names)).fit_names())
    scale = np.array([model.parameters[i].scale for i in index])
    x[index] += 0.3 * scale * np.random.default_rng(7).uniform(-1, 1, len(index))
    squares, z, dof = [], [], 0
    for seed in range(12):
        fit = identify_positions(wide, measured(wide, x, 12, TRACKER, seed), names)
        assert not fit.left_aside
        truth = x[model.index([e.name for e in fit.estimates[6:]])]
        z += [(e.value - t) / e.sd for e, t in zip(fit.estimates[6:], truth, strict=True)]
        frame = fit.frames[0]
        turn = rotation_vector(frame.rotation @ TRACKER.rotation.T)
        z += list(np.concatenate([frame.origin - TRACKER.origin, turn]) / [e.sd for e in fit.estimates[:6]])
        squares.append(fit.chi2)
        dof = fit.dof
    assert np.abs(z).max() < 4.0
    assert np.mean(np.square(z)) == pytest.approx(1.0, abs=0.5)
    assert abs(np.mean(squares) - dof) < 4.0 * np.sqrt(2.0 * dof / 12)


def test_the_experiments_sigma_is_that_of_one_position_for_both_commands(tmp_path: Path) -> None:
    """One state file, the noise stated in the experiment only: chi-square is right as positions and as differences."""
    (tmp_path / "experiment.yaml").write_text(ARM)
    arm = load_experiment(tmp_path / "experiment.yaml")
    names = ["joint_compliance"]
    count = 20
    squares: dict[str, list[float]] = {"positions": [], "differences": []}
    dofs: dict[str, int] = {}
    for seed in range(count):
        states = measured(arm, arm.model().nominal, 8, BASE, 100 + seed)
        states = replace(states, sigma=np.full(len(states.sigma), np.nan))
        displaced = differences(states, arm)[0]
        fits = {"positions": identify_positions(arm, states, names), "differences": identify(arm, displaced, names)}
        for kind, fit in fits.items():
            assert fit.sigma_source == "stated"
            squares[kind].append(fit.chi2)
            dofs[kind] = fit.dof
        assert fits["positions"].sigma == pytest.approx(SIGMA)
        assert fits["differences"].sigma == pytest.approx(np.sqrt(2.0) * SIGMA)
    for kind, dof in dofs.items():
        assert abs(np.mean(squares[kind]) - dof) < 4.0 * np.sqrt(2.0 * dof / count), (kind, np.mean(squares[kind]), dof)


def test_poses_all_equal_are_refused_with_what_would_help(m900ib: Experiment) -> None:
    controller = m900ib.robot.controller
    pendant = np.tile(np.deg2rad([10.0, 20.0, -10.0, 30.0, -40.0, 20.0]), (8, 1))
    poses = Poses(pendant, controller.to_joints(pendant), np.tile(LOADS[1], (8, 1)))
    readings = simulate(m900ib, make_plan(poses, ["weight"] * 8), seed=0).readings
    for method in ("linear", "one-step"):
        with pytest.raises(NotIdentifiable, match="cannot tell the parameters") as caught:
            identify(m900ib, readings, method=method)
        assert "joint_1" in str(caught.value)
        assert "add" in str(caught.value) or "measure" in str(caught.value), str(caught.value)


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
    for method in ("linear", "one-step"):
        with pytest.raises(NotIdentifiable, match="all 6 measurements are of one pose: 6 parameters would rest"):
            identify(m900ib, one_pose(m900ib, 1e-5), method=method)
    assert identify(m900ib, one_pose(m900ib, 0.1)).rank.full
    names = m900ib.fit_names()
    fit = identify(m900ib, one_pose(m900ib, 0.0), fit=names[1:2])
    assert "Only one pose was measured" in fit.notes[0]
    fixed = identify(m900ib, one_pose(m900ib, 0.0), method="one-step", fixed=names[1:])
    assert "Only one pose was measured" in fixed.notes[0]
    assert "Only one pose was measured" in identify(m900ib, one_pose(m900ib, 0.0), None, "one-step", True).notes[0]
    masked = one_pose(m900ib, 0.1)
    with pytest.raises(NotIdentifiable, match="the only measurement is of one pose"):
        identify(m900ib, replace(masked, use=masked.measurement == 2))


def test_positions_at_one_pose_are_refused(tmp_path: Path) -> None:
    (tmp_path / "experiment.yaml").write_text(ARM)
    wide = load_experiment(tmp_path / "experiment.yaml")
    states = measured(wide, wide.model().nominal, 8, TRACKER, 1)
    at = np.arange(3)  # the three states of one pose
    rows = np.isin(states.measurement, at)
    with pytest.raises(NotIdentifiable, match=r"are of one pose.*beside the tracker's frame"):
        identify_positions(wide, replace(states, use=rows), ["joint_compliance"])


def test_unequal_sigmas_of_the_two_states_give_the_exact_covariance(m900ib: Experiment) -> None:
    """cov(l1 - u, l2 - u) is the variance of the unloaded position, and that of another pose is zero."""
    states = measured(m900ib, m900ib.model().nominal, 2, BASE, 1)
    sigma = np.where(states.loaded[states.measurement], 3.0 * SIGMA, SIGMA)
    readings, noise = differences(replace(states, sigma=sigma), m900ib)
    assert readings.sigma == pytest.approx(np.full(len(readings.use), np.sqrt(10.0) * SIGMA))
    m = 3 * len(readings.use)
    white = noise.whiten(np.eye(m))
    cov = np.linalg.inv(white.T @ white)
    K = 3 * len(m900ib.markers)
    assert np.diag(cov) == pytest.approx(np.full(m, 10.0 * SIGMA**2))
    assert np.diag(cov[:K, K : 2 * K]) == pytest.approx(np.full(K, SIGMA**2))
    assert np.abs(cov[:K, 2 * K : 3 * K]).max() < 1e-9 * SIGMA**2
    used = fit_rows(m900ib, readings, 6)[0].noise.whiten(np.eye(m))
    assert np.linalg.inv(used.T @ used) == pytest.approx(cov, abs=1e-9 * SIGMA**2)  # the fit weighs with the same


def test_sigmas_are_given_for_all_rows_or_for_none(m900ib: Experiment) -> None:
    states = measured(m900ib, m900ib.model().nominal, 2, BASE, 1)
    quiet = m900ib.with_(noise=replace(m900ib.noise, sigma=None))
    some = np.where(np.arange(len(states.use)) < 4, np.nan, SIGMA)
    with pytest.raises(InputError, match="some rows have no sigma_mm and the experiment states no noise"):
        differences(replace(states, sigma=some), quiet)
    readings, _ = differences(replace(states, sigma=some), m900ib)
    assert np.isfinite(readings.sigma).all(), "the experiment's noise fills the gaps"
