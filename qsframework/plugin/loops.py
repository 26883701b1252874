"""Loops that build on each other: which closes first, and where the joints stand that no actuator drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.plugin.facts import Array, Context, Poses, RobotFacts
from qsframework.plugin.kinds import Effect, Loop
from qsframework.plugin.laws import closure


def own_joints(loop: Loop, robot: RobotFacts) -> tuple[str, ...]:
    """The joints that a loop turns: all but its leaders."""
    leaders = loop.leaders(robot)
    return tuple(joint for joint in loop.joints(robot) if joint not in leaders)


def with_branches(robot: RobotFacts, effects: Sequence[Effect]) -> RobotFacts:
    """The robot with the links that its loops bring along, where it has them not yet."""
    brought = [branch for e in effects if isinstance(e, Loop) for branch in e.branches(robot)]
    more = tuple(branch for branch in brought if branch.joint not in robot.turning)
    return replace(robot, branches=(*robot.branches, *more)) if more else robot


def loop_problems(loops: Sequence[Loop], robot: RobotFacts) -> dict[str, Problem]:
    """By the loop's name, what keeps loops from closing one after the other."""
    out: dict[str, Problem] = {}
    owner: dict[str, str] = {}
    for loop in loops:
        own = own_joints(loop, robot)
        for joint in own:
            if owner.setdefault(joint, loop.name) != loop.name:
                text = f"{loop.name} and {owner[joint]} both turn {joint}; a joint belongs to one loop only"
                out[loop.name] = Problem(text)
        arm = [joint for joint in own if joint in robot.joints]
        undriven = [joint for joint in arm if joint in robot.passive]
        if undriven and len(undriven) < len(arm):
            text = f"{loop.name}: {', '.join(undriven)} has no actuator, the other joints that it turns have"
            out[loop.name] = Problem(text, hint="Give each joint without an actuator a coupling of its own.")
    _, circle = _sorted(loops, robot)
    for loop in circle:
        turned = ", ".join(own_joints(loop, robot))
        text = f"{loop.name}: {turned} and {', '.join(loop.leaders(robot))} follow each other in a circle"
        out.setdefault(loop.name, Problem(text, hint="Of joints that depend on each other one must lead."))
    return out


def in_order(loops: Sequence[Loop], robot: RobotFacts) -> tuple[Loop, ...]:
    """The loops, each after those that turn its leaders. InputError where two turn one joint or lead each other."""
    problems = loop_problems(loops, robot)
    if problems:
        raise InputError(problems.values())
    return tuple(_sorted(loops, robot)[0])


def _sorted(loops: Sequence[Loop], robot: RobotFacts) -> tuple[list[Loop], list[Loop]]:
    """The loops in order, and those that wait for each other."""
    waiting, placed = list(loops), list[Loop]()
    while waiting:
        open_ = {joint for loop in waiting for joint in own_joints(loop, robot)}
        ready = [loop for loop in waiting if not open_ & set(loop.leaders(robot))]
        if not ready:
            return placed, waiting
        placed += ready
        waiting = [loop for loop in waiting if loop not in ready]
    return placed, []


def follow(loops: Sequence[Loop], q: Array, robot: RobotFacts) -> Array:
    """Angles (N, n + b) of all joints at those of the arm, q (N, n).

    Joints that no actuator drives and branches stand where their perfect loops hold them.
    """
    out = np.concatenate([q.T, np.zeros((len(robot.branches), len(q)))])
    for loop in in_order(loops, robot):
        tied, own, leaders = loop.joints(robot), own_joints(loop, robot), loop.leaders(robot)
        held = [i for i, joint in enumerate(tied) if joint not in robot.driven and joint in own]
        if not held:
            continue
        at = np.array([robot.turning_index(joint) for joint in tied])
        phi = out[at]
        others = [i for i, joint in enumerate(tied) if i not in held and joint not in leaders]
        if others:
            phi[others] = loop.actuators(out[at].T, robot).T[others]
        phi[held] = 0.0
        bars = np.zeros((len(q), len(loop.parameters(robot))))
        out[at[held]] = closure(loop, phi.T, bars, Context(robot, Poses(q, q, np.zeros((len(q), 6))))).q.T[held]
    return out.T
