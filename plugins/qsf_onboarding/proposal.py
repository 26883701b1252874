"""A robot's folder proposed from a URDF: what the file tells, what is assumed, and what it cannot tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from qsf_onboarding.balancer import Balancer, find_balancer
from qsf_onboarding.chain import Build, build_of, choose_chain
from qsf_onboarding.closed_loop import closed_loops
from qsf_onboarding.joints import (
    ChainJoint,
    TelescopicColumn,
    columns,
    endless,
    many_turns,
    slides,
    told_joints,
    used_limits,
)
from qsf_onboarding.masses import mass_of, moving_mass, with_bodies, with_masses
from qsf_onboarding.meshes import with_meshes
from qsf_onboarding.reach import reaches
from qsf_onboarding.text import (
    ControllerRow,
    NominalRow,
    loops_text,
    nominal_text,
    readme_text,
    robot_text,
)
from qsf_onboarding.unread import unread_of
from qsf_onboarding.zeros import first_bearing, zero_notes
from qsframework.errors import InputError, refuse, some_of
from qsframework.robot.checks import check_chain, check_structure, check_tree
from qsframework.robot.model import plain_urdf
from qsframework.robot.packages import Sources
from qsframework.robot.urdf import Joint, Link, MeshVisual, Mimic, Urdf, Visual, read_urdf
from qsframework.robot.xml_tree import quoted
from qsframework.units import SLIDES, TURNS

_TWIST = 7e-3  # rad: joints 1 and 2 of the shipped arms would turn by 4 to 9 mrad if all that moves hung at full reach
_SMALLEST = 6e3  # N m/rad, of the smallest strain-wave gears that arms have
_ELBOW, _WRIST = 0.6, {True: (0.11, 0.11, 0.08), False: (0.17, 0.17, 0.17)}
"""Stiffness over that of joints 1 and 2: of the further ones that place the wrist, and of the wrist's three, in an arm
that is built as industrial ones are and in another."""
_SHORTEST = 0.05  # m
_SLIDE, _WHY_SLIDE = 5e7, "50 kN/mm, a rack and pinion with its gear"


@dataclass(frozen=True)
class Proposal:
    """Files by name, the checklist (what to look up, because a URDF does not say it) and the fate of each joint."""

    files: dict[str, str]
    checklist: tuple[str, ...]
    chain: tuple[ChainJoint, ...] = ()


def propose(
    name: str,
    urdf: Path | Urdf,
    base: str | None = None,
    flange: str | None = None,
    sources: Sources | None = None,
    payload: float | None = None,
    bearing: float | None = None,
) -> Proposal:
    """The files of a new robot from a URDF or xacro, or what was read of one. InputError if it is no arm, or several.

    sources: where a xacro's packages are and what its arguments say; payload: kg, from the manual; bearing:
    m, the height of the first one, where it is stated
    """
    sources = sources or Sources(nearby=True)
    source = urdf if isinstance(urdf, Urdf) else read_urdf(urdf, urdf.parent, sources)
    refuse(source.unreadable or closed_loops(source) or check_tree(source))
    base, flange, stated = choose_chain(source, base, flange)
    chain, led = columns(source, stated)
    every = [joint for joint in chain if joint.moves]
    refuse(endless([joint for joint in every if joint.mimic is None]))
    arm, dropped = _arm(source, base, chain)
    bars = [joint for joint in arm.joints if joint.moves and joint.name not in _names(every)]
    following = {**_following(every), **_following(bars, every)}
    lost = sum(mass_of(source, joint.child) for joint in dropped)
    moving = [joint for joint in every if joint.mimic is None]
    build, senses = build_of(moving, chain)
    heavy = build is not Build.OTHER
    far = reaches(chain, {joint: mimic for joint, mimic in following.items() if joint in _names(chain)})
    reach = max(far[1] if far else sum(float(np.linalg.norm(joint.origin.xyz)) for joint in chain), _SHORTEST)
    arm, impossible = with_bodies(arm)
    arm, guessed = with_masses(arm, chain, base, moving_mass(payload, reach, heavy))
    refuse(check_structure(arm))
    refuse(check_chain(arm, base, flange))
    arm, meshes, unread = with_meshes(arm, sources)
    stiffness = [row for row in _stiffness(arm, every, reach, _WRIST[heavy]) if row[0] not in following]
    balancer = find_balancer(source, base, chain)
    bearings, asked = first_bearing(chain, bearing)
    notes = (
        *_checklist(moving, payload, build, senses, balancer),
        *_size(every, far),
        *(zero_notes(chain) if source.tree is None else ()),
        *asked,
        *_told_following(following, led),
        *_found(arm, every, moving, guessed, impossible, heavy),
        *unread,
        *_left_out(dropped, lost),
        *(f"file: {note}" for note in (*source.notes, *(unread_of(source.tree) if source.tree else ()))),
    )
    files = {
        f"{name}.urdf": _urdf_text(arm, name, base, bool(guessed)),
        "robot.yaml": robot_text(
            name,
            source.path.name,
            base,
            flange,
            _rows(moving, led, bearings),
            payload,
            following,
            loops_text(build, senses, moving, balancer),
        ),
        "nominal.yaml": nominal_text(stiffness),
        "README.md": readme_text(name, source.path.name, guessed, stiffness[-1][3], notes),
        **meshes,
    }
    return Proposal(files, notes, told_joints(source, chain, arm.joints, dropped, flange, led))


def _arm(urdf: Urdf, base: str, chain: list[Joint]) -> tuple[Urdf, list[Joint]]:
    """The chain, what is fixed to it and bars that follow its joints; and the moving joints that were left out."""
    names, turning, used = {base}, _names(chain), {joint.name: joint for joint in chain}
    joints: list[Joint] = []
    dropped: list[Joint] = []
    for joint in urdf.below(base):
        if joint.parent in names and _is_bar(urdf, joint, turning):
            names.add(joint.child)
            turning.append(joint.name)
            joints.append(replace(joint, limits=None, kind="continuous"))
        elif joint.parent in names and (joint.name in used or not joint.moves):
            joint = used.get(joint.name, joint)
            names.add(joint.child)
            joints.append(replace(joint, limits=None) if joint.kind == "continuous" else joint)
        elif joint.moves:
            dropped.append(joint)
    links = tuple(link for link in urdf.links if link.name in names)
    return replace(urdf, links=links, joints=tuple(joints)), dropped


def _names(joints: Sequence[Joint]) -> list[str]:
    return [joint.name for joint in joints]


def _is_bar(urdf: Urdf, joint: Joint, turning: Sequence[str]) -> bool:
    """Whether a joint beside the arm follows one of it and carries a mass."""
    follows = joint.mimic is not None and joint.mimic.joint in turning and joint.name not in turning
    return follows and joint.kind in ("revolute", "continuous") and mass_of(urdf, joint.child) > 0.0


def _following(moving: Sequence[Joint], before: Sequence[Joint] = ()) -> dict[str, Mimic]:
    """The joints that follow others. InputError where one follows a joint that is no part of the arm."""
    names = _names([*before, *moving])
    for joint in moving:
        if joint.mimic is not None and joint.mimic.joint not in names:
            message = f"joint {joint.name!r} follows {joint.mimic.joint!r}, which is no part of the arm"
            hint = f"End the arm before it: flange {joint.parent}."
            raise InputError(joint.place.problem(message, hint=hint, argument=("flange", joint.parent)))
    return {joint.name: joint.mimic for joint in moving if joint.mimic is not None}


def _told_following(following: dict[str, Mimic], led: Sequence[TelescopicColumn]) -> tuple[str, ...]:
    told = ", ".join(f"{joint} follows {m.joint}" for joint, m in following.items())
    notes = [f"couplings: by mimic {told}; is it so on the machine, or has the joint a motor of its own?"]
    columns = [f"column: the pendant's {c.stage} is the travel of {c.leader.name}; its stages share it" for c in led]
    return (*notes[: bool(following)], *columns)


def _stiffness(urdf: Urdf, moving: list[Joint], reach: float, wrist: Sequence[float]) -> list[NominalRow]:
    """Assumed for each joint, N m/rad, from what turns and how far it reaches (m); N/m for one that slides."""
    turning = [joint for joint in moving if not slides(joint)]
    mass = sum(mass_of(urdf, joint.child) for joint in (moving[moving.index(turning[0]) :] if turning else ()))
    weight = f"what turns, {float(f'{mass:.3g}'):g} kg, at its reach of {reach:.2g} m"
    why = f"{1e3 * _TWIST:g} mrad under {weight}; less at the wrist"
    placing = max(len(turning) - 3, min(len(turning), 3))
    shares = iter((*(1.0 if k < 2 else _ELBOW for k in range(placing)), *wrist[3 + placing - len(turning) :]))
    return [
        (j.name, True, _SLIDE, _WHY_SLIDE)
        if slides(j)
        else (j.name, False, max(9.81 * mass * reach / _TWIST * next(shares), _SMALLEST), why)
        for j in moving
    ]


def _rows(moving: list[Joint], led: Sequence[TelescopicColumn], bearings: Mapping[str, float]) -> list[ControllerRow]:
    """The entries of `controller:`, in the unit in which people read each joint; bearings: m along a joint's axis."""
    rows: list[ControllerRow] = []
    for k, joint in enumerate(moving, start=1):
        unit = SLIDES if slides(joint) else TURNS
        column = next((c for c in led if c.stage == joint.name), None)
        lower, upper = used_limits(joint if column is None else column.leader)
        more = "" if column is None else f", equals: {column.multiplier:g} J{k}"
        more += f", bearing_mm: {1e3 * bearings[joint.name]:.6g}" if joint.name in bearings else ""
        rows.append((joint.name, unit.shown, round(lower * unit.per, 3), round(upper * unit.per, 3), more))
    return rows


