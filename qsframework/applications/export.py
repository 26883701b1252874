"""A plan as a file for the robot's controller, read back before it is called good."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from qsframework.applications.export_fanuc import parse_fanuc, write_fanuc
from qsframework.applications.export_krl import parse_krl, write_krl
from qsframework.applications.export_rapid import parse_rapid, write_rapid
from qsframework.applications.export_readback import Parsed, Stop, wrong
from qsframework.applications.export_urscript import parse_urscript, write_urscript
from qsframework.applications.programme import Programme
from qsframework.errors import InputError, Problem, nearest
from qsframework.experiment import Plan
from qsframework.files import read_text, write_text
from qsframework.units import JointUnits

FORMATS = ("fanuc-ls", "krl", "rapid", "urscript", "csv")
ENDINGS = {"fanuc-ls": (".ls",), "krl": (".src", ".dat"), "rapid": (".mod",), "urscript": (".script",), "csv": ()}
"""How a format's files end; () for any ending."""
_MAKERS = {"fanuc-ls": "FANUC", "krl": "KUKA", "rapid": "ABB", "urscript": "UNIVERSAL ROBOTS"}
_FRAMES = {"fanuc-ls": ("1", "0"), "krl": ("1", "0"), "rapid": ("tool0", "wobj0")}
"""Tool and user frame where nothing else is asked for; the other formats state none, for joint angles need none."""
_FRAME_NAMES = {"fanuc-ls": r"\d{1,2}", "krl": r"\d{1,2}", "rapid": r"[A-Za-z]\w{0,31}"}
_KNOWN = ("FANUC", "KUKA", "ABB", "YASKAWA", "MOTOMAN", "UNIVERSAL ROBOTS", "STAUBLI", "KAWASAKI", "COMAU", "NACHI")
_NAME = re.compile(r"[A-Za-z0-9_.+-]{1,16}")
"""A pose's name that every format can hold."""


def export(programme: Programme, plan: Plan, to: str, path: str | Path) -> tuple[Path, ...]:
    """Write the programme in one of the FORMATS, read it back, and return the files.

    InputError for another maker's robot, or names that the format cannot hold.
    """
    path = Path(path)
    check_format(programme, to)
    _check_names(programme)
    programme = _with_frames(programme, to)
    if to == "krl":
        src, dat = write_krl(programme, path.stem)
        _proof(parse_krl(src, dat), programme, plan)
        return write_text(path.with_suffix(".src"), src), write_text(path.with_suffix(".dat"), dat)
    if to == "fanuc-ls":
        text = write_fanuc(programme, re.sub(r"\W", "_", path.stem).upper())
        _proof(parse_fanuc(text), programme, plan)
    elif to == "rapid":
        text = write_rapid(programme, path.stem)
        _proof(parse_rapid(text), programme, plan)
    elif to == "urscript":
        text = write_urscript(programme, path.stem)
        _proof(parse_urscript(text), programme, plan)
    else:
        text = write_csv(programme)
        _proof(parse_csv(text), programme, plan)
    return (write_text(path, text),)


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
        Problem(f"the {what} of the controller", found=repr(said), allowed=allowed)
        for what, said in (("tool", made.tool), ("frame", made.frame))
        if not re.fullmatch(_FRAME_NAMES[to], said, re.ASCII)
    ]
    if problems:
        raise InputError(problems)
    return made


def read_export(path: str | Path) -> Parsed:
    """Read back a file that `export` wrote, by its ending: .ls, .src (with its .dat), .mod, .script or .csv.

    InputError where it has been spoilt since.
    """
    path = Path(path)
    try:
        parsed = _parsed(path)
    except InputError as error:
        raise InputError([replace(p, file=p.file or str(path)) for p in error.problems]) from error
    except (ValueError, IndexError, KeyError, TypeError, csv.Error) as error:
        raise InputError(Problem(f"is no file of `qsf export`: {error}", file=str(path))) from error
    angles = [stop.pendant for stop in parsed.stops]
    if not angles or any(a.shape != angles[0].shape or not np.isfinite(a).all() or not a.size for a in angles):
        raise InputError(Problem("does not hold the same number of finite angles at every stop", file=str(path)))
    if not all(np.isfinite(stop.pause or 0.0) for stop in parsed.stops):
        raise InputError(Problem("holds a pause that is no finite number", file=str(path)))
    return parsed


