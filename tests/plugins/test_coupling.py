"""Couplings: joints that follow others, coupled wrists, loops that build on each other."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_energy import energy_tip

from qsframework.elastostatics import Model, Site, make_model
from qsframework.elastostatics.motion import move, nominal_actuators
from qsframework.elastostatics.state import place
from qsframework.errors import InputError
from qsframework.plugin import Context, Effect, Poses, build_effects, check_effect
from qsframework.plugin.check import sample_context
from qsframework.plugin.loops import in_order
from qsframework.robot import Robot, load_robot

TOOL = np.array([0.1, 0.2, 0.3])
PALLETIZER = Path(__file__).parents[1] / "robots" / "machines" / "palletizer"


@pytest.fixture(scope="module")
def palletizer() -> Robot:
    return load_robot(PALLETIZER)


def model_of(robot: Robot, effects: tuple[Effect, ...] | None = None, **compliances: float) -> Model:
    effects = robot.effects if effects is None else effects
    values = {p.name: p for e in effects for p in e.parameters(robot.facts)} | {p.name: p for p in robot.parameters}
    for joint, value in compliances.items():
        name = f"joint_compliance[{joint}]"
        values[name] = dataclasses.replace(values[name], nominal=value)
    tip = Site(robot.facts.n, TOOL)
    return make_model(robot.facts, effects, tuple(values.values()), tip, [("tip", tip)], robot.gravity)


def some_poses(robot: Robot, count: int, seed: int = 0, force: float = 2e3) -> Poses:
    rng, c = np.random.default_rng(seed), robot.controller
    pendant = rng.uniform(c.lower, c.upper, (count, c.axes))
    return Poses(pendant, c.to_joints(pendant), rng.normal(0, force, (count, 6)) * [1, 1, 1, 0.1, 0.1, 0.1])


def effects_of(robot: Robot, *entries: dict[str, object]) -> tuple[Effect, ...]:
    return tuple(e for entry in entries for e in build_effects(entry, robot.facts))


def test_four_axes_keep_the_flange_level(palletizer: Robot) -> None:
    controller, data = palletizer.controller, palletizer.model.createData()
    assert controller.axes == 4
    assert palletizer.facts.passive == ("joint_4",)
    assert "joint_compliance[joint_4]" not in [p.name for p in palletizer.parameters]
    pendant = some_poses(palletizer, 20).pendant
    q = controller.to_joints(pendant)
    for angles in q:
        pin.forwardKinematics(palletizer.model, data, angles)
        np.testing.assert_allclose(data.oMi[5].rotation[:, 2], [0, 0, 1], atol=1e-14)
    np.testing.assert_allclose(controller.to_pendant(q), pendant, atol=1e-14)
    q[3, 3] += 1e-3
    with pytest.raises(InputError, match=r"joint 4 follows other joints.*pose 4"):
        controller.to_pendant(q)


def test_jacobians_of_chained_loops_are_pinocchio_s(palletizer: Robot) -> None:
    """Actuators 2 and 3 turn (q2, q3, q4) by (1, -1, 0) and (0, 1, -1): the wrist hangs on the forearm alone."""
    model, poses, data = model_of(palletizer), some_poses(palletizer, 50), palletizer.model.createData()
    G = np.zeros((5, 5))
    G[[0, 1, 2, 2, 3, 4], [0, 1, 1, 2, 2, 4]] = [1, 1, -1, 1, -1, 1]
    motion = move(
        model.layout, Context(model.facts, poses), nominal_actuators(model.layout, poses.q.T), np.zeros((1, 50))
    )
    D = place(motion, model.tip, ()).D
    for i, q in enumerate(poses.q):
        pin.computeJointJacobians(palletizer.model, data, q)
        J = pin.getJointJacobian(palletizer.model, data, 5, pin.LOCAL_WORLD_ALIGNED)
        arm = data.oMi[5].rotation @ TOOL
        J[:3] += np.cross(J[3:].T, arm).T
        np.testing.assert_allclose(D[i], (J @ G)[:, [0, 1, 2, 4]], atol=1e-12)


def test_the_equilibrium_is_where_the_energy_is_least(palletizer: Robot) -> None:
    """What follows moves along when the springs give: an energy written with Pinocchio and the closed rods alone."""
    c = np.array([0.5e-6, 0.4e-6, 0.6e-6, 0.0, 4e-6])
    rates = np.array([[1, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, -1, 1, 0, 0], [0, 0, -1, 1, 0], [0, 0, 0, 0, 1.0]])
    model, poses = model_of(palletizer), some_poses(palletizer, 5, 1)
    wrench = poses.wrench * [1, 1, 1, 0, 0, 0]
    poses = dataclasses.replace(poses, wrench=wrench)
    ours = model.predict(poses)[:, 0]
    for i in range(5):
        phi = np.linalg.solve(rates, poses.q[i])
        tips = [
            energy_tip(palletizer.model, lambda p: (rates @ p, rates), c, f, phi, 5, TOOL)
            for f in (wrench[i, :3], np.zeros(3))
        ]
        np.testing.assert_allclose(ours[i], tips[0] - tips[1], atol=1e-9)


def test_a_rod_s_give_is_a_compliance_of_the_joint_that_follows(palletizer: Robot) -> None:
    """It turns the wrist alone, by the torque about its axis."""
    rod = effects_of(palletizer, {"effect": "joint_compliance", "joint": "joint_4"})
    poses = some_poses(palletizer, 6, 2)
    soft = model_of(palletizer, (*palletizer.effects, *rod), joint_4=1e-6)
    moved = soft.predict(poses, linear=True) - model_of(palletizer).predict(poses, linear=True)
    data = palletizer.model.createData()
    for i, q in enumerate(poses.q):
        pin.computeJointJacobians(palletizer.model, data, q)
        axis = data.oMi[4].rotation @ [0, 1, 0]
        arm = data.oMi[5].act(TOOL) - data.oMi[4].translation
        torque = axis @ (np.cross(arm, poses.wrench[i, :3]) + poses.wrench[i, 3:])
        np.testing.assert_allclose(moved[i, 0], 1e-6 * torque * np.cross(axis, arm), atol=1e-12)


WRIST = [[1.0, 0.0, 0.0], [0.2, 1.0, 0.0], [-0.1, 0.5, 0.5]]


def test_a_coupled_wrist_spreads_its_gears() -> None:
    """Compliance of the joints: M diag(c) M', M the matrix of the coupled axes."""
    robot = load_robot("kuka_kr500_r2800_2")
    tied = [f"joint_{k}" for k in (4, 5, 6)]
    (loop,) = effects_of(robot, {"effect": "coupling", "tied": tied, "matrix": WRIST})
    assert loop.name == "coupling[joint_4+joint_5+joint_6]"
    check_effect(loop, robot.facts)
    c = {"joint_4": 1e-6, "joint_5": 2e-6, "joint_6": 5e-6}
    zero = dict.fromkeys(robot.facts.joints, 0.0)
    model = model_of(robot, (*robot.effects, loop), **(zero | c))
    poses, data = some_poses(robot, 5), robot.model.createData()
    moved = model.predict(poses, linear=True)
    C = np.array(WRIST) @ np.diag(list(c.values())) @ np.array(WRIST).T
    for i, q in enumerate(poses.q):
        pin.computeJointJacobians(robot.model, data, q)
        J = pin.getJointJacobian(robot.model, data, 6, pin.LOCAL_WORLD_ALIGNED)
        J[:3] += np.cross(J[3:].T, data.oMi[6].rotation @ TOOL).T
        np.testing.assert_allclose(moved[i, 0], (J[:, 3:] @ C @ J[:, 3:].T @ poses.wrench[i])[:3], atol=1e-12)


