"""What the calibrated model is for."""

from qsframework.applications.stiffness import Stiffness, stiffness_at

__all__ = ["Stiffness", "stiffness_at"]
