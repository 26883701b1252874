"""A programme in the KUKA robot language: .src with the motion, .dat with the points, in joint angles."""

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


def write_krl(programme: Programme, name: str) -> tuple[str, str]:
    """The .src and the .dat. `name` is the module's name: a letter, then letters, digits and _, up to 24."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,23}", name):
        raise bad_name(name, "a letter, then letters, digits and _, up to 24, for the file bears the module's name")
    names, remarks = arm_axes(len(programme.moves[0].pendant), programme.external, "A", "KRL")
    src = [
        "&ACCESS RVP",
        "&REL 1",
        f"DEF {name}( )",
        f";robot {programme.robot}",
        f";{payload_text(programme.payload)}",
        *(f";{remark}" for remark in remarks),
        *(
            f";{remark}"
            for remark in weight_remarks(programme.loaded, "set the load data of tool and weight before the start")
        ),
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
            wait = f"WAIT SEC {programme.pause or 0:.2f}"
            src += stopped(plain(move.load), plain(move.station), programme.pause, ";", wait, "HALT")
        degrees = dict(zip(names, np.rad2deg(move.pendant) + 0.0, strict=True))
        axes = [f"{a} {degrees[a]:.4f}" if a in degrees else f"{a} 0.0" for a in _AXES]
        dat.append(f"DECL E6AXIS XP{i}={{{','.join(axes)}}}")
    return "\n".join([*src, "END"]) + "\n", "\n".join([*dat, "ENDDAT"]) + "\n"


_AXES = tuple(f"{letter}{k}" for letter in "AE" for k in range(1, MOST + 1))
