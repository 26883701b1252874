"""A programme as an ABB RAPID module (.mod), in joint angles, and back.

RAPID knows no share of each joint's largest speed: `VelSet` takes the share of `vmax`, the largest of the tool centre
point and of its turning.
"""

from __future__ import annotations

import re

import numpy as np

from qsframework.applications.controller_axes import MOST, axes_remark, axis_names, remarked_axes, six_axes
from qsframework.applications.export_readback import Parsed, Stop, bad_name, plain, wrong
from qsframework.applications.programme import Programme
from qsframework.plugin import Array

_FASTEST = 5000
"""mm/s of the tool centre point that `VelSet` allows at most."""
_UNUSED = "9E+09"


def write_rapid(programme: Programme, name: str) -> str:
    """The module. `name` is the module's name: a letter, then letters, digits and _, up to 28."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,27}", name):
        raise bad_name(name, "a letter, then letters, digits and _, up to 28, for the procedure is named run_ and this")
    count = len(programme.moves[0].pendant)
    six_axes(count, programme.external, "RAPID")
    names = axis_names(count, programme.external, "J")
    payload = "not stated" if programme.payload is None else f"{programme.payload:g} kg"
    remarks = [f"robot {programme.robot}", f"payload {payload}"]
    remarks += [remark] if (remark := axes_remark(names, "J")) else []
    remarks += ["set the load data of tool and weight before the start", "no weight while the arm moves"]
    points, body = list[str](), [f"VelSet {programme.speed},{_FASTEST};"]
    for i, move in enumerate(programme.moves, start=1):
        points.append(f"LOCAL CONST jointtarget jp{i}:={_target(dict(zip(names, move.pendant, strict=True)))};")
        if move.measured:
            body.append(f"! pose {move.pose} visit {move.repeat}")
        body.append(f"MoveAbsJ jp{i}\\NoEOffs,vmax,fine,{programme.tool}\\WObj:={programme.frame};")
        if move.measured:
            body += _stopped(move.load, programme.pause)
    lines = [f"MODULE {name}", *(f"  ! {r}" for r in remarks), *(f"  {p}" for p in points), f"  PROC run_{name}()"]
    return "\n".join([*lines, *(f"    {b}" for b in body), "  ENDPROC", "ENDMODULE"]) + "\n"


def _target(angles: dict[str, float]) -> str:
    def cell(name: str) -> str:
        return f"{np.rad2deg(angles[name]) + 0.0:.4f}" if name in angles else _UNUSED

    own, beside = (",".join(cell(f"{letter}{k}") for k in range(1, MOST + 1)) for letter in "JE")
    return f"[[{own}],[{beside}]]"


def _stopped(load: str, pause: float | None) -> list[str]:
    """What is done once the arm stands: a load is named where the programme waits for it, never before a move."""
    if pause is not None:
        return [*([f"! load {plain(load)}"] if load else []), f"WaitTime\\InPos,{pause:.2f};"]
    return [*([f"! now hang {plain(load)}", "! take it off before the start"] if load else []), "Stop;"]


_POINT = re.compile(r"\s*LOCAL CONST jointtarget jp(\d+):=\[\[([^\]]*)\],\[([^\]]*)\]\];")
_VISIT = re.compile(r"\s*! pose (\S+) visit (\d+)")
_LOAD = re.compile(r"\s*! (?:now hang|load) (\S+)")
_MOVE = re.compile(r"\s*MoveAbsJ jp(\d+)\\NoEOffs,vmax,fine,(\w+)\\WObj:=(\w+);")
_WAIT = re.compile(r"\s*(?:WaitTime\\InPos,([\d.]+)|(Stop));")


def parse_rapid(text: str) -> Parsed:
    """Read a module that `write_rapid` wrote."""
    robot, speed = re.search(r"^  ! robot (\S+)$", text, re.MULTILINE), re.search(r"VelSet (\d+),", text)
    if not text.startswith("MODULE ") or robot is None or speed is None or "ENDMODULE" not in text:
        raise wrong("is no module of `qsf export`")
    points = {int(m[1]): _angles(m[2], m[3], text) for line in text.splitlines() if (m := _POINT.fullmatch(line))}
    stops, frames = list[Stop](), set[tuple[str, str]]()
    visit: tuple[str, int] = ("", 0)
    for line in text.splitlines():
        if match := _LOAD.fullmatch(line):
            stops[-1] = stops[-1].hanging(match[1])
        elif match := _VISIT.fullmatch(line):
            visit = (match[1], int(match[2]))
        elif match := _MOVE.fullmatch(line):
            if int(match[1]) not in points:
                raise wrong(f"jp{match[1]} has no position")
            stops.append(Stop(*visit, points[int(match[1])], int(speed[1]), 0.0))
            frames.add((match[2], match[3]))
            visit = ("", 0)
        elif match := _WAIT.fullmatch(line):
            stops[-1] = stops[-1].waiting(None if match[2] else float(match[1]))
    if len(frames) != 1:
        raise wrong("has no move, or moves in more than one tool or work object")
    return Parsed(robot[1], tuple(stops), *frames.pop())


def _angles(own: str, beside: str, text: str) -> Array:
    cells = {f"J{k}": v for k, v in enumerate(own.split(","), start=1)}
    cells |= {f"E{k}": v for k, v in enumerate(beside.split(","), start=1)}
    used = sum(v != _UNUSED for v in cells.values())
    return np.deg2rad([float(cells[name]) for name in remarked_axes(text, "!", "J", used)])
