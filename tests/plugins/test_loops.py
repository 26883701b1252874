"""Closed loops: four-bar, parallelogram with an imperfect or elastic bar, against plain geometry and statics."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from qsf_plugins.bar_compliance import BarCompliance
from qsf_plugins.closed_chain import ChainLink, ClosedChain
from qsf_plugins.four_bar import BARS, FourBar
from qsf_plugins.joint_compliance import JointCompliance
from qsf_plugins.parallelogram import Parallelogram
from qsframework.elastostatics import Site, make_model
from qsframework.plugin import Array, InputError, Loop, LoopTerm, Poses, RobotFacts, build_effects, check_effect
from qsframework.plugin.check import sample_context, sample_robot
from qsframework.plugin.facts import frozen
from qsframework.plugin.laws import difference
from qsframework.robot import load_robot

ROBOT = sample_robot()
LINK = 1.1
PARALLELOGRAM = Parallelogram("joint_3", "joint_2", 0.75)
EQUAL = FourBar("joint_3", "joint_2", lever=0.75, bar=LINK, rocker=0.75)
BENT = FourBar("joint_3", "joint_2", lever=0.75, bar=1.2, rocker=0.65, lever_zero=1.5, rocker_zero=1.2)
CROSSED = FourBar("joint_3", "joint_2", lever=0.75, bar=1.2, rocker=0.6, branch=-1.0)
BELOW = FourBar("joint_3", "joint_2", lever=0.75, bar=1.05, rocker=0.8, lever_zero=-1.5, rocker_zero=-1.6, branch=-1.0)
BARRED = (EQUAL, BENT, CROSSED, BELOW)


def alike(robot: RobotFacts) -> RobotFacts:
    """The same arm with axis 3 along axis 2: the other sign."""
    return replace(robot, axes=frozen(robot.axes * np.array([1, 1, -1, 1, 1, 1])[:, None]))


def commands(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 2))


def sign(robot: RobotFacts) -> float:
    return float(np.sign(robot.axes[1] @ robot.axes[2]))


def pivots(loop: FourBar, phi: np.ndarray, q: np.ndarray, s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elbow, lever end and rocker end in the fixed plane, as complex numbers: shoulder at 0, link 2 along 1 at zero."""
    elbow = LINK * np.exp(1j * q[:, 0])
    lever = loop.lever * np.exp(1j * (loop.lever_zero + s * phi[:, 1]))
    rocker = elbow + loop.rocker * np.exp(1j * (loop.rocker_zero + q[:, 0] + s * q[:, 1]))
    return elbow, lever, rocker


@pytest.mark.parametrize("loop", [PARALLELOGRAM, *BARRED, BarCompliance("joint_3")], ids=str)
@pytest.mark.parametrize("robot", [ROBOT, alike(ROBOT)], ids=["opposed", "alike"])
def test_the_protocol_holds_for_every_geometry(loop: Loop, robot: RobotFacts) -> None:
    for seed in range(3):
        check_effect(loop, robot, seed)


@pytest.mark.parametrize("robot", [ROBOT, alike(ROBOT)], ids=["opposed", "alike"])
@pytest.mark.parametrize("bar", [0.0, 1e-4, -5e-3])
def test_a_four_bar_of_equal_lengths_is_the_parallelogram(robot: RobotFacts, bar: float) -> None:
    phi = commands(200)
    bars = np.zeros((200, 4))
    bars[:, 0] = bar
    one, other = (
        PARALLELOGRAM.closure(phi, bars[:, :1], sample_context(robot)),
        EQUAL.closure(phi, bars, sample_context(robot)),
    )
    assert np.allclose(other.q, one.q, rtol=0, atol=1e-12)
    assert np.allclose(other.q_u[..., :3], one.q_u, rtol=0, atol=1e-12)
    assert np.allclose(other.q_uu[..., :3, :3], one.q_uu, rtol=0, atol=1e-12 * np.abs(one.q_uu).max())
    if bar == 0.0:
        assert np.array_equal(one.q[:, 1], phi[:, 1] - sign(robot) * phi[:, 0])
        angles = [e.transmission_angle(one.q, robot) for e in (PARALLELOGRAM, EQUAL)]
        assert np.allclose(*angles, rtol=0, atol=1e-7)  # arcsin near 90 deg


