"""What the calibrated model is for."""

from typing import TYPE_CHECKING

from qsframework.lazily import lazily

if TYPE_CHECKING:
    from qsframework.applications.compensate import Compensation, compensate
    from qsframework.applications.stiffness import Stiffness, stiffness_at
    from qsframework.applications.targets import Targets, joint_targets, read_targets

__all__ = [
    "Compensation",
    "Stiffness",
    "Targets",
    "compensate",
    "joint_targets",
    "read_targets",
    "stiffness_at",
]
__getattr__ = lazily(
    __name__,
    {
        "compensate": "Compensation compensate",
        "stiffness": "Stiffness stiffness_at",
        "targets": "Targets joint_targets read_targets",
    },
)
