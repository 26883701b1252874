"""What is wrong with a table of readings: a hypothesis that was judged, whoever asks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qsframework.experiment.finding import Finding
from qsframework.hypotheses.hypothesis import Hypothesis

FILES = "robot"
"""In place of a file of readings: the robot's own."""
_MENDS = {
    "load_unit": (
        "Correct the unit in the table's header, or the loads; where they are right, so are the compliances: make them "
        "the robot's nominal values (nominal.yaml, which `qsf identify` writes)."
    ),
    "load_payload": "Correct the forces, or payload_kg in robot.yaml.",
    FILES: "Correct the robot's files.",
}
STAND_OUT = ("gross", "small model", "tool", "repeated_readings")
"""Names of rows that stand out, as noise with heavy tails makes them, or equal others: said, and no reason to stop."""
_ROWS = "Correct the rows, have them left out (clean), or say that they are right (keep-all)."
_TABLE = "Correct the table, or how it is read."


@dataclass(frozen=True)
class Moved:
    """A parameter that a mistake moved: its value with and without it, SI."""

    name: str
    unit: str
    before: float
    after: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Mistake(Hypothesis):
    """A hypothesis of the table or of the arm beside the readings as given; single rows are told without two fits.

    rms, rms_given: m, of the fits with it and as given; NaN where no two fits were compared
    evidence: log of how much likelier it makes the readings, the number of alternatives counted; NaN likewise
    below: compliances that the fit puts below their bounds
    moved: the parameters that change most with it
    stops: whether what uses a fit stops there, or notes it

    Only a compelling one is to be believed; a `load_unit` never is, because the compliances absorb it.
    """

    rms: float = float("nan")
    rms_given: float = float("nan")
    evidence: float = float("nan")
    below: int = 0
    compelling: bool = False
    moved: tuple[Moved, ...] = ()
    stops: bool = True

    @property
    def finding(self) -> Finding:
        """The same as a fit keeps it: in words, with what to do."""
        by_rows = _ROWS if self.mask is not None else _TABLE
        return Finding(
            self.name,
            self.words,
            _MENDS.get(self._kind, by_rows),
            place=self.file or self.column,
            rows=self.rows,
            evidence=self.evidence,
            stops=self.stops,
        )

    @property
    def _kind(self) -> str:
        return FILES if self.file == FILES else self.name

    @property
    def suspected(self) -> bool:
        """Whether it is told and never applied: no fit can prove it."""
        return self._kind in _MENDS

    @property
    def told(self) -> bool:
        """Whether it is worth a line: beyond doubt, suspected, or about single rows."""
        return self.compelling or self.suspected or self.mask is not None


def adopted(found: Sequence[Mistake]) -> tuple[Mistake, ...]:
    """The conventions and mistakes that are beyond doubt, in the order in which they were applied: the last one holds
    the readings with all of them. None where the readings are right as given."""
    return tuple(c for c in found if c.compelling)