def test_slopes_are_taken_once_and_where_they_are_asked_for() -> None:
    asked = list[str]()

    def slope() -> Array:
        asked.append("slope")
        return np.ones((2, 1, 1))

    def bend() -> Array:
        asked.append("bend")
        return np.zeros((2, 1, 1, 1))

    term = LoopTerm(np.zeros((2, 1)), slope, bend)
    assert not asked
    assert term.q_u is term.q_u
    assert asked == ["slope"]
    assert not term.q_uu.any()
    given = LoopTerm(np.zeros((2, 1)), np.ones((2, 1, 1)))
    assert given.q_u is given.slope


def test_a_perfect_bar_loses_nothing_even_where_the_loop_is_flat() -> None:
    phi = np.array([[0.0, np.pi / 2], [0.4, np.pi / 2 - 0.4], [0.1, 0.2]])
    term = PARALLELOGRAM.closure(phi, np.zeros((3, 1)), sample_context(ROBOT))
    assert np.array_equal(term.q[:, 1], phi[:, 1] + phi[:, 0])
    assert np.isfinite(term.q_u).all()
    assert np.isfinite(term.q_uu).all()
    assert not term.q_uu[:, :, :2, :2].any()
    assert abs(term.q_u[0, 1, 2]) > 1e5
    with pytest.raises(InputError, match=r"parallelogram\[joint_3\] cannot close.*first at pose 1.*1.000 mm"):
        PARALLELOGRAM.closure(phi, np.full((3, 1), 1e-3), sample_context(ROBOT))


@pytest.mark.parametrize("robot", [ROBOT, alike(ROBOT)], ids=["opposed", "alike"])
@pytest.mark.parametrize("loop", BARRED, ids=str)
def test_the_bar_spans_the_two_pivots_and_the_branch_is_kept(loop: FourBar, robot: RobotFacts) -> None:
    phi = commands(100)
    q = loop.closure(phi, np.zeros((100, 4)), sample_context(robot)).q
    elbow, lever, rocker = pivots(loop, phi, q, sign(robot))
    assert np.allclose(np.abs(rocker - lever), loop.bar, rtol=0, atol=1e-13)
    turn = np.angle((rocker - elbow) / (rocker - lever))
    assert np.array_equal(np.sign(turn), np.full(100, loop.branch))
    at_lever = np.angle((rocker - lever) / lever)
    angle = np.minimum(np.arcsin(np.abs(np.sin(turn))), np.arcsin(np.abs(np.sin(at_lever))))
    assert np.allclose(loop.transmission_angle(q, robot), angle, atol=1e-7)


def test_two_branches_are_two_assemblies_of_the_same_bars() -> None:
    other = replace(CROSSED, branch=1.0)
    phi = commands(50)
    q = [e.closure(phi, np.zeros((50, 4)), sample_context(ROBOT)).q[:, 1] for e in (CROSSED, other)]
    assert np.abs(q[0] - q[1]).min() > 0.1
    for loop, angle in zip((CROSSED, other), q, strict=True):
        back = loop.actuators(np.stack([phi[:, 0], angle], axis=1), ROBOT)
        assert np.allclose(back, phi, rtol=0, atol=1e-12)


@pytest.mark.parametrize("loop", [PARALLELOGRAM, *BARRED], ids=str)
def test_slopes_agree_with_differences(loop: Loop) -> None:
    m = len(loop.parameters(ROBOT))
    u = np.concatenate([commands(50, 1), np.random.default_rng(1).normal(0, 1e-3, (50, m))], axis=1)
    term = loop.closure(u[:, :2], u[:, 2:], sample_context(ROBOT))
    first = difference(lambda v: loop.closure(v[:, :2], v[:, 2:], sample_context(ROBOT)).q, u)
    second = difference(lambda v: loop.closure(v[:, :2], v[:, 2:], sample_context(ROBOT)).q_u, u)
    assert np.allclose(term.q_u[..., :2], first[..., :2], rtol=0, atol=1e-9)
    assert np.allclose(term.q_u, first, rtol=0, atol=1e-7)  # by a length: steps of 1e-8 m
    assert np.allclose(term.q_uu[..., :2], second[..., :2], rtol=0, atol=1e-9 * np.abs(second).max())
    assert np.allclose(term.q_uu, np.swapaxes(term.q_uu, -1, -2), rtol=0, atol=1e-12 * np.abs(second).max())