def test_loops_that_build_on_each_other_bend_as_differences_say() -> None:
    """A four-bar drives joint 3, joint 4 follows it and joint 5 follows joint 4: slopes and curvature of the whole."""
    robot = load_robot("fanuc_m900ia_260l")
    loops = effects_of(
        robot,
        {"effect": "coupling", "joint": "joint_5", "follows": {"joint_4": 0.5, "joint_1": 0.1}},
        {"effect": "coupling", "joint": "joint_4", "follows": {"joint_2": -1, "joint_3": 0.7}, "offset_deg": 3},
        {
            "effect": "four_bar",
            "driver": "joint_2",
            "driven": "joint_3",
            "lever_m": 0.5,
            "bar_m": 1.2,
            "rocker_m": 0.6,
            "lever_zero_deg": -100,
            "rocker_zero_deg": -90,
            "branch": -1,
        },
    )
    assert [e.where for e in in_order(loops, robot.facts)] == ["joint_3", "joint_4", "joint_5"]
    springs = effects_of(robot, {"effect": "joint_compliance", "joints": "all"})
    model = model_of(robot, (*springs, *loops))
    (group,) = model.layout.loops
    rng = np.random.default_rng(0)
    phi, bars = rng.uniform(-0.2, 0.2, (6, 4)), rng.normal(0, 1e-3, (4, 4))
    context = sample_context(model.facts, 4)

    def at(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        actuators = phi.copy()
        actuators[list(group.joints)] = u[: len(group.joints)]
        motion = move(model.layout, context, actuators, u[len(group.joints) :])
        return motion.q[list(group.joints)], motion.loops[0].q_u

    u = np.concatenate([phi[list(group.joints)], bars])
    term = move(model.layout, context, phi, bars).loops[0]
    for k in range(len(u)):
        h = np.zeros_like(u)
        h[k] = 1e-6
        (q1, s1), (q0, s0) = at(u + h), at(u - h)
        np.testing.assert_allclose(term.q_u[:, :, k], (q1 - q0).T / 2e-6, atol=1e-8)
        np.testing.assert_allclose(term.q_uu[:, :, :, k], (s1 - s0) / 2e-6, atol=1e-7)
    q = move(model.layout, context, phi, np.zeros_like(bars)).q
    np.testing.assert_allclose(nominal_actuators(model.layout, q), phi, atol=1e-12)


def test_sensitivities_are_the_slope_of_the_prediction(palletizer: Robot) -> None:
    extra = effects_of(
        palletizer,
        {"effect": "joint_offset", "joints": ["joint_2", "joint_3", "joint_4"]},
        {"effect": "bar_compliance", "driven": "joint_3"},
    )
    model, poses = model_of(palletizer, (*palletizer.effects, *extra)), some_poses(palletizer, 6, 3)
    x = model.nominal + 1e-4 * np.array([n.startswith(("joint_offset", "parallelogram")) for n in model.names])
    x[model.index(["bar_compliance[joint_3]"])] = 1e-8
    for value, slope in ((model.predict, model.sensitivity), (model.positions, model.position_sensitivity)):
        ours = slope(poses, x)
        for k, p in enumerate(model.parameters):
            h = np.zeros(len(x))
            h[k] = 1e-4 * p.typical
            step = (value(poses, x + h) - value(poses, x - h)) / (2 * h[k])
            np.testing.assert_allclose(ours[..., k] * p.typical, step * p.typical, atol=1e-9)


REFUSED = {
    "a circle": (
        ({"joint": "joint_4", "follows": {"joint_5": 1}}, {"joint": "joint_5", "follows": {"joint_4": 1}}),
        "joint_4 and joint_5 follow each other in a circle",
    ),
    "of itself": (({"joint": "joint_4", "follows": {"joint_4": 1}},), "must name its leaders"),
    "no such joint": (({"joint": "joint_9", "follows": {"joint_4": 1}},), "no joint 'joint_9'"),
    "no such leader": (({"joint": "joint_4", "follows": {"joint_9": 1}},), "no joint 'joint_9'"),
    "twice": (
        ({"joint": "joint_4", "follows": {"joint_2": 1}}, {"tied": ["joint_4", "joint_5"], "matrix": [[1, 0], [1, 1]]}),
        "both turn joint_4",
    ),
    "no factor": (({"joint": "joint_4", "follows": {"joint_2": "one"}},), "joint_2: 'one'"),
    "nothing": (({},), "needs joint and follows, or tied and matrix"),
    "both": (({"joint": "joint_4", "follows": {"joint_2": 1}, "tied": ["joint_4"]},), "needs joint and follows"),
    "singular": (({"tied": ["joint_4", "joint_5"], "matrix": [[1, 1], [1, 1]]},), "wrong matrix"),
    "not square": (({"tied": ["joint_4", "joint_5"], "matrix": [[1, 1]]},), "wrong matrix"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_couplings_that_cannot_be_are_refused_with_file_and_line(case: str, tmp_path: Path) -> None:
    entries, words = REFUSED[case]
    for name in ("palletizer.urdf", "nominal.yaml"):
        (tmp_path / name).write_text((PALLETIZER / name).read_text())
    text = (PALLETIZER / "robot.yaml").read_text()
    text = text[: text.index("  - {effect: parallelogram")] + text[text.index("nominal: ") :]
    text = text.replace("  joint_5:", "  joint_4: {limits_deg: [-90, 90]}\n  joint_5:")
    lines = "".join(f"  - {json.dumps({'effect': 'coupling'} | e)}\n" for e in entries)
    (tmp_path / "robot.yaml").write_text(text.replace("nominal: ", lines + "nominal: "))
    with pytest.raises(InputError, match=re.escape(words)) as refused:
        load_robot(tmp_path)
    told = [p for p in refused.value.problems if words in str(p)]
    first = (tmp_path / "robot.yaml").read_text().splitlines().index(lines.splitlines()[0]) + 1
    assert told[0].file == str(tmp_path / "robot.yaml")
    assert told[0].line in range(first, first + len(entries))


def test_a_joint_that_nothing_drives_is_told(tmp_path: Path) -> None:
    for name in ("palletizer.urdf", "nominal.yaml"):
        (tmp_path / name).write_text((PALLETIZER / name).read_text())
    text = (PALLETIZER / "robot.yaml").read_text()
    (tmp_path / "robot.yaml").write_text(re.sub(r"  - \{effect: coupling.*\n", "", text))
    with pytest.raises(InputError, match=r"no limits for 'joint_4'.*\{effect: coupling, joint: joint_4, follows: "):
        load_robot(tmp_path)
    bent = text.replace(
        "{effect: coupling, joint: joint_4, follows: {joint_2: -1, joint_3: -1}}",
        "{effect: four_bar, driver: joint_3, driven: joint_4, lever_m: 0.5, bar_m: 1.2, rocker_m: 0.6}",
    )
    (tmp_path / "robot.yaml").write_text(bent)
    with pytest.raises(InputError, match="joint_4 does not follow in proportion"):
        load_robot(tmp_path)
