"""What a model refuses, and in which words; corners of the springs and of the pulls."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from qsframework.elastostatics import Model, actuator_torques, equilibrium, make_model
from qsframework.errors import InputError, NotConverged, PluginError
from qsframework.experiment import Experiment
from qsframework.plugin import (
    Actuator,
    Array,
    At,
    Bar,
    Context,
    Effect,
    LawTerm,
    Parameter,
    Poses,
    RobotFacts,
    Spring,
    SpringLaw,
    build_effects,
)


def wide(experiment: Experiment, *effects: Effect, own: bool = True) -> Model:
    """The experiment's model with more effects, or with these alone."""
    model = experiment.model()
    markers = list(zip(model.marker_names, model.markers, strict=True))
    given = (*model.effects, *effects) if own else effects
    return make_model(model.facts, given, model.parameters, model.tip, markers, model.gravity)


def batch(experiment: Experiment, count: int = 3) -> Poses:
    q = np.random.default_rng(0).uniform(-0.4, 0.4, (count, 6))
    wrench = np.tile([100.0, 50.0, -900.0, 0.0, 0.0, 0.0], (count, 1))
    return Poses(q, experiment.robot.controller.to_joints(q), wrench)


def build(experiment: Experiment, **entry: object) -> tuple[Effect, ...]:
    return build_effects(entry, experiment.robot.facts)


def test_a_joint_belongs_to_one_loop(m900ib: Experiment) -> None:
    lengths = {"lever_m": 0.75, "bar_m": 1.2, "rocker_mm": 600}
    second = build(m900ib, effect="four_bar", driver="joint_2", driven="joint_3", **lengths)
    with pytest.raises(InputError, match="a joint belongs to one loop only"):
        wide(m900ib, *second)


def test_a_law_needs_its_spring(r2000ic: Experiment) -> None:
    law = build(r2000ic, effect="joint_hardening", joint="joint_2")
    with pytest.raises(InputError, match=r"needs a spring with the role 'gear' at joint_2"):
        wide(r2000ic, *law, own=False)


@dataclass(frozen=True)
class Strange(Spring):
    """A spring of something that is no coordinate."""

    what: object = "hinge"

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter("strange", "rad/(N m)"),)

    def virtual_joints(self, robot: RobotFacts) -> tuple[Actuator, ...]:
        return (self.what,)  # pyright: ignore[reportReturnType]


@pytest.mark.parametrize(
    ("what", "error", "words"),
    [
        ("hinge", PluginError, "not an Actuator, Bar or VirtualJoint"),
        (Bar("no_loop", 0), InputError, "no loop 'no_loop'; loops: parallelogram"),
        (Bar("parallelogram[joint_3]", 7), InputError, "has 1 bars, counted from 0: no bar 7"),
    ],
)
def test_a_coordinate_that_the_arm_has_not(
    m900ib: Experiment, what: object, error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        wide(m900ib, Strange(what))


@pytest.mark.parametrize("x", [np.zeros(3), np.full(16, np.nan)])
def test_parameters_are_one_finite_number_each(m900ib: Experiment, x: Array) -> None:
    with pytest.raises(InputError, match="x must hold 16 finite numbers"):
        m900ib.model().predict(batch(m900ib), x)


def point_spring(experiment: Experiment, second_z: float) -> Effect:
    (effect,) = build(
        experiment,
        effect="point_spring",
        first="link_1",
        first_x_m=0.2,
        first_y_m=0.0,
        first_z_m=0.0,
        second="link_1",
        second_x_m=0.2,
        second_y_m=0.0,
        second_z_m=second_z,
    )
    return effect


def test_a_spring_between_two_points_needs_a_length(m900ib: Experiment) -> None:
    with pytest.raises(InputError, match="its two ends meet"):
        wide(m900ib, point_spring(m900ib, 0.0)).predict(batch(m900ib))


def test_a_spring_within_one_link_does_nothing(m900ib: Experiment) -> None:
    """Both ends on one link: it pulls, but no joint feels it."""
    model = wide(m900ib, point_spring(m900ib, 0.5))
    x = model.nominal
    x[model.index([n for n in model.names if n.startswith("point_spring") and "stiffness" in n])] = 1e6
    poses = batch(m900ib)
    np.testing.assert_allclose(model.predict(poses, x), model.predict(poses), rtol=1e-12)
    np.testing.assert_allclose(actuator_torques(model, poses, x), actuator_torques(m900ib.model(), poses), rtol=1e-12)


def test_the_torque_of_a_spring_between_links_is_held_by_the_actuators(m900ib: Experiment) -> None:
    """Against the derivative of its energy by the joint angle, by differences."""
    (effect,) = build(
        m900ib,
        effect="point_spring",
        first="base_link",
        first_x_m=0.9,
        first_y_m=0.0,
        first_z_m=1.0,
        second="link_2",
        second_x_m=0.3,
        second_y_m=0.1,
        second_z_m=0.6,
    )
    model = wide(m900ib, effect)
    x = model.nominal
    k, s0 = model.index([n for n in model.names if n.startswith("point_spring")])
    x[k], x[s0] = 1e5, 0.4
    poses = batch(m900ib)
    without = x.copy()
    without[k] = 0.0
    found = actuator_torques(model, poses, x) - actuator_torques(model, poses, without)

    robot = m900ib.robot
    sites = [m900ib.site("base_link", np.array([0.9, 0.0, 1.0])), m900ib.site("link_2", np.array([0.3, 0.1, 0.6]))]
    rigid = make_model(robot.facts, [], [], m900ib.load_site, [("a", sites[0]), ("b", sites[1])], robot.gravity)

    def energy(q: Array) -> Array:
        ends = rigid.positions(Poses(q, q, np.zeros_like(poses.wrench)))
        return 0.5e5 * (np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) - 0.4) ** 2

    for joint in range(2):
        step = np.zeros(6)
        step[joint] = 1e-6
        slope = (energy(poses.q + step) - energy(poses.q - step)) / 2e-6
        np.testing.assert_allclose(found[:, joint], -slope, rtol=1e-5, atol=1e-3)
    assert found.shape == (3, 6)
    assert np.abs(found[:, 0]).max() > 0.0
    assert np.abs(found[:, 3:]).max() == 0.0  # nothing beyond link 2 is touched