@pytest.mark.parametrize("robot", [ROBOT, alike(ROBOT)], ids=["opposed", "alike"])
def test_the_parallelogram_keeps_the_determinant_of_the_compliance(robot: RobotFacts) -> None:
    """Equation (16), corrected: G diag(c2, c3) G' has determinant c2 c3; a four-bar scales it by det(G)^2."""
    c = np.diag([0.14e-6, 0.2e-6])
    for loop in (PARALLELOGRAM, EQUAL):
        G = loop.closure(commands(20), np.zeros((20, len(loop.parameters(robot)))), sample_context(robot)).q_u[..., :2]
        assert np.allclose(np.linalg.det(G @ c @ np.swapaxes(G, 1, 2)), np.linalg.det(c), rtol=1e-12, atol=0.0)
        s = sign(robot)
        serial = np.array([[c[0, 0], -s * c[0, 0]], [-s * c[0, 0], c[0, 0] + c[1, 1]]])
        assert np.allclose(G @ c @ np.swapaxes(G, 1, 2), serial, rtol=1e-12, atol=0.0)
    G = BENT.closure(commands(20), np.zeros((20, 4)), sample_context(robot)).q_u[..., :2]
    ratio = np.linalg.det(G @ c @ np.swapaxes(G, 1, 2)) / np.linalg.det(c)
    assert np.allclose(ratio, np.linalg.det(G) ** 2, rtol=1e-9)
    assert np.abs(ratio - 1.0).max() > 0.1


def test_a_loop_that_cannot_close_says_where() -> None:
    phi = np.array([[0.0, 0.1], [0.0, 1.5], [0.1, 0.1]])
    with pytest.raises(InputError) as caught:
        BENT.closure(phi, np.zeros((3, 4)), sample_context(ROBOT))
    for word in ("four_bar[joint_3]", "at 1 of 3 poses", "pose 2", "joint_3 85.94 deg", "branch"):
        assert word in str(caught.value)
    with pytest.raises(InputError, match="no lever angle that reaches"):
        BENT.actuators(np.array([[0.0, 3.0]]), ROBOT)
    assert BENT.transmission_angle(np.array([[0.0, 3.0]]), ROBOT)[0] == 0.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"bar_m": 5.0}, "does not close at zero actuator angles"),
        ({"bar_m": -1.0}, "bar must be a positive length"),
        ({"branch": 2}, "branch must be 1 or -1"),
        ({"driven": "joint_5"}, "must be the joint after joint_2"),
        ({"driver": "joint_1", "driven": "joint_2"}, "needs parallel axes"),
        ({"lever_zero_m": 1.0}, "lever_zero_deg"),
    ],
)
def test_spec_entries_of_a_four_bar(change: dict[str, object], words: str) -> None:
    entry = {
        "effect": "four_bar",
        "driver": "joint_2",
        "driven": "joint_3",
        "lever_mm": 750,
        "bar_m": 1.2,
        "rocker_m": 0.6,
        "lever_zero_deg": 80,
        "branch": 1,
    }
    assert build_effects(entry, ROBOT)[0].name == "four_bar[joint_3]"
    with pytest.raises(InputError) as caught:
        build_effects(entry | change, ROBOT)
    assert words in str(caught.value)


def test_bars_are_told_apart_by_name() -> None:
    names = [p.name for p in BENT.parameters(ROBOT)]
    assert names == [f"four_bar[joint_3].{b}" for b in BARS]
    effects = build_effects({"effect": "bar_compliance", "driven": "joint_3", "loop": "four_bar", "bar": 1}, ROBOT)
    assert effects[0].name == "bar_compliance[joint_3/1]"
    with pytest.raises(InputError, match="whole number"):
        build_effects({"effect": "bar_compliance", "driven": "joint_3", "bar": 0.5}, ROBOT)
    with pytest.raises(InputError, match="no loop 'parallelogram"):
        make_model(ROBOT, [BarCompliance("joint_3")], [], TIP, [], np.zeros(3))


# An elastic bar, held against statics with nothing but rotation matrices.

TIP = Site(6, np.array([0.15, 0.0, 0.2]))
SOFT = 3e-9


@cache
def arm() -> RobotFacts:
    """The M-900iB without masses."""
    facts = load_robot("fanuc_m900ib").facts
    return replace(facts, masses=frozen(np.zeros(facts.n + 1)))


