"""Plans that hardly tell a direction, and arms of forty parameters: stable ranks, honest sds, exact references."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numerics import SIGMA, campaign, candidates, few, noisy, poses, weighed, with_effects

from qsframework.estimation import FitOptions, Independent, Observations, rank_test, solve
from qsframework.experiment import Experiment, make_plan, on_robot, simulate
from qsframework.fits import EstimateState, identify
from qsframework.information import information_rows, predicted_sd
from qsframework.plans import DesignOptions, design
from qsframework.plans.criteria import Determinant, Linear
from qsframework.plans.problem import joint_sd
from qsframework.plugin import Array, Parameter, build_effects
from qsframework.plugin.facts import frozen


def exact_least_squares(A: Array, y: Array) -> tuple[list[Fraction], list[Fraction]]:
    """The solution of the normal equations and the diagonal of their inverse, in rational numbers: no rounding."""
    rows = [[Fraction(v) for v in row] for row in A.tolist()]
    right = [Fraction(v) for v in y.tolist()]
    p = A.shape[1]
    M = [[sum((r[i] * r[j] for r in rows), Fraction(0)) for j in range(p)] for i in range(p)]
    b = [sum((r[i] * v for r, v in zip(rows, right, strict=True)), Fraction(0)) for i in range(p)]
    inverse = rational_inverse(M)
    return [sum((inverse[i][j] * b[j] for j in range(p)), Fraction(0)) for i in range(p)], [
        inverse[i][i] for i in range(p)
    ]


def rational_inverse(M: Sequence[Sequence[Fraction]]) -> list[list[Fraction]]:
    """Gauss and Jordan in rational numbers."""
    p = len(M)
    work = [[*row, *(Fraction(int(i == j)) for j in range(p))] for i, row in enumerate(M)]
    for k in range(p):
        pivot = next(i for i in range(k, p) if work[i][k] != 0)
        work[k], work[pivot] = work[pivot], work[k]
        work[k] = [v / work[k][k] for v in work[k]]
        for i in range(p):
            if i != k and work[i][k] != 0:
                factor = work[i][k]
                work[i] = [v - factor * w for v, w in zip(work[i], work[k], strict=True)]
    return [row[p:] for row in work]


def nearly_singular(seed: int, gap: float, p: int = 3, m: int = 8) -> Array:
    """Rows (m, p) whose last column is the sum of the others but for `gap`, the columns of sizes far apart."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((m, p))
    A[:, -1] = A[:, :-1].sum(axis=1) + gap * rng.standard_normal(m)
    return A * 10.0 ** rng.uniform(-6, 6, p)


def observed(A: Array, y: Array, parameters: tuple[Parameter, ...], sigma: float) -> Observations:
    """A linear problem for the solver."""
    return Observations(
        measured=y,
        predict=lambda x: A @ x,
        jacobian=lambda x: A,
        parameters=parameters,
        noise=Independent(np.full(len(y), sigma)),
        block=np.arange(len(y)),
        row=np.arange(len(y)),
    )


@few(25)
@given(seed=st.integers(0, 10_000), power=st.floats(-7.5, 0.0))
def test_least_squares_agrees_with_rational_numbers(seed: int, power: float) -> None:
    """Values and sds of nearly singular problems: as close to the exact ones as the condition allows."""
    gap = 10.0**power
    A = nearly_singular(seed, gap)
    y = A @ np.array([1.0, -2.0, 0.5]) / np.linalg.norm(A, axis=0).max() + np.random.default_rng(seed).normal(size=8)
    size = np.linalg.norm(A, axis=0)
    parameters = tuple(Parameter(f"p{i}", "m", typical=float(1.0 / s)) for i, s in enumerate(size))
    found = solve(observed(A, y, parameters, 1.0), FitOptions(starts=0))
    values, variances = exact_least_squares(A, y)
    sds = np.sqrt([float(v) for v in variances])
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(sds, rel=1e-13 / gap + 1e-12)
    errors = np.abs(found.x - [float(v) for v in values])
    assert np.all(errors <= (1e-14 / gap + 1e-12) * np.abs([float(v) for v in values]) + 1e-9 * sds)


