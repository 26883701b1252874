"""A programme as a FANUC TP listing (.ls), in joint angles.

Joint positions are what the pendant shows; J3 of a FANUC is what robot.yaml's `controller:` says it is.
"""

from __future__ import annotations

import re

import numpy as np

from qsframework.applications.controller_names import (
    axes_remark,
    axis_names,
    bad_name,
    payload_text,
    plain,
    stopped,
    weight_remarks,
)
from qsframework.applications.programme import Move, Programme

_REMARK = 32
"""Characters that a remark may have on the controller."""
_LOAD_NAME = _REMARK - len("!now hang ")
_STATION_NAME = _REMARK - len("!tracker at ")
_MOST_JOINTS = 9
_PER_LINE = 3


def write_fanuc(programme: Programme, name: str) -> str:
    """The listing. `name` is the programme's name on the controller: letters, digits and _, up to 36."""
    if not re.fullmatch(r"[A-Z][A-Z0-9_]{0,35}", name):
        raise bad_name(name, "a letter, then letters, digits and _, up to 36")
    _check_loads(programme)
    names = axis_names(len(programme.moves[0].pendant), programme.external, "J", _MOST_JOINTS)
    lines = [*_head(programme, names), f"UFRAME_NUM={programme.frame}", f"UTOOL_NUM={programme.tool}"]
    for i, move in enumerate(programme.moves, start=1):
        if move.measured:
            lines.append(f"!{move.pose} visit {move.repeat}"[:_REMARK])
        lines.append(f"J P[{i}] {programme.speed}% FINE")
        if move.measured:
            said = (plain(move.load)[:_LOAD_NAME], plain(move.station)[:_STATION_NAME])
            lines += stopped(*said, programme.pause, "!", f"WAIT {programme.pause or 0:6.2f}(sec)", "PAUSE")
    numbered = [_line(k, text) for k, text in enumerate(lines, start=1)]
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
    return "\n".join([*head, *numbered, "/POS", *positions, "/END"]) + "\n"


def _head(programme: Programme, names: tuple[str, ...]) -> list[str]:
    payload = payload_text(programme.payload)
    remarks = [f"robot {programme.robot}", payload]
    remarks += weight_remarks(programme.loaded, "set PAYLOAD of tool and weight")
    if len(remarks[0]) >= _REMARK:
        raise bad_name(programme.robot, f"a robot's name of up to {_REMARK - 7} characters, for a remark holds no more")
    remarks += [remark] if (remark := axes_remark(names, "J")) else []
    return [f"!{text}" for text in remarks]


def _check_loads(programme: Programme) -> None:
    """InputError where the remarks of two loads would read the same."""
    seen: dict[str, str] = {}
    for load in (m.load for m in programme.moves if m.load):
        if (other := seen.setdefault(plain(load)[:_LOAD_NAME], load)) != load:
            raise bad_name(load, f"a name that differs from that of {other!r} in its first {_LOAD_NAME} characters")


def _line(number: int, text: str) -> str:
    motion = text.startswith("J P[")
    return f"{number:4d}:{text}    ;" if motion else f"{number:4d}:  {text} ;"


def _position(index: int, move: Move, names: tuple[str, ...], where: str) -> str:
    degrees = dict(zip(names, np.rad2deg(move.pendant) + 0.0, strict=True))
    cells = [f"{axis}={degrees[axis]:11.4f} deg" for axis in sorted(names, key=lambda a: (a[0] == "E", a))]
    rows = [",\t".join(cells[s : s + _PER_LINE]) for s in range(0, len(cells), _PER_LINE)]
    label = f':"{move.pose[:16]}"' if move.measured else ""
    return f"P[{index}{label}]{{\n   GP1:\n\t{where},\t\n\t" + ",\n\t".join(rows) + "\n};"
