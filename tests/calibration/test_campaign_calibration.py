"""What fits of campaigns, plans and predictions state, against draws of campaigns of a three-joint arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.elastostatics import equilibrium
from qsframework.elastostatics.so3 import rotation_vector
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import (
    Experiment,
    LoadUncertainty,
    Plan,
    Readings,
    load_experiment,
    make_plan,
    read_readings,
    simulate,
)
from qsframework.experiment.readings import joined
from qsframework.experiment.simulate import planned_readings
from qsframework.fits import Fit, identify
from qsframework.information import predicted_uncertainties
from qsframework.plugin import Array, Poses
from qsframework.uses import compensate, joint_targets
from tests.calibration.agreement import balanced, check_coverage, check_p_values, check_sds
from tests.calibration.small_arm import SIGMA, SPRINGS, TRACKER, WEIGHT, acting, positions, small_arm, small_plan

LINEAR = FitOptions(linear=True, keep_all=True)


@pytest.fixture
def arm(tmp_path: Path) -> Experiment:
    return small_arm(tmp_path)


def truth(fit: Fit) -> Array:
    return fit.model.nominal[fit.model.index(fit.names)]


def drawn_fits(experiment: Experiment, exact: Readings, errors: Array, options: FitOptions = LINEAR) -> list[Fit]:
    """Fits of exact readings with errors (n, R, 3), m."""
    return [identify(experiment, exact.with_values(exact.value + e), options=options) for e in errors]


def of_noise(exact: Readings, seed: int = 0) -> Array:
    """Balanced errors (n, R, 3) m of one sd."""
    return SIGMA * balanced(exact.value.size, np.random.default_rng(seed)).reshape(-1, *exact.value.shape)


def errors_of(fits: list[Fit]) -> Array:
    return np.array([fit.values - truth(fit) for fit in fits])


def rms_sd(fits: list[Fit]) -> Array:
    return np.sqrt(np.mean([fit.sd**2 for fit in fits], axis=0))


@pytest.mark.parametrize("stated", [True, False])
def test_sds_of_springs(tmp_path: Path, stated: bool) -> None:
    """And what a plan predicts of them, the tangent model's within what the model bends."""
    arm = small_arm(tmp_path, "{sigma_mm: 0.03}" if stated else "estimate")
    plan = small_plan(arm, 5)
    exact = planned_readings(small_arm(tmp_path), plan, linear=True)
    exact = exact if stated else replace(exact, stated=False)
    fits = drawn_fits(arm, exact, of_noise(exact))
    check_sds(errors_of(fits), rms_sd(fits), allowed=1e-3)
    if stated:
        check_sds(errors_of(fits), np.array([p.sd for p in predicted_uncertainties(arm, plan)]), allowed=0.01)
    chi2 = np.mean([fit.chi2 / fit.dof for fit in fits])
    assert chi2 == pytest.approx(1.0, rel=1e-6)


def test_predicted_sds_of_a_plan_with_a_gauge(tmp_path: Path) -> None:
    """Under one of its loads a dial gauge reads one direction of one marker."""
    loads = "[{name: down, fz_N: -2000}, {name: side, fz_N: -1200, fy_N: 900, gauge: {marker: m1, along: [0, 1, 0]}}]"
    arm = small_arm(tmp_path, loads=loads)
    plan = small_plan(arm, 6)
    exact = planned_readings(arm, plan, linear=True)
    errors = errors_of(drawn_fits(arm, exact, of_noise(exact)))
    check_sds(errors, np.array([p.sd for p in predicted_uncertainties(arm, plan)]))


def with_visits(exact: Readings, own: float, shared: float, seed: int) -> Array:
    """Balanced errors (n, R, 3) m: of each coordinate, and of all markers of a visit."""
    m, visits = exact.value.size, int(exact.plus.max()) + 1
    e = balanced(m + 3 * visits, np.random.default_rng(seed))
    visit = e[:, m:].reshape(len(e), visits, 3)[:, exact.plus]
    return own * e[:, :m].reshape(-1, *exact.value.shape) + shared * visit


