"""How to fit: one record for every command and every kind of reading."""

from __future__ import annotations

from dataclasses import dataclass

from qsframework.errors import InputError, Problem, nearest
from qsframework.estimation.robust import LOSSES
from qsframework.files import FileRecord

METHODS = ("one-step", "two-step")
SHARED = ("", "pose")


@dataclass(frozen=True, kw_only=True)
class FitOptions(FileRecord):
    """method      "one-step", or "two-step" for an arm with a balancer: its joint angle by angle first
    linear      the load balanced at the undeflected pose, as the paper does; else the full equilibrium
    bounds      keep the parameters' bounds; without them a wrong model shows itself in a value beyond one
    priors      stated values and sds count as readings
    loss        "linear" (squares), "huber" or "soft_l1"
    fixed       parameters that stay at their nominal values
    tied        groups that keep the ratios of their nominal values
    shared      "pose": the markers of a visit share an error, whose sd is estimated (REML)
    profile     parameters whose 95 % profile intervals are wanted
    keep_all    mask no reading, however gross
    starts      more starts for models that bend
    """

    method: str = "one-step"
    linear: bool = False
    bounds: bool = False
    priors: bool = False
    loss: str = "linear"
    fixed: tuple[str, ...] = ()
    tied: tuple[tuple[str, ...], ...] = ()
    shared: str = ""
    profile: tuple[str, ...] = ()
    keep_all: bool = False
    starts: int = 5

    def __post_init__(self) -> None:
        problems: list[Problem] = []
        for what, value, allowed in (
            ("method", self.method, METHODS),
            ("loss", self.loss, LOSSES),
            ("shared error", self.shared, SHARED),
        ):
            if value not in allowed:
                told = ", ".join(a for a in allowed if a)
                problems.append(Problem(f"unknown {what} {value!r}", allowed=told, hint=nearest(value, allowed)))
        grouped = [name for group in self.tied for name in group]
        twice = dict.fromkeys(n for n in grouped if n in self.fixed or grouped.count(n) > 1)
        if twice:
            hint = "A parameter is in one group at most, once, and what is tied is estimated."
            problems.append(Problem(f"tied and fixed, or tied twice: {', '.join(twice)}", hint=hint))
        more = self.bounds or self.priors or self.loss != "linear" or self.tied or self.fixed or self.profile
        if self.method == "two-step" and more:
            problems.append(
                Problem(
                    "the two-step method is plain least squares, twice: bounds, priors, loss, fixed, tied and "
                    "profile are for method one-step"
                )
            )
        if problems:
            raise InputError(problems)


PLAIN = FitOptions()
