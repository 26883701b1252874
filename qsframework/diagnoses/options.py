"""What is asked of a diagnosis, and of the poses that would decide what it leaves open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from qsframework.option import Option, Options, Seed

LEVEL = 0.02
LIBRARY_SHARE = 0.6
"""Of the level that the test of the library gets; that for remaining signal gets the rest."""


def seen_below(level: float) -> float:
    """p-value from which down a cause of the library is seen, everywhere: with this share of the level at most 3 % of
    clean campaigns raised an alarm, the test for remaining signal included."""
    return LIBRARY_SHARE * level


Level = Annotated[float, Option("False-alarm probability.", group="Diagnosis")]


@dataclass(frozen=True, kw_only=True)
class DiagnoseOptions(Options):
    """How to diagnose, and which visits of a second day to plan."""

    level: Level = LEVEL
    follow_up: Annotated[
        int,
        Option(
            "Plan N visits of a second day that decide what is open.",
            group="Further poses",
            form="N",
            least=0,
            most=1000,
            shown=False,
        ),
    ] = 0
    without: Annotated[
        tuple[str, ...],
        Option("A link that nobody can mount a reflector on (world: the floor; gauges: no dial gauge).", form="LINK"),
    ] = ()
    count: Annotated[int, Option("Visits that are judged where something is open.", least=1, most=1000)] = 8
    seed: Seed = 0
