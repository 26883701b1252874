"""The structures that a robot may really have, beside the one that its file describes.

A file may leave out a loop or claim one, take an elevation for the angle between two links, or describe a balancer or
a coupling that this arm does not have. Each alternative is a whole robot: it is simulated and fitted as any other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TypeVar

import numpy as np

from qsframework.errors import InputError
from qsframework.plugin import Bar, Branch, Effect, Loop, ParallelSpring, RobotFacts, Spring, registry
from qsframework.plugin.facts import frozen
from qsframework.plugin.loops import loop_problems, own_joints
from qsframework.robot.controller import Controller
from qsframework.robot.robot import MeshShape, Robot, Shape

K = TypeVar("K", bound=Effect)
S = TypeVar("S", Shape, MeshShape)
_SMALL = 1e-9


class StructuralChange(StrEnum):
    """What an alternative changes."""

    LOOP_ABSENT = "loop absent"
    LOOP_PRESENT = "loop present"
    COUPLING_ABSENT = "coupling absent"
    BALANCER_ABSENT = "balancer absent"
    ANGLE_RELATIVE = "angle relative"
    ANGLE_ABSOLUTE = "angle absolute"


@dataclass(frozen=True, eq=False)
class Alternative:
    """A robot of another structure.

    kind: what changes; subjects: the effects that are left out or added, or the joint whose angle counts otherwise
    """

    kind: StructuralChange
    subjects: tuple[str, ...]
    robot: Robot

    @property
    def id(self) -> str:
        """A name of its own among the alternatives of one robot, such as `loop absent: parallelogram[joint_3]`."""
        return f"{self.kind}: {' + '.join(self.subjects)}"


def alternatives(robot: Robot) -> tuple[Alternative, ...]:
    """All structural alternatives of a robot, one change each."""
    return (*_loops_absent(robot), *_loops_present(robot), *_balancers_absent(robot), *_angles(robot))


def _loops_absent(robot: Robot) -> Iterator[Alternative]:
    """Without a loop or coupling, where every joint that it turns has an actuator to turn it instead."""
    for loop in _of(robot, Loop):
        arm = [joint for joint in own_joints(loop, robot.facts) if joint in robot.facts.joints]
        if arm and not set(arm) & set(robot.facts.passive):
            kind = StructuralChange.LOOP_ABSENT if loop.parameters(robot.facts) else StructuralChange.COUPLING_ABSENT
            yield Alternative(kind, (loop.name,), without(robot, (loop,)))


def _loops_present(robot: Robot) -> Iterator[Alternative]:
    """With a loop that an effect knows for arms of this kind, where no loop turns its joints yet."""
    loops = _of(robot, Loop)
    for kind in registry().values():
        for effect in kind.structures(robot.facts):
            turned = {joint for loop in loops for joint in own_joints(loop, robot.facts)}
            if not isinstance(effect, Loop) or turned & set(own_joints(effect, robot.facts)):
                continue
            if any(robot.facts.slides(joint) for joint in effect.joints(robot.facts)):
                continue
            if not loop_problems((*loops, effect), robot.facts):
                yield Alternative(StructuralChange.LOOP_PRESENT, (effect.name,), with_effect(robot, effect))


def _balancers_absent(robot: Robot) -> Iterator[Alternative]:
    """Without a balancer: effects between the same two pivots are one, and those of its joint without pivots go too."""
    springs = _of(robot, ParallelSpring)
    drawn = {spring.name: _pivots(spring, robot.facts) for spring in springs}
    for place in dict.fromkeys(drawn.values()):
        mine = [s for s in springs if drawn[s.name] == place]
        joints = {s.joints(robot.facts) for s in mine}
        if place is None and any(s.joints(robot.facts) in joints for s in springs if drawn[s.name] is not None):
            continue
        beside = [s for s in springs if drawn[s.name] is None and s.joints(robot.facts) in joints and s not in mine]
        gone = (*mine, *beside)
        yield Alternative(StructuralChange.BALANCER_ABSENT, tuple(s.name for s in gone), without(robot, gone))


def _angles(robot: Robot) -> Iterator[Alternative]:
    """A joint shown as an elevation where the file says relative to the link before it, or the reverse.

    At the pendant's zero both are alike.
    """
    facts, shown = robot.facts, robot.controller
    for own, before in zip(shown.driven[1:], shown.driven[:-1], strict=True):
        sense = _sense(facts, before, own)
        if sense == 0.0:
            continue
        matrix, column = np.array(shown.matrix), shown.driven.index(before)
        rate = matrix[own, column] / matrix[before, column] if matrix[before, column] else np.nan
        if abs(rate) < _SMALL:
            kind, change = StructuralChange.ANGLE_ABSOLUTE, -sense
        elif abs(rate + sense) < _SMALL:
            kind, change = StructuralChange.ANGLE_RELATIVE, sense
        else:
            continue
        matrix += change * shown.following[:, [shown.driven.index(own)]] * matrix[before]
        controller = replace(shown, matrix=frozen(matrix))
        yield Alternative(
            kind, (facts.joints[own],), replace(robot, controller=controller, facts=_within(facts, controller))
        )


def _within(facts: RobotFacts, controller: Controller) -> RobotFacts:
    """With the joint angles that a controller can command."""
    driven, ranges = list(controller.driven), controller.ranges()
    limits = ranges.copy() if facts.limits is None else np.array(facts.limits)
    limits[driven] = ranges[driven]
    return replace(facts, limits=frozen(limits))


def _sense(facts: RobotFacts, first: int, second: int) -> float:
    """+1 or -1 where two joints' axes are parallel whatever the angles between them, and apart; else 0."""
    if second != first + 1:
        return 0.0
    between = facts.placements[second]
    cosine = float(facts.axes[first] @ between[:3, :3] @ facts.axes[second])
    apart = np.linalg.norm(np.cross(facts.axes[first], between[:3, 3]))
    return float(np.sign(cosine)) if abs(abs(cosine) - 1.0) < 1e-6 and apart > 1e-6 else 0.0


