"""Masses, friction, link springs and placements, against arithmetic that does not use them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from qsframework.elastostatics import Model, Site, equilibrium, make_model
from qsframework.errors import InputError
from qsframework.plugin import Conditions, Poses, RobotFacts, build_effects
from qsframework.robot import Robot, load_robot

POINT = np.array([0.15, 0.0, 0.2])
C2 = 2e-7
JOINT_2 = {"effect": "joint_compliance", "joint": "joint_2"}
RIGID = {"effect": "base_compliance", "direction": "z"}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("fanuc_m900ib")


@pytest.fixture(scope="module", params=["straight", "crooked"])
def facts(robot: Robot, request: pytest.FixtureRequest) -> RobotFacts:
    """The arm, and the same arm with every joint's frame turned at random."""
    from scipy.spatial.transform import Rotation

    if request.param == "straight":
        return robot.facts
    placements = robot.facts.placements.copy()
    placements[:, :3, :3] = Rotation.from_rotvec(np.random.default_rng(2).normal(size=(robot.facts.n, 3))).as_matrix()
    return dataclasses.replace(robot.facts, placements=placements)


def serial(
    robot: Robot,
    entries: Sequence[Mapping[str, object]],
    values: Mapping[str, float],
    point: np.ndarray = POINT,
    facts: RobotFacts | None = None,
) -> Model:
    """The arm as a plain chain with the effects given, and nothing of its own but its masses."""
    facts = facts or robot.facts
    effects = [e for entry in entries for e in build_effects(entry, facts, ("m",))]
    parameters = [p for e in effects for p in e.parameters(facts)]
    parameters = [dataclasses.replace(p, nominal=values.get(p.name, p.nominal)) for p in parameters]
    return make_model(facts, effects, parameters, Site(6, point), [("m", Site(6, POINT))], robot.gravity)


def poses(robot: Robot, wrench: np.ndarray | None = None, side: np.ndarray | None = None) -> Poses:
    rng = np.random.default_rng(4)
    pendant = rng.uniform(robot.controller.lower, robot.controller.upper, (8, 6)) * 0.9
    wrench = rng.normal(size=(8, 6)) * np.array([3e3] * 3 + [200.0] * 3) if wrench is None else wrench
    at = Conditions(approach=side)
    return Poses(pendant, robot.controller.to_joints(pendant), wrench, at, at)


def frames(facts: RobotFacts, q: np.ndarray) -> list[np.ndarray]:
    """Base to each link, by multiplying matrices; `q` of one pose."""
    from scipy.spatial.transform import Rotation

    out = [np.eye(4)]
    for k in range(facts.n):
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec(q[k] * facts.axes[k]).as_matrix()
        out.append(out[-1] @ facts.placements[k] @ turn)
    return out