@few(25)
@given(seed=st.integers(0, 10_000), power=st.floats(-7.5, 0.0))
def test_the_nonlinear_solver_agrees_with_rational_numbers(seed: int, power: float) -> None:
    gap = 10.0**power
    A = nearly_singular(seed, gap)
    size = np.linalg.norm(A, axis=0)
    rng = np.random.default_rng(seed)
    y = A @ (np.array([1.0, -2.0, 0.5]) / size) + 1e-3 * rng.normal(size=8)
    parameters = tuple(Parameter(f"p{i}", "m", typical=float(1.0 / s)) for i, s in enumerate(size))
    found = solve(observed(A, y, parameters, 1e-3))
    _, variances = exact_least_squares(A, y)
    sds = 1e-3 * np.sqrt([float(v) for v in variances])
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(sds, rel=1e-13 / gap + 1e-10)


@few(40)
@given(seed=st.integers(0, 10_000), power=st.floats(-14.0, 0.0), scale=st.floats(-2.0, 2.0))
def test_a_direction_is_named_or_its_sd_is_large(seed: int, power: float, scale: float) -> None:
    """Never a silent small sd: either the rank test names the group, or the sd is that of the exact inverse."""
    gap = 10.0**power
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((8, 3))
    A[:, 2] = A[:, :2].sum(axis=1) + gap * rng.standard_normal(8)
    A[:, 1] *= 10.0**scale
    A[:, 2] += 0.0
    test = rank_test(A, ["a", "b", "c"])
    if test.full:
        _, variances = exact_least_squares(A, np.zeros(8))
        sds = np.sqrt([float(v) for v in variances])
        # the rank says "told" only where double precision can still tell how well
        assert np.linalg.norm(np.linalg.inv(np.linalg.qr(A, mode="r")), axis=1) == pytest.approx(sds, rel=1e-5)
        assert sds[2] > 0.05 / gap
    else:
        assert gap < 1e-6
        assert set(test.tied[0]) >= {"b", "c"} or not test.tied


def test_the_rank_does_not_flicker() -> None:
    """From regular to singular it changes once."""
    ranks = [rank_test(nearly_singular(3, 10.0**-k), ["a", "b", "c"]).rank for k in np.linspace(0, 16, 65)]
    assert ranks[0] == 3
    assert ranks[-1] == 2
    assert sum(a != b for a, b in pairwise(ranks)) == 1


def vertical_only(tilt: float) -> Experiment:
    """The campaign under one weight, tilted a little: joint 1 is told by the tilt alone."""
    load = replace(campaign().loads[0], wrench=frozen([0.0, 4000.0 * tilt, -4000.0, 0.0, 0.0, 0.0]))
    return campaign().with_(loads=(load,))


@pytest.mark.parametrize("power", [-1, -3, -5, -6, -7, -8, -9, -10, -12, -14])
def test_joint_1_under_a_vertical_load(power: int) -> None:
    """Its sd grows as the tilt falls, until it is named as not told: at no tilt is it silently small."""
    experiment = vertical_only(10.0**power)
    plan = make_plan(poses(experiment, 20), ["w"] * 20)
    sd = predicted_sd(experiment, plan)
    joint_1 = experiment.fit_names().index("joint_compliance[joint_1]")
    usual = predicted_sd(vertical_only(0.1), make_plan(poses(vertical_only(0.1), 20), ["w"] * 20))[joint_1]
    together = joint_sd(experiment, [plan])[joint_1]
    assert sd[joint_1] == np.inf or sd[joint_1] == pytest.approx(usual * 0.1 / 10.0**power, rel=0.05)
    assert together == np.inf or together == pytest.approx(usual * 0.1 / 10.0**power, rel=0.05)
    known = noisy(experiment, SIGMA)
    fit = identify(known, simulate(known, plan, seed=1).readings)
    if left := fit.not_estimated:
        assert [entry.name for entry in left] == ["joint_compliance[joint_1]"]
        assert power <= -5
        return
    there = weighed(simulate(noisy(experiment, 0.0), plan).readings, SIGMA)  # a fit ends where the plan's sd is taken
    assert identify(known, there).estimates[joint_1].sd == pytest.approx(sd[joint_1], rel=1e-9)
    assert power >= -9
    if power <= -5:
        assert fit.estimates[joint_1].state is EstimateState.NOT_IDENTIFIABLE


