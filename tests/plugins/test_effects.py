"""What each effect does, against arithmetic that does not use it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from qsframework.elastostatics import Model, Site, equilibrium, make_model
from qsframework.errors import InputError
from qsframework.plugin import Conditions, Effect, Poses, SpringLaw, build_effects
from qsframework.plugin.check import sample_context
from qsframework.robot import Robot, load_robot

POINT = np.array([0.15, 0.0, 0.2])
MARKER = np.array([0.3, -0.2, 0.1])


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("fanuc_m900ib")


def arm(
    robot: Robot,
    entries: Sequence[Mapping[str, object]],
    values: dict[str, float],
    point: np.ndarray = POINT,
    marker: np.ndarray = MARKER,
    base: bool = True,
) -> Model:
    """The M-900iB's own effects (or none) with others whose parameters have the values given."""
    extra: list[Effect] = [e for entry in entries for e in build_effects(entry, robot.facts, ("m",))]
    parameters = [p for e in extra for p in e.parameters(robot.facts)]
    parameters = [dataclasses.replace(p, nominal=values.get(p.name, p.nominal)) for p in parameters]
    own = robot.effects if base else ()
    return make_model(
        robot.facts,
        [*own, *extra],
        [*robot.parameters, *parameters],
        Site(6, point),
        [("m", Site(6, marker))],
        robot.gravity,
    )


def poses(robot: Robot, **conditions: np.ndarray) -> Poses:
    rng = np.random.default_rng(1)
    pendant = rng.uniform(robot.controller.lower, robot.controller.upper, (8, 6)) * 0.9
    wrench = rng.normal(size=(8, 6)) * np.array([3e3] * 3 + [200.0] * 3)
    loaded = Conditions(**conditions)
    return Poses(pendant, robot.controller.to_joints(pendant), wrench, Conditions(), loaded)


def test_base_spring_is_a_lever(robot: Robot) -> None:
    """A turn about the base's z under a side pull, linear: angle = c (x fy - y fx), displacement = angle x lever."""
    c = 3e-8
    model = arm(robot, [{"effect": "base_compliance", "direction": "rz"}], {"base_compliance[rz]": c}, base=False)
    p = poses(robot)
    p = Poses(p.pendant, p.q, np.concatenate([p.wrench[:, :3], np.zeros((8, 3))], axis=1))
    rigid = arm(robot, [{"effect": "base_compliance", "direction": "z"}], {}, base=False)
    at = equilibrium(rigid, p, loaded=False)
    tip, marker = at.tip, at.markers[:, 0]
    angle = c * (tip[:, 0] * p.wrench[:, 1] - tip[:, 1] * p.wrench[:, 0])
    expected = np.stack([-angle * marker[:, 1], angle * marker[:, 0], np.zeros(8)], axis=1)
    assert np.allclose(model.predict(p, linear=True)[:, 0], expected, rtol=1e-10, atol=1e-16)


@pytest.mark.parametrize(("direction", "axis"), [("x", 0), ("y", 1), ("z", 2)])
def test_tool_translation_is_a_spring_at_the_flange(robot: Robot, direction: str, axis: int) -> None:
    c = 2e-7
    model = arm(
        robot,
        [{"effect": "flange_compliance", "direction": direction}],
        {f"flange_compliance[{direction}]": c},
        base=False,
    )
    p = poses(robot)
    along = equilibrium(model, p, loaded=False).tip_rotation[:, :, axis]
    expected = c * np.einsum("nc,nc->n", along, p.wrench[:, :3])[:, None] * along
    assert np.allclose(model.predict(p)[:, 0], expected, rtol=1e-9, atol=1e-15)


def test_link_spring_at_the_last_link_is_the_tool_spring(robot: Robot) -> None:
    p = poses(robot)
    one = arm(robot, [{"effect": "flange_compliance", "direction": "rx"}], {"flange_compliance[rx]": 1e-6})
    two = arm(
        robot,
        [{"effect": "link_compliance", "link": "link_6", "direction": "rx"}],
        {"link_compliance[link_6/rx]": 1e-6},
    )
    assert np.allclose(one.predict(p), two.predict(p), rtol=1e-14, atol=0)


