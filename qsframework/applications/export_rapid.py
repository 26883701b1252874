"""A programme as an ABB RAPID module (.mod), in joint angles.

RAPID knows no share of each joint's largest speed: `VelSet` takes the share of `vmax`, the largest of the tool centre
point and of its turning.
"""

from __future__ import annotations

import re

import numpy as np

from qsframework.applications.controller_names import (
    MOST,
    arm_axes,
    bad_name,
    payload_text,
    plain,
    stopped,
    weight_remarks,
)
from qsframework.applications.programme import Programme

_FASTEST = 5000
"""mm/s of the tool centre point that `VelSet` allows at most."""
_UNUSED = "9E+09"


def write_rapid(programme: Programme, name: str) -> str:
    """The module. `name` is the module's name: a letter, then letters, digits and _, up to 28."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,27}", name):
        raise bad_name(name, "a letter, then letters, digits and _, up to 28, for the procedure is named run_ and this")
    names, order = arm_axes(len(programme.moves[0].pendant), programme.external, "J", "RAPID")
    remarks = [f"robot {programme.robot}", payload_text(programme.payload), *order]
    remarks += weight_remarks(programme.loaded, "set the load data of tool and weight before the start")
    points, body = list[str](), [f"VelSet {programme.speed},{_FASTEST};"]
    for i, move in enumerate(programme.moves, start=1):
        points.append(f"LOCAL CONST jointtarget jp{i}:={_target(dict(zip(names, move.pendant, strict=True)))};")
        if move.measured:
            body.append(f"! pose {move.pose} visit {move.repeat}")
        body.append(f"MoveAbsJ jp{i}\\NoEOffs,vmax,fine,{programme.tool}\\WObj:={programme.frame};")
        if move.measured:
            wait = f"WaitTime\\InPos,{programme.pause or 0:.2f};"
            body += stopped(plain(move.load), plain(move.station), programme.pause, "! ", wait, "Stop;")
    lines = [f"MODULE {name}", *(f"  ! {r}" for r in remarks), *(f"  {p}" for p in points), f"  PROC run_{name}()"]
    return "\n".join([*lines, *(f"    {b}" for b in body), "  ENDPROC", "ENDMODULE"]) + "\n"


def _target(angles: dict[str, float]) -> str:
    def cell(name: str) -> str:
        return f"{np.rad2deg(angles[name]) + 0.0:.4f}" if name in angles else _UNUSED

    own, beside = (",".join(cell(f"{letter}{k}") for k in range(1, MOST + 1)) for letter in "JE")
    return f"[[{own}],[{beside}]]"