@pytest.mark.parametrize("of", ["fit", "plan", "simulation"])
def test_a_stated_repeatability_counts(tmp_path: Path, of: str) -> None:
    """repeatability_mm: the sd of a coordinate that the markers of a visit share."""
    arm = small_arm(tmp_path, "{sigma_mm: 0.03, repeatability_mm: 0.04}")
    plan = small_plan(arm, 4)
    exact = planned_readings(arm, plan, linear=True)
    if of == "simulation":
        drawn = [simulate(arm, plan, seed=s, linear=True).readings.value - exact.value for s in range(100)]
        means = np.array(drawn).reshape(-1, 3, 3).mean(axis=1)
        check_sds(means.reshape(-1, 1), np.array([np.hypot(SIGMA / np.sqrt(3.0), 4e-5)]), allowed=0.1)
    else:
        fits = drawn_fits(arm, exact, with_visits(exact, SIGMA, 4e-5, 3))
        stated = rms_sd(fits) if of == "fit" else np.array([p.sd for p in predicted_uncertainties(arm, plan)])
        check_sds(errors_of(fits), stated)


@pytest.mark.parametrize("stated", [True, pytest.param(False, marks=pytest.mark.long)])
def test_sds_with_an_error_that_visits_share(tmp_path: Path, stated: bool) -> None:
    """`shared-error pose` finds both sizes; without it the sds are too small, and residuals hardly show it."""
    arm = small_arm(tmp_path, "{sigma_mm: 0.03}" if stated else "estimate")
    exact = planned_readings(small_arm(tmp_path), small_plan(arm, 10), linear=True)
    exact = exact if stated else replace(exact, stated=False)
    rng, shape = np.random.default_rng(4), exact.value.shape
    errors = [SIGMA * rng.normal(size=shape) + 4e-5 * rng.normal(size=(10, 3))[exact.plus] for _ in range(70)]
    fits = drawn_fits(arm, exact, np.array(errors), replace(LINEAR, shared="pose"))
    whitened = [
        np.linalg.solve(np.linalg.cholesky(f.covariance), e) for f, e in zip(fits, errors_of(fits), strict=True)
    ]
    check_sds(np.concatenate(whitened)[:, None], np.ones(1), allowed=0.1)
    assert np.mean([f.shared_sd**2 for f in fits]) == pytest.approx(16e-10, rel=0.1)
    assert np.mean([f.sigma**2 for f in fits]) == pytest.approx(SIGMA**2, rel=0.05)
    assert np.mean([f.chi2 / f.dof for f in fits]) == pytest.approx(1.0, abs=0.03)
    assert np.mean(np.square([f.studentised for f in fits])) == pytest.approx(1.0, abs=0.04)
    plain = drawn_fits(arm, exact, np.array(errors[:20]))
    assert np.all(rms_sd(plain) < 0.8 * rms_sd(fits))


def test_p_values_of_the_residuals(arm: Experiment) -> None:
    """`p_value` of a fit whose noise is as stated: of 45 coordinates, 3 of them for the springs."""
    exact = planned_readings(arm, small_plan(arm, 5), linear=True)
    errors = SIGMA * np.random.default_rng(5).normal(size=(150, *exact.value.shape))
    check_p_values(np.array([f.p_value for f in drawn_fits(arm, exact, errors)], dtype=float))


def test_expanded_uncertainty_of_an_estimated_noise_covers(tmp_path: Path) -> None:
    """k = 2 is said to be about 95 %: with 15 degrees of freedom, 12 and less being usual, as well."""
    arm = small_arm(tmp_path, "estimate")
    exact = replace(planned_readings(small_arm(tmp_path), small_plan(arm, 2), linear=True), stated=False)
    fit = identify(arm, exact.with_values(exact.value + of_noise(exact)[0]), options=LINEAR)
    rng = np.random.default_rng(6)
    estimate, square = rng.normal(size=40_000), rng.chisquare(fit.dof, 40_000) / fit.dof
    check_coverage(np.abs(estimate) < fit.coverage * np.sqrt(square), 0.9545)


SCALE, TURN = 0.01, np.deg2rad(0.3)


def displacements(arm: Experiment, plan: Plan, load: Array) -> Readings:
    """Without noise, of a load that errs by (scale, rx, ry, rz), with the plan's wrench in the table."""
    really = make_plan(acting(plan.poses, load[0], load[1:]), plan.load)
    readings = planned_readings(arm, really, linear=True)
    return readings.with_poses(replace(readings.poses, wrench=np.concatenate([plan.wrench, 0.0 * plan.wrench])))


def both(arm: Experiment, plan: Plan, load: Array) -> Readings:
    return joined([positions(arm, plan, load), displacements(arm, plan, load)])


def frame_errors(fit: Fit) -> Array:
    """Errors of the estimates (p,), those of the tracker's frame first where that was estimated."""
    names = [n for n in fit.names if n in fit.model.names]
    springs = fit.values[len(fit.names) - len(names) :] - fit.model.nominal[fit.model.index(names)]
    if not fit.frames:
        return springs
    frame = fit.frames[0]
    turn = rotation_vector(frame.rotation @ TRACKER.rotation.T)
    return np.concatenate([frame.origin - TRACKER.origin, turn, springs])


