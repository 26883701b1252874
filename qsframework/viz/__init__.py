"""Pictures in 3D."""

from typing import TYPE_CHECKING

from qsframework.lazily import lazily

if TYPE_CHECKING:
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
__getattr__ = lazily(
    __name__,
    {
        "plan_scene": "plan_scene",
        "residual_arrows": "residuals",
        "residual_scene": "residual_scene",
        "robot_row": "robot_row",
        "scene": "Scene",
        "server": "Site serve",
        "show_scene": "Residuals place_poses show_scene",
        "task_scene": "task_scene",
    },
)
