"""A plan as a file for the robot's controller."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from qsframework.applications.controller_files import maker_of, write_fanuc, write_krl, write_rapid, write_urscript
from qsframework.applications.programme import Programme
from qsframework.arguments import checked
from qsframework.errors import InputError, Problem, nearest, refuse
from qsframework.experiment.columns import WRENCH_NAMES, table_text
from qsframework.files import write_text

FORMATS = ("fanuc-ls", "krl", "rapid", "urscript", "csv")
ENDINGS = {"fanuc-ls": (".ls",), "krl": (".src", ".dat"), "rapid": (".mod",), "urscript": (".script",), "csv": ()}
"""How a format's files end; () for any ending."""
_MAKERS = {"fanuc-ls": "FANUC", "krl": "KUKA", "rapid": "ABB", "urscript": "UNIVERSAL ROBOTS"}
_FRAMES = {"fanuc-ls": ("1", "0"), "krl": ("1", "0"), "rapid": ("tool0", "wobj0")}
"""Tool and user frame where nothing else is asked for; the other formats state none, for joint angles need none."""
_FRAME_NAMES = {"fanuc-ls": r"\d{1,2}", "krl": r"\d{1,2}", "rapid": r"[A-Za-z]\w{0,31}"}
_NAME = re.compile(r"[A-Za-z0-9_.+-]{1,16}")
"""A pose's name that every format can hold."""


@checked
def export(programme: Programme, to: str, path: str | Path) -> tuple[Path, ...]:
    """Write a programme in a controller's format.

    Args:
        programme: from `make_programme`.
        to: one of FORMATS.
        path: the file; krl makes a .src and a .dat of it.

    Returns:
        The files written.

    Raises:
        InputError: for another maker's robot, or names that the format cannot hold.
    """
    return tuple(write_text(file, text) for file, text in written(programme, to, Path(path)).items())


def written(programme: Programme, to: str, path: Path) -> dict[Path, str]:
    """The files of a format and their texts. InputError as of `export`."""
    check_format(programme, to)
    names = dict.fromkeys(m.pose for m in programme.moves if m.measured and not _NAME.fullmatch(m.pose))
    allowed = "1 to 16 letters, digits and _ . + -"
    hint = "Name it so in the plan's column pose."
    message = "the controller cannot hold this name"
    refuse([Problem(f"pose {name!r}: {message}", allowed=allowed, hint=hint) for name in names])
    programme = _with_frames(programme, to)
    if to == "krl":
        src, dat = write_krl(programme, path.stem)
        return {path.with_suffix(".src"): src, path.with_suffix(".dat"): dat}
    if to == "fanuc-ls":
        return {path: write_fanuc(programme, re.sub(r"\W", "_", path.stem).upper())}
    if to == "rapid":
        return {path: write_rapid(programme, path.stem)}
    return {path: write_urscript(programme, path.stem) if to == "urscript" else write_csv(programme)}


def _with_frames(programme: Programme, to: str) -> Programme:
    """The programme with its tool and frame, those of the format where none are asked for."""
    if to not in _FRAMES:
        if programme.tool or programme.frame:
            found = f"{programme.tool} {programme.frame}".strip()
            message = f"{to} states joint angles, for which no tool and no frame is chosen"
            raise InputError(Problem(message, found=found, hint="Leave them out."))
        return programme
    tool, frame = _FRAMES[to]
    made = replace(programme, tool=programme.tool or tool, frame=programme.frame or frame)
    allowed = "a number" if to != "rapid" else "the name of a tooldata or wobjdata"
    problems = [
        Problem(f"the {what} of the controller", found=repr(name), allowed=allowed)
        for what, name in (("tool", made.tool), ("frame", made.frame))
        if not re.fullmatch(_FRAME_NAMES[to], name, re.ASCII)
    ]
    refuse(problems)
    return made


def check_format(programme: Programme, to: str) -> None:
    """InputError for an unknown format, or the format of another maker's controller."""
    if to not in FORMATS:
        raise InputError(Problem(f"unknown format {to!r}", allowed=", ".join(FORMATS), hint=nearest(to, FORMATS)))
    if to != "csv" and any(programme.units.sliding):
        axes = ", ".join(f"J{k + 1}" for k, slides in enumerate(programme.units.sliding) if slides)
        message = f"{to} holds turning axes only so far, and {axes} of this arm slides"
        raise InputError(Problem(message, hint="Use csv.", argument=("to", "csv")))
    maker = maker_of(programme.title)
    if to in _MAKERS and maker not in (None, _MAKERS[to]):
        other = next((f for f, m in _MAKERS.items() if m == maker), "csv")
        message, hint = f"{to} is for controllers by {_MAKERS[to]}", f"Use {other}."
        raise InputError(Problem(message, found=programme.title, hint=hint, argument=("to", other)))


def write_csv(programme: Programme) -> str:
    """One row per stop, in the order of the way."""
    payload = "not stated" if programme.payload is None else f"{programme.payload:g} kg"
    comments = [f"robot: {programme.robot}", f"payload: {payload}"]
    if programme.loaded:
        comments.append("load: hang it after the arm has stopped, take it off again before the arm starts")
    stands = any(move.station for move in programme.moves)
    last = ["load", *WRENCH_NAMES[:3], *(["tracker_moves_to"] if stands else [])]
    header = ["stop", "pose", "visit", *programme.units.names(), "speed_percent", "pause_s", *last]
    rows: list[list[str]] = []
    for i, move in enumerate(programme.moves, start=1):
        pause = "0" if not move.measured else "hold" if programme.pause is None else repr(programme.pause)
        degrees = [f"{v:.4f}" for v in programme.units.shown(move.pendant) + 0.0]
        row = [str(i), move.pose, str(move.repeat), *degrees, str(programme.speed), pause, move.load]
        rows.append([*row, *(f"{f:g}" for f in move.force), *([move.station] if stands else [])])
    return table_text(header, rows, comments)
