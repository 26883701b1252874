"""What would help is told from what the readings load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.errors import InputError, NotIdentifiable
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, load_experiment, make_plan, simulate
from qsframework.experiment.examples import example
from qsframework.experiment.noise import NoiseModel
from qsframework.fits import EstimateState, identify
from qsframework.information import predicted_sd, what_would_help
from qsframework.information.advice import load_share, spring_torques, unit_torques
from qsframework.plans import design
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
    at = turned(poses(m900ib, 1))
    units = unit_torques(m900ib.model(), at)
    assert np.allclose(np.einsum("nca,na->nc", units, at.wrench), spring_torques(m900ib.model(), at))


def turned(at: Poses, size: float = 900.0) -> Poses:
    """The same poses under a moment too, N m."""
    moment = np.random.default_rng(5).normal(size=(len(at), 3)) * size
    return replace(at, wrench=np.concatenate([at.wrench[:, :3], moment], axis=1))


@pytest.mark.parametrize("force", [0.0, 0.1, 1.0])
def test_no_load_turns_a_joint_by_more_than_it_could(m900ib: Experiment, force: float) -> None:
    """Moments count: without them a small force with a large moment gave 185 % and more."""
    model, at = m900ib.model(), turned(poses(m900ib, 1))
    at = replace(at, wrench=at.wrench * np.repeat([force, 1.0], 3))
    for k in range(6):
        share = load_share(model, at, k)
        assert share is not None
        assert 0.0 <= share <= 1.0
        said = what_would_help(model, f"joint_compliance[joint_{k + 1}]", at)
        assert (
            f"reaches only {100 * share:.0f} % of the torque these forces and moments allow" in said
            or "no reading loads" in said
        )
    if force == 0.0:  # joint 2 moves the forearm without turning it: no moment reaches its motor
        assert load_share(model, at, 1) == 0.0


def test_a_moment_about_the_joints_own_axis_is_all_that_a_moment_can_do(m900ib: Experiment) -> None:
    """Joint 1 stands upright: about z a moment turns it with 100 %, about x with nothing, between with its cosine."""
    model, at = m900ib.model(), poses(m900ib, 1)
    for direction, share in (([0, 0, 1], 1.0), ([3, 0, 4], 0.8), ([1, 0, 0], 0.0)):
        wrench = np.tile([0.0, 0.0, 0.0, *(100.0 * np.array(direction, dtype=float))], (len(at), 1))
        assert load_share(model, replace(at, wrench=wrench), 0) == pytest.approx(share, abs=1e-12)


def test_joint_1_needs_a_side_pull(m900ib: Experiment) -> None:
    said = what_would_help(m900ib.model(), "joint_compliance[joint_1]", poses(m900ib, 0))
    assert "no reading loads joint 1; add a side pull along the base's" in said
    assert "with the arm stretched" in said
    assert "no reading loads" not in what_would_help(m900ib.model(), "joint_compliance[joint_1]", poses(m900ib, 1))
    assert "no reading loads" not in what_would_help(m900ib.model(), "joint_compliance[joint_2]", poses(m900ib, 0))


def test_what_no_reading_tells_is_left_aside_with_what_would_help(m900ib: Experiment) -> None:
    at = poses(m900ib, 0)
    readings = simulate(m900ib, make_plan(at, ["weight"] * len(at))).readings
    for options in (FitOptions(), FitOptions(linear=True)):
        fit = identify(m900ib, readings, options=options)
        (one,) = fit.not_estimated
        assert one.words() == "joint_compliance[joint_1]: no reading depends on it"
        assert any(n.startswith("joint_compliance[joint_1]: ") and "add a side pull" in n for n in fit.notes)
    with pytest.raises(NotIdentifiable, match=r"joint_1.*no reading depends on it.*add a side pull"):
        identify(m900ib, readings, ["joint_compliance[joint_1]"])


@pytest.mark.parametrize("options", [FitOptions(), FitOptions(bounds=True)], ids=["plain", "bounds"])
def test_the_physical_balancer_is_not_identifiable(m900ib: Experiment, options: FitOptions) -> None:
    """15 poses at 0.03 mm: its sd is several times its nominal value, and that number is given."""
    at = poses(m900ib, 1)
    readings = simulate(m900ib, make_plan(at, ["pull"] * len(at)), seed=1).readings
    fit = identify(m900ib, readings, ["joint_compliance", BALANCER], options)
    estimate = next(e for e in fit.estimates if e.name == BALANCER)
    assert estimate.state is EstimateState.NOT_IDENTIFIABLE
    if not np.isnan(estimate.sd):
        assert estimate.sd > estimate.initial
    others = [e for e in fit.estimates if e.name != BALANCER]
    assert all(e.state is EstimateState.FINE for e in others)


def test_the_same_fit_told_at_little_noise(m900ib: Experiment) -> None:
    """The verdict follows the numbers: at 0.1 um the same readings do tell the balancer."""
    at = poses(m900ib, 1)
    fine = m900ib.with_(noise=replace(m900ib.noise, sigma=1e-7))
    readings = simulate(fine, make_plan(at, ["pull"] * len(at)), seed=1).readings
    fit = identify(fine, readings, ["joint_compliance", BALANCER])
    assert all(e.state is EstimateState.FINE for e in fit.estimates)


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


def test_a_load_point_on_an_axis_is_to_be_moved(m900ib: Experiment) -> None:
    """A load point on the axis of joint 6: no force turns that joint, whatever its direction."""
    straight = m900ib.with_(load_point=frozen([0.0, 0.0, 0.0]))
    said = what_would_help(straight.model(), "joint_compliance[joint_6]", poses(m900ib, 1))
    axis = "the load point lies on the axis of joint 6, so that no force there turns it: move the load point off it"
    assert said == axis


def test_a_plan_that_tells_nothing_promises_nothing(m900ib: Experiment) -> None:
    """A vertical weight alone never turns joint 1."""
    down = poses(m900ib, 0)
    assert np.isinf(predicted_sd(m900ib, make_plan(down, ["pull"] * len(down)), ["joint_compliance[joint_1]"])).all()
    at = poses(m900ib, 1)
    with pytest.raises(InputError, match="a displacement needs its noise"):
        predicted_sd(m900ib.with_(noise=NoiseModel(None)), make_plan(at, ["pull"] * len(at)))


def test_a_free_length_without_a_stiffness_is_told_why(m900ib: Experiment) -> None:
    """The angles were blamed, which are many. With a nominal stiffness, as the paper's example has it, it is told."""
    stiffness, length = (f"compensator_stiffness[joint_2].{what}" for what in ("stiffness", "free_length"))
    experiment = m900ib.with_(fit=("joint_compliance[joint_2]", stiffness, length))
    at = poses(experiment, 0)
    said = what_would_help(experiment.model(), length, at)
    assert f"it changes nothing while the nominal {stiffness} is 0" in said
    assert "angles of joint_2" in what_would_help(experiment.model(), stiffness, at)
    with pytest.raises(NotIdentifiable, match="changes nothing while the nominal"):
        design(experiment, 6, candidates=60)
    stated = load_experiment(example("m900ib") / "paper_balancer.yaml")
    assert "changes nothing" not in what_would_help(stated.model(), length, at)
    assert np.isfinite(predicted_sd(stated, design(stated, 6, candidates=60))).all()