def _third_angle(moving: list[Joint], senses: tuple[float, ...]) -> str:
    """How to tell what the pendant shows of the elbow, and what to write where it is the elevation."""
    second, third = [k for k, joint in enumerate(moving, start=1) if not slides(joint)][1:3]
    sign, alike = ("-", "alike") if senses[1] > 0.0 else ("+", "in opposite ways")
    return (
        f"controller: turn J{second} alone by 20 deg. Where the forearm turns along, the pendant's J{third} is "
        "relative and nothing is to do. Where it keeps its attitude (FANUC, ABB with a parallelogram), "
        f"J{third} is its elevation: write equals: J{third} {sign} J{second} for {moving[third - 1].name}, "
        f"whose axis and that of {moving[second - 1].name} point {alike} in the URDF"
    )


def _checklist(
    moving: list[Joint],
    payload: float | None,
    build: Build,
    senses: tuple[float, ...],
    balancer: Balancer | None,
) -> tuple[str, ...]:
    """What a URDF cannot tell."""
    torques = "torque_limit_Nm per joint where the maker states them"
    springs = "springs: a balancer or counterweight? Pivots and spring: see the comment in robot.yaml"
    if balancer is not None:
        ends = " and ".join(balancer.drawn)
        springs = f"springs: {ends} are the pivots of a balancer; its stiffness and free length are not in the URDF: "
        springs += "add both to nominal.yaml; qsf check names them"
    loops = "loops: a parallelogram or other coupling bar? Lever length and margin: see the comment in robot.yaml"
    if build is Build.PALLETIZER:
        level = [joint.name for joint in moving if not slides(joint)][3]
        loops = f"loops: a palletizer has no motor at {level}: bars keep its head level, and most have one more loop "
        loops += "that drives the elbow from the turret; see the two comments in robot.yaml"
    return (
        *((_third_angle(moving, senses), loops) if build is not Build.OTHER else ()),
        *((springs,) if build is not Build.OTHER or balancer is not None else ()),
        "limits: a maker's limits hold for what the pendant shows; compare them with the manual",
        "compliances: all are assumed; replace them where the maker or a paper states some",
        f"payload: add payload_kg, and {torques}" if payload is None else f"payload: add {torques}",
    )


