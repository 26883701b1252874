"""What became of every joint of a stranger's URDF, and of the limits that it states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.plausible import allowed, beyond
from qsframework.robot.urdf import Joint, Mimic, Urdf
from qsframework.units import SLIDES, TURNS, JointUnit


class Fate(StrEnum):
    """What `qsf new` makes of a joint: part of the arm, stiff in it, left out, or part of it in another way."""

    KEPT = "kept"
    FIXED = "fixed"
    DROPPED = "dropped"
    OVERRULED = "overruled"


@dataclass(frozen=True, kw_only=True)
class ChainJoint:
    """A joint of the file and its fate; stated, used: its limits (lower, upper), rad or m, None where it has none."""

    name: str
    parent: str
    child: str
    fate: Fate
    why: str = ""
    slides: bool = False
    stated: tuple[float, float] | None = None
    used: tuple[float, float] | None = None

    @property
    def unit(self) -> JointUnit:
        return SLIDES if self.slides else TURNS


@dataclass(frozen=True)
class TelescopicColumn:
    """A telescopic column: the joint that leads it and moves nothing of the arm, and the stage that stands for it.

    The stage's travel is the multiplier times what the pendant shows.
    """

    leader: Joint
    stage: str
    multiplier: float


_TURN = 2.0 * np.pi
_ANY = (-_TURN, _TURN)


def slides(joint: Joint) -> bool:
    """Whether a joint moves along its axis, and not about it."""
    return joint.kind == "prismatic"


def used_limits(joint: Joint) -> tuple[float, float]:
    """Between which values a joint is planned: as stated, of a continuous one where that is within a turn."""
    stated = joint.limits
    if stated is None or (joint.kind == "continuous" and not 0.0 < stated[1] - stated[0] <= _TURN * (1.0 + 1e-6)):
        return _ANY
    return stated


def many_turns(joint: Joint) -> bool:
    """Whether a joint that turns states limits that arms do not have, as degrees in the place of radians are."""
    return joint.kind == "revolute" and joint.limits is not None and max(map(abs, joint.limits)) > 4.0 * _TURN


def endless(moving: Sequence[Joint]) -> list[Problem]:
    """What to say of joints with a motor whose limits no arm has, as those of a vehicle below it."""
    units = {joint.name: "m" if slides(joint) else "rad" for joint in moving}
    far = [(j, r) for j in moving if (r := beyond(max(map(abs, used_limits(j))), units[j.name])) is not None]
    return [
        joint.place.problem(
            f"joint {joint.name!r}: no joint of an arm has these limits",
            found="{:g} .. {:g} {}".format(*used_limits(joint), units[joint.name]),
            allowed=allowed(known, units[joint.name]),
            hint=f"Correct them, or, where it is a vehicle's, begin the arm beyond it: base {far[-1][0].child}.",
            argument=("base", far[-1][0].child),
        )
        for joint, known in far
    ]


def columns(urdf: Urdf, chain: Sequence[Joint]) -> tuple[list[Joint], list[TelescopicColumn]]:
    """The chain with its telescopic columns as joints that can be: where stages follow a slide that is no part of the
    chain, the first stage stands for the slide and the others follow it; and these columns.

    An offset of a stage, which the pendant does not show, goes into its place.
    """
    names = [joint.name for joint in chain]
    led: dict[str, TelescopicColumn] = {}
    out: list[Joint] = []
    for joint in chain:
        follows = joint.mimic
        leader = None if follows is None else next((j for j in urdf.joints if j.name == follows.joint), None)
        if follows is None or leader is None or leader.name in names or not (slides(joint) and slides(leader)):
            out.append(joint)
            continue
        if leader.mimic is not None or not follows.multiplier or leader.limits is None:
            message = f"joint {joint.name!r} follows {leader.name!r}, of which nothing says where it stands"
            hint = "A column is led by a slide with limits that follows nothing, and its stages by a factor of it."
            raise InputError(joint.place.problem(message, hint=hint))
        there = joint.origin.matrix()[:3, :3] @ (joint.axis / np.linalg.norm(joint.axis)) * follows.offset
        placed = replace(joint, origin=replace(joint.origin, xyz=joint.origin.xyz + there))
        if leader.name not in led:
            led[leader.name] = TelescopicColumn(leader, joint.name, follows.multiplier)
            ends = sorted(follows.multiplier * end for end in leader.limits)
            out.append(replace(placed, mimic=None, limits=(ends[0], ends[1])))
        else:
            first = led[leader.name]
            out.append(replace(placed, mimic=Mimic(first.stage, follows.multiplier / first.multiplier, 0.0)))
    return out, list(led.values())


def told_joints(
    urdf: Urdf,
    chain: Sequence[Joint],
    arm: Sequence[Joint],
    beside: Sequence[Joint],
    flange: str,
    led: Sequence[TelescopicColumn],
) -> tuple[ChainJoint, ...]:
    """The joints from base to flange in this order, then those beside them: bars that are kept, and what is left out.

    chain: as it is used; arm: all joints that are kept
    """
    stated = {joint.name: joint for joint in urdf.joints}
    out = [_of_chain(stated[joint.name], joint, led) for joint in chain]
    names = [joint.name for joint in chain]
    bars = [joint for joint in arm if joint.moves and joint.name not in names]
    out += [
        _row(bar, Fate.KEPT, f"a bar beside the arm, follows {bar.mimic.joint}" if bar.mimic else "") for bar in bars
    ]
    return (*out, *(_row(joint, Fate.DROPPED, _why_dropped(urdf, joint, chain, flange, led)) for joint in beside))


def _row(joint: Joint, fate: Fate, why: str, used: tuple[float, float] | None = None) -> ChainJoint:
    return ChainJoint(
        name=joint.name,
        parent=joint.parent,
        child=joint.child,
        fate=fate,
        why=why,
        slides=slides(joint),
        stated=joint.limits,
        used=used,
    )


def _of_chain(stated: Joint, joint: Joint, led: Sequence[TelescopicColumn]) -> ChainJoint:
    """A joint between base and flange."""
    if not joint.moves:
        return _row(stated, Fate.FIXED, "")
    column = next((c for c in led if c.stage == joint.name), None)
    if column is not None:
        why = f"driven as {column.leader.name} is: {column.multiplier:g} times what the pendant shows"
        return _row(stated, Fate.OVERRULED, why, column.leader.limits)
    if joint.mimic is not None:
        fate = Fate.KEPT if joint.mimic == stated.mimic else Fate.OVERRULED
        return _row(stated, fate, f"no motor: follows {joint.mimic.joint}")
    used = used_limits(joint)
    if joint.kind != "continuous":
        return _row(stated, Fate.KEPT, "beyond four turns: are they degrees?" if many_turns(joint) else "", used)
    if stated.limits is None:
        return _row(stated, Fate.KEPT, "continuous, without limits in the URDF", used)
    if used == stated.limits:
        return _row(stated, Fate.OVERRULED, "continuous, but its limits are narrower than a turn and are kept", used)
    return _row(stated, Fate.OVERRULED, "continuous: its limits are those of no turn", used)


def _why_dropped(urdf: Urdf, joint: Joint, chain: Sequence[Joint], flange: str, led: Sequence[TelescopicColumn]) -> str:
    column = next((c for c in led if c.leader is joint), None)
    if column is not None:
        return f"leads a column and carries nothing of the arm: {column.stage} stands for it"
    fingers = followers(urdf, joint)
    if fingers:
        return f"drives fingers: {', '.join(finger.name for finger in fingers)} follow{'s' * (len(fingers) == 1)} it"
    if joint.mimic is not None and joint.mimic.joint not in [other.name for other in urdf.joints]:
        return f"follows {joint.mimic.joint}, which is no joint of the file: correct its <mimic>"
    if joint.mimic is not None:
        return f"follows {joint.mimic.joint} beside the arm"
    last = [flange, *(j.child for j in chain if j.moves)][-1]
    beyond = joint in (*urdf.below(flange), *urdf.below(last))
    return f"beyond the flange {flange}" if beyond else "does not move the flange"


def followers(urdf: Urdf, joint: Joint) -> list[Joint]:
    """The joints that follow this one from the body on which it stands too: of a finger's drive, the other fingers."""
    here = body_of(urdf, joint.parent)
    beyond = urdf.below(joint.child)
    return [
        other
        for other in urdf.joints
        if other.mimic is not None
        and other.mimic.joint == joint.name
        and other not in beyond
        and body_of(urdf, other.parent) == here
    ]


def body_of(urdf: Urdf, link: str) -> str:
    """The link that carries all that is fixed to one another and to this link."""
    above, seen = urdf.above(), {link}
    while link in above and not above[link].moves and above[link].parent not in seen:
        link = above[link].parent
        seen.add(link)
    return link