def _parsed(path: Path) -> Parsed:
    ending = path.suffix.lower()
    text = read_text(path)
    if ending in (".src", ".dat"):
        return parse_krl(read_text(path.with_suffix(".src")), read_text(path.with_suffix(".dat")))
    parsers = {".ls": parse_fanuc, ".mod": parse_rapid, ".script": parse_urscript}
    return parsers.get(ending, parse_csv)(text)


def check_format(programme: Programme, to: str) -> None:
    """InputError for an unknown format, or the format of another maker's controller."""
    if to not in FORMATS:
        raise InputError(Problem(f"unknown format {to!r}", allowed=", ".join(FORMATS), hint=nearest(to, FORMATS)))
    if to != "csv" and any(programme.units.sliding):
        axes = ", ".join(f"J{k + 1}" for k, slides in enumerate(programme.units.sliding) if slides)
        message = f"{to} holds turning axes only so far, and {axes} of this arm slides"
        raise InputError(Problem(message, hint="Use csv.", argument=("to", "csv")))
    maker = next((m for m in _KNOWN if m in programme.title.upper()), None)
    if to in _MAKERS and maker not in (None, _MAKERS[to]):
        own = next((f for f, m in _MAKERS.items() if m == maker), "csv")
        raise InputError(
            Problem(
                f"{to} is for controllers by {_MAKERS[to]}",
                found=programme.title,
                hint=f"Use {own}.",
                argument=("to", own),
            )
        )


def _check_names(programme: Programme) -> None:
    problems = [
        Problem(
            f"pose {name!r}: the controller cannot hold this name",
            allowed="1 to 16 letters, digits and _ . + -",
            hint="Name it so in the plan's column pose.",
        )
        for name in dict.fromkeys(m.pose for m in programme.moves if m.measured)
        if not _NAME.fullmatch(name)
    ]
    if problems:
        raise InputError(problems)


def _proof(parsed: Parsed, programme: Programme, plan: Plan) -> None:
    found = [*parsed.differences(programme), *parsed.plan_differences(plan)]
    if found:
        raise InputError(f"the exported file does not say what the plan says, so it was not written: {found[0]}")


def write_csv(programme: Programme) -> str:
    """One row per stop, in the order of the way."""
    stream = io.StringIO()
    payload = "not stated" if programme.payload is None else f"{programme.payload:g} kg"
    stream.write(f"# robot: {programme.robot}\n# payload: {payload}\n")
    stream.write("# load: hang it after the arm has stopped, take it off again before the arm starts\n")
    writer = csv.writer(stream, lineterminator="\n")
    angles = programme.units.names()
    writer.writerow(["stop", "pose", "visit", *angles, "speed_percent", "pause_s", "load", "fx_N", "fy_N", "fz_N"])
    for i, move in enumerate(programme.moves, start=1):
        pause = "0" if not move.measured else "hold" if programme.pause is None else repr(programme.pause)
        degrees = [f"{v:.4f}" for v in programme.units.shown(move.pendant) + 0.0]
        force = [f"{f:g}" for f in move.force]
        writer.writerow([i, move.pose, move.repeat, *degrees, programme.speed, pause, move.load, *force])
    return stream.getvalue()


def parse_csv(text: str) -> Parsed:
    """Read a table that `write_csv` wrote."""
    robot = re.match(r"# robot: (\S+)\n", text)
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    if robot is None or not rows or not {"stop", "pose", "visit", "pause_s"} <= rows[0].keys():
        raise wrong("is no table of `qsf export`")
    angles = [name for name in rows[0] if re.fullmatch(r"q\d+_(deg|mm)", name)]
    joints = JointUnits(tuple(name.endswith("mm") for name in angles))
    return Parsed(
        robot[1],
        tuple(
            Stop(
                r["pose"],
                int(r["visit"]),
                joints.si([float(r[a]) for a in angles]),
                int(r["speed_percent"]),
                None if r["pause_s"] == "hold" else float(r["pause_s"]),
                r.get("load") or "",
            )
            for r in rows
        ),
    )