def forty() -> Experiment:
    """The campaign with geometry, off-axis, base and tool springs and a turned tracker, under four oblique loads."""
    stated = replace(campaign().robot.facts, bearings=(0.0,) * len(campaign().robot.facts.joints))
    arm = on_robot(campaign(), replace(campaign().robot, facts=stated))
    entries = (
        {"effect": "offaxis_compliance", "joints": "all", "axes": "all"},
        {"effect": "base_compliance", "directions": ["x", "y", "z", "rx", "ry", "rz"]},
        {"effect": "flange_compliance", "directions": ["x", "y", "z"]},
        {"effect": "tracker_frame"},
        {"effect": "joint_offset", "joints": "all"},
        {"effect": "joint_placement", "joints": ["joint_3", "joint_4"]},
    )
    effects = tuple(e for entry in entries for e in build_effects(entry, stated))
    wrenches = np.array([[0, 0, -4, 0, 0, 0], [2, 0, -3, 0.5, 0, 0], [0, 2, -3, 0, 0.5, 0], [1, -2, -2, 0, 0, 0.5]])
    loads = tuple(replace(campaign().loads[0], name=f"w{i}", wrench=frozen(1e3 * w)) for i, w in enumerate(wrenches))
    names = ["joint_compliance", *dict.fromkeys(e.effect_name() for e in effects)]
    return with_effects(arm, effects, names).with_(loads=loads)


def told_by(experiment: Experiment, count: int = 60) -> tuple[str, ...]:
    """The parameters that so many poses tell in the linear model, of tied ones the first.

    What only the bending of the arm tells apart is told by no campaign: its sd is 1e5 natural sizes.
    """
    names = experiment.fit_names()
    rows = information_rows(experiment.model(), poses(experiment, count), names, SIGMA, linear=True)
    rows = rows.reshape(-1, len(names))
    kept: list[int] = []
    for i in range(len(names)):
        if rank_test(rows[:, [*kept, i]], [names[j] for j in (*kept, i)]).full:
            kept.append(i)
    return tuple(names[i] for i in kept)


def test_forty_parameters_are_designed_for_and_identified() -> None:
    """Geometry, springs and the tracker's frame in one fit: the rank is reported, the truth found."""
    experiment = forty().with_(fit=told_by(forty()))
    names = experiment.fit_names()
    assert len(names) >= 40
    model = experiment.model()
    x = model.nominal
    chosen = model.index(names)
    x[chosen] += [0.3 * p.scale for p in experiment.fit_parameters()]
    quiet = noisy(experiment, 0.0)
    plan = make_plan(poses(experiment, 60), ["w"] * 60)
    fit = identify(quiet, simulate(quiet, plan, x=x).readings, options=FitOptions(free=True))
    assert fit.rank.rank == fit.rank.parameters == len(names)
    found = model.index(fit.names)
    sd = np.array([e.sd for e in fit.estimates])  # of readings that rounding alone spoils
    assert np.abs((fit.x[found] - x[found]) / sd).max() < 100.0
    error = np.abs(fit.x[chosen] - x[chosen]) / [p.scale for p in experiment.fit_parameters()]
    assert error.max() < 0.1
    designed = design(
        experiment, 30, candidates=candidates(), options=DesignOptions(criterion="D", polish=False, starts=1)
    )
    assert designed.certificate is not None
    assert designed.certificate.relaxed_efficiency > 0.9999
    assert 0.8 < designed.certificate.efficiency <= 1.0


def test_what_forty_parameters_cannot_tell_is_named() -> None:
    experiment = forty()
    plan = make_plan(poses(experiment, 60), ["w"] * 60)
    lost = [n for n, v in zip(experiment.fit_names(), predicted_sd(experiment, plan), strict=True) if np.isinf(v)]
    assert lost
    fit = identify(experiment, simulate(experiment, plan, seed=3).readings)
    left = {entry.name for entry in fit.not_estimated}
    assert left
    assert left <= set(lost), "what the fit leaves aside was foretold"
    assert all("confounded with" in entry.words() for entry in fit.not_estimated), "and what absorbs it is named"
    assert not left & set(fit.names)


@pytest.mark.parametrize("size", [1e-18, 1e-9, 1.0, 1e9])
@pytest.mark.parametrize("p", [6, 40])
def test_criteria_know_no_smallest_information(size: float, p: int) -> None:
    """A well-conditioned matrix is regular however small: many parameters, or a noise of metres."""
    rng = np.random.default_rng(p)
    A = rng.standard_normal((3 * p, p))
    M = size * A.T @ A
    determinant, trace = float(Determinant().value(M)), float(Linear().value(M))
    assert determinant == pytest.approx(float(Determinant().value(A.T @ A)) / size, rel=1e-9)
    assert trace == pytest.approx(float(Linear().value(A.T @ A)) / size, rel=1e-9)
    assert np.isinf(Determinant().value(M - np.outer(M[:, 0], M[0]) / M[0, 0] * (1 + 1e-9)))
