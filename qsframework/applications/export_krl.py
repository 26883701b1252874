"""A programme in the KUKA robot language: .src with the motion, .dat with the points, in joint angles."""

from __future__ import annotations

import re

import numpy as np

from qsframework.applications.controller_names import MOST, axes_remark, axis_names, bad_name, plain, six_axes
from qsframework.applications.programme import Programme


def write_krl(programme: Programme, name: str) -> tuple[str, str]:
    """The .src and the .dat. `name` is the module's name: a letter, then letters, digits and _, up to 24."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,23}", name):
        raise bad_name(name, "a letter, then letters, digits and _, up to 24, for the file bears the module's name")
    count = len(programme.moves[0].pendant)
    six_axes(count, programme.external, "KRL")
    names = axis_names(count, programme.external, "A")
    payload = "not stated" if programme.payload is None else f"{programme.payload:g} kg"
    src = [
        "&ACCESS RVP",
        "&REL 1",
        f"DEF {name}( )",
        f";robot {programme.robot}",
        f";payload {payload}",
        *([f";{remark}"] if (remark := axes_remark(names, "A")) else []),
        ";set the load data of tool and weight before the start",
        ";no weight while the arm moves",
        "DECL INT K",
        "BAS(#INITMOV,0)",
        f"BAS(#TOOL,{programme.tool})",
        f"BAS(#BASE,{programme.frame})",
        f"FOR K=1 TO {MOST}",
        f"$VEL_AXIS[K]={programme.speed}",
        "ENDFOR",
        *(f"$VEL_EXTAX[{k}]={programme.speed}" for k in range(1, len(programme.external) + 1)),
        "PTP $AXIS_ACT",
    ]
    dat = ["&ACCESS RVP", "&REL 1", f"DEFDAT {name}"]
    for i, move in enumerate(programme.moves, start=1):
        if move.measured:
            src.append(f";pose {move.pose} visit {move.repeat}")
        src.append(f"PTP XP{i}")
        if move.measured:
            src += _stopped(move.load, programme.pause)
        degrees = dict(zip(names, np.rad2deg(move.pendant) + 0.0, strict=True))
        axes = [f"{a} {degrees[a]:.4f}" if a in degrees else f"{a} 0.0" for a in _AXES]
        dat.append(f"DECL E6AXIS XP{i}={{{','.join(axes)}}}")
    return "\n".join([*src, "END"]) + "\n", "\n".join([*dat, "ENDDAT"]) + "\n"


def _stopped(load: str, pause: float | None) -> list[str]:
    """What is done once the arm stands: a load is named where the programme waits for it, never before a move."""
    if pause is not None:
        return [*([f";load {plain(load)}"] if load else []), f"WAIT SEC {pause:.2f}"]
    return [*([f";now hang {plain(load)}", ";take it off before the start"] if load else []), "HALT"]


_AXES = tuple(f"{letter}{k}" for letter in "AE" for k in range(1, MOST + 1))
