"""What a method of identification found, before it is told."""

from __future__ import annotations

from dataclasses import dataclass

from qsframework.estimation import Observations, Solution
from qsframework.experiment import Bridge
from qsframework.identify.selection import LeftAside
from qsframework.plugin import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Found:
    """What a method found: the bridge at its values, the solution, and what it left aside.

    covariance (p, p) of noise of the stated size; solved: the observations of the solution, weak holds included
    """

    seen: Bridge
    solution: Solution
    covariance: Array
    method: str
    left: tuple[LeftAside, ...] = ()
    notes: tuple[str, ...] = ()
    solved: Observations | None = None
