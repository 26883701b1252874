"""The same physics told in other units gives the same predictions, designs, fits and diagnoses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numerics import (
    campaign,
    candidates,
    few,
    force_power,
    in_force_unit,
    noisy,
    poses,
    readings,
    scaled,
    weighed,
    with_effects,
    with_forces,
)

from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, load_experiment, make_plan, read_readings, simulate, write_readings
from qsframework.experiment.observations import REACH
from qsframework.fits import Fit, identify
from qsframework.plans import DesignOptions, design
from qsframework.plugin import Array, Context, Load, Loads, LoadTerm, Parameter, Reading, RobotFacts, Sensor, SensorTerm
from qsframework.units import to_si

POWERS = st.floats(-9.0, 9.0)


def same(found: Any, wanted: Any, rtol: float = 1e-9, rounding: float = 0.0) -> None:
    """Equal to 1e-9, and to 1e-12 of the largest entry or to rounding."""
    a, b = np.asarray(found, dtype=float), np.asarray(wanted, dtype=float)
    np.testing.assert_allclose(a, b, rtol=rtol, atol=max(rtol * float(np.abs(b).max(initial=0.0)) * 1e-3, rounding))


def same_fits(found: Fit, wanted: Fit, factors: Array, stepwise: bool = False) -> None:
    """Fits whose parameters differ by the factors of their units: values, sds, tests and words."""
    close = 1e-9 if wanted.linear and not stepwise else 1e-8  # steps to a minimum end where rounding lets them
    same([e.value for e in found.estimates] / factors, [e.value for e in wanted.estimates], close)
    same([e.sd for e in found.estimates] / factors, [e.sd for e in wanted.estimates], close)
    assert found.covariance / np.outer(factors, factors) == pytest.approx(
        wanted.covariance, rel=1e-8, abs=1e-9 * float(np.abs(wanted.covariance).max())
    )
    same(found.chi2, wanted.chi2)
    # a displacement of the full equilibrium is the difference of two positions, each rounded as metres are, in each of
    # the two fits; what a pose's own readings decide of their prediction is added where the pose is left out
    rounding = 0.0 if wanted.linear else 4.0 * float(np.finfo(float).eps) * REACH
    same(found.studentised, wanted.studentised, 1e-8, max(rounding / wanted.sigma, 1e-9))
    lever = float(np.abs(wanted.left_out).max() / np.abs(wanted.residuals).max())
    same(found.left_out, wanted.left_out, 1e-8, max(rounding * max(lever, 1.0), 1e-9 * wanted.sigma))
    assert found.rank.rank == wanted.rank.rank
    assert [e.state for e in found.estimates] == [e.state for e in wanted.estimates]


@few(6)
@given(power=POWERS)
def test_predictions_do_not_depend_on_the_unit_of_force(power: float) -> None:
    one, other = campaign(), in_force_unit(campaign(), 10.0**power)
    same(other.model().predict(poses(other, 10)), one.model().predict(poses(one, 10)))
    same(other.model().predict(poses(other, 4)), one.model().predict(poses(one, 4)))


@few(6)
@given(power=POWERS, linear=st.booleans())
def test_fits_do_not_depend_on_the_unit_of_force(power: float, linear: bool) -> None:
    k = 10.0**power
    one, other = campaign(), in_force_unit(campaign(), k)
    data = readings(one, seed=4)
    options = FitOptions(linear=linear)
    wanted = identify(one, data, options=options)
    found = identify(other, with_forces(data, k), options=options)
    same_fits(found, wanted, np.full(len(wanted.estimates), 1.0 / k))


WAYS = (FitOptions(linear=True), FitOptions(), FitOptions(method="two-step"))


@pytest.mark.parametrize("options", WAYS)
def test_fits_with_the_balancer_do_not_depend_on_the_unit_of_force(options: FitOptions) -> None:
    fit = ("joint_compliance", "compensator_stiffness[joint_2].stiffness")
    x = campaign().model().nominal
    x[campaign().model().index(fit[1:])] = 4e6
    batch = poses(campaign(), 40, 5)
    angles = np.array(batch.pendant)
    angles[:, 1] = np.deg2rad([10.0, 30.0, 50.0, 70.0])[np.arange(40) % 4]
    grid = replace(batch, pendant=angles, q=campaign().robot.controller.to_joints(angles))
    fine = noisy(campaign(), 1e-6)
    data = simulate(fine, make_plan(grid, ["load"] * 40), x=x, seed=5).readings
    one = fine.with_(fit=fit)
    wanted = identify(one, data, options=options)
    for k in (1e-9, 1e9):
        other = in_force_unit(one, k)
        factors = np.array([k ** force_power(p) for p in one.fit_parameters()])
        same_fits(identify(other, with_forces(data, k), options=options), wanted, factors)


@pytest.mark.parametrize("criterion", ["D", "A", "I"])
@pytest.mark.parametrize("k", [1e-9, 1e9])
def test_plans_do_not_depend_on_the_unit_of_force(criterion: str, k: float) -> None:
    options = DesignOptions(criterion=criterion, polish=False, starts=3)
    wanted = design(campaign(), 8, candidates=candidates(), options=options)
    found = design(in_force_unit(campaign(), k), 8, candidates=candidates(), options=options)
    assert np.array_equal(found.pendant, wanted.pendant)
    assert found.certificate is not None
    assert wanted.certificate is not None
    same(found.certificate.value, wanted.certificate.value)
    same(found.wrench / k, wanted.wrench)


@dataclass(frozen=True)
class OddUnitSensor(Sensor):
    """The tracker's frame turned about z and then x, both angles in a unit `k` times as small as a radian."""

    k: float = 1.0
    order = 1

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        base = (Parameter("odd.z", "rad", typical=1e-3, sd=1e-2), Parameter("odd.x", "rad", typical=1e-4))
        return tuple(scaled(p, self.k) for p in base)

    def read(self, reading: Reading, x: Array, context: Context) -> SensorTerm:
        (a, b), one = np.asarray(x) / self.k, 1.0
        Z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, one]])
        dZ = np.array([[-np.sin(a), -np.cos(a), 0], [np.cos(a), -np.sin(a), 0], [0, 0, 0.0]])
        X = np.array([[one, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
        dX = np.array([[0.0, 0, 0], [0, -np.sin(b), -np.cos(b)], [0, np.cos(b), -np.sin(b)]])
        by_x = np.stack([reading.position @ (X @ dZ).T, reading.position @ (dX @ Z).T], axis=-1) / self.k
        position = reading.position @ (X @ Z).T
        return SensorTerm(position, np.broadcast_to(X @ Z, (*position.shape, 3)), by_x)


@few(3)
@given(power=st.sampled_from([-9, -3, 3, 9]), rest=st.floats(0.5, 2.0))
def test_fits_and_plans_do_not_depend_on_the_unit_of_a_parameter(power: int, rest: float) -> None:
    k = rest * 10.0**power
    names = ("joint_compliance", "odd.z", "odd.x")
    one = with_effects(campaign(), [OddUnitSensor()], names)
    other = with_effects(campaign(), [OddUnitSensor(k)], names)
    data = readings(campaign(), seed=6)
    for options in WAYS[:2] if abs(power) == 9 else WAYS[:1]:
        wanted = identify(one, data, options=options)
        factors = np.where(["odd" in n for n in wanted.names], k, 1.0)
        same_fits(identify(other, data, options=options), wanted, factors, stepwise=True)  # a sensor's angles
    options = DesignOptions(criterion="D", polish=False, starts=2)
    plans = [design(e, 8, candidates=candidates(), options=options) for e in (one, other)]
    assert np.array_equal(plans[0].pendant, plans[1].pendant)
    certificates = [p.certificate for p in plans]
    assert certificates[0] is not None
    assert certificates[1] is not None
    same(certificates[1].efficiency, certificates[0].efficiency)


NOMINAL = """joint_compliance[shoulder]:
  value_{c}: {a!r}
  sd_percent: 30
joint_compliance[elbow]:
  value_{c}: {b!r}
  sd_{c}: {s!r}
"""


@pytest.mark.parametrize("unit", ["prad/(N m)", "Mrad/(GN m)", "deg/(MN mm)", "arcmin/(daN km)"])
def test_files_in_other_units_say_the_same(tmp_path: Path, unit: str) -> None:
    """nominal.yaml, experiment.yaml and readings.csv in units 1e9 apart: one fit."""
    one = small(tmp_path / "one", "rad/(N m)", "mm", "N")
    other = small(tmp_path / "other", unit, "um", "MN")
    assert [p.nominal for p in other.robot.parameters] == pytest.approx([p.nominal for p in one.robot.parameters])
    q = np.array([[0.2, -0.3], [-0.5, 0.1], [0.6, -0.9], [0.0, 0.0]])
    batch = replace(poses(campaign(), 4), pendant=q, q=one.robot.controller.to_joints(q))
    batch = replace(batch, wrench=np.tile([100.0, 0, -900.0, 0, 0, 0], (4, 1)))
    data = simulate(one, make_plan(batch, ["w"] * 4), seed=1).readings
    write_readings(tmp_path / "mm.csv", data, one)
    text = (tmp_path / "mm.csv").read_text()
    lines = text.replace("dx_mm,dy_mm,dz_mm", "dx_km,dy_km,dz_km").splitlines()
    head = lines[1].split(",")
    columns = [i for i, name in enumerate(head) if name in ("dx_km", "dy_km", "dz_km")]
    for i, line in enumerate(lines[2:], 2):
        cells = line.split(",")
        for c in columns:
            cells[c] = repr(float(cells[c]) * 1e-6)
        lines[i] = ",".join(cells)
    (tmp_path / "km.csv").write_text("\n".join(lines) + "\n")
    wanted = identify(one, read_readings(tmp_path / "mm.csv", one))
    found = identify(other, read_readings(tmp_path / "km.csv", other))
    same_fits(found, wanted, np.ones(2))


def in_unit(value: float, unit: str) -> float:
    return value / float(to_si(1.0, unit))


def small(folder: Path, unit: str, length: str, force: str) -> Experiment:
    """A two-joint arm whose files are in the units."""
    folder.mkdir()
    urdf = (Path(__file__).parents[1] / "robot" / "conftest.py").read_text().split('"""')[3]
    (folder / "small.urdf").write_text(urdf)
    (folder / "robot.yaml").write_text(
        "name: small\ntitle: small\nurdf: small.urdf\nbase: base\nflange: tip\n"
        "controller:\n  shoulder: {limits_deg: [-90, 90]}\n  elbow: {limits_deg: [-120, 30]}\n"
        "effects:\n  - {effect: joint_compliance, joints: all}\nnominal: nominal.yaml\n"
    )
    values = {name: in_unit(v, unit) for name, v in zip("abs", (2e-7, 3e-7, 1e-7), strict=True)}
    (folder / "nominal.yaml").write_text(NOMINAL.format(c=unit, **values))
    m = [in_unit(v, length) for v in (0.1, 0.05, -0.02)]
    (folder / "experiment.yaml").write_text(
        f"robot: {folder}\nload: {{point_{length}: [0, 0, 0]}}\nmarkers:\n  m: {{xyz_{length}: {m}}}\n"
        f"noise: {{sigma_{length}: {in_unit(3e-5, length)!r}}}\n"
        f"loads:\n  - {{name: w, fz_{force}: {in_unit(-900.0, force)!r}}}\n"
    )
    return load_experiment(folder / "experiment.yaml")


@dataclass(frozen=True)
class OddUnitLoad(Load):
    """The load's scale in a unit `k` times as small."""

    k: float = 1.0

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (scaled(Parameter("odd_load", "", typical=1e-2, sd=1e-2), self.k),)

    def apply(self, loads: Loads, x: Array, context: Context) -> LoadTerm:
        factor = 1.0 + x[0] / self.k
        n = len(loads.wrench)
        by_wrench = np.broadcast_to(factor * np.eye(6), (n, 6, 6))
        return LoadTerm(loads.wrench * factor, by_wrench, loads.wrench[..., None] / self.k)


def test_priors_do_not_depend_on_the_unit_of_a_parameter() -> None:
    """A load's scale is told by its prior alone: what it tells is the same in every unit."""
    names = ("joint_compliance", "odd_load")
    data = readings(campaign(), seed=7)
    wanted = identify(with_effects(campaign(), [OddUnitLoad()], names), data)
    for k in (1e-9, 1e9):
        found = identify(with_effects(campaign(), [OddUnitLoad(k)], names), data)
        same_fits(found, wanted, np.where([n == "odd_load" for n in wanted.names], k, 1.0))


def test_estimated_noise_does_not_depend_on_the_unit_of_force() -> None:
    blank = weighed(readings(campaign(), seed=8), None)
    one = noisy(campaign(), None)
    wanted = identify(one, blank)
    found = identify(in_force_unit(one, 1e9), with_forces(blank, 1e9))
    same(found.sigma, wanted.sigma)
    same_fits(found, wanted, np.full(len(wanted.estimates), 1e-9))
