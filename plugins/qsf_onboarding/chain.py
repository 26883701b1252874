"""Which joints of a stranger's URDF are the arm: from the link that stands still to the one that carries the tool."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from enum import StrEnum

import numpy as np

from qsf_onboarding.joints import body_of, followers
from qsframework.errors import InputError, Problem, some_of
from qsframework.plugin import Array
from qsframework.robot.checks import chain_joints
from qsframework.robot.urdf import Joint, Urdf, placement

_SAME = 1e-4
_ASKEW = 0.05
"""Of the cosine of two axes: within 18 degrees of parallel, 3 of square."""
_FLANGES = ("tool0", "flange", "ee_link", "link_ee", "tool_link", "end_effector", "end_effector_link")
"""Names of a link that carries the tool, or ends of such names; the first that is there."""
_GRIPPER = re.compile(r"(^|_|joint)gripper(_?joint)?$|jaw|finger", re.IGNORECASE)
"""Names of a joint that is a gripper's where it is the last: a single jaw is followed by nothing."""
MOST_JOINTS = 30
"""Of an arm that move."""
_TRUNK = 3
"""Joints before a parting that could be an arm which carries a hand."""


def choose_chain(urdf: Urdf, base: str | None, flange: str | None) -> tuple[str, str, list[Joint]]:
    """Base, flange and all joints between them: those asked for, or the only ones there are.

    What slides across or follows beyond the last turning joint, or turns about that joint's own axis, is a gripper's
    and no part of the arm; what slides before it, or along the axis of the joint before, as in a SCARA, is part of it.
    InputError where the file holds no arm or several.
    """
    links, file = [link.name for link in urdf.links], str(urdf.path)
    for key, link in (("base", base), ("flange", flange)):
        if link is not None and link not in links:
            raise InputError(Problem(f"{key}: no link {link!r}", file=file, allowed=", ".join(links)))
    base = base or _root(urdf, links)
    flange = flange or _flange(urdf, base)
    chain = chain_joints(urdf, base, flange)
    if chain is None:
        message = f"link {flange!r} does not hang on {base!r}"
        raise InputError(
            Problem(message, file=file, hint="Choose another base or flange.", argument=("flange", "LINK"))
        )
    _check_kinds(chain)
    moving = [joint for joint in chain if joint.moves]
    if len(moving) > MOST_JOINTS:
        message = f"joint {moving[MOST_JOINTS].name!r} is one too many: {len(moving)} joints move from base to flange"
        hint, argument = "Name the flange of the arm.", ("flange", moving[MOST_JOINTS - 1].child)
        allowed = f"up to {MOST_JOINTS}"
        raise InputError(moving[MOST_JOINTS].place.problem(message, allowed=allowed, hint=hint, argument=argument))
    return base, flange, chain


def _root(urdf: Urdf, links: list[str]) -> str:
    roots = [link for link in links if link not in urdf.above()]
    if len(roots) != 1:
        found = ", ".join(roots) or "none"
        raise InputError(Problem("a URDF has one root link", file=str(urdf.path), found=found, hint="Is it a robot?"))
    return roots[0]


def _turns(joint: Joint) -> bool:
    """A joint with a motor of its own that turns."""
    return joint.kind in ("revolute", "continuous") and joint.mimic is None


def _slides(joint: Joint) -> bool:
    """A joint with a motor of its own that slides."""
    return joint.kind == "prismatic" and joint.mimic is None


