"""Arms on which joints slide: kinematics, gravity, equilibrium and derivatives, and what is refused of them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sliding_arms import ARMS, write_arm

from qsframework.elastostatics import Model, Site, cartesian_compliance, equilibrium, make_model
from qsframework.errors import InputError
from qsframework.plugin import Array, Effect, Poses, Spring, SpringLaw, build_effects, registry
from qsframework.robot import Robot, load_robot
from qsframework.robot.agreement import kernel_statics
from qsframework.robot.reference import reference_statics

WRENCH = np.array([300.0, -200.0, -900.0, 40.0, 60.0, -30.0])


@pytest.fixture(params=sorted(ARMS))
def robot(request: pytest.FixtureRequest, tmp_path: Path) -> Robot:
    return load_robot(write_arm(tmp_path, request.param))


def some(robot: Robot, count: int, seed: int = 0) -> Array:
    limits = robot.facts.limits
    assert limits is not None
    return np.random.default_rng(seed).uniform(limits[:, 0], limits[:, 1], (count, robot.facts.n))


def poses(robot: Robot, count: int, seed: int = 0) -> Poses:
    q = some(robot, count, seed)
    return Poses(robot.controller.to_pendant(q), q, np.tile(WRENCH, (count, 1)))


def model(robot: Robot, *more: Effect) -> Model:
    facts, effects = robot.facts, (*robot.effects, *more)
    parameters = (*robot.parameters, *(p for e in more for p in e.parameters(facts)))
    site = Site(facts.n, np.array([0.1, 0.2, 0.3]))
    markers = [("tip", site), ("elbow", Site(facts.n - 1, np.array([0.2, 0.0, 0.1])))]
    return make_model(facts, effects, parameters, site, markers, robot.gravity)


def test_a_joint_that_slides_says_so_in_its_unit(robot: Robot) -> None:
    slides = [robot.facts.slides(joint) for joint in robot.facts.joints]
    assert slides == list(robot.facts.sliding)
    names = robot.controller.units.names()
    assert names == tuple(f"q{k + 1}_{'mm' if s else 'deg'}" for k, s in enumerate(slides))
    q = some(robot, 3)
    assert np.allclose(robot.controller.units.si(robot.controller.units.shown(q)), q, atol=1e-15)
    assert {p.unit for p in robot.parameters} == {"m/N", "rad/(N m)"}


def test_kinematics_and_gravity_are_those_of_pinocchio(robot: Robot) -> None:
    q = some(robot, 40)
    ours, theirs = kernel_statics(robot, q), reference_statics(robot, q)
    for name in ("positions", "rotations", "linear", "angular"):
        assert np.abs(getattr(ours, name) - getattr(theirs, name)).max() < 1e-12, name
    assert np.abs(ours.torque - theirs.torque).max() < 1e-12 * np.abs(theirs.torque).max() * 10


@pytest.mark.parametrize("linear", [True, False])
def test_every_derivative_of_every_effect_that_is_offered(robot: Robot, linear: bool) -> None:
    """Readings by each parameter, loaded minus unloaded, against differences."""
    at = poses(robot, 3)
    places = [e for kind in registry().values() for e in kind.places(robot.facts, ("tip", "elbow"))]
    offered = [e for e in places if e.name not in {o.name for o in robot.effects} and fits(e, robot) and not e.needs]
    assert {type(e).__name__ for e in offered} > {"OffaxisCompliance", "JointPlacement", "JointOffset", "GearRatio"}
    for effect in offered:
        whole = model(robot, *springs_below(effect, robot), effect)
        x = np.array([p.nominal or 0.3 * p.typical for p in whole.parameters])
        exact = whole.sensitivity(at, x, linear=linear)
        for i, p in enumerate(whole.parameters):
            if not p.name.startswith(effect.name):
                continue
            h = 1e-4 * abs(x[i])
            up, down = (np.where(np.arange(len(x)) == i, x + s * h, x) for s in (1.0, -1.0))
            slope = (whole.predict(at, up, linear) - whole.predict(at, down, linear)) / (2.0 * h)
            floor = 1e-12 / h + 1e-5 * np.abs(exact[..., i]).max()
            assert np.abs(slope - exact[..., i]).max() < floor, p.name


def springs_below(effect: Effect, robot: Robot) -> list[Effect]:
    """The springs that a law bends where the robot has them not."""
    if not isinstance(effect, SpringLaw):
        return []
    have = {(e.role, e.where) for e in robot.effects if isinstance(e, Spring)}
    kinds = [k for k in registry().values() if issubclass(k, Spring)]
    return [
        next(e for k in kinds if k.role == role for e in k.places(robot.facts) if e.where == where)
        for role, where in effect.springs(robot.facts)
        if (role, where) not in have
    ]


def fits(effect: Effect, robot: Robot) -> bool:
    try:
        effect.require_fit(robot.facts)
    except InputError:
        return False
    return True


def test_the_equilibrium_gives_as_its_compliance_says(robot: Robot) -> None:
    """(18), with the hessian of the load and of gravity, against differences of the settled tip, (17)."""
    at, whole = poses(robot, 4), model(robot)
    found, slope = cartesian_compliance(whole, at), np.empty((len(at), 6, 6))
    for i, unit in enumerate(np.eye(6)):
        up, down = (equilibrium(whole, Poses(at.pendant, at.q, at.wrench + s * unit)) for s in (1.0, -1.0))
        turned = up.tip_rotation @ down.tip_rotation.transpose(0, 2, 1)
        spin = 0.5 * np.stack([turned[:, a, b] - turned[:, b, a] for a, b in ((2, 1), (0, 2), (1, 0))], axis=1)
        slope[:, :, i] = 0.5 * np.concatenate([up.tip - down.tip, spin], axis=1)
    assert np.abs(found - slope).max() < 1e-5 * np.abs(slope).max()


@pytest.mark.parametrize("linear", [True, False])
def test_positions_have_the_derivatives_of_their_differences(robot: Robot, linear: bool) -> None:
    """Of the loaded state, with offsets and misplaced joints, by every parameter."""
    kinds = [registry()["joint_offset"], registry()["joint_placement"]]
    more = [e for kind in kinds for e in build_effects({"joints": "all"}, robot.facts, effect=kind)]
    whole, at = model(robot, *more), poses(robot, 3)
    x = np.array([p.nominal or p.typical for p in whole.parameters])
    exact = whole.position_sensitivity(at, x, loaded=True, linear=linear)
    for i, p in enumerate(whole.parameters):
        h = 1e-3 * abs(x[i])
        up, down = (whole.positions(at, np.where(np.arange(len(x)) == i, x + s * h, x), True, linear) for s in (1, -1))
        slope = (up - down) / (2.0 * h)
        assert np.abs(slope - exact[..., i]).max() < 1e-5 * np.abs(slope).max() + 1e-11 / h, p.name


def test_an_offset_of_a_track_is_a_travel(tmp_path: Path) -> None:
    robot = load_robot(write_arm(tmp_path, "tracked"))
    (effect,) = build_effects({"effect": "joint_offset", "joint": "j1"}, robot.facts)
    (parameter,) = effect.parameters(robot.facts)
    assert parameter.unit == "m"
    whole, at = model(robot, effect), poses(robot, 2)
    x = np.zeros(len(whole.parameters))
    moved = x.copy()
    moved[whole.index([parameter.name])[0]] = 2e-3
    rail = robot.facts.placements[0][:3, :3] @ robot.facts.axes[0]
    shift = whole.positions(at, moved, False) - whole.positions(at, x, False)
    assert np.allclose(shift, 2e-3 * rail, atol=1e-12)


def test_a_carriage_that_tilts_turns_about_where_it_stands(tmp_path: Path) -> None:
    robot = load_robot(write_arm(tmp_path, "tracked"))
    (effect,) = build_effects({"effect": "offaxis_compliance", "joint": "j1", "axis": "x"}, robot.facts)
    whole = model(robot, effect)
    x = np.zeros(len(whole.parameters))
    x[whole.index([effect.name])[0]] = 1e-9
    q = np.zeros((2, robot.facts.n))
    q[1, 0] = 1.2
    at = Poses(q, q, np.tile(WRENCH, (2, 1)))
    here, there = whole.predict(at, x)
    assert np.allclose(here, there, atol=1e-15)  # the arm stands alike on its carriage, wherever that is


@pytest.mark.parametrize("name", ["encoder_eccentricity", "gear_waves", "gravity_sag", "gravity_compensator"])
def test_effects_of_turning_joints_are_refused_on_a_track(name: str, tmp_path: Path) -> None:
    robot = load_robot(write_arm(tmp_path, "tracked"))
    entry: dict[str, Any] = {"effect": name, "joint": "j1"}
    entry |= {"lc_m": 0.3, "l2_m": 1.0} if name == "gravity_compensator" else {}
    with pytest.raises(InputError, match=r"j1 slides, and this effect is of joints that turn; allowed: j2, j3"):
        build_effects(entry, robot.facts)


def test_no_effect_is_offered_where_a_joint_slides_that_is_of_turning_ones(robot: Robot) -> None:
    sliding = {joint for joint in robot.facts.joints if robot.facts.slides(joint)}
    for kind in registry().values():
        for effect in kind.places(robot.facts, ("tip",)):
            if fits(effect, robot) and not effect.slides:
                assert getattr(effect, "joint", "") not in sliding, effect.name


def test_a_torque_is_no_setting_of_a_track(tmp_path: Path) -> None:
    robot = load_robot(write_arm(tmp_path, "tracked"))
    with pytest.raises(InputError, match=r"j1 slides, and width is a torque or an angle. Leave it out"):
        build_effects({"effect": "joint_backlash", "joint": "j1", "width_Nm": 20.0}, robot.facts)


Change = tuple[str, str]
REFUSED: dict[str, tuple[Change, str]] = {
    "turning limits": (
        ("limits_mm: [-600, 1400]", "limits_deg: [-60, 140]"),
        r"robot.yaml, line 8: j1 slides and needs limits in mm; allowed: limits_mm, limits_m, limits_um",
    ),
    "no limits": (("{limits_mm: [-600, 1400]}", "{}"), r"line 8: j1 slides and needs limits in mm"),
    "wrong way": (("[-600, 1400]", "[1400, -600]"), r"j1: limits must be .lower, upper.; found .1400, -600. mm"),
    "torque": (("[-600, 1400]", "[-600, 1400], torque_limit_Nm: 100"), r"j1 slides: .* in N; allowed: force_limit_N"),
    "motor": (("[-600, 1400]", "[-600, 1400], motor_ratio: 100"), r"j1 slides: motor_ratio and counts_per_turn"),
    "angle": (("[-600, 1400]", "[-600, 1400], equals: J1 + J2"), r"this joint slides, and J2 turns"),
    "degrees": (("[-600, 1400]", "[-600, 1400], equals: J1 + 5 deg"), r"deg is no unit of this joint, which slides"),
    "coupled": (
        ("nominal: nominal.yaml", "  - {effect: coupling, joint: j3, follows: {j1: 1}}\nnominal: nominal.yaml"),
        r"coupling\[j3\]: j1 slides, and the others turn. Joints that slide follow joints that slide",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_does_not_fit_a_joint_that_slides_is_refused_with_its_line(name: str, tmp_path: Path) -> None:
    folder = write_arm(tmp_path, "tracked")
    (old, new), words = REFUSED[name]
    text = (folder / "robot.yaml").read_text()
    assert old in text
    (folder / "robot.yaml").write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        load_robot(folder)


def test_a_track_without_limits_in_the_urdf_is_refused_with_its_line(tmp_path: Path) -> None:
    folder = write_arm(tmp_path, "tracked")
    text = (folder / "tracked.urdf").read_text()
    bare = re.sub(r'(<joint name="j1".*?)<limit[^>]*/>', r"\1", text, count=1)
    (folder / "tracked.urdf").write_text(bare)
    with pytest.raises(InputError, match=r"tracked.urdf, line 1: joint 'j1' has no limits"):
        load_robot(folder)


def test_the_pendant_may_count_a_track_from_elsewhere(tmp_path: Path) -> None:
    folder = write_arm(tmp_path, "tracked")
    text = (folder / "robot.yaml").read_text()
    (folder / "robot.yaml").write_text(
        text.replace("[-600, 1400]", "[-1400, 600], force_limit_N: 9000, equals: -J1 + 200 mm", 1)
    )
    robot = load_robot(folder)
    assert robot.torque_limits is not None
    assert robot.torque_limits[0] == 9000.0
    assert np.allclose(robot.controller.to_joints(np.zeros((1, 7)))[0, 0], 0.2)
