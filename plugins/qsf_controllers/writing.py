"""What exported programmes of all languages share: their remarks, their axes, and the lines of their way."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from qsframework.plugin import AXES, InputError, Move, Problem, Programme, axis_names

LOAD_DATA = "set the load data of tool and weight before the start"


def plain(name: str) -> str:
    """The name of a load or a station as a remark of a controller's file holds it."""
    return re.sub(r"[^A-Za-z0-9_.+-]", "_", name)


def file_text(lines: Sequence[str]) -> str:
    """The text of a file."""
    return "\n".join(lines) + "\n"


def bad_name(found: str, allowed: str) -> InputError:
    """The error for a name that the controller cannot hold."""
    return InputError(Problem("a name that the controller cannot hold", found=repr(found), allowed=allowed))


def check_name(name: str, pattern: str, allowed: str) -> None:
    """InputError for a programme's name that is none on the controller."""
    if not re.fullmatch(pattern, name):
        raise bad_name(name, allowed)


def arm_axes(programme: Programme, letter: str, language: str) -> tuple[str, ...]:
    """Names of the axes. InputError where an arm has not the six of its own that the language states at every point."""
    count = len(programme.moves[0].pendant)
    joints = count - len(programme.external)
    if joints < AXES:
        words = f"{language} states six axes of the arm at every point"
        raise InputError(Problem(words, found=f"{joints} joints", allowed="6", argument=("to", "csv")))
    return axis_names(count, programme.external, letter)


def axis_order(names: Sequence[str], letter: str) -> list[str]:
    """What a file remarks of the order of its axes: nothing of A1, A2, ... one after the other."""
    alike = list(names) == [f"{letter}{k}" for k in range(1, len(names) + 1)]
    return [] if alike else [f"axes {' '.join(names)}"]


def axis_cells(names: Sequence[str], move: Move, letter: str, absent: str) -> Iterable[tuple[str, str]]:
    """The six axes of a letter with their angles in deg; absent: of those that the arm does not have."""
    degrees = dict(zip(names, np.rad2deg(move.pendant) + 0.0, strict=True))
    for axis in (f"{letter}{k}" for k in range(1, AXES + 1)):
        yield axis, f"{degrees[axis]:.4f}" if axis in degrees else absent


def opening_remarks(programme: Programme, load_data: str, more: Sequence[str] = ()) -> list[str]:
    """What a file says first; load_data: what the controller is to know of weights, where any are hung."""
    payload = "not stated" if programme.payload is None else f"{programme.payload:g} kg"
    weights = [load_data, "no weight while the arm moves"] if programme.loaded else []
    return [f"robot {programme.robot}", f"payload {payload}", *more, *weights]


def way_lines(
    programme: Programme,
    sign: str,
    motions: Iterable[tuple[str, str]],
    wait: str,
    visit: str = "pose ",
    longest: int = 9999,
) -> list[str]:
    """The lines of all moves. A load is named where the programme waits for it, never before a move.

    sign: of a remark; motions: of each move, and how it waits there to be started; wait: how it waits for a time;
    visit: word before a pose's name; longest: characters of a remark
    """
    out: list[str] = []
    for move, (motion, halt) in zip(programme.moves, motions, strict=True):
        if not move.measured:
            out.append(motion)
            continue
        load = plain(move.load)[: longest - len("!now hang ")]
        station = plain(move.station)[: longest - len("!tracker at ")]
        out += [f"{sign}{visit}{move.pose} visit {move.repeat}"[:longest], motion]
        out += [f"{sign}tracker at {station}"] if station else []
        if programme.pause is not None:
            out += [*([f"{sign}load {load}"] if load else []), wait]
        else:
            hang = [f"{sign}now hang {load}", f"{sign}take it off before the start"] if load else []
            out += [*hang, halt]
    return out