def test_all_directions_come_from_one_entry(robot: Robot) -> None:
    assert len(build_effects({"effect": "base_compliance", "directions": "all"}, robot.facts)) == 6
    with pytest.raises(InputError, match="unknown direction"):
        build_effects({"effect": "base_compliance", "direction": "w"}, robot.facts)


def test_load_scale_scales(robot: Robot) -> None:
    p = poses(robot)
    model = arm(robot, [{"effect": "load_scale"}], {"load_scale": 0.03})
    plain = arm(robot, [], {})
    scaled = Poses(p.pendant, p.q, 1.03 * p.wrench)
    assert np.allclose(model.predict(p), plain.predict(scaled), rtol=1e-12, atol=0)
    assert np.allclose(model.predict(p, linear=True), 1.03 * plain.predict(p, linear=True), rtol=1e-12, atol=0)


def test_load_direction_turns_the_wrench(robot: Robot) -> None:
    from scipy.spatial.transform import Rotation

    p = poses(robot)
    R = Rotation.from_rotvec([0.02, -0.05, 0.0]).as_matrix()
    turned = np.concatenate([p.wrench[:, :3] @ R.T, p.wrench[:, 3:] @ R.T], axis=1)
    model = arm(robot, [{"effect": "load_direction"}], {"load_direction.rx": 0.02, "load_direction.ry": -0.05})
    assert np.allclose(model.predict(p), arm(robot, [], {}).predict(Poses(p.pendant, p.q, turned)), rtol=1e-12, atol=0)


def test_load_point_offset_moves_the_load_point(robot: Robot) -> None:
    """Linear and full: the arm turns with the flange."""
    p = poses(robot)
    p = Poses(p.pendant, p.q, np.concatenate([p.wrench[:, :3], np.zeros((8, 3))], axis=1))
    values = {"load_point_offset.x": 0.03, "load_point_offset.y": -0.02, "load_point_offset.z": 0.05}
    model = arm(robot, [{"effect": "load_point_offset"}], values)
    moved = arm(robot, [], {}, point=POINT + np.array([0.03, -0.02, 0.05]))
    assert np.allclose(model.predict(p, linear=True), moved.predict(p, linear=True), rtol=1e-12, atol=1e-18)
    assert np.allclose(model.predict(p), moved.predict(p), rtol=1e-12, atol=1e-18)


def test_marker_offset_moves_the_marker(robot: Robot) -> None:
    """Both marker models differ by second order in the turn of the flange only."""
    p = poses(robot)
    values = {"marker_offset[m].x": 0.02, "marker_offset[m].y": 0.01, "marker_offset[m].z": -0.03}
    model = arm(robot, [{"effect": "marker_offset", "marker": "m"}], values)
    moved = arm(robot, [], {}, marker=MARKER + np.array([0.02, 0.01, -0.03]))
    change = np.abs(moved.predict(p) - arm(robot, [], {}).predict(p)).max()
    assert np.abs(model.predict(p) - moved.predict(p)).max() < 5e-3 * change


def test_tracker_effects(robot: Robot) -> None:
    from scipy.spatial.transform import Rotation

    p = poses(robot)
    plain = arm(robot, [], {}).predict(p)
    scaled = arm(robot, [{"effect": "tracker_scale"}], {"tracker_scale": 2e-3}).predict(p)
    assert np.allclose(scaled, plain * 1.002, rtol=1e-9, atol=1e-14)
    values = {"tracker_frame.rx": 0.01, "tracker_frame.ry": 0.02, "tracker_frame.rz": -0.03}
    R = Rotation.from_rotvec([0.01, 0.02, -0.03]).as_matrix()
    turned = arm(robot, [{"effect": "tracker_frame"}], values).predict(p)
    assert np.allclose(turned, plain @ R.T, rtol=1e-9, atol=1e-14)


