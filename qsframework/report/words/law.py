"""Laws that nobody has written, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from qsframework.errors import listed, some_of
from qsframework.hypotheses.catalogue.law import Law, LikelyPlace
from qsframework.plugin import RobotFacts

_FACTORS = {
    "torque": "the torque there",
    "others": "the torque about other axes",
    "moment": "the moments there",
    "attitude": "where gravity points",
    "order": "the order of the readings",
    "came": "the direction of approach of the joint",
    "time": "the time",
    "temperature": "the temperature",
    "approach": "the side of approach",
    "force": "the force of the load",
    "direction": "the direction of the load",
    "before": "the load that hung before",
    "always": "nothing (a constant)",
}
_STATES = ("loaded", "always")
_HOW: dict[tuple[str, ...], str] = {
    (): "that differs at each visit",
    ("loaded",): "that is constant once a load hangs",
    ("always",): "that is constant",
    ("loaded", "came"): "that depends on the direction of approach, once a load hangs",
}


_RANKED = 3
"""Places that are ranked by name."""
_TOLD = 2
"""Other places that are told by name."""
_LOAD = {"load": "the load", "point": "the point where the load acts"}
_SHARED = {*_LOAD, "readings"}
_SHARED = {*_LOAD, "readings"}


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
    if not law.by:
        return "nothing that was tried: it differs at each visit"
    said = [_factor_words(f, f in law.angles) for f in law.by if f not in _STATES]
    if not said:
        return "whether a load hangs" if law.by == ("loaded",) else _FACTORS["always"]
    return " and ".join(said) + (" (once a load hangs)" if "loaded" in law.by else "")


def _factor_words(factor: str, angle: bool) -> str:
    what, _, joint = factor.partition(" ")
    if not angle:
        other = {
            "torque": f"the torque at {joint}",
            "came": f"the direction of approach of {joint}",
            "travel": f"the travel of {joint}",
        }
        return other[what] if joint else _FACTORS[factor]
    joints = factor.split("+")
    return f"the angle of {' and '.join(joints)}{' together' if joints[1:] else ''}"


def moving_words(law: Law, facts: RobotFacts, places: Sequence[LikelyPlace] = ()) -> str:
    """Where an error acts that no cause explains, and on what it depends; what can hardly act there stands in for
    another variable. places: where it may be; those that are not the law's own are named."""
    moves = f"an error {'of' if law.part in _SHARED else 'at'} {place_words(law)}"
    how = _HOW.get(law.by) or f"that depends on {variable_words(law)}"
    how += "" if law.reaches(facts) else ", which can hardly act there and stands in for something else"
    other = [place_words(replace(x.law, axis="")) for x in places if x.law.where != law.where]
    if len(other) > _TOLD:
        other[1:] = [f"one of {len(other) - 1} other places"]
        return f"{moves} {how} (or {', or '.join(other)})"
    return f"{moves} {how} (or {' or '.join(other)})" if other else f"{moves} {how}"


def places_words(places: Sequence[LikelyPlace]) -> Iterator[str]:
    """Where what is left may be, with the share of the evidence of each place, and how far it moves there."""
    if not places:
        return
    first, *other = [f"{place_words(x.law)} ({100 * x.share:.0f} %)" for x in places]
    if other:
        yield (
            f"These readings cannot separate {first} from {' and '.join(other)}: in brackets the share of the evidence "
            "that each place holds."
        )
    best = places[0]
    if not best.law.by:
        yield f"No variable that was tried explains it: it moves by {_moved(best)} (1 sigma), otherwise at each visit."
    if best.equivalent:
        same = listed([place_words(law) for law in best.equivalent])
        yield f"Equivalent places: {same}. A reflector or a gauge nearer the base separates them."


def ranked_words(places: Sequence[LikelyPlace]) -> str:
    """Where something would be if it acts, the likeliest first."""
    shown = some_of([f"{place_words(x.law)} ({100 * x.share:.0f} %)" for x in places], _RANKED)
    return f"Most likely places of an effect, if there is one: {shown}. Visits chosen for it would settle it."


def _moved(place: LikelyPlace) -> str:
    turns = place.law.part in ("drive", "bearing", "link")
    return f"{1e6 * place.sd:.2g} urad" if turns else f"{1e3 * place.sd:.2g} mm"