def with_effect(robot: Robot, effect: Effect) -> Robot:
    """The robot with one more effect, at its nominal values."""
    effects = sorted((*robot.effects, effect), key=lambda e: (e.stage, e.order))
    return replace(robot, effects=tuple(effects), parameters=(*robot.parameters, *effect.parameters(robot.facts)))


def without(robot: Robot, gone: Sequence[Effect]) -> Robot:
    """The robot without some effects, and without the branches and effects that cannot be without these."""
    effects = tuple(e for e in robot.effects if e not in gone)
    facts, before = robot.facts, len(effects) + 1
    while len(effects) < before:
        turned = {joint for e in effects if isinstance(e, Loop) for joint in e.joints(facts)}
        facts, before = replace(facts, branches=_hanging(facts, turned)), len(effects)
        effects = tuple(e for e in effects if stands(e, effects, facts))
    names = {p.name for e in effects for p in e.parameters(facts)}
    return replace(
        robot,
        facts=facts,
        effects=effects,
        parameters=tuple(p for p in robot.parameters if p.name in names),
        branch_shapes=_moved(robot.branch_shapes, robot.facts, facts),
        meshes=_moved(robot.meshes, robot.facts, facts),
    )


def _hanging(facts: RobotFacts, turned: set[str]) -> tuple[Branch, ...]:
    """The branches that a loop turns and that hang on something."""
    kept: list[Branch] = []
    for branch in facts.branches:
        if branch.joint in turned and branch.parent in (*facts.links, *(b.link for b in kept)):
            kept.append(branch)
    return tuple(kept)


def _moved(shapes: tuple[S, ...], before: RobotFacts, after: RobotFacts) -> tuple[S, ...]:
    """The shapes of the bodies that are left, by their new indices."""
    place = {before.bodies.index(link): i for i, link in enumerate(after.bodies)}
    return tuple(replace(s, link=place[s.link]) for s in shapes if s.link in place)


def stands(effect: Effect, effects: Sequence[Effect], facts: RobotFacts) -> bool:
    """Whether an effect fits the robot's joints, links and loops."""
    try:
        effect.require_fit(facts)
    except InputError:
        return False
    loops = [e.name for e in effects if isinstance(e, Loop)]
    virtual = effect.virtual_joints(facts) if isinstance(effect, Spring) else ()
    return all(v.loop in loops for v in virtual if isinstance(v, Bar))


def _of(robot: Robot, kind: type[K]) -> list[K]:
    return [e for e in robot.effects if isinstance(e, kind)]


def _pivots(spring: ParallelSpring, facts: RobotFacts) -> tuple[object, ...] | None:
    """Where a balancer is fixed, to 0.1 mm; None where it does not say."""
    ends = spring.outline(facts)
    return None if ends is None else tuple((p.link, *(round(c, 4) for c in p.xyz)) for p in ends)