def _flange(urdf: Urdf, base: str) -> str:
    """The link that carries the tool: one that is called so, else the last one that moves before a gripper."""
    below, file = urdf.below(base), str(urdf.path)
    own = _turns if any(_turns(j) for j in below) else _slides
    every = [j for j in below if own(j)]
    if not every:
        raise InputError(Problem(f"no joint of an arm moves beyond {base!r}", file=file, hint="It turns or slides."))
    called = _called(urdf, base, every)
    ends = [j for j in every if not any(own(o) for o in urdf.below(j.child))]
    ends = [called] if called is not None else _before_fingers(urdf, base, ends, own)
    if not ends:
        hint = "Give the URDF of the arm, or of the arm with the gripper on it."
        raise InputError(
            every[0].place.problem("the joints that move are those of a gripper; there is no arm before it", hint=hint)
        )
    if len(ends) > 1:
        hint = "Name the flange (and the base if the arm does not start at the root)."
        raise InputError(
            Problem(
                f"{len(ends)} chains hang on {base!r}; say which one is the arm",
                file=file,
                allowed=_offered(urdf, base, ends),
                hint=hint,
                argument=("flange", "LINK"),
            )
        )
    last = ends[0]
    if called is None:
        last = _before_a_spin(chain_joints(urdf, base, ends[0].child) or [], ends[0])
        last = _quill(urdf, last) if last is ends[0] else last
    return min(urdf.fixed_to(last.child), key=_rank)


def _rank(link: str) -> int:
    """Place of a link's name, without what a maker puts before it, among those of a flange."""
    return next((k for k, name in enumerate(_FLANGES) if re.search(rf"(^|[_./-]){name}$", link)), len(_FLANGES))


def _called(urdf: Urdf, base: str, own: list[Joint]) -> Joint | None:
    """The last joint before the one body with a flange's name; what moves beyond it, fewer than before, is a tool's.

    own: the joints with a motor. None where there is no such body, or several beside one another.
    """
    found: dict[str, Joint] = {}
    for name in (j.child for j in urdf.below(base) if j.kind == "fixed" and _rank(j.child) < len(_FLANGES)):
        chain = [j for j in chain_joints(urdf, base, name) or [] if j.moves]
        beyond = [chain_joints(urdf, name, j.child) or [] for j in urdf.below(chain[-1].child)] if chain else []
        before = sum(j in own for j in chain)
        if before and max((sum(j in own for j in path) for path in beyond), default=0) < before:
            found[chain[-1].name] = chain[-1]
    first = [j for j in found.values() if not any(j in urdf.below(o.child) for o in found.values())]
    return first[0] if len(first) == 1 else None


def _before_fingers(urdf: Urdf, base: str, ends: list[Joint], own: Callable[[Joint], bool]) -> list[Joint]:
    """The ends of the chains, without the drives of fingers that follow them."""
    kept: dict[str, Joint] = {}
    for end in ends:
        chain = [j for j in chain_joints(urdf, base, end.child) or [] if own(j)]
        while chain and (_GRIPPER.search(chain[-1].name) or _drives_fingers(urdf, chain[-1])):
            chain.pop()
        if chain:
            kept[chain[-1].name] = chain[-1]
    return [j for j in kept.values() if not any(o in urdf.below(j.child) for o in kept.values())]


def _drives_fingers(urdf: Urdf, end: Joint) -> bool:
    """Whether joints follow the last one of a chain, or one that moves on the same body, as fingers do."""
    here = body_of(urdf, end.parent)
    return any(followers(urdf, joint) for joint in urdf.joints if body_of(urdf, joint.parent) == here)


def _quill(urdf: Urdf, last: Joint) -> Joint:
    """The one joint beyond the last that slides along its axis, as a SCARA's quill does and no finger that another
    follows; else the last itself."""
    beyond = [j for j in urdf.below(last.child) if _slides(j) and not followers(urdf, j)]
    if len(beyond) != 1:
        return last
    along = placement(chain_joints(urdf, last.child, beyond[0].child) or [])[:3, :3] @ beyond[0].axis
    size = np.linalg.norm(along) * np.linalg.norm(last.axis)
    return beyond[0] if size > 0.0 and np.linalg.norm(np.cross(last.axis, along)) < _SAME * size else last


def _before_a_spin(chain: list[Joint], last: Joint) -> Joint:
    """The last joint, or the one before it where both turn about one axis: then the last is a gripper's, and no
    force could tell the two apart."""
    turning = [j for j in chain if _turns(j)]
    if len(turning) < 2 or last is not turning[-1]:
        return last
    before = turning[-2]
    place = placement(chain[chain.index(before) + 1 :])
    axis = before.axis / np.linalg.norm(before.axis)
    other = place[:3, :3] @ (last.axis / np.linalg.norm(last.axis))
    apart = np.linalg.norm(np.cross(axis, place[:3, 3])) + np.linalg.norm(np.cross(axis, other))
    return before if apart < _SAME else last


