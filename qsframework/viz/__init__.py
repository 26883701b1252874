"""Pictures in 3D."""

from qsframework.viz.plan_scene import place_poses, plan_scene
from qsframework.viz.residual_scene import residual_scene
from qsframework.viz.scene import Scene

__all__ = ["Scene", "place_poses", "plan_scene", "residual_scene"]