def _size(moving: list[Joint], far: tuple[float, float] | None) -> tuple[str, ...]:
    """How large the arm is, to compare with the manual. far: as `reaches` says"""
    if far is None:
        return ()
    said = f"the flange comes {far[1]:.3g} m from the first axis"
    said += f", the origin of {moving[-2].name} {far[0]:.3g} m" if far[0] > _SHORTEST else ""
    return (f"size: within these limits {said}; does the manual's reach agree?",)


def _found(
    urdf: Urdf,
    moving: list[Joint],
    every: list[Joint],
    guessed: tuple[str, ...],
    impossible: tuple[str, ...],
    heavy: bool,
) -> tuple[str, ...]:
    """What looks odd in this URDF, or is missing."""
    total, notes = sum(mass_of(urdf, j.child) for j in moving), list[str]()
    if guessed:
        which = "all moving links have assumed ones" if len(guessed) == len(moving) else "there they are assumed"
        which += ", as of castings; a lightweight arm has a third" if heavy and len(guessed) == len(moving) else ""
        notes.append(f"masses: {_file(urdf)} has none for {', '.join(guessed)}; {which}")
    else:
        notes.append(f"masses: all that moves weighs {total:.3g} kg in the URDF; can that be, by the manual?")
    if impossible:
        notes.append(
            f"inertias: no body has those of {', '.join(impossible)} in the URDF; balls of the same mass stand in, "
            "which changes nothing here, for an arm at rest has no use for them"
        )
    turning = [j for j in every if j.kind == "continuous"]
    if unlimited := [j.name for j in turning if j.limits is None]:
        notes.append(f"limits: -360..360 deg are assumed for {', '.join(unlimited)}, without limits in {_file(urdf)}")
    if kept := [j.name for j in turning if j.limits is not None and used_limits(j) == j.limits]:
        notes.append(f"limits: {', '.join(kept)} are continuous in {_file(urdf)}, and the limits stated there are kept")
    if lost := [j.name for j in turning if j.limits is not None and used_limits(j) != j.limits]:
        notes.append(
            f"limits: -360..360 deg are assumed for {', '.join(lost)}, whose stated limits are those of no turn"
        )
    if far := [j.name for j in every if many_turns(j)]:
        notes.append(
            f"limits: {', '.join(far)} would turn more than four times either way: angles of a URDF are in rad. "
            "Where degrees are meant, correct them there, and run qsf new again"
        )
    links = {j.child: map(urdf.link, urdf.fixed_to(j.child)) for j in moving}
    if bare := [child for child, own in links.items() if not any(o.visuals or o.meshes or o.collisions for o in own)]:
        notes.append(
            f"solids: no box, cylinder, sphere or mesh of {', '.join(bare)} in {_file(urdf)}: these links are not "
            "checked for collisions and hide nothing from the tracker"
        )
    return tuple(notes)


