"""The uncertainty that a plan predicts is that of the fit to its readings, and that of differences of the settled
prediction: also where a parameter acts only by how the unloaded arm sags; and a fit's is that of its minimum."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import predicted
import pytest

from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Plan, example, load_experiment, read_plan, simulate
from qsframework.fits import EstimateState, Fit, identify
from qsframework.information import predicted_sd
from qsframework.plugin import Array
from tests.identify.arm import arm_text

SIGMA = 3e-5
"""m, of both campaigns."""
LOADS = """
loads:
  - {name: weight, fz_N: -4000}
  - {name: weight_and_side_pull, fz_N: -4000, fy_N: 1500}
fit: [joint_compliance, "gas_balancer[joint_2].pressure"]
"""
POSES = (
    "-170.23,-125.65,-59.47,144.79,16.14,-35.74",
    "-127.8,-125.37,-60.6,-37.45,-14.92,145.41",
    "-114.45,-51.34,62.94,-107.81,69.54,-133.73",
    "-88.44,-126.5,-59.64,-105.05,15.07,7.71",
    "-67.43,-8.42,-50.58,-80.92,65.42,150.68",
    "-50.22,-112.78,121.84,-119.08,21.14,51.07",
    "-44.14,-127,-56.51,-107.28,68.32,-136.62",
    "-3.48,-113.05,99.49,-21.24,24.96,-78.81",
    "21.57,-127,-19.29,-160.48,67.18,-46.05",
    "34.94,-127,-67.38,146.29,-28.89,135.62",
    "65.17,17,-59.64,-75.78,62.95,151.12",
    "72.6,-9.42,-49.89,-81.2,65.43,150.59",
    "96.58,-113.73,106.05,-67.37,68.34,106.44",
    "2.91,13.13,-19.27,28.06,25.6,21.59",
    "3.95,11.54,-14.87,92.27,12.3,-12.24",
    "177.6,13.66,-18.62,74.63,19.38,25.28",
)


def gas_balancer(folder: Path, repeats: int = 1) -> tuple[Experiment, Plan]:
    """A KR 600 whose balancer's pressure is fitted, and 16 poses; the last three are pulled to the side."""
    (folder / "experiment.yaml").write_text(arm_text("0.03", LOADS, "kuka_kr600_r2830"))
    rows = ["pose," + ",".join(f"q{i}_deg" for i in range(1, 7)) + ",fx_N,fy_N,fz_N,mx_Nm,my_Nm,mz_Nm,load,repeats"]
    for i, pose in enumerate(POSES):
        load = "0,0,-4000,0,0,0,weight" if i < 13 else "0,1500,-4000,0,0,0,weight_and_side_pull"
        rows.append(f"p{i:02d},{pose},{load},{repeats}")
    (folder / "plan.csv").write_text("\n".join(rows) + "\n")
    experiment = load_experiment(folder / "experiment.yaml")
    return experiment, read_plan(folder / "plan.csv", experiment)


def spring_balancer(folder: Path) -> tuple[Experiment, Plan]:
    """The paper's arm with its balancer's spring fitted beside what the paper fits; the plan of examples/day."""
    plan = read_plan(example("day") / "plan.csv", load_experiment(example("day") / "experiment.yaml"))
    plain = load_experiment(example("m900ib") / "experiment.yaml")
    return plain.with_(fit=(*plain.fit_names(), "gravity_compensator[joint_2].stiffness")), plan


def by_differences(experiment: Experiment, plan: Plan) -> Array:
    """sd (p,) of all that is fitted, SI: fourth-order differences of the settled prediction, each visit a pose."""
    model, columns = experiment.model(), list[Array]()
    poses, x = plan.repeated(), model.nominal
    for i in model.index(experiment.fit_names()):
        h = 1e-3 * x[i] * np.eye(len(x))[i]
        near, far = (model.predict(poses, x + k * h) - model.predict(poses, x - k * h) for k in (1.0, 2.0))
        columns.append((8.0 * near - far).ravel() / (12.0 * h[i] * SIGMA))
    J: Array = np.array(columns).T
    size = np.linalg.norm(J, axis=0)
    covariance = np.asarray(np.linalg.inv((J / size).T @ (J / size)), dtype=np.float64)
    return np.sqrt(np.diag(covariance)) / size


def fitted(experiment: Experiment, plan: Plan, sigma: float) -> Fit:
    """A fit to readings made at the nominal values, almost without noise."""
    quiet = experiment.with_(noise=replace(experiment.noise, sigma=sigma))
    return identify(quiet, simulate(quiet, plan, seed=1).readings, options=FitOptions(keep_all=True))


@pytest.mark.parametrize("campaign", [spring_balancer, gas_balancer])
def test_one_uncertainty_by_plan_fit_and_differences(
    campaign: Callable[[Path], tuple[Experiment, Plan]], tmp_path: Path
) -> None:
    experiment, plan = campaign(tmp_path)
    assert experiment.noise.sigma == SIGMA
    predicted, sigma = predicted_sd(experiment, plan), 1e-9
    assert predicted == pytest.approx(by_differences(experiment, plan), rel=1e-6)
    fit = fitted(experiment, plan, sigma)
    assert [e.sd for e in fit.estimates] == pytest.approx(predicted * sigma / SIGMA, rel=1e-4)


