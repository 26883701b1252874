"""A programme in the KUKA robot language: .src with the motion, .dat with the points, in joint angles, and back."""

from __future__ import annotations

import re

import numpy as np

from qsframework.applications.export_readback import Parsed, Stop, bad_name, plain, wrong
from qsframework.applications.programme import Programme
from qsframework.errors import InputError, Problem

_JOINTS = 6


def write_krl(programme: Programme, name: str) -> tuple[str, str]:
    """The .src and the .dat. `name` is the module's name: a letter, then letters, digits and _, up to 24."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,23}", name):
        raise bad_name(name, "a letter, then letters, digits and _, up to 24, for the file bears the module's name")
    if len(programme.moves[0].pendant) != _JOINTS:
        raise InputError(Problem("KRL states the six axes A1 to A6", found=f"{len(programme.moves[0].pendant)} joints"))
    payload = "not stated" if programme.payload is None else f"{programme.payload:g} kg"
    src = [
        "&ACCESS RVP",
        "&REL 1",
        f"DEF {name}( )",
        f";robot {programme.robot}",
        f";payload {payload}",
        ";set the load data of tool and weight before the start",
        ";no weight while the arm moves",
        "DECL INT K",
        "BAS(#INITMOV,0)",
        f"FOR K=1 TO {_JOINTS}",
        f"$VEL_AXIS[K]={programme.speed}",
        "ENDFOR",
        "PTP $AXIS_ACT",
    ]
    dat = ["&ACCESS RVP", "&REL 1", f"DEFDAT {name}"]
    for i, move in enumerate(programme.moves, start=1):
        if move.measured:
            src.append(f";pose {move.pose} visit {move.repeat}")
        src.append(f"PTP XP{i}")
        if move.measured:
            src += _stopped(move.load, programme.pause)
        axes = [f"A{k} {value:.3f}" for k, value in enumerate(np.rad2deg(move.pendant) + 0.0, start=1)]
        axes += [f"E{k} 0.0" for k in range(1, _JOINTS + 1)]
        dat.append(f"DECL E6AXIS XP{i}={{{','.join(axes)}}}")
    return "\n".join([*src, "END"]) + "\n", "\n".join([*dat, "ENDDAT"]) + "\n"


def _stopped(load: str, pause: float | None) -> list[str]:
    """What is done once the arm stands: a load is named where the programme waits for it, never before a move."""
    if pause is not None:
        return [*([f";load {plain(load)}"] if load else []), f"WAIT SEC {pause:.2f}"]
    return [*([f";now hang {plain(load)}", ";take it off before the start"] if load else []), "HALT"]


_POINT = re.compile(r"DECL E6AXIS XP(\d+)=\{([^}]*)\}")
_VISIT = re.compile(r";pose (\S+) visit (\d+)")
_LOAD = re.compile(r";(?:now hang|load) (\S+)")


def parse_krl(src: str, dat: str) -> Parsed:
    """Read a pair of files that `write_krl` wrote."""
    robot, speed = re.search(r"^;robot (\S+)$", src, re.MULTILINE), re.search(r"\$VEL_AXIS\[K\]=(\d+)", src)
    if robot is None or speed is None:
        raise wrong("is no module of `qsf export`")
    points = {
        int(m[1]): np.deg2rad([float(v) for v in re.findall(r"A\d (-?[\d.]+)", m[2])]) for m in _POINT.finditer(dat)
    }
    stops: list[Stop] = []
    visit: tuple[str, int] = ("", 0)
    for line in src.splitlines():
        if match := _LOAD.fullmatch(line):
            stops[-1] = stops[-1].hanging(match[1])
        elif match := _VISIT.fullmatch(line):
            visit = (match[1], int(match[2]))
        elif match := re.fullmatch(r"PTP XP(\d+)", line):
            if int(match[1]) not in points:
                raise wrong(f"XP{match[1]} has no position in the .dat")
            stops.append(Stop(*visit, points[int(match[1])], int(speed[1]), 0.0))
            visit = ("", 0)
        elif match := re.fullmatch(r"WAIT SEC ([\d.]+)", line):
            stops[-1] = stops[-1].waiting(float(match[1]))
        elif line == "HALT":
            stops[-1] = stops[-1].waiting(None)
    return Parsed(robot[1], tuple(stops))
