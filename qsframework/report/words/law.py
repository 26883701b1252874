"""Laws that nobody has written, in words."""

from __future__ import annotations

from qsframework.diagnose.law import Law

_VARIABLES = {
    "torque": "the torque there",
    "others": "the torque about other axes",
    "order": "the order of the readings",
    "step": "where the joint came from",
    "constant": "nothing (a constant)",
    "time": "the time",
    "temperature": "the temperature",
    "approach": "the side of approach",
}
_HOW = {
    "constant": "by a constant amount",
    "order": "in the course of the readings",
    "step": "with the side that the joint came from",
    "torque": "with the torque there",
}

_UNLEARNED = {
    "step": "It needs the pose before, which no plan has: no law of it is learned. Record the side of approach.",
    "constant": "A constant is a parameter of the geometry there: fit that.",
    "others": "It couples axes: a law of one spring cannot hold it, only an effect that couples them.",
}


def place_words(law: Law) -> str:
    """Where it is: `the drive of joint_1`, `link_2`, `marker m1`, `all readings`."""
    if law.part == "drive":
        return f"the drive of {law.place}"
    if law.part == "marker":
        return f"marker {law.place}"
    if law.part == "readings":
        return "all readings"
    return law.place


def variable_words(law: Law) -> str:
    """On what it depends."""
    if law.joints:
        return f"the angle of {' and '.join(law.joints)}{' together' if law.joints[1:] else ''}"
    return _VARIABLES[law.variable]


def moving_words(law: Law) -> str:
    """That something moves, and with what."""
    how = _HOW.get(law.variable) or f"with {variable_words(law)}"
    return f"all readings move {how}" if law.part == "readings" else f"something moves {place_words(law)} {how}"


def unlearned_words(law: Law) -> str:
    """Why a law cannot be an effect of the arm; empty where it can."""
    if law.part == "marker":
        return "It belongs to the marker's mount and not to the arm: no law of it is learned or extended."
    if law.part == "readings":
        return "It belongs to the instrument or its place and not to the arm: no law of it is learned or extended."
    return _UNLEARNED.get(law.variable, "")
