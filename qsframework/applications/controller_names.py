"""Names as a controller's file holds them: axes (A1 to A6 of the arm, E1 to E6 beside it), loads, programmes."""

from __future__ import annotations

import re
from collections.abc import Sequence

from qsframework.errors import InputError, Problem

MOST = 6
"""Axes of an arm, and external axes, that KRL, RAPID and URScript can state."""

_MAKERS = ("FANUC", "KUKA", "ABB", "YASKAWA", "MOTOMAN", "UNIVERSAL ROBOTS", "STAUBLI", "KAWASAKI", "COMAU", "NACHI")


def maker_of(title: str) -> str | None:
    """The maker that a robot's title names, in capitals; None where it names none that is known."""
    return next((m for m in _MAKERS if m in title.upper()), None)


def axis_names(count: int, external: Sequence[int], letter: str, most: int = MOST) -> tuple[str, ...]:
    """The controller's name of each of `count` angles, such as A1, A2 or E1, in the order of the plan's columns.

    letter: of the arm's own axes; most: how many of them there may be. InputError where there are more, or more than
    six external ones.
    """
    own = [k for k in range(count) if k not in external]
    if len(own) > most or count - len(own) > MOST:
        hint = "Say `external: true` in robot.yaml, controller, at each joint that the controller shows as E1, E2, ..."
        found = f"{len(own)} axes of the arm and {count - len(own)} external ones"
        raise InputError(
            Problem("more axes than the format holds", found=found, allowed=f"up to {most} and {MOST}", hint=hint)
        )
    names = {k: f"{letter}{i}" for i, k in enumerate(own, start=1)}
    names |= {k: f"E{i}" for i, k in enumerate((k for k in range(count) if k in external), start=1)}
    return tuple(names[k] for k in range(count))


def six_axes(count: int, external: Sequence[int], what: str) -> None:
    """InputError where an arm has not the six axes of its own that the format states at every point."""
    if count - len(external) < MOST:
        found = f"{count - len(external)} joints"
        words = f"{what} states six axes of the arm at every point"
        raise InputError(Problem(words, found=found, allowed="6", argument=("to", "csv")))


def arm_axes(count: int, external: Sequence[int], letter: str, what: str) -> tuple[tuple[str, ...], list[str]]:
    """Names of the axes of an arm with six of its own, and what a file remarks of their order."""
    six_axes(count, external, what)
    names = axis_names(count, external, letter)
    return names, [remark] if (remark := axes_remark(names, letter)) else []


def axes_remark(names: Sequence[str], letter: str) -> str:
    """What a file says of the order of its axes: "" for A1, A2, ... one after the other."""
    plain = [f"{letter}{k}" for k in range(1, len(names) + 1)]
    return "" if list(names) == plain else f"axes {' '.join(names)}"


def plain(name: str) -> str:
    """The name of a load or a station as a remark of a controller's file holds it."""
    return re.sub(r"[^A-Za-z0-9_.+-]", "_", name)


def payload_text(payload: float | None) -> str:
    """A payload as a remark says it."""
    return "payload not stated" if payload is None else f"payload {payload:g} kg"


def weight_remarks(loaded: bool, told: str) -> list[str]:
    """What a file says first where weights are hung. told: what the controller is to be told of them"""
    return [told, "no weight while the arm moves"] if loaded else []


def stopped(load: str, station: str, pause: float | None, sign: str, wait: str, halt: str) -> list[str]:
    """What is done once the arm stands: a load is named where the programme waits for it, never before a move.

    load, station: their names as the format holds them; sign: of a remark; wait, halt: how it waits for a time, or to
    be started
    """
    tracker = [f"{sign}tracker at {station}"] if station else []
    if pause is not None:
        return [*tracker, *([f"{sign}load {load}"] if load else []), wait]
    return [*tracker, *([f"{sign}now hang {load}", f"{sign}take it off before the start"] if load else []), halt]


def bad_name(found: str, allowed: str) -> InputError:
    """A name that the controller cannot hold."""
    return InputError(Problem("a name that the controller cannot hold", found=repr(found), allowed=allowed))
