"""Pictures in 3D."""

from qsframework.viz.plan_scene import plan_scene
from qsframework.viz.residual_arrows import residuals
from qsframework.viz.residual_scene import residual_scene
from qsframework.viz.robot_row import robot_row
from qsframework.viz.scene import Scene
from qsframework.viz.server import Site, serve
from qsframework.viz.show_scene import Residuals, place_poses, show_scene
from qsframework.viz.task_scene import task_scene

__all__ = [
    "Residuals",
    "Scene",
    "Site",
    "place_poses",
    "plan_scene",
    "residual_scene",
    "residuals",
    "robot_row",
    "serve",
    "show_scene",
    "task_scene",
]