@pytest.mark.parametrize("repeats", [1, 3])
def test_visits_count_in_the_prediction_as_in_the_fit(repeats: int, tmp_path: Path) -> None:
    experiment, plan = gas_balancer(tmp_path, repeats)
    fit = fitted(experiment, plan, 1e-9)
    assert fit.dof == 9 * repeats * len(POSES) - len(fit.names)
    scale = 1e-9 / SIGMA
    assert [e.sd for e in fit.estimates] == pytest.approx(predicted_sd(experiment, plan) * scale, rel=1e-4)
    once = predicted_sd(experiment, replace(plan, repeats=(1,) * len(POSES)))
    assert predicted_sd(experiment, plan) == pytest.approx(once / np.sqrt(repeats), rel=1e-9)


def test_a_fit_has_the_uncertainty_of_its_minimum_wherever_it_starts(tmp_path: Path) -> None:
    """From the file's values, from those of the first fit and from elsewhere."""
    experiment, plan = gas_balancer(tmp_path)
    readings = simulate(experiment, plan, seed=1).readings
    first = identify(experiment, readings)
    known = [e.value for e in first.estimates]
    for start in (known, [1.1 * v for v in known]):
        rows = [
            f'"{e.name}": {{"value_{e.unit}": {v!r}, source: "a fit"}}'
            for e, v in zip(first.estimates, start, strict=True)
        ]
        (tmp_path / "start.yaml").write_text("\n".join(rows) + "\n")
        (tmp_path / "again.yaml").write_text(experiment.path.read_text() + "nominal: start.yaml\n")
        again = identify(load_experiment(tmp_path / "again.yaml"), readings)
        for one, other in zip(first.estimates, again.estimates, strict=True):
            assert other.sd == pytest.approx(one.sd, rel=1e-5)
            assert abs(other.value - one.value) < 1e-4 * one.sd


def test_readings_exactly_on_the_start_have_the_uncertainty_of_any_others(tmp_path: Path) -> None:
    experiment, plan = gas_balancer(tmp_path)
    made = simulate(experiment, plan, seed=1)
    model = experiment.model()
    exact = model.predict(plan.repeated()).reshape(-1, 3)
    fit = identify(experiment, made.readings.with_values(exact))
    assert fit.chi2 < 1e-12
    for e, sd in zip(fit.estimates, predicted_sd(experiment, plan), strict=True):
        assert e.state is EstimateState.FINE
        assert e.sd == pytest.approx(sd, rel=1e-6)
        assert e.value == pytest.approx(e.initial, rel=1e-6)


# --------------------------------------------------------------------- a part of the table of docs/model.md


OWN = {
    "fanuc_m900ib": ["gravity_compensator[joint_2].stiffness", "counterweight[link_3]"],
    "kuka_kr600_r2830": ["gas_balancer[joint_2].pressure", "gas_balancer[joint_2].volume"],
}
OF = {
    "fanuc_m900ib": ("load_point_offset", "gear_waves[joint_3]"),
    "fanuc_r2000ic": ("hose[flange]", "joint_placement[joint_3]"),
    "kuka_kr600_r2830": ("link_mass[link_3]", "joint_hardening[joint_2]"),
    "abb_irb760": ("joint_offset[joint_2]", "gravity_sag[joint_2]"),
    "ur10": ("joint_backlash[joint_2]", "encoder_eccentricity[joint_2]"),
    "kuka_kr500_on_kl4000": ("gear_friction[joint_2]", "offaxis_compliance[track/x]"),
}


@pytest.mark.parametrize("robot", predicted.ROBOTS)
def test_sds_of_some_of_a_robots_parameters_and_effects(robot: str) -> None:
    """By sensitivities, by fits and by differences, from displacements and positions: within 3 %."""
    plain = predicted.campaign(robot)
    poses = predicted.poses_of(plain, 20)
    springs = predicted.springs_of(plain)
    found = list(predicted.compare(predicted.with_effects(plain, ()), poses, OWN.get(robot, springs), springs))
    for effects in predicted.effects_for(plain):
        if effects[0].name in OF[robot]:
            found += predicted.of_effects(plain, poses, effects)
    assert {c.name.partition(".")[0] for c in found} >= {*OF[robot]}
    assert {c.name for c in found} >= {*OWN.get(robot, springs)}
    assert {c.reading for c in found} == {*predicted.READINGS}
    off = [c for c in found if not c.tied and not c.off < predicted.WITHIN]
    assert not off
    assert sum(c.tied for c in found) < 0.2 * len(found)


@pytest.mark.parametrize(("robot", "criterion"), [("kuka_kr600_r2830", "A"), ("fanuc_m900ib", "D")])
def test_a_plan_is_as_good_as_it_is_certified(robot: str, criterion: str) -> None:
    """With a balancer's value fitted; against the optimum of the same candidates, found without the library."""
    experiment = predicted.planned(robot, predicted.BALANCED[robot])
    certified, exact = predicted.efficiency(experiment, criterion, candidates=100, poses=8)
    assert exact > 1.0, "a polished plan is better than the relaxed optimum of so few candidates"
    assert exact == pytest.approx(certified, rel=1e-3)
