"""The structure of a URDF, checked here because no library does.

Pinocchio and others accept negative masses, impossible inertias and unknown mimic targets, and
double a link that has two parents.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from qsframework.errors import Problem, nearest
from qsframework.robot.urdf import JOINT_TYPES, Joint, Link, Urdf

_SUPPORTED = ("revolute", "continuous", "prismatic", "fixed")
_FARTHEST = 20.0
"""Of a link's centre of mass from its frame, m: four times the reach of the largest arms."""


def check_structure(urdf: Urdf) -> list[Problem]:
    """Everything wrong in a URDF, with file and line. An arm of which no link has a mass may be without."""
    empty = weightless(urdf)
    moved = {joint.child: joint for joint in urdf.joints if joint.moves and not empty}
    problems = [*check_tree(urdf), *_roots(urdf)]
    for link in urdf.links:
        problems += _mass(urdf, link, link.name in moved)
    for joint in urdf.joints:
        problems += _joint(urdf, joint)
    return problems


def check_tree(urdf: Urdf) -> list[Problem]:
    """What keeps links and joints from being a tree whose every part has a name of its own, with file and line."""
    return [*urdf.unreadable, *_names(urdf), *_ends(urdf), *two_parents(urdf), *_circles(urdf)]


def weightless(urdf: Urdf) -> bool:
    """Whether the file states no mass at all, not even a wrong one."""
    return all(link.inertial is None or link.inertial.mass == 0.0 for link in urdf.links)


def check_chain(urdf: Urdf, base: str, flange: str) -> list[Problem]:
    """What keeps the joints from base to flange from being a serial arm, and those beside it from being branches.

    The structure must be sound.
    """
    chain = chain_joints(urdf, base, flange)
    if chain is None:
        return [urdf.link(flange).place.problem(f"link {flange!r} does not hang on the base {base!r}")]
    problems: list[Problem] = []
    for joint in urdf.below(base):
        if joint.kind not in _SUPPORTED:
            hint = "An arm's joints are revolute, continuous or prismatic; fix the others."
            problems.append(
                joint.place.problem(f"joint {joint.name!r}: a {joint.kind} joint is not supported yet", hint=hint)
            )
        elif joint.kind == "prismatic" and joint not in chain:
            hint = 'Make it type="fixed", at the place where it stands in the campaign.'
            problems.append(
                joint.place.problem(f"joint {joint.name!r} slides beside the arm: only turns do", hint=hint)
            )
    if not any(joint.moves for joint in chain):
        problems.append(urdf.link(flange).place.problem(f"no joint moves between {base!r} and {flange!r}"))
    return problems


def chain_joints(urdf: Urdf, base: str, flange: str) -> list[Joint] | None:
    """All joints from base to flange in this order, None if the flange does not hang on the base."""
    above, link = urdf.above(), flange
    chain: list[Joint] = []
    while link != base:
        if link not in above:
            return None
        chain.append(above[link])
        link = above[link].parent
    return chain[::-1]


def without_branches(urdf: Urdf, base: str, flange: str) -> Urdf:
    """The URDF without the links that move beside the arm."""
    chain = chain_joints(urdf, base, flange) or []
    branches = [joint for joint in urdf.below(base) if joint.moves and joint not in chain]
    gone = [joint for top in branches for joint in (top, *urdf.below(top.child))]
    links = {joint.child for joint in gone}
    return replace(
        urdf,
        links=tuple(link for link in urdf.links if link.name not in links),
        joints=tuple(joint for joint in urdf.joints if joint not in gone),
    )


def _names(urdf: Urdf) -> Iterator[Problem]:
    for kind, items in (("link", urdf.links), ("joint", urdf.joints)):
        first: dict[str, Link | Joint] = {}
        for item in items:
            if not item.name:
                yield item.place.problem(f"a {kind} has no name")
            elif item.name in first:
                where = first[item.name].place
                yield item.place.problem(f"{kind} {item.name!r} stands here again; it is also at {where}")
            first.setdefault(item.name, item)
    if not urdf.links:
        hint = "A xacro that only defines macros draws nothing: give the file that calls them."
        yield Problem("holds no link", file=str(urdf.path), hint=hint)


def _ends(urdf: Urdf) -> Iterator[Problem]:
    names = [link.name for link in urdf.links]
    for joint in urdf.joints:
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if not link:
                yield joint.place.problem(f"joint {joint.name!r} has no {end} link")
            elif link not in names:
                message = f"joint {joint.name!r}: unknown {end} link {link!r}"
                yield joint.place.problem(message, allowed=", ".join(names), hint=nearest(link, names))


