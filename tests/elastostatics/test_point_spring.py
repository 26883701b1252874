"""The general spring between two points against the closed form of the balancer and against energy."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from qsframework.elastostatics import Model, Site, cartesian_compliance, make_model
from qsframework.errors import InputError
from qsframework.plugin import Effect, Poses, build_effects
from qsframework.robot import Robot, load_robot

TIP = Site(6, np.array([0.15, 0.0, 0.2]))
PIVOTS = {
    "first": "link_1",
    "first_x_m": 0.41,
    "first_y_m": 0.0,
    "first_z_m": 0.235,
    "second": "link_2",
    "second_x_m": 0.0,
    "second_y_m": 0.0,
    "second_z_m": 1.12,
}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("fanuc_m900ib")


def arm(robot: Robot, *balancers: Effect, stiffness: float = 4e6, free_length: float = 0.7) -> Model:
    """The M-900iB with other balancers, stiff enough to matter."""
    kept = [e for e in robot.effects if "compensator" not in e.effect_name()]
    own = [p for e in balancers for p in e.parameters(robot.facts)]
    values = {".stiffness": stiffness, ".free_length": free_length}
    own = [dataclasses.replace(p, nominal=values.get(p.name[p.name.rindex(".") :], p.nominal)) for p in own]
    return make_model(robot.facts, [*kept, *balancers], [*robot.parameters, *own], TIP, [("tip", TIP)], robot.gravity)


def poses(robot: Robot) -> Poses:
    rng = np.random.default_rng(3)
    pendant = rng.uniform(robot.controller.lower, robot.controller.upper, (25, 6))
    wrench = rng.normal(size=(25, 6)) * np.array([3e3] * 3 + [200.0] * 3)
    return Poses(pendant, robot.controller.to_joints(pendant), wrench)


def test_it_equals_the_closed_form_of_the_balancer(robot: Robot) -> None:
    """Equations (7)-(11): same linear prediction, equilibrium, stiffness and sensitivities."""
    points = build_effects({"effect": "point_spring", **PIVOTS}, robot.facts)
    closed = build_effects(
        {"effect": "gravity_compensator", "joint": "joint_2", "lc_m": 0.235, "l2_m": 1.12}, robot.facts
    )
    p, a, b = poses(robot), arm(robot, *points), arm(robot, *closed)
    assert np.allclose(a.predict(p), b.predict(p), rtol=1e-11, atol=1e-16)
    assert np.allclose(a.predict(p), b.predict(p), rtol=1e-9, atol=1e-15)
    assert np.allclose(cartesian_compliance(a, p), cartesian_compliance(b, p), rtol=1e-9, atol=1e-16)
    for name in ("stiffness", "free_length"):
        first = a.sensitivity(p, names=[f"{points[0].name}.{name}"])
        second = b.sensitivity(p, names=[f"{closed[0].name}.{name}"])
        assert np.allclose(first, second, rtol=1e-8, atol=1e-9 * np.abs(second).max())


def test_two_balancers_on_one_joint_add_up(robot: Robot) -> None:
    one = build_effects({"effect": "point_spring", **PIVOTS}, robot.facts)
    sides = [
        build_effects({"effect": "point_spring", **PIVOTS, "first_y_m": y, "second_y_m": y}, robot.facts)[0]
        for y in (0.3,)
    ]
    other = build_effects(
        {"effect": "gravity_compensator", "joint": "joint_2", "lc_m": 0.235, "l2_m": 1.12}, robot.facts
    )
    p = poses(robot)
    both, double = arm(robot, *sides, *other, stiffness=2e6), arm(robot, *one, stiffness=4e6)
    assert np.allclose(both.predict(p), double.predict(p), rtol=1e-11, atol=1e-16)
    assert np.allclose(both.predict(p), double.predict(p), rtol=1e-9, atol=1e-15)


def test_two_springs_with_labels_are_one_of_twice_the_stiffness(robot: Robot) -> None:
    """Left and right beside link 2, of both kinds: each half of the one that they stand for."""
    entries = (
        {"effect": "point_spring", **PIVOTS},
        {"effect": "gravity_compensator", "joint": "joint_2", "lc_m": 0.235, "l2_m": 1.12},
    )
    p = poses(robot)
    for entry in entries:
        one = arm(robot, *build_effects(entry, robot.facts), stiffness=4e6)
        sides = [e for s in ("left", "right") for e in build_effects({**entry, "label": s}, robot.facts)]
        both = arm(robot, *sides, stiffness=2e6)
        assert np.allclose(both.predict(p), one.predict(p), rtol=1e-11, atol=1e-16)
        assert np.allclose(both.predict(p), one.predict(p), rtol=1e-9, atol=1e-15)
        with pytest.raises(InputError, match=r"effect listed twice: .*give each a name of its own, such as label"):
            arm(robot, *build_effects(entry, robot.facts), *build_effects(entry, robot.facts))


def test_compliance_with_a_spring_across_many_joints(robot: Robot) -> None:
    """A spring from the pedestal to the wrist: equation (18) against differences of the equilibrium."""
    across = {
        "effect": "point_spring",
        "first": "base_link",
        "first_x_m": 1.5,
        "first_y_m": 0.4,
        "first_z_m": 2.5,
        "second": "link_4",
        "second_x_m": 0.3,
        "second_y_m": 0.2,
        "second_z_m": 0.1,
    }
    model, p = arm(robot, *build_effects(across, robot.facts), stiffness=2e5), poses(robot)
    C = cartesian_compliance(model, p)[:, :3, :3]
    h = 20.0
    from qsframework.elastostatics import equilibrium

    for k in range(3):

        def tip(scale: float, k: int = k) -> np.ndarray:
            return equilibrium(model, Poses(p.pendant, p.q, p.wrench + scale * h * np.eye(6)[k])).tip

        slope = (8 * (tip(1) - tip(-1)) - (tip(2) - tip(-2))) / (12 * h)
        assert np.abs(C[:, :, k] - slope).max() < 5e-10 * np.abs(C).max()


def test_ends_that_meet_are_an_error(robot: Robot) -> None:
    meeting = {**PIVOTS, "second": "link_1", "second_x_m": 0.41, "second_z_m": 0.235}
    model = arm(robot, *build_effects({"effect": "point_spring", **meeting}, robot.facts))
    with pytest.raises(InputError, match="its two ends meet"):
        model.predict(poses(robot))
