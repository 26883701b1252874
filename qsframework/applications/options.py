"""What a user chooses in the applications: records for the commands and for Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from qsframework.option import Option, Options, Seed

if TYPE_CHECKING:
    from qsframework.plugin import Array

ORDERS = ("shortest", "random", "plan")

Order = Annotated[str, Option("random (separates drift), shortest, or as in the plan.", choices=ORDERS)]
RepeatShare = Annotated[float, Option("Fraction of the poses visited twice.", least=0, most=1)]
Reference = Annotated[
    str,
    Option(
        "Reference of the target: the rigid ('commanded') or the 'unloaded' arm.", choices=("commanded", "unloaded")
    ),
]


@dataclass(frozen=True, kw_only=True)
class VisitOptions(Options):
    """How the poses of a plan are visited and read."""

    order: Order = "random"
    cycles: Annotated[int, Option("Loadings at each visit.", least=1, most=10)] = 2
    repeat_share: RepeatShare = 0.2
    drive: Annotated[
        str, Option("What holds the arm during a reading: servo or brake.", choices=("servo", "brake"))
    ] = "servo"
    reflectors: Annotated[int, Option("Reflectors fixed to the floor.", least=0, most=20)] = 3
    half: Annotated[bool, Option("Also half the load at repeated poses, to test linearity.")] = True
    seed: Seed = 0


@dataclass(frozen=True, kw_only=True)
class ProtocolOptions(VisitOptions):
    """How the poses of a plan are visited and read, and how long one waits."""

    settle: Annotated[float, Option("Wait before a reading, s.", least=0, most=3600)] = 30.0
    warm_up: Annotated[float, Option("Warm-up, minutes.", least=0, most=600)] = 30.0


@dataclass(frozen=True, kw_only=True)
class ExportOptions(Options):
    """How a plan is driven, and the controller's names; home: pendant angles, as a text; hold: instead of a pause."""

    to: Annotated[str, Option("fanuc-ls, krl, rapid, urscript or csv.", group="Programme", shown=False)]
    tool: Annotated[str, Option("Number or name of the controller's tool (default: 1 or tool0).", shown=False)] = ""
    frame: Annotated[str, Option("Number or name of its user frame (default: 0 or wobj0).", shown=False)] = ""
    speed: Annotated[int, Option("Joint speed, percent of the maximum.", group="Motion", least=1, most=100)] = 10
    pause: Annotated[float, Option("Wait at each pose, s.", least=0.01, most=3600)] = 10.0
    hold: Annotated[bool, Option("Wait for the start button instead.")] = False
    home: Annotated[str | None, Option("Pendant angles where the path starts and ends, deg, or mm: J1,J2,...")] = None
    order: Order = "shortest"
    repeat_share: RepeatShare = 0.0
    seed: Seed = 0


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


@dataclass(frozen=True, kw_only=True)
class ImportOptions(Options):
    """What the files of others do not state.

    clock: s, the log's minus the tracker's; align: "", "unloaded" or a file of known points; within: m
    """

    columns: Annotated[
        Mapping[str, str],
        Option("Such as x=Xcoord, or x=3 where columns have no names.", name="map", form="ROLE=COLUMN"),
    ] = field(default_factory=dict[str, str])
    units: Annotated[tuple[str, ...], Option("Unit of columns that state none: mm, in, deg, ms.", name="unit")] = ()
    names: Annotated[
        Mapping[str, str],
        Option("In names, such as WITH=loaded or ball1=m1.", name="word", form="FOUND=MEANT"),
    ] = field(default_factory=dict[str, str])
    sheet: Annotated[str, Option("Which sheet of a workbook.")] = ""
    separator: Annotated[
        str,
        Option(
            "Column separator: ',', ';', '|', tab or space (default: detected).",
            choices=("", ",", ";", "|", "tab", "space"),
        ),
    ] = ""
    decimal: Annotated[str, Option("Decimal sign: '.' or ',' (default: detected).", choices=("", ".", ","))] = ""
    match: Annotated[
        str,
        Option(
            "Match points by names, by order (of the plan) or nearest.",
            group="Points",
            choices=("names", "order", "nearest"),
        ),
    ] = "names"
    join: Annotated[
        str, Option("Match the joint log by names, by order or by time.", choices=("", "names", "order", "time"))
    ] = ""
    state: Annotated[
        str, Option("State of points that carry none: unloaded or loaded.", choices=("", "unloaded", "loaded"))
    ] = ""
    series: Annotated[str, Option("Name of the tracker's station.")] = ""
    ignore: Annotated[tuple[str, ...], Option("Ignore these points, such as 'B*', or a column.")] = ()
    clock: Annotated[float, Option("Seconds by which the log's clock is ahead of the tracker's.")] = 0.0
    align: Annotated[
        str, Option("Tracker to base: from the 'unloaded' readings, or a file of known points, base frame.")
    ] = ""
    within: Annotated[
        float,
        Option("Largest distance of a point from its predicted place, mm.", least=1e-3, most=1e5, unit="mm"),
    ] = 0.05
