"""What a user chooses in the applications: records for the commands and for Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from qsframework.option import Option, Options

if TYPE_CHECKING:
    from qsframework.plugin import Array

Reference = Annotated[
    str,
    Option(
        "Reference of the target: the rigid ('commanded') or the 'unloaded' arm.", choices=("commanded", "unloaded")
    ),
]


@dataclass(frozen=True, kw_only=True)
class ProgrammeOptions(Options):
    """What a programme does not say.

    loads: (6,) N and N m of each point, "" for all others; keep: points and motions to leave as they are; tools,
    frames: (6,) as the controller shows them, by their names or by a point's; start (m,) rad or nothing: where the
    search for the joint angles of Cartesian points begins
    """

    loads: Annotated[
        Mapping[str, Array],
        Option("Of a programme: fx,fy,fz[,mx,my,mz], or NAME=... of one point.", name="load"),
    ] = field(default_factory=dict[str, "Array"])
    keep: Annotated[
        tuple[str, ...],
        Option("Leave this point, or the motion in 'line N' of the file, uncorrected; refused: all refused ones."),
    ] = ()
    tools: Annotated[
        Mapping[str, Array],
        Option("Of a programme's poses: N=X,Y,Z,... of tool (or point) N on the flange.", name="tool"),
    ] = field(default_factory=dict[str, "Array"])
    frames: Annotated[
        Mapping[str, Array],
        Option("N=X,Y,Z,... of user frame (or point) N in the base frame, as the controller has it.", name="frame"),
    ] = field(default_factory=dict[str, "Array"])
    start: Annotated[Array | None, Option("Pendant angles, deg, from which those of the first pose are searched.")] = (
        None
    )
