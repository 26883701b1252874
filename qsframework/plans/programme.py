"""A plan as a sequence of moves of the real robot: ordered, checked, with poses in between where needed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from qsframework.arguments import checked
from qsframework.elastostatics import actuator_torques
from qsframework.errors import InputError, Problem, refuse
from qsframework.experiment import Experiment, Plan
from qsframework.plans import broken_constraints
from qsframework.plans.constraints import on_one_side
from qsframework.plans.options import Order
from qsframework.plans.ordering import visits, way_length
from qsframework.plans.path_check import Surroundings, find_way
from qsframework.plugin import Array, Move, Programme
from qsframework.plugin.facts import frozen
from qsframework.robot import Robot

_ROUNDS = 4
_DETOUR = 2.0
"""rad that a way which is not free counts longer when the order is sought again."""
_BLOCKED = 1.0
"""rad that poses in between cost where the straight way is not free, about: 7 to 90 deg on the M-900iB."""
_MEND = "Leave it out, or design again with this experiment: its plans keep what its constraints ask."
_FOR_THE_READINGS = ("sight", "singularity_margin", "joint_margin", "joint_values")
"""Constraints whose breach harms the readings, not the robot."""
Tell = Callable[[str, int, int], None]


@checked
def make_programme(
    experiment: Experiment,
    plan: Plan,
    order: Order = "shortest",
    seed: int = 0,
    speed: int = 10,
    pause: float | None = 10.0,
    home: Array | None = None,
    tell: Tell | None = None,
    file: str = "",
) -> Programme:
    """Order a plan and check the path between its poses.

    Args:
        experiment: the campaign.
        plan: its plan.
        order: "shortest", "random" or "plan".
        seed: random seed of a random order.
        speed: percent of the maximum joint speed.
        pause: wait at each pose, s; None: for the start button.
        home: (n,) pendant angles, rad, where the path starts and ends.
        tell: called with each step, its number and how many there are.
        file: the plan's name, for the programme's comments.

    Returns:
        The moves, in order.

    Raises:
        InputError: where a pose is outside the limits or collides, a load is above the payload or an actuator's torque,
            or no free path was found between two poses; each names the poses.
    """
    if not 1 <= speed <= 100:
        raise InputError(Problem("the speed is a share of the robot's own", found=f"{speed} %", allowed="1 to 100 %"))
    if pause is not None and not 0.01 <= pause <= 3600.0:
        raise InputError(Problem("the pause at a pose", found=f"{pause:g} s", allowed="0.01 to 3600 s"))
    if home is not None and home.shape != (axes := (experiment.robot.controller.axes,)):
        raise InputError(Problem("home: of another shape", found=f"{home.shape}", allowed=f"{axes}, rad or m"))
    pause = None if pause is None else round(pause, 2)  # controllers are told hundredths
    check_plan(experiment, plan, file)
    around = Surroundings(experiment)
    _check_constraints(around, plan, home, file)
    stations = tuple(dict.fromkeys(plan.stations))
    if pause is not None and len(stations) > 1:  # it would drive on while the tracker is set up elsewhere
        hint = "A programme that waits at each pose says where the tracker moves."
        message = f"the tracker moves between {' and '.join(stations)}"
        raise InputError(Problem(message, file or None, hint=hint, argument=("hold", "")))
    tell = tell or (lambda label, done, total: None)
    sequence = _free_order(around, plan, order, seed, home, tell)
    moves = _moves(around, plan, sequence, home, np.random.default_rng(seed), tell, file)
    points = np.stack([m.pendant for m in moves])
    return replace(
        draft(experiment, plan, speed, pause),
        moves=moves,
        length=way_length(points, range(len(points))),
        length_as_planned=way_length(plan.pendant, visits(plan, "plan"), home),
        notes=_notes(around, plan, moves, home, pause),
        home=home is not None,
    )


def draft(experiment: Experiment, plan: Plan, speed: int = 10, pause: float | None = 10.0) -> Programme:
    """The visits of a plan in its own order, with nothing checked: enough to see whether a format holds them."""
    robot = experiment.robot
    return Programme(
        robot=robot.name,
        title=robot.title,
        payload=robot.payload,
        moves=tuple(_stops(plan, visits(plan, "plan"))),
        units=robot.controller.units,
        speed=speed,
        pause=pause,
        external=robot.controller.external,
    )


def check_plan(experiment: Experiment, plan: Plan, file: str = "") -> None:
    """InputError with every pose outside the limits and every load that the robot must not carry."""
    robot = experiment.robot
    problems: list[Problem] = []

    def add(i: int, message: str, found: str, allowed: str, hint: str | None = None) -> None:
        message = f"pose {plan.pose[i]!r}: {message}"
        problems.append(Problem(message, file or None, found=found, allowed=allowed, hint=hint))

    for i, k in np.argwhere(robot.controller.outside(plan.pendant)).tolist():
        unit, allowed = robot.controller.units[k], robot.controller.range_of(k)
        value = unit.text(float(plan.pendant[i, k]))
        add(i, f"{robot.facts.driven[k]} is outside its limits", value, unit.between(*allowed))
    force = np.linalg.norm(plan.wrench[:, :3], axis=1)
    most = np.inf if robot.payload is None else robot.payload * float(np.linalg.norm(robot.gravity))
    for i in np.flatnonzero(force > most * (1.0 + 1e-9)).tolist():
        message, hint = (
            "the load is above the wrist's payload",
            "The real robot never holds it: plan with a smaller load.",
        )
        add(i, message, f"{force[i]:.0f} N", f"{robot.payload:g} kg, {most:.0f} N", hint)
    if robot.torque_limits is not None:
        empty = replace(plan.poses, wrench=np.zeros_like(plan.wrench))
        torque = np.max([np.abs(actuator_torques(experiment.model(), p)) for p in (plan.poses, empty)], axis=0)
        for i, k, found, allowed in overloads(robot, torque):
            add(i, f"{robot.facts.joints[k]} cannot hold the load", found, allowed)
    refuse(problems)


def overloads(robot: Robot, torque: Array) -> Iterator[tuple[int, int, str, str]]:
    """Where torques (N, n) are above the actuators': the pose, the joint, and both in words."""
    limits = np.full(torque.shape[1], np.inf) if robot.torque_limits is None else robot.torque_limits
    for i, k in np.argwhere(torque > limits).tolist():
        unit = robot.facts.units[k].load
        yield i, k, f"{torque[i, k]:.0f} {unit}", f"up to {limits[k]:.0f} {unit}"


