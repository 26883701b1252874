"""A programme in the languages of controllers, in joint angles: FANUC TP, KUKA KRL, ABB RAPID, URScript; their names.

FANUC: joint positions are what the pendant shows; J3 is what robot.yaml's `controller:` says it is.
RAPID knows no share of each joint's largest speed: `VelSet` takes the share of `vmax`, the largest of the tool centre
point and of its turning. URScript: a joint move takes the speed of the joint that turns farthest, in rad/s: the share
is of 120 deg/s, the largest of the slowest joints that the maker has.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from qsframework.applications.programme import Move, Programme
from qsframework.errors import InputError, Problem

MOST = 6
"""Axes of an arm, and external axes, that KRL, RAPID and URScript can state."""
_MAKERS = ("FANUC", "KUKA", "ABB", "YASKAWA", "MOTOMAN", "UNIVERSAL ROBOTS", "STAUBLI", "KAWASAKI", "COMAU", "NACHI")
_REMARK = 32
"""Characters that a remark may have on a FANUC controller."""
_LOAD_NAME = _REMARK - len("!now hang ")
_MOST_FANUC = 9
_PER_LINE = 3
_FASTEST_TOOL = 5000
"""mm/s of the tool centre point that `VelSet` of RAPID allows at most."""
_FASTEST_JOINT = float(np.deg2rad(120.0))
_ACCELERATION = 0.5
"""rad/s^2, of the joint that turns farthest, in URScript."""
_LOAD_DATA = "set the load data of tool and weight before the start"


def maker_of(title: str) -> str | None:
    """The maker that a robot's title names, in capitals; None where it names none that is known."""
    return next((m for m in _MAKERS if m in title.upper()), None)


def axis_names(count: int, external: Sequence[int], letter: str, most: int = MOST) -> tuple[str, ...]:
    """The controller's name of each of `count` angles, such as A1, A2 or E1, in the order of the plan's columns.

    letter: of the arm's own axes; most: how many of them there may be. InputError where there are more, or more than
    six external ones.
    """
    arm = [k for k in range(count) if k not in external]
    beside = [k for k in range(count) if k in external]
    if len(arm) > most or len(beside) > MOST:
        hint = "Say `external: true` in robot.yaml, controller, at each joint that the controller shows as E1, E2, ..."
        found = f"{len(arm)} axes of the arm and {len(beside)} external ones"
        allowed = f"up to {most} and {MOST}"
        raise InputError(Problem("more axes than the format holds", found=found, allowed=allowed, hint=hint))
    names = {k: f"{letter}{i}" for i, k in enumerate(arm, start=1)} | {
        k: f"E{i}" for i, k in enumerate(beside, start=1)
    }
    return tuple(names[k] for k in range(count))


def plain(name: str) -> str:
    """The name of a load or a station as a remark of a controller's file holds it."""
    return re.sub(r"[^A-Za-z0-9_.+-]", "_", name)


def write_fanuc(programme: Programme, name: str) -> str:
    """The listing. `name` is the programme's name on the controller: letters, digits and _, up to 36."""
    _check_name(name, r"[A-Z][A-Z0-9_]{0,35}", "a letter, then letters, digits and _, up to 36")
    remarked: dict[str, str] = {}
    for load in (m.load for m in programme.moves if m.load):
        if (other := remarked.setdefault(plain(load)[:_LOAD_NAME], load)) != load:
            raise _bad_name(load, f"a name that differs from that of {other!r} in its first {_LOAD_NAME} characters")
    names = axis_names(len(programme.moves[0].pendant), programme.external, "J", _MOST_FANUC)
    remarks = [*_remarks(programme, "set PAYLOAD of tool and weight"), *_order(names, "J")]
    if len(remarks[0]) >= _REMARK:
        allowed = f"a robot's name of up to {_REMARK - 7} characters, for a remark holds no more"
        raise _bad_name(programme.robot, allowed)
    motions = [(f"J P[{i}] {programme.speed}% FINE", "PAUSE") for i in range(1, len(programme.moves) + 1)]
    wait = f"WAIT {programme.pause or 0:6.2f}(sec)"
    lines = [f"!{text}" for text in remarks]
    lines += [f"UFRAME_NUM={programme.frame}", f"UTOOL_NUM={programme.tool}"]
    lines += _way(programme, "!", motions, wait, visit="", longest=_REMARK)
    texts = [f"{text}    ;" if text.startswith("J P[") else f"  {text} ;" for text in lines]
    where = f"UF : {programme.frame}, UT : {programme.tool}"
    positions = [_position(i, m, names, where) for i, m in enumerate(programme.moves, start=1)]
    head = [
        f"/PROG  {name}",
        "/ATTR",
        "OWNER\t\t= MNEDITOR;",
        'COMMENT\t\t= "qsf export";',
        f"LINE_COUNT\t= {len(lines)};",
        "PROTECT\t\t= READ_WRITE;",
        "TCD:  STACK_SIZE\t= 0,",
        "      TASK_PRIORITY\t= 50,",
        "      TIME_SLICE\t= 0,",
        "      BUSY_LAMP_OFF\t= 0,",
        "      ABORT_REQUEST\t= 0,",
        "      PAUSE_REQUEST\t= 0;",
        "DEFAULT_GROUP\t= 1,*,*,*,*;",
        "CONTROL_CODE\t= 00000000 00000000;",
        "/MN",
    ]
    numbered = (f"{k:4d}:{text}" for k, text in enumerate(texts, start=1))
    return _text([*head, *numbered, "/POS", *positions, "/END"])


