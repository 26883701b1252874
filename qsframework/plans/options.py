"""What a plan is to be, besides the number of its poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from qsframework.option import Option, Options

STARTS = 30

Order = Annotated[
    str, Option("random (separates drift), shortest, or as in the plan.", choices=("shortest", "random", "plan"))
]
RepeatShare = Annotated[float, Option("Fraction of the poses visited twice.", least=0, most=1)]

CriterionName = Annotated[
    str,
    Option(
        "I: mean error of the tip after compensation; D, A, O3: of the parameters; Ds, L: of those of interest.",
        group="Criterion",
        choices=("I", "D", "A", "O3", "Ds", "L"),
        gone=(("E", "A weighs all directions."), ("G", "I speaks of the tip.")),
    ),
]


@dataclass(frozen=True, kw_only=True)
class DesignOptions(Options):
    """What is asked of a plan besides the number of its poses."""

    budget: Annotated[
        float | None, Option("Total cost instead of a number of poses, by the loads' `cost`.", group="Plan")
    ] = None
    repeats: Annotated[bool, Option("Allow a pose to be measured more than once.")] = False
    criterion: CriterionName = "I"
    interest: Annotated[tuple[str, ...], Option("A parameter of interest for Ds and L.")] = ()
    free: Annotated[bool, Option("Plan as if nothing were known of the parameters before the readings.")] = False
    samples: Annotated[int, Option("Draws of the parameters that the plan must serve.", least=1, most=1000)] = 1
    efficiency: Annotated[float, Option("Efficiency that must be certified.", group="Search", least=0.0, most=1.0)] = (
        0.9999
    )
    solver: Annotated[str, Option("'columns', or 'cvxpy' as the reference.", choices=("columns", "cvxpy"))] = "columns"
    polish: Annotated[bool, Option("Refine the angles continuously, off the candidates.")] = True
    starts: int = STARTS
    """Of the exchange."""
