"""Lack of fit: uniform p-values where nothing is missing, and the variable where something is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import f as fisher, kstest

from qsframework.diagnoses.residuals.lack_of_fit import arm_axes, lack_of_fit, smooth, variables_of
from qsframework.experiment import Experiment, make_plan, make_rows, simulate
from qsframework.plugin import Array, Conditions, Poses
from qsframework.report.words.noise import misfit_words

ROWS, COLUMNS = 90, 8
ALONE = np.arange(ROWS)
RNG = np.random.default_rng(0)
A = RNG.standard_normal((ROWS, 3, COLUMNS))
Q = np.linalg.qr(A.reshape(3 * ROWS, -1))[0]
VARIABLES = {
    "joint_1": RNG.uniform(-1, 1, ROWS),
    "joint_2": RNG.uniform(-2, 1, ROWS),
    "load": RNG.choice([1.0, 2.0, 5.0], ROWS),
    "approach": RNG.choice([-1.0, 1.0], ROWS),
    "marker": np.array(["m1", "m2", "m3"] * (ROWS // 3)),
}


def residuals(errors: Array) -> Array:
    flat = errors.ravel()
    return (flat - Q @ (Q.T @ flat)).reshape(ROWS, 3)


def test_p_values_are_uniform_without_a_cause() -> None:
    """Whatever the size of the noise."""
    rng = np.random.default_rng(1)
    found = [lack_of_fit(residuals(7.0 * rng.standard_normal((ROWS, 3))), A, ALONE, VARIABLES) for _ in range(300)]
    for name in VARIABLES:
        p = [t.p_raw for g in found for t in g.trends if t.variable == name]
        assert len(p) == 300
        assert kstest(p, "uniform").pvalue > 1e-3
    # Holm: any of them at 5 % in at most 5 %, 3.3 sd of the binomial beyond
    assert sum(g.trends[0].p_value < 0.05 for g in found) <= 27


def test_replicates_give_the_f_test_of_textbooks() -> None:
    """Poses measured three times: pure error from the means, computed here by sums."""
    rng = np.random.default_rng(2)
    columns = np.concatenate([A[:30]] * 3)
    label = np.tile(np.arange(30), 3)
    basis = np.linalg.qr(columns.reshape(3 * ROWS, -1))[0]
    p = []
    for _ in range(200):
        errors = rng.standard_normal((ROWS, 3))
        left = (errors.ravel() - basis @ (basis.T @ errors.ravel())).reshape(ROWS, 3)
        found = lack_of_fit(left, columns, label, {})
        p.append(found.p_replicates)
    assert kstest(p, "uniform").pvalue > 1e-3
    pure = sum(np.sum((errors[label == g] - errors[label == g].mean(axis=0)) ** 2) for g in range(30))
    lack, dof, free = np.sum(left**2) - pure, 90 - COLUMNS, 180
    assert found.free_replicates == free
    assert np.isclose(found.p_replicates, fisher.sf(lack / dof / (pure / free), dof, free))
    wrong = lack_of_fit(left + np.concatenate([rng.standard_normal((30, 3))] * 3), columns, label, {})
    assert wrong.p_replicates < 1e-3
    assert "larger than the replicates' scatter" in misfit_words(wrong)[0]


@pytest.mark.parametrize("name", ["joint_1", "joint_2", "load", "approach", "marker"])
def test_the_variable_is_named(name: str) -> None:
    rng = np.random.default_rng(3)
    value = VARIABLES[name]
    size = np.array([{"m1": 0.0, "m2": 1.0, "m3": -1.0}.get(str(v), v) for v in value], dtype=float)
    size = (size - size.mean()) / size.std()
    bent = np.where(name == "joint_1", np.sin(2.0 * size), size)
    errors = rng.standard_normal((ROWS, 3)) + bent[:, None] * [0.0, 1.2, 0.0]
    found = lack_of_fit(residuals(errors), A, ALONE, VARIABLES)
    assert found.trends[0].variable == name
    assert found.trends[0].p_value < 1e-4
    assert f"depend on {name}" in " ".join(misfit_words(found))


def test_what_the_fit_absorbs_is_no_trend() -> None:
    """A trend that is one of the fitted columns leaves nothing, and takes no degree of freedom."""
    trend = np.polynomial.legendre.legvander(np.linspace(-1, 1, ROWS), 3)[:, 1:]
    columns = (trend[:, None, None, :] * np.eye(3)[None, :, :, None]).reshape(ROWS, 3, -1)
    found = lack_of_fit(np.zeros((ROWS, 3)), columns, ALONE, {"time": np.linspace(0.0, 9.0, ROWS)})
    assert found.trends == ()


def test_constants_and_labels_have_as_many_functions_as_they_can() -> None:
    assert smooth(np.ones(5)).shape == (5, 0)
    assert smooth(np.array([1.0, 2.0, 1.0])).shape == (3, 1)
    assert smooth(np.arange(9.0)).shape == (9, 3)
    assert smooth(np.array(["a", "b", "c", "a"])).shape == (4, 2)


def test_variables_and_axes_of_a_campaign(m900ib: Experiment) -> None:
    rng = np.random.default_rng(4)
    controller = m900ib.robot.controller
    pendant = rng.uniform(controller.lower, controller.upper, (20, 6)) * 0.6
    wrench = np.tile([0.0, 0, -4000, 0, 0, 0], (20, 1))
    wrench[::2, 1] = 1500.0
    plan = make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["x"] * 20)
    readings = simulate(m900ib, plan).readings
    timed = readings.with_poses(replace(readings.poses, loaded=Conditions(time=np.arange(40.0))))
    rows = make_rows(timed.masked(np.arange(60) < 3))
    found = variables_of(m900ib, rows)
    assert set(found) == {*m900ib.robot.facts.joints, "fy", "load", "time", "marker"}  # fx, fz, moments do not vary
    assert np.array_equal(found["joint_3"], readings.poses.q[readings.plus[3:], 2])
    axes = arm_axes(m900ib, rows)
    assert np.allclose(axes.transpose(0, 2, 1) @ axes, np.eye(3))
    assert np.allclose(np.linalg.det(axes), 1.0)
    place = m900ib.model().positions(readings.poses, linear=True)[readings.plus[3:], readings.marker[3:]]
    assert np.allclose(np.einsum("rij,ri->rj", axes, place)[:, 1], 0.0, atol=1e-12)


def test_a_trend_that_turns_with_the_arm_needs_the_arms_axes(m900ib: Experiment) -> None:
    """An outward error that grows with joint 2, the arm turned all round: invisible along the axes of the base."""
    rng = np.random.default_rng(5)
    around = rng.uniform(-np.pi, np.pi, ROWS)
    zero, one = np.zeros(ROWS), np.ones(ROWS)
    outward = np.stack([np.cos(around), np.sin(around), zero], axis=1)
    axes = np.stack([outward, np.cross([0.0, 0, 1], outward), np.stack([zero, zero, one], axis=1)], axis=2)
    errors = 0.3 * rng.standard_normal((ROWS, 3)) + VARIABLES["joint_2"][:, None] * outward
    only = {"joint_2": VARIABLES["joint_2"]}
    assert lack_of_fit(residuals(errors), A, ALONE, only, axes).trends[0].p_value < 1e-12
    assert lack_of_fit(residuals(errors), A, ALONE, only).trends[0].p_value > 1e-6
