"""How a plan is driven."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from qsframework.option import Option, Options, Seed
from qsframework.plans.options import Order, RepeatShare


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