def test_drift_needs_times_and_adds_velocity_times_time(robot: Robot) -> None:
    p = poses(robot)
    model = arm(robot, [{"effect": "tracker_drift"}], {"tracker_drift.vy": 1e-8})
    with pytest.raises(InputError, match="needs the columns time_s and time_unloaded_s"):
        model.predict(p)
    timed = dataclasses.replace(
        p, unloaded=Conditions(time=np.arange(8.0)), loaded=Conditions(time=np.arange(8.0) + 300)
    )
    change = model.predict(timed) - arm(robot, [], {}).predict(p)
    assert np.allclose(change[:, 0], [0.0, 3e-6, 0.0], atol=1e-14)


def test_hardening_and_backlash_at_one_joint(robot: Robot) -> None:
    """One spring, one torque, linear: eps = c T + c3 T^3 + b/2 sign(T), the unloaded state taken off."""
    entries = [
        {"effect": "joint_compliance", "joint": "joint_2"},
        {"effect": "joint_hardening", "joint": "joint_2"},
        {"effect": "joint_backlash", "joint": "joint_2", "width_Nm": 1e-3},
    ]
    c, c3, b = 2e-7, -2e-16, 3e-4
    values = {"joint_compliance[joint_2]": c, "joint_hardening[joint_2]": c3, "joint_backlash[joint_2]": b}
    robot_values = [p for p in robot.parameters if p.name != "joint_compliance[joint_2]"]
    extra = [e for entry in entries for e in build_effects(entry, robot.facts)]
    own = [dataclasses.replace(p, nominal=values[p.name]) for e in extra for p in e.parameters(robot.facts)]
    model = make_model(
        robot.facts, extra, [*robot_values, *own], Site(6, POINT), [("m", Site(6, POINT))], robot.gravity
    )
    p = poses(robot)
    found = model.predict(p, linear=True)[:, 0]
    import pinocchio as pin

    data = robot.model.createData()
    for i, q in enumerate(p.q):
        gravity = -pin.computeGeneralizedGravity(robot.model, data, q)[1]
        pin.computeJointJacobians(robot.model, data, q)
        J = pin.getJointJacobian(robot.model, data, 6, pin.LOCAL_WORLD_ALIGNED)
        arm_ = data.oMi[6].rotation @ POINT
        column = J[:3, 1] + np.cross(J[3:, 1], arm_)
        torque = column @ p.wrench[i, :3] + J[3:, 1] @ p.wrench[i, 3:]

        def law(T: float) -> float:
            return c * T + c3 * T**3 + 0.5 * b * np.sign(T)

        expected = column * (law(gravity + torque) - law(gravity))
        assert np.allclose(found[i], expected, rtol=1e-6, atol=1e-10)


def test_the_knee_changes_the_compliance(robot: Robot) -> None:
    (law,) = build_effects({"effect": "joint_hardening", "joint": "joint_2", "knee_Nm": 2000}, robot.facts)
    torque = np.array([[-9000.0], [-500.0], [0.0], [500.0], [9000.0]])
    assert isinstance(law, SpringLaw)
    term = law.extra(torque, np.array([1e-8]), sample_context(robot.facts, 5))
    assert np.allclose(term.dT[[0, 4], 0], 1e-8, rtol=1e-4)
    assert np.abs(term.dT[1:4, 0]).max() < 2e-11
    assert np.allclose(term.value[0], -term.value[4])
    assert np.isclose(term.value[4, 0], 1e-8 * 7000, rtol=1e-3)