def frames(q: np.ndarray) -> list[np.ndarray]:
    here, out = np.eye(4), [np.eye(4)]
    for placement, axis, angle in zip(arm().placements, arm().axes, q, strict=True):
        x, y, z = axis
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn = np.eye(4)
        turn[:3, :3] = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        here = here @ placement @ turn
        out.append(here)
    return out


def at(frame: np.ndarray, point: np.ndarray) -> np.ndarray:
    return frame[:3, :3] @ point + frame[:3, 3]


def tip(q: np.ndarray) -> np.ndarray:
    return at(frames(q)[6], TIP.xyz)


def with_elbow(q: np.ndarray, angle: float) -> np.ndarray:
    return np.array([*q[:2], angle, *q[3:]])


def slope(f, x: float, h: float = 1e-4) -> np.ndarray:
    return (8 * (f(x + h) - f(x - h)) - (f(x + 2 * h) - f(x - 2 * h))) / (12 * h)


def poses_at(transmission: np.ndarray) -> Poses:
    """Poses with given transmission angles (deg); the lever hangs at 90 deg to link 2 at zero."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-0.5, 0.5, (len(transmission), 6))
    q[:, 2] = np.deg2rad(90.0 - transmission)
    wrench = np.zeros((len(q), 6))
    wrench[:, :3] = rng.normal(0, 2e3, (len(q), 3))
    return Poses(q, q, wrench)


def rear_pivot() -> np.ndarray:
    return np.array([-0.75, 0.0, 0.0])


ANGLES = np.array([90.0, 60.0, 35.0, 20.0, 12.0, 6.0, 4.0, 2.0])


@pytest.mark.parametrize("kind", ["parallelogram", "four_bar"])
def test_an_elastic_bar_agrees_with_statics(kind: str) -> None:
    """Bar force = torque of joint 3 / (lever sin mu); elongation = c force; joint 3 turns by it / (lever sin mu)."""
    loop: Loop = Parallelogram("joint_3", "joint_2", 0.75, zero=-np.pi / 2)
    if kind == "four_bar":
        loop = FourBar(
            "joint_3",
            "joint_2",
            lever=0.75,
            bar=1.12,
            rocker=0.75,
            lever_zero=-np.pi / 2,
            rocker_zero=-np.pi / 2,
            branch=-1.0,
        )
    poses = poses_at(ANGLES)
    model = make_model(arm(), [loop, BarCompliance("joint_3", kind)], [], TIP, [("tip", TIP)], np.zeros(3))
    x = np.zeros(len(model.parameters))
    x[-1] = SOFT
    found = model.predict(poses, x, linear=True)[:, 0]
    for q, wrench, degrees, displacement in zip(poses.q, poses.wrench, ANGLES, found, strict=True):
        rate = slope(lambda angle, q=q: tip(with_elbow(q, angle)), q[2])
        here = frames(q)
        link, lever = here[3][:3, 3] - here[2][:3, 3], at(here[3], rear_pivot()) - here[3][:3, 3]
        sine = np.linalg.norm(np.cross(link, lever)) / np.linalg.norm(link) / 0.75
        assert np.isclose(sine, np.sin(np.deg2rad(degrees)))
        force = rate @ wrench[:3] / (0.75 * sine)
        assert np.allclose(displacement, rate * SOFT * force / (0.75 * sine), rtol=1e-8, atol=1e-14)


def test_the_full_equilibrium_of_an_elastic_bar_agrees_with_its_geometry() -> None:
    """The lever stands still; joint 3 turns until the stretch of the measured bar balances the force."""
    from scipy.optimize import brentq

    poses = poses_at(ANGLES[:-1])
    loop = Parallelogram("joint_3", "joint_2", 0.75, zero=-np.pi / 2)
    model = make_model(arm(), [loop, BarCompliance("joint_3")], [], TIP, [("tip", TIP)], np.zeros(3))
    found = model.predict(poses, np.array([0.0, SOFT]))[:, 0]
    for q, wrench, displacement in zip(poses.q, poses.wrench, found, strict=True):
        here = frames(q)
        end = here[2][:3, 3] + at(here[3], rear_pivot()) - here[3][:3, 3]

        def length(angle: float, q=q, end=end) -> float:
            return float(np.linalg.norm(at(frames(with_elbow(q, angle))[3], rear_pivot()) - end))

        def imbalance(angle: float, q=q, wrench=wrench, length=length) -> float:
            torque = slope(lambda a: tip(with_elbow(q, a)), angle) @ wrench[:3]
            return float(torque - (length(angle) - 1.12) / SOFT * slope(length, angle))

        reach = 4.0 * np.linalg.norm(displacement) / 1.5 + 1e-6
        settled = brentq(imbalance, q[2] - reach, q[2] + reach, xtol=1e-15)
        assert np.allclose(displacement, tip(with_elbow(q, settled)) - tip(q), rtol=1e-6, atol=1e-10)


def test_an_elastic_bar_counts_as_one_over_sine_squared() -> None:
    loop = Parallelogram("joint_3", "joint_2", 0.75, zero=-np.pi / 2)
    q = np.zeros((len(ANGLES), 6))
    q[:, 2] = np.deg2rad(90.0 - ANGLES)
    wrench = np.zeros((len(q), 6))
    wrench[:, 4] = 1e3  # a moment about the joint's axis: the torque is the same at every pose
    model = make_model(
        arm(), [loop, BarCompliance("joint_3")], [], TIP, [("elbow", Site(3, np.array([0, 0, 1.0])))], np.zeros(3)
    )
    size = np.linalg.norm(model.predict(Poses(q, q, wrench), np.array([0.0, SOFT]), linear=True)[:, 0], axis=1)
    assert np.allclose(size * np.sin(np.deg2rad(ANGLES)) ** 2, size[0], rtol=1e-9)
    assert np.isclose(size[0], SOFT * 1e3 / 0.75**2)


def test_motors_and_bar_give_together() -> None:
    """Springs in series, linear: each gives as if it were alone."""
    loop = Parallelogram("joint_3", "joint_2", 0.75, zero=-np.pi / 2)
    poses = poses_at(ANGLES)
    springs = [JointCompliance("joint_2"), JointCompliance("joint_3"), BarCompliance("joint_3")]
    model = make_model(arm(), [loop, *springs], [], TIP, [("tip", TIP)], np.zeros(3))
    x = np.array([0.0, 1.4e-7, 2e-7, SOFT])
    alone = sum(model.predict(poses, x * keep, linear=True) for keep in np.eye(4)[1:])
    assert np.allclose(model.predict(poses, x, linear=True), alone, rtol=1e-12, atol=1e-18)


# A chain given by its pivots, held against the planar loops and against Pinocchio's point constraint.


def pivot(length: float, angle: float) -> np.ndarray:
    """A point about the driver's axis (+y) from link 2 (+z at zero): angles count from z to x."""
    return length * np.array([np.sin(angle), 0.0, np.cos(angle)])


