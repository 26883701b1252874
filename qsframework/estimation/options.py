"""How to fit: one record for every command and every kind of reading."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from qsframework.errors import Problem
from qsframework.files import FileRecord
from qsframework.option import Option, Options

Linear = Annotated[bool, Option("Balance the load at the undeflected pose, as the paper does.")]


@dataclass(frozen=True, kw_only=True)
class FitOptions(Options, FileRecord):
    """How a fit is made."""

    method: Annotated[
        str,
        Option("one-step, or two-step (a balanced joint angle by angle first).", choices=("one-step", "two-step")),
    ] = "one-step"
    linear: Linear = False
    bounds: Annotated[bool, Option("Keep the parameters' bounds.")] = False
    free: Annotated[bool, Option("Count nothing as known before the readings: classical least squares.")] = False
    loss: Annotated[str, Option("linear, huber or soft_l1.", choices=("linear", "huber", "soft_l1"))] = "linear"
    fixed: Annotated[tuple[str, ...], Option("Hold this parameter at its value.")] = ()
    tied: Annotated[
        tuple[tuple[str, ...], ...], Option("Keep the ratio of their nominal values.", form="NAME,NAME")
    ] = ()
    profile: Annotated[tuple[str, ...], Option("Profile interval, 95 %, of this parameter.")] = ()
    keep_all: Annotated[bool, Option("Mask no reading: outliers are used too.", group="Readings")] = False
    shared: Annotated[
        str,
        Option(
            "Estimate the repeatability error, which the markers of a visit share.",
            name="shared-error",
            choices=("", "pose"),
            switch="pose",
        ),
    ] = ""
    starts: int = 5
    """Further starts for models that bend."""

    def _problems(self) -> list[Problem]:
        """Besides the values, what does not go together."""
        problems = super()._problems()
        if single := [group[0] for group in self.tied if len(group) == 1]:
            hint = "A group of tied parameters has two or more names: tied=((one, other),)."
            problems.append(Problem(f"tied to nothing: {', '.join(single)}", hint=hint))
        grouped = [name for group in self.tied for name in group]
        twice = dict.fromkeys(n for n in grouped if n in self.fixed or grouped.count(n) > 1)
        if twice:
            hint = "A parameter is in one group at most, once, and what is tied is estimated."
            problems.append(Problem(f"tied and fixed, or tied twice: {', '.join(twice)}", hint=hint))
        more = self.bounds or self.loss != "linear" or self.tied or self.fixed or self.profile
        if self.method == "two-step" and more:
            problems.append(
                Problem(
                    "the two-step method is plain least squares, twice: bounds, loss, fixed, tied and "
                    "profile are for method one-step"
                )
            )
        return problems


PLAIN = FitOptions()