def _position(index: int, move: Move, names: tuple[str, ...], where: str) -> str:
    degrees = dict(zip(names, np.rad2deg(move.pendant) + 0.0, strict=True))
    cells = [f"{axis}={degrees[axis]:11.4f} deg" for axis in sorted(names, key=lambda a: (a[0] == "E", a))]
    rows = [",\t".join(cells[s : s + _PER_LINE]) for s in range(0, len(cells), _PER_LINE)]
    label = f':"{move.pose[:16]}"' if move.measured else ""
    return f"P[{index}{label}]{{\n   GP1:\n\t{where},\t\n\t" + ",\n\t".join(rows) + "\n};"


def write_krl(programme: Programme, name: str) -> tuple[str, str]:
    """The .src with the motion and the .dat with the points. `name` is the module's name: a letter, then letters,
    digits and _, up to 24."""
    allowed = "a letter, then letters, digits and _, up to 24, for the file bears the module's name"
    _check_name(name, r"[A-Za-z][A-Za-z0-9_]{0,23}", allowed)
    names = _arm_axes(programme, "A", "KRL")
    motions = [(f"PTP XP{i}", "HALT") for i in range(1, len(programme.moves) + 1)]
    src = [
        "&ACCESS RVP",
        "&REL 1",
        f"DEF {name}( )",
        *(f";{remark}" for remark in _remarks(programme, _LOAD_DATA, _order(names, "A"))),
        "DECL INT K",
        "BAS(#INITMOV,0)",
        f"BAS(#TOOL,{programme.tool})",
        f"BAS(#BASE,{programme.frame})",
        f"FOR K=1 TO {MOST}",
        f"$VEL_AXIS[K]={programme.speed}",
        "ENDFOR",
        *(f"$VEL_EXTAX[{k}]={programme.speed}" for k in range(1, len(programme.external) + 1)),
        "PTP $AXIS_ACT",
        *_way(programme, ";", motions, f"WAIT SEC {programme.pause or 0:.2f}"),
        "END",
    ]
    dat = ["&ACCESS RVP", "&REL 1", f"DEFDAT {name}"]
    for i, move in enumerate(programme.moves, start=1):
        angles = [",".join(f"{axis} {cell}" for axis, cell in _cells(names, move, k, "0.0")) for k in "AE"]
        dat.append(f"DECL E6AXIS XP{i}={{{','.join(angles)}}}")
    return _text(src), _text([*dat, "ENDDAT"])


def write_rapid(programme: Programme, name: str) -> str:
    """The module. `name` is the module's name: a letter, then letters, digits and _, up to 28."""
    allowed = "a letter, then letters, digits and _, up to 28, for the procedure is named run_ and this"
    _check_name(name, r"[A-Za-z][A-Za-z0-9_]{0,27}", allowed)
    names = _arm_axes(programme, "J", "RAPID")
    points, motions = list[str](), list[tuple[str, str]]()
    for i, move in enumerate(programme.moves, start=1):
        arm, beside = (",".join(cell for _, cell in _cells(names, move, k, "9E+09")) for k in "JE")
        points.append(f"  LOCAL CONST jointtarget jp{i}:=[[{arm}],[{beside}]];")
        motions.append((f"MoveAbsJ jp{i}\\NoEOffs,vmax,fine,{programme.tool}\\WObj:={programme.frame};", "Stop;"))
    body = [f"VelSet {programme.speed},{_FASTEST_TOOL};"]
    body += _way(programme, "! ", motions, f"WaitTime\\InPos,{programme.pause or 0:.2f};")
    remarks = [f"  ! {remark}" for remark in _remarks(programme, _LOAD_DATA, _order(names, "J"))]
    lines = [f"MODULE {name}", *remarks, *points, f"  PROC run_{name}()", *(f"    {line}" for line in body)]
    return _text([*lines, "  ENDPROC", "ENDMODULE"])