def _file(urdf: Urdf) -> str:
    return "the URDF" if urdf.tree else "the table"


def _left_out(dropped: list[Joint], lost: float) -> tuple[str, ...]:
    """The joints beside the arm, and what they carry, kg."""
    if not dropped:
        return ()
    names = some_of([j.name for j in dropped], 6)
    weight = f"; what they carry, {lost:.3g} kg with all that is fixed to it, is omitted too" if lost > 0 else ""
    return (f"omitted, as they do not move the flange: {names}{weight}. Bars of a loop are an effect",)


def _urdf_text(urdf: Urdf, name: str, base: str, guessed: bool) -> str:
    """One plain URDF: numbers in full, simple solids, and the meshes that the new robot keeps."""
    text = plain_urdf(urdf, base).replace('<robot name="robot">', f"<robot name={quoted(name)}>", 1)
    for link in urdf.links:
        text = text.replace(f"<link name={quoted(link.name)}>", _head(link), 1)
    told = "Masses are assumed, see README.md." if guessed else ""
    return f'<?xml version="1.0"?>\n<!-- Made by qsf new from {urdf.path.name}. {told} -->\n' + text


def _head(link: Link) -> str:
    drawn = "".join(_solid(solid, "visual") for solid in (*link.visuals, *link.meshes))
    return f"<link name={quoted(link.name)}>{drawn}" + "".join(_solid(s, "collision") for s in link.collisions)


def _solid(solid: Visual | MeshVisual, tag: str) -> str:
    def row(values: object) -> str:
        return " ".join(f"{float(v):.9g}" for v in np.atleast_1d(np.asarray(values, dtype=float)))

    if isinstance(solid, MeshVisual):
        size = f"<mesh filename={quoted(solid.name)}/>"
    else:
        size = {
            "box": f'<box size="{row(solid.size)}"/>',
            "sphere": f'<sphere radius="{solid.size[0]:.9g}"/>',
            "cylinder": f'<cylinder radius="{solid.size[0]:.9g}" length="{solid.size[-1]:.9g}"/>',
        }[solid.kind]
    colour = f'<material name=""><color rgba="{row(solid.rgba)}"/></material>' if tag == "visual" else ""
    return (
        f'<{tag}><origin xyz="{row(solid.origin.xyz)}" rpy="{row(solid.origin.rpy)}"/>'
        f"<geometry>{size}</geometry>{colour}</{tag}>"
    )