def _offered(urdf: Urdf, base: str, ends: list[Joint]) -> str:
    """The links where chains end, and before them those where an arm parts into a hand."""
    paths = [[j.child for j in chain_joints(urdf, base, end.child) or [] if _turns(j)] for end in ends]
    through = Counter(link for path in paths for link in path[:-1])
    parting: dict[str, str] = {}
    for path in paths:
        for k, link in enumerate(path[:-1]):
            if k + 1 >= _TRUNK and through[link] > 1 and through[link] > through.get(path[k + 1], 1):
                parting[link] = f"{link} ({k + 1} joints, then {through[link]} chains)"
                break
    hands = {path[-1] for path in paths if any(link in parting for link in path)}
    single = [f"{p[-1]} ({len(p)} joint{'s' * (len(p) > 1)})" for p in paths if p[-1] not in hands]
    listed = [*parting.values(), *sorted(single, key=lambda text: -int(text.split("(")[-1].split()[0]))]
    return some_of(listed)


class Build(StrEnum):
    """How an arm is built, as far as that says which loops and balancers it can have."""

    ELBOW = "elbow"
    PALLETIZER = "palletizer"
    OTHER = "other"


def build_of(moving: list[Joint], chain: list[Joint]) -> tuple[Build, tuple[float, ...]]:
    """The build of an arm, and with it the senses (+1 or -1) of its parallel axes against the second.

    A turret, two parallel axes across it, then a wrist of other axes: so are the heavy arms, which alone can have a
    parallelogram or a balancer at link 2, or a pendant that shows the forearm's elevation. A third parallel axis and
    then one along the turret's: so are palletizers, whose head no motor keeps level. Other arms with three parallel
    axes, or with more than six motors, have none of these.
    moving: the joints with a motor
    """
    turning = [joint for joint in moving if _turns(joint)]
    if not 3 <= len(turning) <= 6:
        return Build.OTHER, ()
    turn, axes = np.eye(3), dict[str, Array]()
    for joint in chain:
        turn = turn @ joint.origin.matrix()[:3, :3]
        if joint.moves:
            axes[joint.name] = turn @ (joint.axis / np.linalg.norm(joint.axis))
    first, second, third, *rest = (axes[joint.name] for joint in turning)
    senses = [float(np.sign(second @ axis)) for axis in (second, third, *rest[:1])]
    along = [abs(second @ axis) > 1.0 - _ASKEW for axis in (third, *rest[:1])]
    if abs(first @ second) >= _ASKEW or not along[0]:
        return Build.OTHER, ()
    if not any(along[1:]):
        return Build.ELBOW, tuple(senses[:2])
    level = len(turning) == 5 and abs(first @ rest[1]) > 1.0 - _ASKEW
    return (Build.PALLETIZER, tuple(senses)) if level else (Build.OTHER, ())


def _check_kinds(chain: list[Joint]) -> None:
    """InputError where a joint floats, or slides as another does and is neither a column's stage nor led by the arm."""
    for joint in reversed(chain):
        rest = chain[chain.index(joint) + 1 :]
        led = joint.mimic is not None and joint.mimic.joint in [j.name for j in chain]
        stage = joint.kind == "prismatic" and (led or any(_turns(j) or _slides(j) for j in rest))
        if joint.moves and joint.kind not in ("revolute", "continuous") and not (_slides(joint) or stage):
            at = chain.index(joint)
            before, beyond = (sum(map(_turns, part)) for part in (chain[:at], chain[at + 1 :]))
            message = f"joint {joint.name!r}: a {joint.kind} joint cannot be part of the arm"
            if before and beyond:
                hint = f'Make it type="fixed" where it stands in the campaign: {before + beyond} joints then turn.'
                raise InputError(joint.place.problem(message, hint=hint))
            end = ("base", joint.child) if beyond else ("flange", joint.parent)
            where = "Lock it and begin the arm beyond it" if beyond else "End the arm before it"
            raise InputError(joint.place.problem(message, hint=f"{where}: {end[0]} {end[1]}.", argument=end))
