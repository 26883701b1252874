"""An arm with three reflectors around its tool, as the text of an experiment; and random poses of it under a load."""

from __future__ import annotations

import numpy as np

from qsframework.experiment import Experiment
from qsframework.plugin import Poses


def arm_text(sigma: str, more: str = "", robot: str = "fanuc_m900ib", point: str = "150, 0, 200") -> str:
    """experiment.yaml; sigma in mm, the load point in mm, more: further lines."""
    return f"""
robot: {robot}
load: {{point_mm: [{point}]}}
markers:
  m1: {{xyz_mm: [150, 250, 250]}}
  m2: {{xyz_mm: [400, -150, 150]}}
  m3: {{xyz_mm: [150, -150, -250]}}
noise: {{sigma_mm: {sigma}}}
{more}"""


def random_poses(m900ib: Experiment, load: int, count: int, seed: int = 0) -> Poses:
    """Poses of the paper's robot, all under one of its loads."""
    rng = np.random.default_rng(seed)
    pendant = np.deg2rad(rng.uniform([-170, -50, -60, -150, 30, -150], [170, 80, 20, 150, 100, 150], (count, 6)))
    wrench = np.tile(m900ib.loads[load].wrench, (count, 1))
    return Poses(pendant, m900ib.robot.controller.to_joints(pendant), wrench)