def drawn(loop: FourBar, robot: RobotFacts) -> ClosedChain:
    """The chain of a four-bar that is closed at zero angles: its rocker_zero must fit."""
    lever = pivot(loop.lever, loop.lever_zero)
    end = np.array([0.0, 0.0, LINK]) + pivot(loop.rocker, loop.rocker_zero)
    links = (
        ChainLink("lever", (0.0, sign(robot), 0.0), tuple(lever)),
        ChainLink("bar", (0.0, 1.0, 0.0), tuple(end)),
    )
    return ClosedChain("joint_3", "joint_2", links)


def closed_at_zero(loop: FourBar, robot: RobotFacts) -> FourBar:
    q = loop.closure(np.zeros((1, 2)), np.zeros((1, 4)), sample_context(robot)).q[0, 1]
    return replace(loop, rocker_zero=loop.rocker_zero + sign(robot) * q)


SPATIAL = ClosedChain(
    "joint_3",
    "joint_2",
    (
        ChainLink("lever", tuple(np.array([0.1, -1.0, 0.05]) / np.linalg.norm([0.1, -1.0, 0.05])), (0.7, 0.25, 0.1)),
        ChainLink("knuckle", (0.0, 1.0, 0.0), (0.7, 0.25, 0.1)),
        ChainLink("bar", (1.0, 0.0, 0.0), (0.75, 0.1, 1.15)),
    ),
    at=(0.0, 0.2, 0.0),
)


