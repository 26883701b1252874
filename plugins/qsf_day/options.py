"""How the poses of a plan are visited and read, and the files of a measuring day."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from qsframework.cli import ExperimentFile, PlanFile
from qsframework.option import Option, Options, Seed
from qsframework.plans.options import Order, RepeatShare


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
class DayFiles:
    """The folder of the session; watch: a folder of the tracker's files."""

    experiment: ExperimentFile
    plan: PlanFile
    folder: Annotated[
        Path, Option("The folder of the session; an existing one is resumed.", name="output", short="o")
    ] = Path("day")
    watch: Annotated[Path | None, Option("Read the tracker's exports from this folder instead of the page.")] = None
