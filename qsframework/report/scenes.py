"""What a report needs of a scene beside its page."""

from __future__ import annotations

from qsframework.viz import Scene


def poses_of(scene: Scene) -> tuple[str, ...]:
    """The pose that each step of a scene of residuals shows, from its label."""
    return tuple(label.rpartition(": up to ")[0] for _, label in scene.steps)
