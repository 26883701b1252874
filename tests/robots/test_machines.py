"""Whole machines: a palletizer, and a heavy arm with massive bars, a lever counterweight and a balancer's cylinder."""

from __future__ import annotations

import dataclasses
import re
import shutil
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_energy import energy_tip

from qsframework.elastostatics import Model, Site, actuator_torques, flip_margin, make_model
from qsframework.elastostatics.motion import move, nominal_actuators
from qsframework.elastostatics.state import place
from qsframework.errors import InputError
from qsframework.plugin import Context, Effect, Poses, build_effects, check_effect
from qsframework.robot import Robot, load_robot
from qsframework.uses.conformance import check_robot, small_campaign
from qsframework.viz.robot_shapes import draw_robot, link_frames
from qsframework.viz.scene import Scene
from qsframework.viz.show_scene import place_poses

MACHINES = Path(__file__).parent / "machines"
TOOL = np.array([0.1, 0.2, 0.3])
WEIGHT, LEVER_ARM = 600.0, np.array([-1.1, 0.0, 0.0])


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot(MACHINES / "counterweight_arm")


@pytest.fixture(scope="module")
def tree() -> pin.Model:
    """Lever, bar and housing are links of a tree; its loops are not closed."""
    model = pin.buildModelFromUrdf(str(MACHINES / "counterweight_arm" / "counterweight_arm.urdf"))
    body = pin.Inertia(WEIGHT, LEVER_ARM, np.eye(3))
    model.appendBodyToJoint(model.getJointId("lever_joint"), body, pin.SE3.Identity())
    return model