@pytest.mark.parametrize("robot", [ROBOT, alike(ROBOT)], ids=["opposed", "alike"])
@pytest.mark.parametrize("loop", BARRED, ids=str)
def test_a_chain_reproduces_the_planar_loops(loop: FourBar, robot: RobotFacts) -> None:
    loop = closed_at_zero(loop, robot)
    chain = drawn(loop, robot)
    assert [p.name for p in chain.parameters(robot)] == ["closed_chain[joint_3].lever", "closed_chain[joint_3].bar"]
    check_effect(chain, robot)
    phi = commands(100)
    bars = np.random.default_rng(2).normal(0, 1e-3, (100, 4)) * [1, 1, 0, 0]
    ours, theirs = (
        chain.closure(phi, bars[:, [1, 0]], sample_context(robot)),
        loop.closure(phi, bars, sample_context(robot)),
    )
    columns = [0, 1, 3, 2]
    assert np.allclose(ours.q, theirs.q, rtol=0, atol=1e-10)
    assert np.allclose(ours.q_u, theirs.q_u[..., columns], rtol=0, atol=1e-10)
    theirs_uu = theirs.q_uu[..., columns, :][..., columns]
    assert np.allclose(ours.q_uu, theirs_uu, rtol=0, atol=1e-10 * np.abs(theirs_uu).max())
    angles = [e.transmission_angle(theirs.q, robot) for e in (chain, loop)]
    assert np.allclose(*angles, rtol=0, atol=1e-6)  # arcsin near 90 deg
    if loop.bar == LINK:
        one, other = (
            chain.closure(phi, 0 * phi, sample_context(robot)),
            PARALLELOGRAM.closure(phi, 0 * phi[:, :1], sample_context(robot)),
        )
        assert np.allclose(one.q, other.q, rtol=0, atol=1e-12)
        assert np.allclose(one.q_u[..., [0, 1, 3]], other.q_u, rtol=0, atol=1e-12)


@pytest.mark.parametrize("loop", [drawn(EQUAL, ROBOT), drawn(closed_at_zero(BENT, ROBOT), ROBOT), SPATIAL], ids=str)
def test_a_chain_agrees_with_pinocchios_point_constraint(loop: ClosedChain) -> None:
    """Link 2, elbow and mechanism as an explicit pin.Model: the points meet, and the constraint gives our slopes."""
    import pinocchio as pin

    model = pin.Model()

    def add(parent: int, axis: tuple[float, ...] | np.ndarray, at: np.ndarray) -> int:
        placement = pin.SE3(np.eye(3), np.array(at, dtype=float))
        return model.addJoint(parent, pin.JointModelRevoluteUnaligned(np.array(axis)), placement, f"j{model.njoints}")

    elbow = np.array([0.0, 0.0, LINK])
    shoulder = add(0, (0.0, 1.0, 0.0), np.zeros(3))
    forearm = add(shoulder, (0.0, -1.0, 0.0), elbow)
    here, end = 0, np.zeros(3)
    for link, start in zip(loop.links, (loop.at, *(link.to for link in loop.links)), strict=False):
        here = add(here, link.axis, np.array(start) - end)
        end = np.array(start)
    close = np.array(loop.links[-1].to)
    constraint = pin.PointAnchorConstraintModel(
        model, here, pin.SE3(np.eye(3), close - end), forearm, pin.SE3(np.eye(3), close - elbow)
    )
    data, cdata = model.createData(), constraint.createData()
    m = len(loop.parameters(ROBOT))
    free = [1, *range(3, 2 + len(loop.links))]
    for phi in commands(20, 4):
        term = loop.closure(phi[None], np.zeros((1, m)), sample_context(ROBOT))
        q = np.zeros(model.nq)
        q[0], q[2], q[1] = *phi, 0.0
        for share in np.linspace(0.1, 1.0, 10):
            q[0], q[2] = share * phi
            for _ in range(10):
                pin.computeJointJacobians(model, data, q)
                constraint.calc(model, data, cdata)
                J = constraint.jacobian(model, data, cdata)
                q[free] -= np.linalg.lstsq(J[:, free], cdata.constraint_position_error, rcond=1e-10)[0]
        assert np.abs(cdata.constraint_position_error).max() < 1e-12
        assert np.isclose(term.q[0, 1], q[1], rtol=0, atol=1e-10)
        slopes = -np.linalg.lstsq(J[:, free], J[:, [0, 2]], rcond=1e-10)[0][0]
        assert np.allclose(term.q_u[0, 1, :2], slopes, rtol=0, atol=1e-10)