@pytest.mark.parametrize("made", [displacements, positions, both])
def test_total_sds_hold_the_error_of_the_load(
    arm: Experiment, made: Callable[[Experiment, Plan, Array], Readings]
) -> None:
    """The load's size and direction err by their stated sds, in all readings alike; noise alone says far less."""
    stated = arm.with_(load_uncertainty=LoadUncertainty(SCALE, TURN), fit=("joint_compliance",))
    plan = small_plan(arm, 4 if made is displacements else 3)
    size = made(arm, plan, np.zeros(4)).value.size
    e = balanced(size + 4, np.random.default_rng(7))
    fits: list[Fit] = []
    for noise, load in zip(e[:, 4:], e[:, :4] * [SCALE, TURN, TURN, TURN], strict=True):
        readings = made(arm, plan, load)
        noisy = readings.with_values(readings.value + SIGMA * noise.reshape(-1, 3))
        fits.append(identify(stated, noisy, options=LINEAR))
    errors = np.array([frame_errors(fit) for fit in fits])
    check_sds(errors, np.sqrt(np.mean(np.square([fit.sd_total for fit in fits]), axis=0)), allowed=0.05)
    assert np.max(np.sqrt(np.mean(np.square(errors), axis=0)) / rms_sd(fits)) > 1.3


def errors_at_targets(arm: Experiment, believed: Experiment, fits: list[Fit], x: Array) -> tuple[Array, Array]:
    """Distances (n, N) m of the corrected tool of an arm with values x from its targets, and those to be expected."""
    wrench = np.tile([0.0, 900.0, -1500.0, 0.0, 0.0, 0.0], (2, 1))
    targets = joint_targets(arm, np.array([[0.3, 0.4, 0.5], [-0.5, 0.2, -0.3]]), wrench)
    real, expected = list[Array](), list[Array]()
    for fit in fits:
        corrected = compensate(believed, fit, targets)
        q = arm.robot.controller.to_joints(corrected.pendant)
        stands = equilibrium(arm.model(), Poses(corrected.pendant, q, wrench), x)
        real.append(np.linalg.norm(stands.tip - targets.wanted.position, axis=1))
        expected.append(corrected.sd)
    return np.array(real), np.array(expected)


def test_expected_errors_of_targets(arm: Experiment) -> None:
    """All springs being identified: the root mean square of the distance is the one that is to be expected."""
    exact = planned_readings(arm, small_plan(arm, 3))
    fits = drawn_fits(arm, exact, of_noise(exact), FitOptions(keep_all=True))
    real, expected = errors_at_targets(arm, arm, fits, arm.model().nominal)
    check_sds(real, np.sqrt(np.mean(expected**2, axis=0)), allowed=0.12)


def fitted_of(arm: Experiment, believed: Experiment, plan: Plan, factor: float) -> tuple[Fit, Array]:
    """A fit of readings of an arm whose first spring, which it holds at nominal, is so many times as soft."""
    x = arm.model().nominal.copy()
    x[arm.model().index([SPRINGS[0]])] *= factor
    exact = planned_readings(arm, plan, x)
    noise = SIGMA * np.random.default_rng(plan.q.shape[0]).normal(size=exact.value.shape)
    return identify(believed, exact.with_values(exact.value + noise), options=FitOptions(keep_all=True)), x


def test_expected_errors_hold_the_stated_sd_of_a_spring_that_no_reading_sees(tmp_path: Path) -> None:
    """Under weights alone the first joint is not identified: its nominal value has an sd of 30 %."""
    arm = small_arm(tmp_path, loads=WEIGHT)
    for factor in (0.7, 1.3):
        fit, x = fitted_of(arm, arm, small_plan(arm, 4), factor)
        real, expected = errors_at_targets(arm, arm, [fit], x)
        check_sds(real, expected)


def test_expected_errors_hold_what_nobody_states_of_a_spring_that_no_reading_sees(tmp_path: Path) -> None:
    """A value without an sd is none that is known exactly: it is known to its size."""
    arm = small_arm(tmp_path, loads=WEIGHT)
    nominal = tmp_path / "arm" / "nominal.yaml"
    nominal.write_text(nominal.read_text().replace(", sd_percent: 30", ""))
    fit, x = fitted_of(arm, load_experiment(arm.path), small_plan(arm, 4), 1.3)
    real, expected = errors_at_targets(arm, load_experiment(arm.path), [fit], x)
    assert np.all(expected > 0.2 * real)


