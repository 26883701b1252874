"""A programme as a URScript function (.script) of Universal Robots, in joint angles.

A joint move takes the speed of the joint that turns farthest, in rad/s: the share is of 120 deg/s, the largest of the
slowest joints that the maker has.
"""

from __future__ import annotations

import re

import numpy as np

from qsframework.applications.controller_names import bad_name, payload_text, plain, stopped, weight_remarks
from qsframework.applications.programme import Move, Programme
from qsframework.errors import InputError, Problem

_JOINTS = 6
_FASTEST = float(np.deg2rad(120.0))
_PAYLOAD = "set the payload and its centre of gravity, of tool and weight, before the start"
_ACCELERATION = 0.5
"""rad/s^2, of the joint that turns farthest."""


def write_urscript(programme: Programme, name: str) -> str:
    """The script. `name` is the function's name: a letter, then letters, digits and _, up to 32."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,31}", name):
        raise bad_name(name, "a letter, then letters, digits and _, up to 32")
    count = len(programme.moves[0].pendant)
    if count != _JOINTS or programme.external:
        found = f"{count} joints, {len(programme.external)} of them external"
        words = "URScript states the six joints of the arm"
        raise InputError(Problem(words, found=found, allowed="6 joints", argument=("to", "csv")))
    lines = [
        f"def {name}():",
        f"  # robot {programme.robot}",
        f"  # {payload_text(programme.payload)}",
        f"  # speed {programme.speed} percent of {np.rad2deg(_FASTEST):g} deg/s",
        "  # tool and frame: joint angles need none; set_tcp stays as the installation has it",
        *(f"  # {remark}" for remark in weight_remarks(programme.loaded, _PAYLOAD)),
    ]
    velocity = f"{_FASTEST * programme.speed / 100.0:.5f}"
    for move in programme.moves:
        if move.measured:
            lines.append(f"  # pose {move.pose} visit {move.repeat}")
        angles = ", ".join(f"{v + 0.0:.7f}" for v in move.pendant)
        lines.append(f"  movej([{angles}], a={_ACCELERATION}, v={velocity})")
        if move.measured:
            wait = f"sleep({programme.pause or 0:.2f})"
            said = (plain(move.load), plain(move.station))
            lines += [f"  {line}" for line in stopped(*said, programme.pause, "# ", wait, _ask(move))]
    return "\n".join([*lines, "end"]) + "\n"


def _ask(move: Move) -> str:
    load = f"now hang {plain(move.load)}, take it off before you continue" if move.load else "nothing hangs here"
    tracker = f"tracker at {plain(move.station)}, " if move.station else ""
    return f'popup("{move.pose} visit {move.repeat}: {tracker}{load}", title="measure", blocking=True)'