def payload_notes(experiment: Experiment) -> tuple[str, ...]:
    """What to say of a robot whose loads could not be checked."""
    stated = experiment.robot.payload is not None
    return () if stated else ("robot.yaml states no payload_kg: the loads were not checked against it",)


def load_name(plan: Plan, i: int) -> str:
    """What is hung at a pose of the plan, "" where nothing is."""
    return plan.load[i] or ("load" if np.any(plan.wrench[i]) else "")


def _check_constraints(around: Surroundings, plan: Plan, home: Array | None, file: str) -> None:
    """InputError where a pose or home breaks what keeps robot and load safe."""
    pendant = plan.pendant if home is None else np.vstack([plan.pendant, home])
    names = [*(f"pose {p!r}" for p in plan.pose), "home"]
    away = np.flatnonzero(~on_one_side(around.experiment, pendant)).tolist()
    breaks = [(names[i], ", ".join(words)) for i, words in enumerate(around.named(pendant)) if words]
    breaks += [(names[i], "'transmission angle' on the way: a loop would pass flat between it and most") for i in away]
    breaks = breaks or [
        (f"pose {pose!r}", repr(constraint))
        for constraint, poses in broken_constraints(around.experiment, plan).items()
        if constraint not in (*_FOR_THE_READINGS, "load_capacity")  # `check_plan` asks for the plan's own loads
        for pose in poses
    ]
    refuse([Problem(f"{name}: breaks {words}", file or None, hint=_MEND) for name, words in breaks])