def test_masses_do_not_change_a_linear_displacement(robot: Robot) -> None:
    p = poses(robot)
    heavy = arm(
        robot,
        [
            {"effect": "link_mass", "link": "link_3"},
            {"effect": "counterweight", "link": "link_2", "x_m": 0.0, "y_m": 0.0, "z_m": -0.5},
        ],
        {"link_mass[link_3].mass": 100.0, "counterweight[link_2]": 300.0},
    )
    plain = arm(robot, [], {})
    assert np.array_equal(heavy.predict(p, linear=True), plain.predict(p, linear=True))
    assert np.abs(heavy.predict(p) - plain.predict(p)).max() > 1e-8, "where the arm settles, they do"
    sag, less = (equilibrium(m, p, loaded=False).tip for m in (heavy, plain))
    assert np.abs(sag - less).max() > 1e-5


def test_an_offset_is_another_commanded_angle(robot: Robot) -> None:
    p = poses(robot)
    model = arm(robot, [{"effect": "joint_offset", "joint": "joint_5"}], {"joint_offset[joint_5]": 0.01})
    q = p.q.copy()
    q[:, 4] += 0.01
    assert np.allclose(model.predict(p), arm(robot, [], {}).predict(Poses(p.pendant, q, p.wrench)), rtol=1e-12, atol=0)


def test_an_offset_of_the_shoulder_leaves_the_forearm_s_attitude(robot: Robot) -> None:
    """The encoder sits on the motor: with a parallelogram, joint 3 turns back by as much."""
    p = poses(robot)
    model = arm(robot, [{"effect": "joint_offset", "joint": "joint_2"}], {"joint_offset[joint_2]": 0.01})
    q = p.q.copy()
    q[:, 1] += 0.01
    q[:, 2] += 0.01  # opposed axes: the same attitude
    assert np.allclose(model.predict(p), arm(robot, [], {}).predict(Poses(p.pendant, q, p.wrench)), rtol=1e-12, atol=0)


def test_eccentricity_and_heat(robot: Robot) -> None:
    p = poses(robot, temperature=np.full(8, 303.15))
    values = {"encoder_eccentricity[joint_5].sin": 1e-3, "encoder_eccentricity[joint_5].cos": 2e-3}
    model = arm(robot, [{"effect": "encoder_eccentricity", "joint": "joint_5"}], values)
    q = p.q.copy()
    q[:, 4] += 1e-3 * np.sin(p.q[:, 4]) + 2e-3 * np.cos(p.q[:, 4])
    assert np.allclose(model.predict(p), arm(robot, [], {}).predict(Poses(p.pendant, q, p.wrench)), rtol=1e-12, atol=0)
    rigid = [{"effect": "base_compliance", "direction": "z"}]
    hot = arm(
        robot, [*rigid, {"effect": "thermal_expansion"}], {"thermal_expansion": 1e-3}, point=np.zeros(3), base=False
    )
    cold = arm(robot, rigid, {}, point=np.zeros(3), base=False)
    # ten degrees at 1e-3 per degree: the flange is 1 % farther from the base's origin
    assert np.allclose(equilibrium(hot, p).tip, 1.01 * equilibrium(cold, p).tip, rtol=1e-12)


def test_friction_holds_against_the_approach(robot: Robot) -> None:
    entry = {
        "effect": "compensator_friction",
        "joint": "joint_2",
        "lc_m": 0.235,
        "l2_m": 1.12,
        "spring_stiffness_N/m": 1e5,
        "free_length_m": 0.7,
    }
    model = arm(robot, [entry], {"compensator_friction[joint_2]": 0.1})
    with pytest.raises(InputError, match="needs the column approach"):
        model.predict(poses(robot))
    sides = []
    for side in (-1.0, 1.0):
        p = poses(robot)
        at = Conditions(approach=np.full(8, side))
        sides.append(equilibrium(model, dataclasses.replace(p, unloaded=at, loaded=at), loaded=False).tip)
    middle = equilibrium(arm(robot, [], {}), poses(robot), loaded=False).tip
    assert np.allclose(0.5 * (sides[0] + sides[1]), middle, atol=1e-9)
    assert np.abs(sides[0] - sides[1]).max() > 1e-5
