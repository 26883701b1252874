"""The flip predicate against plain Pinocchio: which side the coupling bar is pressed to."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from qsframework.design import generate_candidates
from qsframework.elastostatics import flip_margin
from qsframework.experiment import Constraints, Experiment
from qsframework.plugin import Poses


def driven_torque(experiment: Experiment, q: np.ndarray, wrench: np.ndarray) -> tuple[float, float]:
    """Torque on the lever (= on joint 3, since G[:, lever] = e3), unloaded and loaded, one pose."""
    robot = experiment.robot
    data = robot.model.createData()
    gravity = -pin.computeGeneralizedGravity(robot.model, data, q)
    pin.computeJointJacobians(robot.model, data, q)
    J = pin.getJointJacobian(robot.model, data, 6, pin.LOCAL_WORLD_ALIGNED)
    arm = data.oMi[6].rotation @ experiment.load_point
    moment = wrench[3:] + np.cross(arm, wrench[:3])
    load = J.T @ np.concatenate([wrench[:3], moment])
    return float(gravity[2]), float(gravity[2] + load[2])


def test_the_margin_is_the_torque_that_holds_the_side(m900ib: Experiment) -> None:
    """On the M-900iB the balancer acts on joint 2 alone, so the lever carries gravity and load only."""
    rng = np.random.default_rng(0)
    controller = m900ib.robot.controller
    pendant = rng.uniform(controller.lower, controller.upper, (200, 6))
    q = controller.to_joints(pendant)
    wrench = rng.normal(size=(200, 6)) * np.array([4e3] * 3 + [300.0] * 3)
    margin = flip_margin(m900ib.model(), Poses(pendant, q, wrench))
    flipped = 0
    for i in range(200):
        unloaded, loaded = driven_torque(m900ib, q[i], wrench[i])
        assert np.isclose(margin[i], min(abs(unloaded), np.sign(unloaded) * loaded), rtol=1e-9, atol=1e-6)
        flipped += unloaded * loaded < 0
        assert (margin[i] < 0) == (unloaded * loaded < 0)
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