def imposed(tree: pin.Model, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles of all joints of the tree and their rates by the six actuators, by hand.

    The forearm's turn about y is q2 - q3 = -phi3, and the lever's too; the bar keeps link 2's; the housing points at
    the rod's pivot, 0.235 m above axis 2, from axis 3.
    """
    q, G = np.zeros(tree.nq), np.zeros((tree.nq, 6))
    lc, l2 = 0.235, 1.12
    sine, cosine = np.sin(phi[1]), np.cos(phi[1])
    swing = np.arctan2(lc * sine, l2 - lc * cosine)
    rate = lc * (l2 * cosine - lc) / (l2**2 + lc**2 - 2 * l2 * lc * cosine)
    rows = {f"joint_{k + 1}": (phi[k], {k: 1.0}) for k in range(6)} | {
        "joint_3": (phi[2] + phi[1], {1: 1.0, 2: 1.0}),
        "lever_joint": (-phi[2], {2: -1.0}),
        "bar_joint": (-phi[2] - phi[1], {1: -1.0, 2: -1.0}),
        "housing_joint": (swing, {1: rate}),
    }
    for name, (angle, rates) in rows.items():
        at = tree.joints[tree.getJointId(name)].idx_q
        q[at] = angle
        G[at, list(rates)] = list(rates.values())
    return q, G


def model_of(robot: Robot, effects: tuple[Effect, ...] | None = None, **values: float) -> Model:
    effects = robot.effects if effects is None else effects
    every = {p.name: p for e in effects for p in e.parameters(robot.facts)} | {p.name: p for p in robot.parameters}
    every |= {name: dataclasses.replace(every[name], nominal=value) for name, value in values.items()}
    tip = Site(robot.facts.n, TOOL)
    return make_model(robot.facts, effects, tuple(every.values()), tip, [("tip", tip)], robot.gravity)


def without_spring(robot: Robot) -> tuple[Effect, ...]:
    return tuple(e for e in robot.effects if e.effect_name() != "gravity_compensator")


def some_poses(robot: Robot, count: int, seed: int = 0, force: float = 2e3) -> Poses:
    """Random poses above the loop's margin, a random force each."""
    rng, c = np.random.default_rng(seed), robot.controller
    pendant = rng.uniform(c.lower, c.upper, (40 * count, c.axes))
    q = c.to_joints(pendant)
    every = Poses(pendant, q, rng.normal(0, force, (40 * count, 6)) * [1, 1, 1, 0, 0, 0])
    return every.take(np.flatnonzero(model_of(robot).transmission_margin(every) > 0.0)[:count])


def test_bars_and_housing_stand_and_weigh_as_pinocchio_s_tree_says(arm: Robot, tree: pin.Model) -> None:
    model, poses, data = model_of(arm, without_spring(arm)), some_poses(arm, 40, force=0.0), tree.createData()
    phi = nominal_actuators(model.layout, poses.q.T.copy())
    motion = move(model.layout, Context(model.facts, poses), phi, np.zeros((1, 40)))
    state, ours = place(motion, model.tip, ()), actuator_torques(model, poses)
    for i in range(40):
        q, G = imposed(tree, motion.phi[:6, i])
        torque = -G.T @ pin.computeGeneralizedGravity(tree, data, q)
        np.testing.assert_allclose(ours[i], torque, atol=1e-12 * np.abs(torque).max())
        pin.computeJointJacobians(tree, data, q)
        for k, branch in enumerate(arm.facts.branches):
            where = data.oMi[tree.getJointId(branch.joint)]
            np.testing.assert_allclose(state.placed.positions[7 + k, :, i], where.translation, atol=1e-12)
            np.testing.assert_allclose(state.placed.matrix(7 + k)[i], where.rotation, atol=1e-12)
        tip = tree.getJointId("joint_6")
        J = pin.getJointJacobian(tree, data, tip, pin.LOCAL_WORLD_ALIGNED)
        J[:3] += np.cross(J[3:].T, data.oMi[tip].rotation @ TOOL).T
        np.testing.assert_allclose(state.D[i], J @ G, atol=1e-12)


def test_the_equilibrium_is_where_the_energy_is_least(arm: Robot, tree: pin.Model) -> None:
    model, poses = model_of(arm, without_spring(arm)), some_poses(arm, 4, 1, 4e3)
    c = np.array(
        [next(p.nominal for p in arm.parameters if p.name == f"joint_compliance[joint_{k}]") for k in range(1, 7)]
    )
    phi = nominal_actuators(model.layout, poses.q.T.copy())[:6].T
    ours, tip = model.predict(poses)[:, 0], tree.getJointId("joint_6")
    for i in range(4):
        tips = [
            energy_tip(tree, lambda p: imposed(tree, p), c, f, phi[i], tip, TOOL)
            for f in (poses.wrench[i, :3], np.zeros(3))
        ]
        np.testing.assert_allclose(ours[i], tips[0] - tips[1], atol=1e-10)


@pytest.mark.parametrize("linear", [True, False])
def test_every_effect_holds_and_sensitivities_are_slopes(arm: Robot, linear: bool) -> None:
    """With a bar that is too long and gives, weights on bars among the parameters."""
    more = [
        {"effect": "bar_compliance", "driven": "joint_3"},
        {"effect": "link_mass", "link": "bar"},
        {"effect": "joint_offset", "joints": ["joint_2", "joint_3"]},
    ]
    effects = (*arm.effects, *(e for entry in more for e in build_effects(entry, arm.facts)))
    for effect in effects:
        check_effect(effect, arm.facts)
    model, poses = model_of(arm, effects), some_poses(arm, 5, 2)
    x = model.nominal + 1e-4 * np.array([n.startswith(("joint_offset", "parallelogram")) for n in model.names])
    x[model.index(["bar_compliance[joint_3]"])] = 1e-8
    ours = model.position_sensitivity(poses, x, linear=linear)
    for k, p in enumerate(model.parameters):
        h = np.zeros(len(x))
        h[k] = 1e-4 * p.typical
        up, down = (model.positions(poses, x + s * h, linear=linear) for s in (1, -1))
        step = (up - down) / (2 * h[k])
        np.testing.assert_allclose(ours[..., k] * p.typical, step * p.typical, atol=1e-9)


def test_what_hangs_on_the_lever_does_not_load_the_bar(arm: Robot) -> None:
    """The passive joints pass on the arm's torque, the lower one the bar's weight too; the actuator holds all.

    The arm's torque is that of its weight at the mass centre of all beyond the elbow: it vanishes where the vertical
    through it crosses the elbow's joint, as section 3.3 of the paper has it.
    """
    poses = some_poses(arm, 30, 3, 6e3)
    unloaded = dataclasses.replace(poses, wrench=np.zeros((30, 6)))
    heavy, light = (model_of(arm, **{"counterweight[lever]": m}) for m in (WEIGHT, 0.0))
    np.testing.assert_allclose(flip_margin(heavy, poses), flip_margin(light, poses), rtol=1e-12)
    assert np.abs(actuator_torques(heavy, poses) - actuator_torques(light, poses))[:, 2].max() > 1e3
    data, pinned = arm.model.createData(), []
    for q, wrench in zip(poses.q, poses.wrench, strict=True):
        pin.centerOfMass(arm.model, data, q)
        centre, axis = (data.oMi[3].rotation @ v for v in (data.com[3], [0.0, -1.0, 0.0]))  # from the elbow
        above = axis @ np.cross(centre, [0.0, 0.0, -9.81 * data.mass[3]])
        pin.computeJointJacobians(arm.model, data, q)
        J = pin.getJointJacobian(arm.model, data, 6, pin.LOCAL_WORLD_ALIGNED)
        load = J[:3, 2] @ wrench[:3] + J[3:, 2] @ np.cross(data.oMi[6].rotation @ TOOL, wrench[:3])
        lever = 9.81 * 90.0 * 0.75 * np.cos(q[1] - q[2])
        sides = [(t, t + load) for t in (above, above + lever)]
        pinned.append(min(min(abs(a), np.sign(a) * b) for a, b in sides))
    assert np.isfinite(flip_margin(heavy, unloaded)).all()
    np.testing.assert_allclose(flip_margin(heavy, poses), pinned, rtol=1e-9)


@pytest.mark.parametrize("name", ["counterweight_arm", "palletizer"])
def test_machines_are_designed_simulated_identified_and_diagnosed(name: str) -> None:
    checks = check_robot(MACHINES / name)
    assert [c.name for c in checks if not c.good] == []


def test_branches_are_drawn_where_they_stand(arm: Robot, tree: pin.Model, tmp_path: Path) -> None:
    """The solids of lever, mass, bar and housing at the frames of Pinocchio's tree; the loop's rods end at the bar."""
    q, data = some_poses(arm, 1, 4).q[0], tree.createData()
    scene = Scene(title="arm")
    robot_q = np.array([q[0], q[1], q[2] - q[1], *q[3:]])
    state = place_poses(small_campaign(arm, tmp_path), q[None])
    draw_robot(scene, "robot", arm, link_frames(state.placed, 0), q)
    pin.forwardKinematics(tree, data, imposed(tree, robot_q)[0])
    moved = scene.placed
    for k, branch in enumerate(arm.facts.branches):
        where = data.oMi[tree.getJointId(branch.joint)]
        np.testing.assert_allclose(moved[f"robot/link_{7 + k}"], where.homogeneous, atol=1e-12)
    drawn = list(scene.drawn)
    names = [branch.link for branch in arm.facts.branches]
    solids = [names[int(path.split("/link_")[1][0]) - 7] for path in drawn if re.search(r"/link_[789]/shape", path)]
    assert sorted(solids) == ["bar", "housing", "lever", "lever"]
    bar = data.oMi[tree.getJointId("bar_joint")].translation
    rod = moved["robot/loop_0"] @ moved["robot/loop_0/bar_0_pivot"]
    np.testing.assert_allclose(np.cross(rod[:3, 3] - bar, data.oMi[2].rotation[:, 1]), 0.0, atol=1e-12)


def test_the_palletizer_is_drawn_with_its_lever_and_bar(tmp_path: Path) -> None:
    robot, scene = load_robot(MACHINES / "palletizer"), Scene(title="palletizer")
    q = some_poses(robot, 1, 6).q
    draw_robot(scene, "robot", robot, link_frames(place_poses(small_campaign(robot, tmp_path), q).placed, 0), q[0])
    drawn = scene.drawn.keys()
    assert {f"robot/loop_0/bar_{k}" for k in range(3)} <= drawn
    assert {f"robot/link_{k}/shape_{k - 1}" for k in range(1, 6)} <= drawn


RODS = """
  <link name="rod"><inertial><origin xyz="0 0 0.5"/><mass value="25"/>INERTIA</inertial><visual>
    <origin xyz="0 0 0.5"/><geometry><box size="0.05 0.05 1"/></geometry></visual></link>
  <link name="plate"><inertial><origin xyz="0.1 0 0.1"/><mass value="15"/>INERTIA</inertial></link>
  <link name="long_rod"><inertial><origin xyz="0.6 0 0"/><mass value="30"/>INERTIA</inertial></link>
  <joint name="rod_joint" type="continuous"><parent link="link_1"/><child link="rod"/>
    <origin xyz="0.05 0.1 0.2"/><axis xyz="0 1 0"/></joint>
  <joint name="plate_joint" type="continuous"><parent link="link_2"/><child link="plate"/>
    <origin xyz="0 0 1"/><axis xyz="0 1 0"/></joint>
  <joint name="long_joint" type="continuous"><parent link="plate"/><child link="long_rod"/>
    <origin xyz="0.1 0.1 0.2"/><axis xyz="0 1 0"/></joint>
</robot>""".replace("INERTIA", '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>')
HOLD = """effects:
  - {effect: coupling, joint: long_joint, follows: {plate_joint: -1, joint_3: 1}}
  - {effect: coupling, joint: plate_joint, follows: {rod_joint: -1}}
  - {effect: coupling, joint: rod_joint, follows: {joint_2: 1}}
"""


def test_a_palletizer_with_the_rods_of_its_two_parallelograms(tmp_path: Path) -> None:
    """A rod beside link 2 keeps a plate at the elbow level, from which another one beside the forearm keeps the wrist.

    Gravity by Pinocchio on the tree, its angles by hand; the couplings stand in the wrong order and lead each other.
    """
    folder = tmp_path / "palletizer"
    shutil.copytree(MACHINES / "palletizer", folder)
    file, spec = folder / "palletizer.urdf", folder / "robot.yaml"
    file.write_text(file.read_text().replace("</robot>", RODS))
    spec.write_text(spec.read_text().replace("effects:\n", HOLD))
    robot, tree = load_robot(folder), pin.buildModelFromUrdf(str(file))
    poses, data = some_poses(robot, 20, force=0.0), tree.createData()
    ours = actuator_torques(model_of(robot), poses)
    hinges = [tree.getJointId(name) for name in (*robot.facts.joints, "rod_joint", "plate_joint", "long_joint")]
    for i, (q1, q2, q3, q4, q5) in enumerate(poses.q):
        q = pin.neutral(tree)
        for hinge, angle in zip(hinges, (q1, q2, q3, q4, q5, q2, -q2, q2 + q3), strict=True):
            part = tree.joints[hinge]  # a continuous joint has a cosine and a sine
            q[part.idx_q : part.idx_q + part.nq] = [angle] if part.nq == 1 else [np.cos(angle), np.sin(angle)]
        held = pin.computeGeneralizedGravity(tree, data, q)
        w1, w2, w3, w4, w5, rod, plate, long_rod = (-held[tree.joints[hinge].idx_v] for hinge in hinges)
        expected = [w1, w2 - w3 + rod - plate, w3 - w4 + long_rod, w5]
        np.testing.assert_allclose(ours[i, [0, 1, 2, 4]], expected, atol=1e-12 * np.abs(held).max())


MASSES = """    lever_mass_kg: 180
    bar_mass_kg: 90
"""


def test_masses_of_lever_and_bar_are_enough_where_no_urdf_draws_them(tmp_path: Path) -> None:
    """Even rods: the same torques, equilibrium and margin as of links that are drawn so, a mass on the lever too."""
    drawn, stated = tmp_path / "drawn", tmp_path / "stated"
    for folder in (drawn, stated):
        shutil.copytree(MACHINES / "counterweight_arm", folder)
    file = drawn / "counterweight_arm.urdf"
    even = file.read_text().replace('"-0.3 0 0"', '"-0.375 0 0"').replace('"0 0 0.5"/><mass', '"0 0 0.56"/><mass')
    file.write_text(even)
    file, spec = stated / "counterweight_arm.urdf", stated / "robot.yaml"
    gone = ("lever", "weight", "bar")
    lines = [x for x in file.read_text().splitlines() if not any(f'"{n}"' in x or f'"{n}_joint"' in x for n in gone)]
    file.write_text("\n".join(lines))
    text = re.sub(r"    lever_joint: .*\n    bar_joint: .*\n", MASSES, spec.read_text())
    spec.write_text(text.replace("link: lever,", "link: joint_3_lever,"))
    named = (stated / "nominal.yaml").read_text().replace("counterweight[lever]", "counterweight[joint_3_lever]")
    (stated / "nominal.yaml").write_text(named)
    one, two = load_robot(drawn), load_robot(stated)
    assert [b.link for b in two.facts.branches] == ["housing", "joint_3_lever", "joint_3_bar"]
    poses = some_poses(one, 20, 5, 4e3)
    for of in (actuator_torques, flip_margin, Model.predict):
        first, second = of(model_of(one), poses), of(model_of(two), poses)
        np.testing.assert_allclose(second, first, atol=1e-11 * np.abs(first).max())
    entry = {"effect": "parallelogram", "driver": "joint_2", "driven": "joint_3", "lever_m": 0.75, "lever_mass_kg": 10}
    (light,) = build_effects(entry, load_robot("fanuc_m900ib").facts)
    check_effect(light, load_robot("fanuc_m900ib").facts)
    for wrong in ({"lever_joint": "lever_joint"}, {"bar_mass_kg": -1}):
        with pytest.raises(InputError, match="wrong masses"):
            build_effects(entry | wrong, one.facts)


REFUSED = {
    "nothing determines it": (
        ("robot.yaml", "    bar_joint: bar_joint\n", ""),
        ("counterweight_arm.urdf", 'name="bar_joint"'),
        "'bar_joint' moves beside the arm, and no effect",
    ),
    "a lever elsewhere": (
        ("counterweight_arm.urdf", 'xyz="0.41 0.3 0"', 'xyz="0.43 0.3 0"'),
        ("robot.yaml", "effect: parallelogram"),
        "lever_joint stands elsewhere at zero joint angles",
    ),
    "a bar on the arm": (
        ("counterweight_arm.urdf", '<parent link="lever"/><child link="bar', '<parent link="link_1"/><child link="bar'),
        ("robot.yaml", "effect: parallelogram"),
        "bar_joint hangs on the wrong link; found link_1",
    ),
    "a crooked lever": (
        ("counterweight_arm.urdf", '"0.41 0.3 0"/><axis xyz="0 1 0"', '"0.41 0.3 0"/><axis xyz="0 1 0.1"'),
        ("robot.yaml", "effect: parallelogram"),
        "needs parallel axes: joint_2 and lever_joint are not",
    ),
    "pivots that meet": (
        ("robot.yaml", "z_m: 0.235}\n", "z_m: 1.12}\n"),
        ("robot.yaml", "effect: cylinder"),
        "its two pivots can meet, so nothing determines its angle",
    ),
    "a cylinder of the arm": (
        ("robot.yaml", "joint: housing_joint, driver", "joint: joint_4, driver"),
        ("robot.yaml", "effect: cylinder"),
        "no joint beside the arm 'joint_4'",
    ),
    "a motor on the bar": (
        ("robot.yaml", "  joint_6: {", "  bar_joint: {limits_deg: [-10, 10]}\n  joint_6: {"),
        ("robot.yaml", "  bar_joint: {"),
        "'bar_joint' does not move the flange",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_branches_that_cannot_be_are_refused_with_file_and_line(case: str, tmp_path: Path) -> None:
    (name, old, new), (file, mark), words = REFUSED[case]
    shutil.copytree(MACHINES / "counterweight_arm", tmp_path / "arm")
    text = (tmp_path / "arm" / name).read_text()
    assert text.count(old) == 1
    (tmp_path / "arm" / name).write_text(text.replace(old, new))
    with pytest.raises(InputError) as refused:
        load_robot(tmp_path / "arm")
    told = [p for p in refused.value.problems if words in str(p)]
    lines = (tmp_path / "arm" / file).read_text().splitlines()
    assert [(p.file, p.line) for p in told] == [
        (str(tmp_path / "arm" / file), next(i for i, line in enumerate(lines, 1) if mark in line))
    ]