def write_urscript(programme: Programme, name: str) -> str:
    """The script. `name` is the function's name: a letter, then letters, digits and _, up to 32."""
    _check_name(name, r"[A-Za-z][A-Za-z0-9_]{0,31}", "a letter, then letters, digits and _, up to 32")
    count = len(programme.moves[0].pendant)
    if count != MOST or programme.external:
        found = f"{count} joints, {len(programme.external)} of them external"
        words = "URScript states the six joints of the arm"
        raise InputError(Problem(words, found=found, allowed="6 joints", argument=("to", "csv")))
    remarks = _remarks(
        programme,
        "set the payload and its centre of gravity, of tool and weight, before the start",
        [
            f"speed {programme.speed} percent of {np.rad2deg(_FASTEST_JOINT):g} deg/s",
            "tool and frame: joint angles need none; set_tcp stays as the installation has it",
        ],
    )
    velocity, motions = f"{_FASTEST_JOINT * programme.speed / 100.0:.5f}", list[tuple[str, str]]()
    for move in programme.moves:
        load = f"now hang {plain(move.load)}, take it off before you continue" if move.load else "nothing hangs here"
        text = f"{f'tracker at {plain(move.station)}, ' if move.station else ''}{load}"
        ask = f'popup("{move.pose} visit {move.repeat}: {text}", title="measure", blocking=True)'
        angles = ", ".join(f"{v + 0.0:.7f}" for v in move.pendant)
        motions.append((f"movej([{angles}], a={_ACCELERATION}, v={velocity})", ask))
    body = [f"# {remark}" for remark in remarks]
    body += _way(programme, "# ", motions, f"sleep({programme.pause or 0:.2f})")
    return _text([f"def {name}():", *(f"  {line}" for line in body), "end"])


def _text(lines: Sequence[str]) -> str:
    return "\n".join(lines) + "\n"


def _bad_name(found: str, allowed: str) -> InputError:
    return InputError(Problem("a name that the controller cannot hold", found=repr(found), allowed=allowed))


def _check_name(name: str, pattern: str, allowed: str) -> None:
    if not re.fullmatch(pattern, name):
        raise _bad_name(name, allowed)


def _arm_axes(programme: Programme, letter: str, language: str) -> tuple[str, ...]:
    """Names of the axes. InputError where an arm has not the six of its own that the language states at every point."""
    count = len(programme.moves[0].pendant)
    joints = count - len(programme.external)
    if joints < MOST:
        words = f"{language} states six axes of the arm at every point"
        raise InputError(Problem(words, found=f"{joints} joints", allowed="6", argument=("to", "csv")))
    return axis_names(count, programme.external, letter)


def _order(names: Sequence[str], letter: str) -> list[str]:
    """What a file remarks of the order of its axes: nothing of A1, A2, ... one after the other."""
    alike = list(names) == [f"{letter}{k}" for k in range(1, len(names) + 1)]
    return [] if alike else [f"axes {' '.join(names)}"]


def _cells(names: Sequence[str], move: Move, letter: str, absent: str) -> Iterable[tuple[str, str]]:
    """The six axes of a letter with their angles in deg; absent: of those that the arm does not have."""
    degrees = dict(zip(names, np.rad2deg(move.pendant) + 0.0, strict=True))
    for axis in (f"{letter}{k}" for k in range(1, MOST + 1)):
        yield axis, f"{degrees[axis]:.4f}" if axis in degrees else absent


def _remarks(programme: Programme, load_data: str, more: Sequence[str] = ()) -> list[str]:
    """What a file says first; load_data: what the controller is to know of weights, where any are hung."""
    payload = "not stated" if programme.payload is None else f"{programme.payload:g} kg"
    weights = [load_data, "no weight while the arm moves"] if programme.loaded else []
    return [f"robot {programme.robot}", f"payload {payload}", *more, *weights]


def _way(
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