@pytest.mark.parametrize(
    ("effect", "link"),
    [("link_compliance", 3), ("link_compliance", 2), ("flange_compliance", 6), ("base_compliance", 0)],
)
@pytest.mark.parametrize("direction", ["x", "y", "z", "rx", "ry", "rz"])
def test_a_spring_at_a_link_s_frame(robot: Robot, facts: RobotFacts, effect: str, link: int, direction: str) -> None:
    """One spring, linear: the load's part along it, times c, moves what lies beyond it."""
    where = f"link_{link}/{direction}" if effect == "link_compliance" else direction
    entry = {"effect": effect, "direction": direction} | ({"link": f"link_{link}"} if "/" in where else {})
    c, p = 3e-8, poses(robot)
    got = serial(robot, [entry], {f"{effect}[{where}]": c}, facts=facts).predict(p, linear=True)[:, 0]
    for i, q in enumerate(p.q):
        at = frames(facts, q)
        axis = at[link][:3, "xyz".index(direction[-1])]
        lever = at[6][:3, :3] @ POINT + at[6][:3, 3] - at[link][:3, 3]
        force, moment = p.wrench[i, :3], p.wrench[i, 3:]
        if direction.startswith("r"):
            expected = c * (axis @ (moment + np.cross(lever, force))) * np.cross(axis, lever)
        else:
            expected = c * (axis @ force) * axis
        assert np.allclose(got[i], expected, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("effect", ["counterweight", "link_mass"])
def test_a_mass_on_the_last_link_hangs_like_a_load(robot: Robot, facts: RobotFacts, effect: str) -> None:
    """Its weight, pulling at its centre, turns joint 2 as far as the same force at that point does."""
    mass, (x, y, z) = 150.0, POINT
    if effect == "counterweight":
        entry = {"effect": effect, "link": "link_6", "x_m": x, "y_m": y, "z_m": z}
        values = {"counterweight[link_6]": mass}
    else:
        entry = {"effect": effect, "link": "link_6"}
        values = dict(
            zip(
                [f"link_mass[link_6].{m}" for m in ("mass", "mx", "my", "mz")],
                mass * np.array([1.0, x, y, z]),
                strict=True,
            )
        )
    stiff = {"joint_compliance[joint_2]": C2}
    weight = np.tile([0.0, 0.0, mass * robot.gravity[2], 0.0, 0.0, 0.0], (8, 1))
    hung = equilibrium(serial(robot, [JOINT_2, entry], stiff | values, facts=facts), poses(robot), loaded=False).tip
    bare = serial(robot, [JOINT_2], stiff, facts=facts)
    pulled = equilibrium(bare, poses(robot, weight)).tip
    plain = equilibrium(bare, poses(robot), loaded=False).tip
    assert np.allclose(hung, pulled, rtol=0, atol=1e-11)
    assert np.abs(hung - plain).max() > 1e-4


def test_a_link_mass_is_that_of_a_heavier_link(robot: Robot, facts: RobotFacts) -> None:
    """First moments are taken in the link's own frame."""
    change = np.array([80.0, 12.0, -7.0, 20.0])
    k = facts.link_index("link_3")
    masses, centres = facts.masses.copy(), facts.centres.copy()
    moment = masses[k] * centres[k] + change[1:]
    masses[k] += change[0]
    centres[k] = moment / masses[k]
    heavier = dataclasses.replace(facts, masses=masses, centres=centres)
    names = [f"link_mass[link_3].{m}" for m in ("mass", "mx", "my", "mz")]
    stiff = {"joint_compliance[joint_2]": C2}
    entries = [JOINT_2, {"effect": "link_mass", "link": "link_3"}]
    one = serial(robot, entries, stiff | dict(zip(names, change, strict=True)), facts=facts)
    two = serial(robot, [JOINT_2], stiff, facts=heavier)
    at = [equilibrium(m, poses(robot), loaded=False).tip for m in (one, two)]
    assert np.allclose(at[0], at[1], rtol=0, atol=1e-12)


def test_friction_is_a_share_of_the_balancer(robot: Robot) -> None:
    """Approached from the side to which it pulls, friction mu is a balancer of mu times the stiffness."""
    mu, stiffness = 0.07, 2e5
    levers = {"joint": "joint_2", "lc_m": 0.235, "l2_m": 1.12, "zero_deg": 25}
    friction = {
        "effect": "compensator_friction",
        **levers,
        "spring_stiffness_N/m": stiffness,
        "free_length_m": 0.7,
    }
    # the spring is longer than 0.7 m everywhere: its moment has the sign of sin b
    side = np.sign(np.sin(poses(robot).q[:, 1] + np.deg2rad(25)))
    assert set(side) == {-1.0, 1.0}
    stiff = {"joint_compliance[joint_2]": C2}
    one = serial(robot, [JOINT_2, friction], stiff | {"compensator_friction[joint_2]": mu})
    values = {"gravity_compensator[joint_2].stiffness": mu * stiffness, "gravity_compensator[joint_2].free_length": 0.7}
    two = serial(robot, [JOINT_2, {"effect": "gravity_compensator", **levers}], stiff | values)
    p = poses(robot, side=side)
    at = [equilibrium(m, p, loaded=False).tip for m in (one, two)]
    assert np.allclose(at[0], at[1], rtol=0, atol=1e-12)
    none = equilibrium(serial(robot, [JOINT_2], stiff), p, loaded=False).tip
    assert np.abs(at[0] - none).max() > 1e-5


@pytest.mark.parametrize("joint", [1, 3, 6])
def test_a_placement_moves_what_the_joint_carries(robot: Robot, facts: RobotFacts, joint: int) -> None:
    """A shift and a turn of a joint's frame is the chain with that frame shifted and turned."""
    error = np.array([3e-4, -5e-4, 2e-4, 4e-4, -3e-4, 6e-4])
    names = [f"joint_placement[joint_{joint}].{a}" for a in ("x", "y", "z", "rx", "ry", "rz")]
    entries = [RIGID, {"effect": "joint_placement", "joint": f"joint_{joint}"}]
    p = poses(robot)
    values = dict(zip(names, error, strict=True))
    got = equilibrium(serial(robot, entries, values, facts=facts), p, loaded=False).tip
    plain = equilibrium(serial(robot, [RIGID], {}, facts=facts), p, loaded=False).tip
    for i, q in enumerate(p.q):
        at = frames(facts, q)
        before = at[joint - 1] @ facts.placements[joint - 1]
        tip = at[6][:3, :3] @ POINT + at[6][:3, 3]
        turn = before[:3, :3] @ error[3:]
        moved = before[:3, :3] @ error[:3] + np.cross(turn, tip - before[:3, 3])
        assert np.allclose(got[i] - plain[i], moved, rtol=0, atol=2e-6)  # the square of the turn, at 3 m
    assert np.abs(got - plain).max() > 2e-4


def test_a_warm_arm_is_a_longer_arm(robot: Robot, facts: RobotFacts) -> None:
    """Every length between joints grows by alpha (T - T0), whichever way the joints' frames stand."""
    alpha, warmth = 1.2e-5, np.linspace(-15.0, 25.0, 8)
    p = poses(robot)
    p = dataclasses.replace(p, loaded=Conditions(temperature=293.15 + warmth))
    warm = serial(robot, [RIGID, {"effect": "thermal_expansion"}], {"thermal_expansion": alpha}, np.zeros(3), facts)
    tip = equilibrium(warm, p).tip - equilibrium(serial(robot, [RIGID], {}, np.zeros(3), facts), p).tip
    expected = [alpha * t * frames(facts, q)[6][:3, 3] for t, q in zip(warmth, p.q, strict=True)]
    assert np.allclose(tip, expected, rtol=1e-9, atol=1e-13)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"effect": "joint_backlash", "joint": "joint_2", "width_Nm": -1}, "width must not be negative"),
        ({"effect": "joint_hardening", "joint": "joint_2", "knee_Nm": -5}, "knee must not be negative"),
        (
            {
                "effect": "compensator_friction",
                "joint": "joint_2",
                "lc_m": 0,
                "l2_m": 1,
                "spring_stiffness_N/m": 1e5,
                "free_length_m": 0.7,
            },
            "lc and l2 must be above 0",
        ),
    ],
)
def test_impossible_settings_are_refused(robot: Robot, entry: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        build_effects(entry, robot.facts)