def _free_order(
    around: Surroundings, plan: Plan, order: str, seed: int, home: Array | None, tell: Tell
) -> tuple[int, ...]:
    """A short order: a way that is not free counts longer, and the order is sought again; the plan's own is tried."""
    penalty: dict[tuple[int, int], float] = {}
    free: dict[tuple[int, int], bool] = {}
    best: tuple[float, tuple[int, ...]] | None = None
    # where it lists poses under one load together, and each once, the plan's own order will do, too
    changes = sum(a != b for a, b in pairwise(plan.load))
    in_rounds = changes == len(set(plan.load)) - 1 and max(plan.repeats) == 1
    for k in range(_ROUNDS):
        as_listed = order == "shortest" and k == _ROUNDS - 1 and in_rounds
        sequence = visits(plan, "plan" if as_listed else order, seed, home, penalty)
        pairs = [(min(i, j), max(i, j)) for i, j in pairwise(sequence)]
        for i, j in pairs:
            if (i, j) not in free:
                free[i, j] = around.way_is_free(plan.pendant[i], plan.pendant[j])
        blocked = [pair for pair in pairs if not free[pair]]
        tell("order", k + 1, _ROUNDS)
        length = way_length(plan.pendant, sequence, home) + _BLOCKED * len(blocked)
        if best is None or length < best[0]:
            best = (length, sequence)
        if order != "shortest":
            break
        penalty |= dict.fromkeys(blocked, _DETOUR)
    tell("order", _ROUNDS, _ROUNDS)
    assert best is not None
    return best[1]


def _stops(plan: Plan, sequence: tuple[int, ...]) -> list[Move]:
    """The visits in an order."""
    out, counts, stand = list[Move](), Counter[int](), ""
    for i in sequence:
        counts[i] += 1
        x, y, z = map(float, plan.wrench[i, :3])
        station = plan.stations[i] if plan.stations[i] != stand else ""
        stand = plan.stations[i]
        out.append(Move(frozen(plan.pendant[i]), plan.pose[i], counts[i], load_name(plan, i), (x, y, z), station))
    return out


def _moves(
    around: Surroundings,
    plan: Plan,
    sequence: tuple[int, ...],
    home: Array | None,
    rng: np.random.Generator,
    tell: Tell,
    file: str,
) -> tuple[Move, ...]:
    stops = _stops(plan, sequence)
    if home is not None:
        stops = [Move(frozen(home)), *stops, Move(frozen(home))]
    out = stops[:1]
    problems: list[Problem] = []
    for k, (here, there) in enumerate(pairwise(stops)):
        between = find_way(around, here.pendant, there.pendant, rng)
        tell("way", k + 1, len(stops) - 1)
        if between is None:
            ends = f"from {here.pose or 'home'} to {there.pose or 'home'}"
            hit = around.in_the_way(here.pendant, there.pendant)
            hint = "Leave one of the two out of the plan, or put a pose between them that both can reach."
            problems.append(Problem(f"no free way found {ends}: it breaks {hit}", file or None, hint=hint))
        out += [*(Move(p) for p in between or ()), there]
    refuse(problems)
    return tuple(out)


def _notes(
    around: Surroundings, plan: Plan, moves: tuple[Move, ...], home: Array | None, pause: float | None
) -> tuple[str, ...]:
    """What to know of a programme: first the constraints that only the readings need, where they are broken."""
    experiment, loaded = around.experiment, bool(plan.wrench.any())
    broken = broken_constraints(experiment, plan)
    notes = [f"{', '.join(broken[c])} break the constraint {c!r}" for c in _FOR_THE_READINGS if c in broken]
    pairs = [(a, b) for a, b in pairwise(moves) if around.loses_sight(a.pendant, b.pendant)]
    if pairs:
        ways = ", ".join(f"{a.pose or 'between'} to {b.pose or 'between'}" for a, b in pairs)
        notes.append(f"the tracker loses a marker on the way {ways}: it must find it again by absolute distance")
    if pause is not None and loaded:
        notes.append(
            f"the programme drives on by itself after {pause:g} s: a run without the weight; without a pause it waits "
            "while a load is hung and taken off"
        )
    if not experiment.robot.shapes:
        notes.append("the robot's URDF has no simple solids: nothing was checked for collisions")
    if experiment.constraints.floor is None:
        notes.append("the experiment states no floor_m among its constraints: the way was not checked against a floor")
    if experiment.constraints.tool_radius is None:
        notes.append("the experiment states no tool_radius_mm: tool and weight were not checked for collisions")
    notes += payload_notes(experiment) if loaded else ()
    if home is None:
        notes.append("no home position was given: bring the arm to the first pose by hand, slowly")
    low = "at low speed without the weight" if loaded else "at low speed"
    notes.append(f"the cell, cables and people are not known here: run it once {low}")
    return tuple(notes)
