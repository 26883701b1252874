"""Positions with priors, losses, fixed and tied parameters, and positions with displacements in one fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.cli.identify import FitFiles, How, run_identify
from qsframework.errors import InputError
from qsframework.experiment import (
    Experiment,
    Readings,
    StateReadings,
    load_experiment,
    make_plan,
    simulate,
    write_readings,
)
from qsframework.identify import Choices, identify, identify_jointly, identify_positions
from qsframework.identify.absolute import fit_order
from qsframework.identify.frames import Frame, rotation
from qsframework.identify.joint import _data
from qsframework.identify.solve import solve
from qsframework.plugin import Array, Poses
from tests.identify.arm import arm_text

ARM = arm_text(
    "0.02",
    more="""effects:
  - {effect: joint_offset, joints: [joint_2, joint_4]}
""",
    point="281, 0, 243",
)
TRACKER = Frame("", rotation(np.array([0.3, -1.2, 2.0])), np.array([1.0, -2.0, 0.5]))
NAMES = ["joint_compliance", "joint_offset"]
SIGMA = 2e-5
WRENCH = np.array([0.0, 1500.0, -3000.0, 0.0, 0.0, 0.0])


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


def positions(arm: Experiment, x: Array, count: int, seed: int) -> StateReadings:
    """Each pose loaded and unloaded, in the tracker's frame."""
    one, model = drawn(arm, count, 3), arm.model()
    poses = one.take(np.repeat(np.arange(count), 2))
    loaded = np.tile([False, True], count)
    both = np.stack([model.positions(one, x, flag) for flag in (False, True)], axis=1)
    seen = TRACKER.apply(both.reshape(2 * count, -1, 3))
    position = (seen + SIGMA * np.random.default_rng(seed).standard_normal(seen.shape)).reshape(-1, 3)
    states, rows, ones = 2 * count, len(position), np.ones(2 * count, dtype=np.intp)
    return StateReadings(
        poses, loaded, tuple(str(i // 2) for i in range(states)), ("",) * states, ("",) * states, ones, ones,
        np.repeat(np.arange(states), 3), np.tile(np.arange(3), states), position, np.full(rows, np.nan),
        np.ones(rows, dtype=bool), np.arange(2, 2 + rows), None, None,
    )  # fmt: skip


def displacements(arm: Experiment, x: Array, count: int, seed: int) -> Readings:
    plan = make_plan(drawn(arm, count, 4), ["pull"] * count)
    readings = simulate(arm, plan, seed=0).readings
    exact = arm.model().predict(readings.poses, x)[readings.measurement, readings.marker]
    return replace(readings, displacement=exact + SIGMA * np.random.default_rng(seed).standard_normal(exact.shape))


def test_both_kinds_tell_more_than_either_and_the_truth(arm: Experiment) -> None:
    x = true_x(arm)
    model = arm.model()
    z, squares, dof = [], [], 0
    for seed in range(6):
        p, d = positions(arm, x, 10, seed), displacements(arm, x, 10, 100 + seed)
        fit = identify_jointly(arm, p, NAMES, d)
        alone = {e.name: e.sd for e in identify_positions(arm, p, NAMES).estimates}
        springs = {e.name: e.sd for e in identify(arm, d, ["joint_compliance"]).estimates}
        for e in fit.estimates[6:]:
            assert e.sd < 0.999 * min(alone[e.name], springs.get(e.name, np.inf))
        z += [(e.value - x[model.index([e.name])[0]]) / e.sd for e in fit.estimates[6:]]
        squares.append(fit.chi2)
        assert fit.method == "joint"
        assert fit.displaced == len(d.use)
        dof = fit.dof
        assert dof == 3 * (len(p.use) + len(d.use)) - len(fit.estimates)
    assert np.abs(z).max() < 4.0
    assert np.mean(np.square(z)) == pytest.approx(1.0, abs=0.6)
    assert abs(np.mean(squares) - dof) < 4.0 * np.sqrt(2.0 * dof / 6)


def test_derivatives_at_the_solution_and_as_many_digits_as_the_readings_have(arm: Experiment) -> None:
    """Positions with and without load, and displacements; a step that rounding hides is no reason not to settle."""
    x = true_x(arm)
    experiment = arm.with_(fit=tuple(NAMES))
    data = _data(experiment, positions(arm, x, 10, 1), displacements(arm, x, 10, 101))
    names = [n for n in fit_order(experiment) if n in data.plain.names]
    o = data.observations(data.plain.x.copy(), names)
    start = np.concatenate([np.zeros(6), data.plain.x[arm.model().index(names)]])
    best = solve(o, start, tolerance=1e-6, starts=0)
    J = o.jacobian(best.x)
    for i, p in enumerate(o.parameters):
        step = np.zeros(len(best.x))
        step[i] = 0.1 * p.scale
        one, two = ((o.predict(best.x + k * step) - o.predict(best.x - k * step)) / step[i] for k in (1, 2))
        slope = (8.0 * one - two) / 12.0
        assert np.linalg.norm(J[:, i] - slope) < 1e-9 * np.linalg.norm(slope), p.name
    again = solve(
        o, start, tolerance=1e-10, starts=0
    )  # steps that gain less than rounding were refused: 200, and stuck
    assert again.iterations < 8
    assert again.cost == pytest.approx(best.cost, rel=1e-9)


def test_without_choices_it_is_the_plain_fit(arm: Experiment) -> None:
    p = positions(arm, true_x(arm), 10, 1)
    plain, fit = identify_positions(arm, p, NAMES), identify_jointly(arm, p, NAMES)
    assert fit.names == plain.names
    sd = np.array([e.sd for e in plain.estimates])
    assert np.allclose([e.sd for e in fit.estimates], sd, rtol=2e-3)
    assert (
        np.abs(np.array([e.value - o.value for e, o in zip(fit.estimates, plain.estimates, strict=True)]) / sd).max()
        < 0.02
    )
    assert np.allclose(fit.studentised, plain.studentised, atol=0.05)
    assert np.allclose(fit.left_out, plain.left_out, atol=0.05 * SIGMA)


def test_fixed_and_tied(arm: Experiment) -> None:
    p = positions(arm, true_x(arm), 10, 1)
    names = [n for n in arm.with_(fit=("joint_compliance",)).fit_names() if "joint_compliance" in n]
    fixed, pair = names[0], (names[3], names[4])
    fit = identify_jointly(arm, p, NAMES, how=Choices(fixed=(fixed,), tied=(pair,)))
    model = arm.model()
    assert fixed not in fit.names
    assert fit.x[model.index([fixed])] == model.nominal[model.index([fixed])]
    at = model.index(list(pair))
    assert fit.x[at[0]] / fit.x[at[1]] == pytest.approx(model.nominal[at[0]] / model.nominal[at[1]], rel=1e-9)
    free = identify_jointly(arm, p, NAMES)
    assert fit.chi2 > free.chi2 + 10.0  # the truth keeps neither
    assert fit.dof == free.dof + 2


def test_priors_are_readings(arm: Experiment) -> None:
    """Information adds: the inverse covariance is that of the readings and that of the priors."""
    p = positions(arm, true_x(arm), 10, 1)
    with_, without = (identify_jointly(arm, p, NAMES, how=Choices(priors=flag)) for flag in (True, False))
    known = arm.model().parameters
    sd = {q.name: q.sd for q in known if q.sd is not None}
    prior = np.diag([0.0 if n not in sd else 1.0 / sd[n] ** 2 for n in with_.names])
    assert prior.any()
    scale = np.sqrt(np.diag(without.covariance))
    told = np.linalg.inv(np.linalg.inv(without.covariance / np.outer(scale, scale)) + prior * np.outer(scale, scale))
    assert np.allclose(with_.covariance / np.outer(scale, scale), told, atol=5e-3)


def test_a_robust_loss_resists_what_is_too_small_to_be_masked(arm: Experiment) -> None:
    x = true_x(arm)
    p = positions(arm, x, 14, 2)
    rng = np.random.default_rng(0)
    wrong = rng.choice(len(p.use), 10, replace=False)
    position = np.array(p.position)
    position[wrong] += 5.0 * SIGMA * np.array([1.0, 1.0, 1.0])
    p = replace(p, position=position)
    error = {}
    clean = identify_positions(arm, positions(arm, x, 14, 2), NAMES).estimates[6:]
    for loss in ("linear", "huber"):
        fit = identify_jointly(arm, p, NAMES, how=Choices(loss=loss))
        truth = x[arm.model().index(list(fit.names[6:]))]
        pairs = zip(fit.estimates[6:], truth, clean, strict=True)
        error[loss] = np.mean([((e.value - t) / c.sd) ** 2 for e, t, c in pairs])
    assert error["huber"] < error["linear"]


def test_the_command(arm: Experiment, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    x = true_x(arm)
    write_readings(tmp_path / "d.csv", displacements(arm, x, 8, 1), arm)
    p = positions(arm, x, 8, 1)
    head = "pose,state,fx_N,fy_N,fz_N,marker,x_mm,y_mm,z_mm," + ",".join(f"q{i + 1}_deg" for i in range(6))
    lines = [head]
    names = [m for m in ("m1", "m2", "m3")]
    for i, m in enumerate(p.measurement):
        force = WRENCH[:3] if p.loaded[m] else np.zeros(3)
        values = [p.pose[m], "loaded" if p.loaded[m] else "unloaded", *force.tolist(), names[p.marker[i]],
                  *(p.position[i] * 1e3).tolist(), *np.degrees(p.poses.pendant[m]).tolist()]  # fmt: skip
        lines.append(",".join(map(str, values)))
    (tmp_path / "p.csv").write_text("\n".join(lines) + "\n")
    files = FitFiles(
        arm.path, tmp_path / "d.csv", tmp_path / "fit.json", tmp_path / "r.html", positions=tmp_path / "p.csv"
    )
    run_identify(files, How(NAMES))
    said = capsys.readouterr().out
    assert "48 positions and 24 displacements in one fit" in said
    assert "displacements, identified" in said
    assert '"joint"' in (tmp_path / "fit.json").read_text()
    assert (tmp_path / "r.html").stat().st_size > 10_000
    run_identify(FitFiles(arm.path, tmp_path / "p.csv"), How(NAMES, priors=True))
    assert "Stated values and sds counted as readings" in capsys.readouterr().out
    for method in ("linear", "two-step"):
        with pytest.raises(InputError, match=f"method {method} is for displacements alone.*Leave --method out"):
            run_identify(FitFiles(arm.path, tmp_path / "p.csv"), How(NAMES, method))
    with pytest.raises(InputError, match="--positions needs absolute positions"):
        run_identify(FitFiles(arm.path, tmp_path / "d.csv", positions=tmp_path / "d.csv"), How(NAMES))
    with pytest.raises(InputError, match="holds positions too"):
        run_identify(FitFiles(arm.path, tmp_path / "p.csv", positions=tmp_path / "p.csv"), How(NAMES))


def test_bad_words(arm: Experiment) -> None:
    p, d = positions(arm, true_x(arm), 8, 1), displacements(arm, true_x(arm), 8, 1)
    with pytest.raises(InputError, match=r"Did you mean 'joint_compliance\[joint_3\]'"):
        identify_jointly(arm, p, NAMES, how=Choices(fixed=("joint_compliance[joint3]",)))
    unknown = arm.with_(noise=replace(arm.noise, sigma=None))
    d = replace(d, sigma=np.full(len(d.sigma), np.nan))
    with pytest.raises(InputError, match="the sd of the positions and of the displacements is not stated"):
        identify_jointly(unknown, p, NAMES, d)
