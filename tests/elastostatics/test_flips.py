"""The flip predicate against plain Pinocchio: which side the coupling bar is pressed to."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from qsframework.elastostatics import flip_margin
from qsframework.experiment import Constraints, Experiment
from qsframework.plans import generate_candidates
from qsframework.plugin import Poses

M2 = (60.0, np.array([-0.36, 0.0, 0.28]))
"""Mass, kg, and place on link 3 of the motors of the wrist."""
BAR = (40.0, np.array([-0.75, 0.0, 0.0]))
"""The bar turns with link 2, so joint 3 moves it as its upper pivot moves, m."""


def driven_torque(
    experiment: Experiment, q: np.ndarray, wrench: np.ndarray, hung: tuple[tuple[float, np.ndarray], ...]
) -> tuple[float, float]:
    """Torque on the driven joint, unloaded and loaded, of one pose: the arm's and that of masses hung on link 3."""
    robot = experiment.robot
    data = robot.model.createData()
    gravity = -pin.computeGeneralizedGravity(robot.model, data, q)
    pin.computeJointJacobians(robot.model, data, q)
    J = pin.getJointJacobian(robot.model, data, 6, pin.LOCAL_WORLD_ALIGNED)
    arm = data.oMi[6].rotation @ experiment.load_point
    moment = wrench[3:] + np.cross(arm, wrench[:3])
    load = J.T @ np.concatenate([wrench[:3], moment])
    axis = data.oMi[3].rotation @ np.array([0.0, -1.0, 0.0])
    held = gravity[2] + sum(-9.81 * kg * np.cross(axis, data.oMi[3].rotation @ at)[2] for kg, at in hung)
    return float(held), float(held + load[2])


def test_the_margin_is_the_torque_that_holds_the_side(m900ib: Experiment) -> None:
    """The balancer acts on joint 2 alone. The elbow's joint passes on the weight of the arm with m2 and
    the load, the lever's end the bar's weight too; lever and m1 hang on the actuator itself."""
    rng = np.random.default_rng(0)
    controller = m900ib.robot.controller
    pendant = rng.uniform(controller.lower, controller.upper, (200, 6))
    q = controller.to_joints(pendant)
    wrench = rng.normal(size=(200, 6)) * np.array([4e3] * 3 + [300.0] * 3)
    margin = flip_margin(m900ib.model(), Poses(pendant, q, wrench))
    flipped = 0
    for i in range(200):
        pairs = [driven_torque(m900ib, q[i], wrench[i], hung) for hung in ((M2,), (M2, BAR))]
        held = [min(abs(unloaded), np.sign(unloaded) * loaded) for unloaded, loaded in pairs]
        assert np.isclose(margin[i], min(held), rtol=1e-9, atol=1e-6)
        flips = any(unloaded * loaded < 0 for unloaded, loaded in pairs)
        flipped += flips
        assert (margin[i] < 0) == flips
    assert 20 < flipped < 180


def test_an_arm_without_loops_never_flips(r2000ic: Experiment) -> None:
    q = np.zeros((3, 6))
    assert np.isinf(flip_margin(r2000ic.model(), Poses(q, q, np.ones((3, 6))))).all()


def test_planned_poses_keep_the_margin(m900ib: Experiment) -> None:
    limits = Constraints(flip_margin=500.0)
    up = m900ib.with_(constraints=limits, loads=(m900ib.loads[1],))
    found = generate_candidates(up, 200, seed=2)
    q = up.robot.controller.to_joints(found.pendant)
    assert flip_margin(up.model(), Poses(found.pendant, q, np.tile(up.loads[0].wrench, (200, 1)))).min() >= 500.0
    assert found.removed["flip_margin"] > 0
