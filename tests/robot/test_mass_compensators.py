"""The M-900iB's mass compensators m1 and m2 (section 3.3 of the paper), against an energy written without the model."""

from __future__ import annotations

from dataclasses import replace

import mujoco_m900ib as plain
import numpy as np
import pytest

from qsframework.elastostatics import Site, actuator_torques, flip_margin, make_model
from qsframework.experiment import Experiment, example, load_experiment, read_plan
from qsframework.plans import check_poses
from qsframework.plugin import Poses
from qsframework.robot import Robot, load_robot

M1, M2, ROD, TIE = 200.0, 60.0, 60.0, 40.0
"""kg: on the lever's extension 0.95 m behind axis 2, of the wrist's motors, of the lever, of the bar."""


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("fanuc_m900ib")


def energy(pendant: np.ndarray) -> float:
    """Potential energy, J: weights of the arm, lever, bar and m1, and the balancer's spring. Link 3 has 700 kg there,
    m2 among them."""
    J2, J3 = pendant[1:3]
    q = pendant.copy()
    q[2] = J2 + J3
    origins, _, rotations = plain.frames(q)
    heights = [o[2] + (R @ c)[2] for o, R, c in zip(origins, rotations, plain.CENTRES, strict=True)]
    height = float(np.dot(plain.MASSES, heights))
    height += -np.sin(J3) * (ROD * 0.375 + M1 * 0.95 + TIE * 0.75) + TIE * 0.56 * np.cos(J2)
    length = np.sqrt(0.235**2 + 1.12**2 - 2 * 0.235 * 1.12 * np.cos(J2))
    return 9.81 * height + 0.5 * plain.SPRING * (length - plain.FREE_LENGTH) ** 2


def test_the_actuators_hold_what_the_energy_says(robot: Robot) -> None:
    model = make_model(robot.facts, robot.effects, robot.parameters, Site(6, np.zeros(3)), [], robot.gravity)
    rng, h = np.random.default_rng(0), 1e-4
    pendant = rng.uniform(robot.controller.lower, robot.controller.upper, (20, 6))
    poses = Poses(pendant, robot.controller.to_joints(pendant), np.zeros((20, 6)))
    held = actuator_torques(model, poses)
    for i, angles in enumerate(pendant):
        steps = h * np.eye(6)
        slope = [(energy(angles + s) - energy(angles - s)) / (2 * h) for s in steps]
        np.testing.assert_allclose(held[i], -np.array(slope), atol=1e-2)  # N m of some 10,000


def without(robot: Robot, *names: str) -> Robot:
    """The robot whose compensators of these names weigh nothing."""
    parameters = tuple(replace(p, nominal=0.0) if p.name in names else p for p in robot.parameters)
    return replace(robot, parameters=parameters)


def test_m1_takes_load_off_actuator_3_and_off_no_passive_joint() -> None:
    """At the paper's twelve poses: 200 kg 0.95 m behind axis 2 hold 1.86 kN m cos J3 of what actuator 3 held."""
    experiment = load_experiment(example("m900ib") / "experiment.yaml")
    poses = read_plan(example("m900ib") / "table5.csv", experiment).poses
    light = without(experiment.robot, "counterweight[joint_3_lever]")
    with_m1, other = experiment.model(), experiment.with_(robot=light).model()
    unloaded = Poses(poses.pendant, poses.q, np.zeros_like(poses.wrench))
    change = actuator_torques(with_m1, unloaded) - actuator_torques(other, unloaded)
    np.testing.assert_allclose(change[:, 2], M1 * 9.81 * 0.95 * np.cos(poses.pendant[:, 2]), rtol=1e-9)
    held = [np.abs(actuator_torques(m, unloaded)[:, 2]) for m in (with_m1, other)]
    assert np.all(held[0] < 0.66 * held[1])
    np.testing.assert_allclose(flip_margin(with_m1, poses), flip_margin(other, poses), rtol=1e-12)


def test_the_compensators_do_not_change_the_response_to_a_load() -> None:
    """The paper's section 3.3. Through the deflected pose they do, by less than a thousandth of 5 mm."""
    experiment = load_experiment(example("m900ib") / "experiment.yaml")
    poses = read_plan(example("m900ib") / "table5.csv", experiment).poses
    light = without(experiment.robot, "counterweight[joint_3_lever]", "counterweight[link_3]")
    both = experiment.model(), experiment.with_(robot=light).model()
    first, second = (m.predict(poses) for m in both)
    assert 0 < np.abs(first - second).max() < 1e-3 * np.abs(first).max()
    first, second = (m.predict(poses, linear=True) for m in both)
    assert np.abs(first - second).max() < 1e-15


def test_the_experiment_keeps_the_passive_joints_pressed(m900ib: Experiment) -> None:
    """`flip_margin_Nm` is on, and the paper's own poses keep it."""
    assert m900ib.constraints.flip_margin == 500.0
    plan = read_plan(example("m900ib") / "table5.csv", m900ib)
    assert check_poses(m900ib, m900ib.model(), plan.pendant)["flip_margin"].all()
