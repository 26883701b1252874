"""What the load's own error adds to the estimates: analytic and against differences."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arm import random_poses

from qsframework.elastostatics import make_model
from qsframework.errors import InputError
from qsframework.estimation import FitOptions, propagated, settle
from qsframework.experiment import (
    Experiment,
    LoadUncertainty,
    Plan,
    Readings,
    load_experiment,
    make_plan,
    observation_model,
    simulate,
)
from qsframework.fits import identify
from qsframework.fits.load_error import LoadError, load_columns
from qsframework.plugin import Array, check_effect, find

KEEP = FitOptions(keep_all=True)
LINEAR = FitOptions(linear=True, keep_all=True)


@pytest.fixture(scope="module")
def plan(m900ib: Experiment) -> Plan:
    return make_plan(random_poses(m900ib, 1, 10), ["pull"] * 10)


def test_the_error_is_a_proper_effect(m900ib: Experiment) -> None:
    check_effect(LoadError(), m900ib.robot.facts)


@pytest.mark.parametrize("linear", [True, False])
def test_columns_are_those_of_the_effects(m900ib: Experiment, plan: Plan, linear: bool) -> None:
    """load_scale and load_direction, the built-in effects, have the same sensitivities; rz by differences."""
    model = m900ib.model()
    seen = observation_model(m900ib, simulate(m900ib, plan).readings, linear=linear)
    J = load_columns(seen, model.nominal).reshape(len(plan.poses), -1, 3, 4)
    effects = (*model.effects, find("load_scale")(), find("load_direction")())
    markers = list(zip(model.marker_names, model.markers, strict=True))
    wide = make_model(model.facts, effects, model.parameters, model.tip, markers, model.gravity)
    names = ["load_scale", "load_direction.rx", "load_direction.ry"]
    assert np.allclose(J[..., :3], wide.sensitivity(plan.poses, None, names, linear), rtol=1e-10, atol=1e-15)
    h, ends = 1e-5, []
    for angle in (h, -h):
        R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        turned = replace(plan.poses, wrench=np.array(plan.poses.wrench @ np.kron(np.eye(2), R).T))
        ends.append(model.predict(turned, linear=linear))
    assert np.allclose(J[..., 3], (ends[0] - ends[1]) / (2 * h), rtol=1e-6, atol=1e-9)


def load_shift(experiment: Experiment, readings: Readings, sds: Array, options: FitOptions) -> Array:
    """How far each estimate moves (p, 4) with an error of one sd of the load."""
    seen = observation_model(experiment, readings, linear=options.linear)
    solution = settle(seen.observations(), options, seen.start)
    columns = seen.rows.noise.whiten(load_columns(seen, seen.values(solution.x)) * sds)
    return propagated(solution, columns)


def test_a_scale_error_is_one_of_all_compliances(m900ib: Experiment, plan: Plan) -> None:
    """A load 1 % too large makes every compliance 1 % too large, for K_par here is next to nothing."""
    stated = m900ib.with_(load_uncertainty=LoadUncertainty(0.01, 0.0))
    readings = simulate(m900ib, plan).readings
    fit = identify(stated, readings, options=KEEP)
    G = load_shift(m900ib, readings, np.array([0.01, 0.0, 0.0, 0.0]), KEEP)
    values = np.array([e.value for e in fit.estimates])
    assert np.allclose(G[:, 0], 0.01 * values, rtol=0.03)
    assert not G[:, 1:].any()
    assert fit.total_covariance is not None
    assert np.allclose(fit.total_covariance - fit.covariance, G @ G.T, rtol=1e-3, atol=1e-6 * np.abs(G @ G.T).max())
    assert identify(m900ib, readings, options=KEEP).total_covariance is None


TEXT = """robot: fanuc_m900ib
load: {point_mm: [150, 0, 200]}
markers: {tool: {xyz_mm: [150, 0, 200]}}
noise: {sigma_mm: 0.03}
"""


def test_the_file_states_it(tmp_path: Path) -> None:
    file = tmp_path / "experiment.yaml"
    file.write_text(TEXT + "load_uncertainty: {scale_percent: 0.5, direction_deg: 0.3}\n")
    found = load_experiment(file).load_uncertainty
    assert np.isclose(found.scale, 0.005)
    assert np.isclose(found.direction, np.deg2rad(0.3))
    file.write_text(TEXT)
    assert load_experiment(file).load_uncertainty == LoadUncertainty(0.0, 0.0)
    for wrong, words in (
        ("{scale: 0.5}", "scale_percent"),
        ("{scale_percent: -1}", "line 5"),
        ("{direction_mm: 3}", "direction_deg"),
    ):
        file.write_text(TEXT + f"load_uncertainty: {wrong}\n")
        with pytest.raises(InputError, match=words):
            load_experiment(file)


def test_a_fit_says_both_sds(m900ib: Experiment, plan: Plan) -> None:
    from qsframework.report import fit_table

    stated = m900ib.with_(load_uncertainty=LoadUncertainty(0.02, 0.0))
    readings = simulate(m900ib, plan).readings
    fit = identify(stated, readings, options=KEEP)
    assert fit.total_covariance is not None
    held = np.diag(fit.held_covariance)
    np.testing.assert_allclose(np.square(fit.sd_total), np.diag(fit.total_covariance) + held, rtol=1e-9)
    assert all(t > e.sd for t, e in zip(fit.sd_total, fit.estimates, strict=True))
    entry = fit.as_json()["estimates"][fit.names[0]]
    assert entry["sd_total"] == fit.sd_total[0]
    assert "most by the load" in fit_table(fit).caption


def test_tied_joints_are_moved_together(m900ib: Experiment, plan: Plan) -> None:
    """Readings under another load than believed move the estimates by the shift that is foretold, in their ratio."""
    group = ("joint_compliance[joint_4]", "joint_compliance[joint_5]", "joint_compliance[joint_6]")
    readings = simulate(m900ib, plan, seed=2).readings
    options = replace(LINEAR, tied=(group,))
    at = identify(m900ib, readings, options=options)
    G = load_shift(m900ib, readings, np.array([0.0, *[1e-4] * 3]), options)
    for axis in range(3):
        r = 1e-4 * np.eye(3)[axis]
        halves = plan.poses.wrench.reshape(-1, 2, 3)
        turned = replace(plan.poses, wrench=(halves + np.cross(r, halves)).reshape(-1, 6))
        acts, thought = (m900ib.model().predict(poses, at.x, linear=True) for poses in (turned, plan.poses))
        shifted = identify(
            m900ib, readings.with_values(readings.value + (acts - thought).reshape(-1, 3)), options=options
        )
        change = np.array([a.value - b.value for a, b in zip(shifted.estimates, at.estimates, strict=True)])
        assert np.allclose(change, G[:, 1 + axis], rtol=1e-3, atol=1e-4 * np.abs(G[:, 1 + axis]).max())
    tied = [at.names.index(n) for n in group]
    ratio = at.x[at.model.index(group)] / at.x[at.model.index(group[:1])]
    assert np.allclose(G[tied, 1:] / G[tied[0], 1:], ratio[:, None])
