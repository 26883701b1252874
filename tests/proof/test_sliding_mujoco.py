"""The full equilibrium of arms that slide against MuJoCo, within a nanometre."""

from __future__ import annotations

from pathlib import Path

import mujoco_chain as mj
import numpy as np
import pytest
from sliding_arms import ARMS, write_arm

from qsframework.elastostatics import Site, equilibrium, make_model
from qsframework.plugin import Poses
from qsframework.robot import load_robot

POINT = np.array([0.1, 0.2, 0.3])
FORCE = 900.0


@pytest.mark.parametrize("name", sorted(ARMS))
def test_mujoco_settles_at_the_same_place(name: str, tmp_path: Path) -> None:
    """Loaded, unloaded, and their difference of 0.03 to 3 mm, at five poses."""
    robot, chain = load_robot(write_arm(tmp_path, name)), mj.stages(ARMS[name])
    facts, rng = robot.facts, np.random.default_rng(3)
    assert facts.limits is not None
    tip = Site(facts.n, POINT)
    model = make_model(facts, robot.effects, robot.parameters, tip, [("tip", tip)], robot.gravity)
    stiffness = 1.0 / np.array([p.nominal for p in robot.parameters])
    for _ in range(5):
        q = rng.uniform(facts.limits[:, 0], facts.limits[:, 1])
        direction = rng.normal(size=3)
        force = FORCE * direction / np.linalg.norm(direction)
        poses = Poses(robot.controller.to_pendant(q[None]), q[None], np.append(force, np.zeros(3))[None])
        loaded, unloaded = (mj.settle(chain, q, stiffness, POINT, f) for f in (force, np.zeros(3)))
        assert np.linalg.norm(equilibrium(model, poses).tip[0] - loaded) < 1e-9
        assert np.linalg.norm(equilibrium(model, poses, loaded=False).tip[0] - unloaded) < 1e-9
        assert np.linalg.norm(model.predict(poses)[0, 0] - (loaded - unloaded)) < 1e-9
