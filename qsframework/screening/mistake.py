"""What is wrong with a table of readings: one record for all that is found, whoever asks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qsframework.estimation.projection import Flags
from qsframework.experiment import Experiment, Readings

SUSPECTED = ("load_unit", "load_payload")
"""Names of what is told and never applied: no fit can prove it."""


@dataclass(frozen=True)
class Moved:
    """A parameter that a mistake moved: its value with and without it, SI."""

    name: str
    unit: str
    before: float
    after: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Mistake:
    """What is wrong with a table or with how it was read: another reading of it, applied and refitted, or single rows.

    name: the parameter of a joint's shown angle, `joint_sign[joint_2]` or another kind of docs/diagnose.md, of single
    rows with their pose; or a structure, such as `loop absent: parallelogram[joint_3]`
    value: what a coupling is fixed at, the factor of a unit, else 1
    experiment, readings: with it applied
    rms, rms_given: m, of the fits with it and as given; NaN where no two fits were compared
    evidence: log of how much likelier it makes the readings, the number of alternatives counted; NaN likewise
    below: compliances that the fit puts below their bounds; structure: whether the arm itself is another one
    rows: lines of the file, none for all; file: its name, where there are several; mask (R,): rows that should not be
    used as they stand
    kinds: of mistakes that mend the readings about as well, its own first
    column: without its unit; found, meant: SI, in that column of one pose, else NaN
    moved: the parameters that change most with it
    hides: whether it scatters every visit and cannot be undone, so that no cause can be identified beside it
    Only a compelling one is to be believed; a `load_unit` never is, because the compliances absorb it.
    """

    name: str
    value: float
    words: str
    experiment: Experiment
    readings: Readings
    rms: float
    rms_given: float
    evidence: float
    below: int
    compelling: bool
    structure: bool = False
    rows: tuple[int, ...] = ()
    file: str = ""
    kinds: tuple[str, ...] = ()
    column: str = ""
    found: float = float("nan")
    meant: float = float("nan")
    moved: tuple[Moved, ...] = ()
    hides: bool = False
    mask: Flags | None = None

    @property
    def told(self) -> bool:
        """Whether it is worth a line: beyond doubt, suspected, or about single rows."""
        return self.compelling or self.name in SUSPECTED or self.mask is not None

    @property
    def title(self) -> str:
        """Its name as people read it."""
        return self.name.replace("_", " ")


def adopted(found: Sequence[Mistake]) -> tuple[Mistake, ...]:
    """The conventions and mistakes that are beyond doubt, in the order in which they were applied: the last one holds
    the readings with all of them. None where the readings are right as given."""
    return tuple(c for c in found if c.compelling)


def compelling(found: Sequence[Mistake]) -> Mistake | None:
    """The first convention that is beyond doubt, None where the readings are right as given."""
    return next(iter(adopted(found)), None)
