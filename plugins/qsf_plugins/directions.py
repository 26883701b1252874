"""The six directions in which a link, a base or a tool gives."""

from __future__ import annotations

from typing import Literal, cast

from qsframework.plugin import InputError, Parameter, Problem, VirtualJoint

DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")


def check_direction(name: str, direction: str) -> None:
    """InputError for anything but the six."""
    if direction not in DIRECTIONS:
        raise InputError(Problem(f"{name}: unknown direction", found=repr(direction), allowed=", ".join(DIRECTIONS)))


def compliance(name: str, direction: str, translation: float, rotation: float) -> Parameter:
    """The compliance in a direction: m/N for a translation, rad/(N m) for a rotation; natural sizes in SI."""
    if direction.startswith("r"):
        return Parameter(name, "rad/(N m)", nominal=0.0, typical=rotation, lower=0.0)
    return Parameter(name, "m/N", nominal=0.0, typical=translation, lower=0.0)


def virtual_joint(link: str, direction: str) -> VirtualJoint:
    """The virtual joint of a direction at a link's frame."""
    axis = cast(Literal["x", "y", "z"], direction[-1])
    return VirtualJoint(link, axis, "rotation" if direction.startswith("r") else "translation")