def test_one_uncertainty_holds_all_that_is_known_of_a_spring(tmp_path: Path) -> None:
    """Two springs are fitted beside a third that is known to 30 %: what the sd quoted holds beyond that of the noise is
    by how much the third moves them."""
    arm = small_arm(tmp_path, more=f"fit: {list(SPRINGS[1:])}")
    fits = [fitted_of(arm, arm, small_plan(arm, 24), factor)[0] for factor in (0.7, 1.3)]
    moved = 0.5 * (fits[1].values - fits[0].values)
    beyond = np.square(fits[0].sd_total) - fits[0].sd ** 2
    check_sds(moved[None], np.sqrt(beyond), allowed=0.05)


def test_before_is_the_arm_in_the_tool_that_suits_it_best(tmp_path: Path) -> None:
    """An arm that is nominal is no better after a fit, whatever was guessed of a marker that is estimated."""
    more = "effects: [{effect: marker_offset, markers: all}]\nfit: [joint_compliance, marker_offset]"
    arm = small_arm(tmp_path, "{position_sigma_mm: 0.03}", more)
    readings = positions(arm, small_plan(arm, 8), np.zeros(4))
    arm.path.write_text(arm.path.read_text().replace("[150, 200, 200]", "[170, 220, 180]"))
    noise = SIGMA * np.random.default_rng(8).normal(size=readings.value.shape)
    fit = identify(load_experiment(arm.path), readings.with_values(readings.value + noise))
    assert fit.held_out_nominal < 1.5 * fit.held_out_error


def test_expected_errors_are_not_stated_of_loads_in_another_unit(arm: Experiment) -> None:
    """Every load 9.81 times what acts: all springs are stiffer by that, and no residual shows it."""
    readings = simulate(arm, small_plan(arm, 12), seed=3).readings
    fit = identify(arm, readings.with_poses(replace(readings.poses, wrench=9.81 * readings.poses.wrench)))
    with pytest.raises(InputError):
        errors_at_targets(arm, arm, [fit], arm.model().nominal)


def test_sds_in_noise_that_differs_by_axis(tmp_path: Path) -> None:
    """A tracker errs along its range otherwise than across: here by a factor of three, estimated from the residuals."""
    arm = small_arm(tmp_path, "estimate")
    exact = replace(planned_readings(small_arm(tmp_path), small_plan(arm, 10), linear=True), stated=False)
    fits = drawn_fits(arm, exact, of_noise(exact) * [0.5, 0.8, 1.45])
    check_sds(errors_of(fits), rms_sd(fits), allowed=0.12)


def read_of_file(folder: Path, arm: Experiment, exact: Readings, values: Array) -> Readings:
    """A file with a pose for each row's read, as programmes log them: consecutive ones at the same angles."""
    head = "pose,q1_deg,q2_deg,q3_deg,fx_N,fy_N,fz_N,marker,dx_mm,dy_mm,dz_mm"
    poses = exact.poses.take(exact.plus)
    numbers = np.column_stack([np.rad2deg(poses.pendant), poses.wrench[:, :3], 1e3 * values])
    cells = [[f"{v:.9f}" for v in row] for row in numbers]
    names = [(exact.states.pose[s], arm.marker_names[k]) for s, k in zip(exact.plus, exact.marker, strict=True)]
    rows = [",".join([pose, *row[:6], marker, *row[6:]]) for (pose, marker), row in zip(names, cells, strict=True)]
    (folder / "reads.csv").write_text("\n".join([head, *rows]) + "\n")
    return read_readings(folder / "reads.csv", arm)


def test_sds_of_reads_that_no_column_numbers(tmp_path: Path) -> None:
    """Four reads of each nest at each visit, which share its error, are no four visits."""
    arm, known = small_arm(tmp_path, "estimate"), small_arm(tmp_path / "known")
    plan, four = small_plan(known, 5), np.repeat(np.arange(5), 4)
    exact = planned_readings(known, make_plan(plan.poses.take(four), [plan.load[k] for k in four]), linear=True)
    rng = np.random.default_rng(9)
    fits: list[Fit] = []
    for _ in range(40):
        visit = 6e-5 * rng.normal(size=(5, 3, 3))[four][exact.plus, exact.marker]
        values = exact.value + SIGMA * rng.normal(size=exact.value.shape) + visit
        fits.append(identify(arm, read_of_file(tmp_path, arm, exact, values), options=LINEAR))
    check_sds(errors_of(fits).reshape(-1, 1) / np.tile(rms_sd(fits), 40)[:, None], np.ones(1), allowed=0.12)
