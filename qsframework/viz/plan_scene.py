"""A plan's poses in 3D, as a report shows them."""

from __future__ import annotations

from qsframework.experiment import Experiment, Plan
from qsframework.viz.scene import Scene
from qsframework.viz.show_scene import place_poses, show_scene

__all__ = ["place_poses", "plan_scene"]


def plan_scene(experiment: Experiment, plan: Plan) -> Scene:
    """Every pose of the plan as a step of the slider, with its load, its markers and its exaggerated deflection."""
    return show_scene(experiment, plan)