def two_parents(urdf: Urdf, advice: Callable[[Joint, Joint], str] | None = None) -> list[Problem]:
    """Every link with two parents. advice: what to do, by the two joints that carry it"""
    first = {joint.child: joint for joint in reversed(urdf.joints)}
    loop = "A closed loop is an effect in robot.yaml, such as parallelogram; the URDF is a tree."
    return [
        joint.place.problem(
            f"link {joint.child!r} has two parents: joint {one.name!r} ({one.place}) and joint {joint.name!r}",
            hint=advice(one, joint) if advice else loop,
        )
        for joint in urdf.joints
        if joint.child and (one := first[joint.child]).name != joint.name
    ]


def _roots(urdf: Urdf) -> Iterator[Problem]:
    names = {link.name for link in urdf.links}
    if any(end not in names for joint in urdf.joints for end in (joint.parent, joint.child)):
        return  # a misspelt link would show here a second time
    above = urdf.above()
    roots = [link for link in urdf.links if link.name not in above]
    for extra in roots[1:]:
        message = f"link {extra.name!r} hangs on nothing; the root is {roots[0].name!r} ({roots[0].place})"
        yield extra.place.problem(message, hint="A URDF has one root. Connect it by a joint.")


def _circles(urdf: Urdf) -> Iterator[Problem]:
    above, tried = urdf.above(), set[str]()
    for joint in urdf.joints:
        way, link = list[str](), joint.child
        while link in above and link not in tried:
            tried.add(link)
            way.append(link)
            link = above[link].parent
        if link in way:
            circle = way[way.index(link) :]
            yield above[circle[0]].place.problem("joints run in a circle: " + " -> ".join([*circle[::-1], circle[-1]]))


def _mass(urdf: Urdf, link: Link, moving: bool) -> Iterator[Problem]:
    inertial, owner = link.inertial, f"link {link.name!r}"
    if inertial is None:
        fixed = urdf.fixed_to(link.name)[1:] if moving else []  # a mass there counts for both
        if moving and not any(o.inertial is not None and o.inertial.mass > 0 for o in urdf.links if o.name in fixed):
            yield link.place.problem(f"{owner} moves but has no <inertial>", hint="It needs mass, centre and inertia.")
        return
    if inertial.mass < 0 or (inertial.mass == 0 and moving):
        what = "a moving link needs a positive mass" if moving else "a mass cannot be negative"
        yield inertial.mass_place.problem(f"{owner}: {what}", found=f"{inertial.mass:g} kg")
    away = float(np.linalg.norm(inertial.origin.xyz))
    if away > _FARTHEST:
        yield inertial.mass_place.problem(
            f"{owner}: the centre of mass is {away:g} m from the link's frame",
            allowed=f"at most {_FARTHEST:g} m",
            hint="A URDF is in metres.",
        )
    if not np.isfinite(inertial.inertia).all() or (inertial.mass == 0 and not inertial.inertia.any()):
        return
    moments = np.linalg.eigvalsh(inertial.inertia)
    found = "principal moments " + ", ".join(f"{m:.6g}" for m in moments) + " kg m2"
    if moments[0] <= 0:
        yield inertial.inertia_place.problem(f"{owner}: the inertia is not positive definite", found=found)
    elif moments[2] > (moments[0] + moments[1]) * (1 + 1e-9):
        yield inertial.inertia_place.problem(
            f"{owner}: no body has this inertia, one moment exceeds the sum of the other two (triangle inequality)",
            found=found,
        )


def _joint(urdf: Urdf, joint: Joint) -> Iterator[Problem]:
    owner = f"joint {joint.name!r}"
    if joint.kind not in JOINT_TYPES:
        hint = nearest(joint.kind, JOINT_TYPES)
        yield joint.place.problem(
            f"{owner}: unknown type", found=repr(joint.kind), allowed=", ".join(JOINT_TYPES), hint=hint
        )
    if joint.kind in ("revolute", "prismatic"):
        if joint.limits is None:
            yield joint.place.problem(f"{owner} has no limits", hint='Add <limit lower=".." upper=".."/>.')
        elif joint.limits[0] >= joint.limits[1]:
            found = f"{joint.limits[0]:g} .. {joint.limits[1]:g}"
            same = joint.limits[0] == joint.limits[1]
            still = 'A joint that does not move is one of type="fixed"; else state how far it turns.'
            hint = still if same else "Exchange the two, or correct the one that is wrong."
            yield joint.place.problem(f"{owner}: the lower limit must be below the upper", found=found, hint=hint)
    if joint.moves and np.isfinite(joint.axis).all() and np.linalg.norm(joint.axis) < 1e-9:
        yield joint.place.problem(f"{owner}: the axis has no direction", found="0 0 0")
    if joint.mimic is None or not joint.moves:
        return
    names, other = [other.name for other in urdf.joints if other is not joint], joint.mimic.joint
    if other not in names:
        yield joint.place.problem(f"{owner} mimics the unknown joint {other!r}", hint=nearest(other, names))
