"""What would help is told from what the readings load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.errors import InputError, NotIdentifiable
from qsframework.experiment import Experiment, load_experiment, make_plan, simulate
from qsframework.experiment.examples import example
from qsframework.experiment.setup import Noise
from qsframework.identify import identify
from qsframework.information import predicted_sd, promised_sd, what_would_help
from qsframework.information.advice import spring_torques, unit_torques
from qsframework.plugin import Poses
from qsframework.plugin.facts import frozen
from tests.identify.arm import random_poses

BALANCER = "gravity_compensator[joint_2].stiffness"


@pytest.fixture(scope="module")
def m900ib() -> Experiment:
    return load_experiment(example("m900ib") / "experiment.yaml")


def poses(m900ib: Experiment, load: int, count: int = 15) -> Poses:
    return random_poses(m900ib, load, count)


def test_unit_torques_add_up(m900ib: Experiment) -> None:
    at = poses(m900ib, 1)
    force = at.wrench[:, :3]
    assert np.allclose(
        np.einsum("nca,na->nc", unit_torques(m900ib.model(), at), force), spring_torques(m900ib.model(), at)
    )


def test_joint_1_needs_a_side_pull(m900ib: Experiment) -> None:
    said = what_would_help(m900ib.model(), "joint_compliance[joint_1]", poses(m900ib, 0))
    assert "no reading loads joint 1; add a side pull along the base's" in said
    assert "with the arm stretched" in said
    assert "no reading loads" not in what_would_help(m900ib.model(), "joint_compliance[joint_1]", poses(m900ib, 1))
    assert "no reading loads" not in what_would_help(m900ib.model(), "joint_compliance[joint_2]", poses(m900ib, 0))


def test_the_error_says_what_would_help(m900ib: Experiment) -> None:
    at = poses(m900ib, 0)
    readings = simulate(m900ib, make_plan(at, ["weight"] * len(at))).readings
    with pytest.raises(NotIdentifiable, match=r"joint_1.*no reading depends on it.*add a side pull"):
        identify(m900ib, readings)
    with pytest.raises(NotIdentifiable, match=r"joint_1.*no reading depends on it.*add a side pull"):
        identify(m900ib, readings, method="one-step")


@pytest.mark.parametrize("method", ["linear", "one-step"])
def test_the_physical_balancer_is_not_identifiable(m900ib: Experiment, method: str) -> None:
    """15 poses at 0.03 mm: its sd is several times its nominal value, the number is given, and what would help."""
    at = poses(m900ib, 1)
    readings = simulate(m900ib, make_plan(at, ["pull"] * len(at)), seed=1).readings
    fit = identify(m900ib, readings, ["joint_compliance", BALANCER], method=method, fixed=())
    estimate = next(e for e in fit.estimates if e.name == BALANCER)
    (note,) = (n for n in fit.notes if n.startswith(BALANCER))
    assert "absolute positions" in note
    assert "motor torques" in note
    if not np.isnan(estimate.sd):
        assert estimate.sd > estimate.initial
        assert f"its sd is {100 * estimate.sd / estimate.initial:.0f} % of its nominal value" in estimate.status
    others = [e for e in fit.estimates if e.name != BALANCER]
    assert all("not identifiable" not in e.status for e in others)


def test_the_same_fit_told_at_little_noise(m900ib: Experiment) -> None:
    """The verdict follows the numbers: at 0.1 um the same readings do tell the balancer."""
    at = poses(m900ib, 1)
    fine = m900ib.with_(noise=replace(m900ib.noise, sigma=1e-7))
    readings = simulate(fine, make_plan(at, ["pull"] * len(at)), seed=1).readings
    fit = identify(fine, readings, ["joint_compliance", BALANCER])
    assert all("not identifiable" not in e.status for e in fit.estimates)


def test_sensor_load_and_geometry_parameters_have_advice(m900ib: Experiment) -> None:
    from qsframework.plugin import build_effects

    facts = m900ib.robot.facts
    entries = ({"effect": "joint_offset", "joint": "joint_1"}, {"effect": "load_scale"}, {"effect": "tracker_scale"})
    effects = tuple(e for entry in entries for e in build_effects(entry, facts))
    parameters = tuple(p for e in effects for p in e.parameters(facts))
    model = m900ib.with_(effects=effects, parameters=parameters).model()
    said = [what_would_help(model, p.name, poses(m900ib, 0)) for p in parameters]
    assert "absolute positions" in said[0]
    assert "weigh the load" in said[1]
    assert "different direction" in said[2]


def test_a_wrist_in_line_with_its_load_point_is_to_be_bent(m900ib: Experiment) -> None:
    """A load point on the axis of joint 6: no force turns that joint, whatever its direction."""
    straight = m900ib.with_(load_point=frozen([0.0, 0.0, 0.0]))
    said = what_would_help(straight.model(), "joint_compliance[joint_6]", poses(m900ib, 1))
    assert said == "no force at the load point turns joint 6 in these poses: bend the wrist or move the load point"


def test_a_plan_that_tells_nothing_promises_nothing(m900ib: Experiment) -> None:
    """A vertical weight alone never turns joint 1."""
    sd = predicted_sd(m900ib.model(), poses(m900ib, 0), ["joint_compliance[joint_1]"], 3e-5)
    assert np.isinf(sd).all()
    at = poses(m900ib, 1)
    with pytest.raises(InputError, match="a promise needs the noise"):
        promised_sd(m900ib.with_(noise=Noise(None)), make_plan(at, ["pull"] * len(at)))
