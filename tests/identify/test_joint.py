"""Positions with priors, losses, fixed and tied parameters, and positions with displacements in one fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.cli.identify import FitFiles, run_identify
from qsframework.elastostatics.so3 import exponential
from qsframework.errors import InputError
from qsframework.estimation import FitOptions, solve
from qsframework.experiment import (
    Experiment,
    Frame,
    Readings,
    load_experiment,
    make_plan,
    observation_model,
    read_readings,
    simulate,
    write_readings,
)
from qsframework.experiment.readings import joined
from qsframework.fits import EstimateState, identify
from qsframework.plugin import Array, Parameter, Poses
from tests.identify.arm import arm_text, position_readings, spoilt

ARM = arm_text(
    "0.02",
    more="""effects:
  - {effect: joint_offset, joints: [joint_2, joint_4]}
""",
    point="281, 0, 243",
)
APART = ARM.replace("{sigma_mm: 0.02}", "{displacement_sigma_mm: 0.02, position_sigma_mm: 0.02}")
TRACKER = Frame("", exponential(np.array([0.3, -1.2, 2.0])), np.array([1.0, -2.0, 0.5]))
NAMES = ["joint_compliance", "joint_offset"]
SIGMA = 2e-5
WRENCH = np.array([0.0, 1500.0, -3000.0, 0.0, 0.0, 0.0])
KEEP = FitOptions(keep_all=True)


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    file = tmp_path_factory.mktemp("arm") / "experiment.yaml"
    file.write_text(ARM)
    return load_experiment(file)


def true_x(arm: Experiment) -> Array:
    model, x = arm.model(), arm.model().nominal
    index = model.index(arm.with_(fit=tuple(NAMES)).fit_names())
    scale = np.array([model.parameters[i].scale for i in index])
    x[index] += 0.3 * scale * np.random.default_rng(7).uniform(-1, 1, len(index))
    return x


def drawn(arm: Experiment, count: int, seed: int) -> Poses:
    controller = arm.robot.controller
    pendant = np.random.default_rng(seed).uniform(controller.lower, controller.upper, (count, 6)) * 0.6
    return Poses(pendant, controller.to_joints(pendant), np.tile(WRENCH, (count, 1)))


def positions(arm: Experiment, x: Array, count: int, seed: int) -> Readings:
    """Each pose loaded and unloaded, in the tracker's frame."""
    one, model = drawn(arm, count, 3), arm.model()
    both = np.stack([model.positions(one, x, flag) for flag in (False, True)], axis=1)
    seen = TRACKER.apply(both.reshape(2 * count, -1, 3))
    seen = seen + SIGMA * np.random.default_rng(seed).standard_normal(seen.shape)
    poses, loaded = one.take(np.repeat(np.arange(count), 2)), np.tile([False, True], count)
    return position_readings(poses, loaded, seen, SIGMA, pose=[str(i // 2) for i in range(2 * count)])


def displacements(arm: Experiment, x: Array, count: int, seed: int) -> Readings:
    return simulate(arm, make_plan(drawn(arm, count, 4), ["pull"] * count), x, seed=seed).readings


def test_both_kinds_tell_more_than_either_and_the_truth(arm: Experiment) -> None:
    x = true_x(arm)
    model = arm.model()
    z, squares, dof = [], [], 0
    for seed in range(6):
        p, d = positions(arm, x, 10, seed), displacements(arm, x, 10, 100 + seed)
        fit = identify(arm, joined([p, d]), NAMES, KEEP)
        alone = {e.name: e.sd for e in identify(arm, p, NAMES, KEEP).estimates}
        springs = {e.name: e.sd for e in identify(arm, d, ["joint_compliance"], KEEP).estimates}
        for e in fit.estimates[6:]:
            assert e.sd < 0.999 * min(alone[e.name], springs.get(e.name, np.inf))
        z += [(e.value - x[model.index([e.name])[0]]) / e.sd for e in fit.estimates[6:]]
        squares.append(fit.chi2)
        assert fit.position.sum() == len(p)
        dof = fit.dof
        assert dof == 3 * (len(p) + len(d)) - 12, "the frame and the springs: of zeros something is known before"
    assert np.abs(z).max() < 4.0
    assert np.mean(np.square(z)) == pytest.approx(1.0, abs=0.6)
    assert abs(np.mean(squares) - dof) < 4.0 * np.sqrt(2.0 * dof / 6)


def test_derivatives_at_the_solution_and_as_many_digits_as_the_readings_have(arm: Experiment) -> None:
    """Positions with and without load, and displacements; a step that rounding hides is no reason not to settle."""
    x = true_x(arm)
    both = joined([positions(arm, x, 10, 1), displacements(arm, x, 10, 101)])
    seen = observation_model(arm, both, arm.with_(fit=tuple(NAMES)).fit_names(), linear=True)
    o = seen.observations()
    best = solve(o, start=seen.start, tolerance=1e-6)
    J = o.jacobian(best.x)
    assert o.predict(best.x) == pytest.approx(seen.predict(best.x), rel=1e-13, abs=1e-15)
    for i, p in enumerate(o.parameters):
        step = np.zeros(len(best.x))
        step[i] = 0.1 * p.scale
        one, two = ((o.predict(best.x + k * step) - o.predict(best.x - k * step)) / step[i] for k in (1, 2))
        slope = (8.0 * one - two) / 12.0
        assert np.linalg.norm(J[:, i] - slope) < 1e-9 * np.linalg.norm(slope), p.name
    again = solve(o, start=seen.start, tolerance=1e-10)
    assert again.iterations < 8
    assert again.cost == pytest.approx(best.cost, rel=1e-9)


def test_fixed_and_tied(arm: Experiment) -> None:
    p = positions(arm, true_x(arm), 10, 1)
    names = [n for n in arm.with_(fit=("joint_compliance",)).fit_names() if "joint_compliance" in n]
    fixed, pair = names[0], (names[3], names[4])
    fit = identify(arm, p, NAMES, replace(KEEP, fixed=(fixed,), tied=(pair,)))
    model = arm.model()
    assert [e.name for e in fit.estimates if e.state is EstimateState.FIXED] == [fixed]
    assert fit.x[model.index([fixed])] == model.nominal[model.index([fixed])]
    at = model.index(list(pair))
    assert fit.x[at[0]] / fit.x[at[1]] == pytest.approx(model.nominal[at[0]] / model.nominal[at[1]], rel=1e-9)
    free = identify(arm, p, NAMES, KEEP)
    assert fit.chi2 > free.chi2 + 10.0  # the truth keeps neither
    assert fit.dof == free.dof + 2


def test_priors_are_readings(arm: Experiment) -> None:
    """Information adds: the inverse covariance is that of the readings and that of the priors."""
    p, x = positions(arm, true_x(arm), 10, 1), true_x(arm)
    model = arm.model()

    def stated(q: Parameter) -> Parameter:
        """As well known as by the readings, and by chance a sd off."""
        own = q.name.startswith("joint_offset")
        return replace(q, nominal=float(x[model.index([q.name])[0]]) + 5e-6, sd=5e-6) if own else q

    known = arm.with_(parameters=tuple(stated(q) for q in arm.parameters))
    with_, without = (identify(known, p, NAMES, replace(KEEP, free=flag)) for flag in (False, True))
    assert [e.prior_sd for e in with_.estimates if e.share is not None] == [5e-6, 5e-6]
    assert all(0.1 < e.share < 0.9 for e in with_.estimates if e.share is not None)
    assert with_.dof == without.dof + 2
    prior = np.diag([0.0 if e.counted_sd is None else 1.0 / e.counted_sd**2 for e in with_.estimates])
    assert prior.any()
    scale = np.sqrt(np.diag(without.covariance))
    told = np.linalg.inv(np.linalg.inv(without.covariance / np.outer(scale, scale)) + prior * np.outer(scale, scale))
    assert np.allclose(with_.covariance / np.outer(scale, scale), told, atol=5e-3)


def test_a_robust_loss_resists_what_is_too_small_to_be_masked(arm: Experiment) -> None:
    x = true_x(arm)
    p = positions(arm, x, 14, 2)
    wrong = np.random.default_rng(0).choice(len(p.use), 10, replace=False)
    spoiled = spoilt(p, wrong, 5.0 * SIGMA * np.ones(3))
    error = {}
    clean = identify(arm, p, NAMES, KEEP).estimates[6:]
    for loss in ("linear", "huber"):
        fit = identify(arm, spoiled, NAMES, replace(KEEP, loss=loss))
        truth = x[arm.model().index(list(fit.names[6:]))]
        pairs = zip(fit.estimates[6:], truth, clean, strict=True)
        error[loss] = np.mean([((e.value - t) / c.sd) ** 2 for e, t, c in pairs])
    assert error["huber"] < error["linear"]


def test_the_command_takes_several_files_in_one_fit(
    arm: Experiment, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    x = true_x(arm)
    write_readings(tmp_path / "d.csv", displacements(arm, x, 8, 1), arm)
    write_readings(tmp_path / "p.csv", positions(arm, x, 8, 1), arm)
    (tmp_path / "experiment.yaml").write_text(APART)
    files = FitFiles(
        experiment=tmp_path / "experiment.yaml",
        data=(tmp_path / "p.csv", tmp_path / "d.csv"),
        json=tmp_path / "fit.json",
        report=tmp_path / "r.html",
    )
    run_identify(files, NAMES, FitOptions(), False)
    said = capsys.readouterr().out
    assert "displacements, 3D RMS" in said
    assert "positions, 3D RMS" in said
    assert (tmp_path / "r.html").stat().st_size > 10_000
    run_identify(replace(files, data=(tmp_path / "p.csv",), report=None), NAMES, FitOptions(free=True), False)
    assert "Nothing counted as known before the readings" in capsys.readouterr().out


def test_bad_words(arm: Experiment, tmp_path: Path) -> None:
    x = true_x(arm)
    p, d = positions(arm, x, 8, 1), displacements(arm, x, 8, 1)
    with pytest.raises(InputError, match=r"Did you mean 'joint_compliance\[joint_3\]'"):
        identify(arm, p, NAMES, FitOptions(fixed=("joint_compliance[joint3]",)))
    for name, readings in (("p.csv", p), ("d.csv", d)):
        write_readings(tmp_path / name, replace(readings, stated=False), arm)
    both = [tmp_path / "p.csv", tmp_path / "d.csv"]
    geometry = arm.with_(fit=tuple(NAMES))
    unknown = geometry.with_(noise=replace(arm.noise, sigma=None))
    with pytest.raises(InputError, match="the sd of displacements and positions is not stated"):
        read_readings(both, unknown)
    with pytest.raises(InputError, match="sigma_mm does not say of which kind of reading it is"):
        read_readings(both, geometry)