def test_a_spatial_chain_keeps_the_protocol() -> None:
    for seed in range(3):
        check_effect(SPATIAL, ROBOT, seed)
    assert [p.name.split(".")[1] for p in SPATIAL.parameters(ROBOT)] == ["lever", "bar"]


def test_an_elastic_bar_of_a_chain_is_that_of_the_parallelogram() -> None:
    chain = drawn(EQUAL, ROBOT)
    springs = BarCompliance("joint_3", "closed_chain", 1), BarCompliance("joint_3")
    poses = poses_at(ANGLES[:5])
    found = []
    for loop, spring in zip((chain, PARALLELOGRAM), springs, strict=True):
        model = make_model(ROBOT, [loop, spring], [], TIP, [("tip", TIP)], np.zeros(3))
        x = np.zeros(len(model.parameters))
        x[-1] = SOFT
        found.append([model.predict(poses, x, linear) for linear in (True, False)])
    assert np.allclose(*found, rtol=1e-9, atol=1e-15)


LINKS = [
    {"name": "lever", "axis": [0, -2, 0], "to_mm": [750, 0, 0]},
    {"name": "bar", "axis": [0, 1, 0], "to_m": [0.75, 0, 1.1]},
]


@pytest.mark.parametrize(
    ("links", "words"),
    [
        (LINKS[:1], "a list of two or three links"),
        ("lever", "a list of two or three links"),
        ([LINKS[0], LINKS[0]], "link 2 needs a name of its own"),
        ([LINKS[0], {"name": "bar", "axis": [0, 0, 0], "to_m": [1, 0, 0]}], "must not be zero"),
        ([LINKS[0], {"name": "bar", "axis": [0, 1, 0], "to": [1, 0, 0]}], "link 2 needs to_m: three numbers"),
        ([LINKS[0], LINKS[1] | {"at_m": [0, 0, 0]}], "unknown key in link 2; found 'at_m'"),
        ([LINKS[0], LINKS[1] | {"to_m": [1.5, 0.0, 0.0]}], None),
        ([LINKS[0], LINKS[1] | {"axis": [1, 0, 0]}], "flat, or its links are free"),
        ([*LINKS[:1], LINKS[1] | {"name": "knee"}, LINKS[1] | {"to_m": [0.3, 0, 0.4]}], "flat, or its links are free"),
    ],
)
def test_spec_entries_of_a_chain(links: object, words: str | None) -> None:
    entry = {"effect": "closed_chain", "driver": "joint_2", "driven": "joint_3", "links": links}
    if words is None:
        assert build_effects(entry, ROBOT)[0].name == "closed_chain[joint_3]"
        return
    with pytest.raises(InputError) as caught:
        build_effects(entry, ROBOT)
    assert words in str(caught.value)


def test_a_chain_that_cannot_close_says_where() -> None:
    chain = build_effects({"effect": "closed_chain", "driver": "joint_2", "driven": "joint_3", "links": LINKS}, ROBOT)[
        0
    ]
    assert isinstance(chain, ClosedChain)
    with pytest.raises(InputError, match=r"closed_chain\[joint_3\] cannot close without passing a flat.* pose 2"):
        chain.closure(np.array([[0.0, 0.1], [0.0, 2.0]]), np.zeros((2, 2)), sample_context(ROBOT))
    assert chain.transmission_angle(np.array([[0.0, 2.0]]), ROBOT)[0] == 0.0
    with pytest.raises(InputError, match="at these joint angles"):
        chain.actuators(np.array([[0.0, 2.0]]), ROBOT)


def test_a_bar_that_the_loop_does_not_have_is_an_error() -> None:
    from qsframework.elastostatics import Site, make_model
    from qsframework.plugin.check import sample_robot

    robot = sample_robot()
    effects = [
        *build_effects({"effect": "parallelogram", "driver": "joint_2", "driven": "joint_3", "lever_m": 0.75}, robot),
        *build_effects({"effect": "bar_compliance", "driven": "joint_3", "bar": 7}, robot),
    ]
    with pytest.raises(InputError, match="has 1 bars, counted from 0: no bar 7"):
        make_model(robot, effects, [], Site(6, np.zeros(3)), [], np.zeros(3))