@dataclass(frozen=True)
class Jump(SpringLaw):
    """A law that jumps and turns back: no step of Newton's helps."""

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter("jump", "rad", nominal=1.0, typical=1.0),)

    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        return (("gear", "joint_2"),)

    def extra(self, torque: Array, x: Array, context: Context) -> LawTerm:
        wave = x[0] * np.where(np.sin(1e3 * torque) > 0, 1.0, -1.0)
        return LawTerm(wave, np.zeros_like(torque), np.sign(wave)[..., None])


@pytest.mark.parametrize(("linear", "words"), [(True, "did not settle|cannot"), (False, "does not settle")])
def test_a_law_without_an_answer_is_not_converged(m900ib: Experiment, linear: bool, words: str) -> None:
    model = wide(m900ib, Jump())
    x = model.nominal
    x[model.index(["compensator_stiffness[joint_2].stiffness"])] = 5e6
    with pytest.raises(NotConverged, match=words):
        model.predict(batch(m900ib), x, linear)


def test_no_poses_no_torques(m900ib: Experiment) -> None:
    none = replace(batch(m900ib), pendant=np.zeros((0, 6)), q=np.zeros((0, 6)), wrench=np.zeros((0, 6)))
    assert actuator_torques(m900ib.model(), none).shape == (0, 6)


def test_names_are_unique_and_known(m900ib: Experiment) -> None:
    with pytest.raises(InputError, match=r"listed twice: joint_compliance\[joint_2\]"):
        wide(m900ib, *build(m900ib, effect="joint_compliance", joint="joint_2"))
    with pytest.raises(InputError, match=r"no parameter 'joint_complience\[joint_2\]'") as caught:
        m900ib.model().index(["joint_complience[joint_2]"])
    assert "joint_compliance[joint_2]" in str(caught.value.problems[0].hint)


@pytest.mark.parametrize("linear", [True, False])
@pytest.mark.parametrize("loaded", [False, True])
def test_positions_and_their_slopes_together_are_those_of_each_alone(
    m900ib: Experiment, loaded: bool, linear: bool
) -> None:
    model, poses = m900ib.model(), batch(m900ib)
    names = [n for n in model.names if n.startswith(("joint_compliance", "gravity"))]
    x = model.nominal
    value, slope = model.position_rates(poses, x, names, loaded, linear)
    np.testing.assert_allclose(value, model.positions(poses, x, loaded, linear), rtol=1e-14)
    np.testing.assert_allclose(slope, model.position_sensitivity(poses, x, names, loaded, linear), atol=1e-18)


def test_readings_are_the_equilibrium_and_what_the_sensor_makes_of_it(m900ib: Experiment) -> None:
    """A scale of 1 % makes the displacement 1 % longer, up to what is linear in it: parts in 1e4."""
    poses = batch(m900ib)
    model = m900ib.model()
    before, after = (equilibrium(model, poses, loaded=on).markers for on in (False, True))
    plain = after - before
    np.testing.assert_allclose(plain, model.predict(poses), atol=1e-14)
    scaled = wide(m900ib, *build(m900ib, effect="tracker_scale"))
    x = scaled.nominal
    np.testing.assert_allclose(scaled.predict(poses, x), plain, atol=1e-15)
    x[scaled.index(["tracker_scale"])] = 0.01
    found = scaled.predict(poses, x)
    np.testing.assert_allclose(found, 1.01 * plain, atol=2e-4 * np.abs(plain).max())
    assert np.abs(found - plain).max() > 5e-3 * np.abs(plain).max()
