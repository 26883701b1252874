"""Laws that nobody has written, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from qsframework.diagnose.law import Law
from qsframework.diagnose.result import LikelyPlace
from qsframework.report.words.lists import listed

_FACTORS = {
    "torque": "the torque there",
    "others": "the torque about other axes",
    "moment": "the moments there",
    "attitude": "where gravity points",
    "order": "the order of the readings",
    "came": "the way by which the joint came",
    "time": "the time",
    "temperature": "the temperature",
    "approach": "the side of approach",
    "force": "the force of the load",
    "direction": "the direction of the load",
    "always": "nothing (a constant)",
}
_STATES = ("loaded", "always")
_HOW: dict[tuple[str, ...], str] = {
    ("loaded",): "by a constant amount once a load hangs",
    ("always",): "by a constant amount",
    ("loaded", "came"): "with the way by which the joint came, once a load hangs",
    ("torque",): "with the torque there",
}


_TOLD = 2
"""Other places that are told by name."""
_ALIKE = 4
"""Places of the same motion that are told by name."""
_LOAD = {"load": "the load", "point": "the point where the load acts"}


def place_words(law: Law) -> str:
    """Where it is: `the drive of joint_1`, `the bearing of joint_4`, `link_2`, `marker m1`, `all readings`."""
    if law.axis:
        return f"{place_words(replace(law, axis=''))} {'about' if law.axis[1:] else 'along'} {law.axis[-1]}"
    if law.part in ("drive", "bearing"):
        return f"the {law.part} of {law.place}"
    if law.part == "marker":
        return f"marker {law.place}"
    if law.part == "readings":
        return "all readings"
    return _LOAD.get(law.part, law.place)


def variable_words(law: Law) -> str:
    """On what it depends."""
    said = [_angle_words(f) if f in law.angles else _FACTORS[f] for f in law.by if f not in _STATES]
    if not said:
        return "whether a load hangs" if law.by == ("loaded",) else _FACTORS["always"]
    return " and ".join(said) + (" (once a load hangs)" if "loaded" in law.by else "")


def _angle_words(factor: str) -> str:
    joints = factor.split("+")
    return f"the angle of {' and '.join(joints)}{' together' if joints[1:] else ''}"


def moving_words(law: Law, places: Sequence[LikelyPlace] = ()) -> str:
    """That something moves, and with what. places: where it may be; those that are not the law's own are told."""
    moves = f"something moves {place_words(law)}"
    if law.part in _LOAD:
        moves = f"{_LOAD[law.part]} differs from what was said"
    elif law.part == "readings":
        moves = "all readings move"
    how = _HOW.get(law.by) or f"with {variable_words(law)}"
    other = [place_words(replace(x.law, axis="")) for x in places if x.law.where != law.where]
    if len(other) > _TOLD:
        other[1:] = [f"one of {len(other) - 1} other places"]
        return f"{moves} {how} (or {', or '.join(other)})"
    return f"{moves} {how} (or {' or '.join(other)})" if other else f"{moves} {how}"


def places_words(places: Sequence[LikelyPlace]) -> str:
    """Where what is left may be, with the share of the evidence of each place."""
    if len(places) < 2:
        return ""
    first, *other = [f"{place_words(x.law)} ({100 * x.share:.0f} %)" for x in places]
    return (
        f"These readings do not tell whether it is {first} or {' or '.join(other)}: in brackets the share of the "
        "evidence that each place holds."
    )


def same_motion_words(places: Sequence[LikelyPlace], same: Sequence[Law]) -> str:
    """Which places beside those that are told could move the markers alike, and what speaks against them."""
    told = {x.law.where for x in places}
    names = [place_words(law) for law in same if law.where not in told]
    if not names:
        return ""
    names[_ALIKE:] = [f"{len(names) - _ALIKE} more places"] if len(names) > _ALIKE else []
    each, them = ("each by a law of its own", "these places") if names[1:] else ("by a law of its own", "this place")
    return (
        f"In the same way, to within the noise, {listed(names)} could move the markers, {each}: only how the motion "
        f"follows its variable speaks against {them}."
    )
