"""What else could be true of a table of readings, or of the arm: one record for every provider, before it is judged."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from typing import Self

from qsframework.estimation.projection import Flags
from qsframework.experiment import Experiment, Readings
from qsframework.hypotheses.catalogue.rows import among, file_of
from qsframework.plugin import Indices


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Another reading of the table, or another arm, with what it asks for.

    name: the parameter of a joint's shown angle, `joint_sign[joint_2]` or another kind of docs/diagnose.md, of single
    rows with their pose; or a structure, such as `loop absent: parallelogram[joint_3]`
    value: what a coupling is fixed at, the factor of a unit, else 1
    experiment, readings: with it applied
    rows: lines of the file, none for all; file: its name, where there are several; mask (R,): rows that should not be
    used as they stand
    column: without its unit; found, meant: SI, in that column of one pose, else NaN
    kinds: of hypotheses that mend the readings about as well, its own first; none: its name
    structure: whether the arm itself is another one
    hides: whether it scatters every visit and cannot be undone, so that no cause can be identified beside it
    free: numbers that it fits to the readings; tried: hypotheses that it is among, as likely before any reading;
    shrunk: log of how much smaller it makes numbers, and all misfits with them
    """

    name: str
    value: float
    words: str
    experiment: Experiment
    _: KW_ONLY
    readings: Readings
    rows: tuple[int, ...] = ()
    file: str = ""
    mask: Flags | None = None
    column: str = ""
    found: float = float("nan")
    meant: float = float("nan")
    kinds: tuple[str, ...] = ()
    structure: bool = False
    hides: bool = False
    free: int = 0
    tried: int = 1
    shrunk: float = 0.0

    def at(self, index: Indices) -> Self:
        """The same of some rows (k,) of the readings."""
        rows = tuple(sorted({int(line) for line in self.readings.line[index]}))
        return replace(self, rows=rows, file=file_of(self.readings, index), mask=among(self.readings, index))

    @property
    def title(self) -> str:
        """Its name as people read it."""
        return self.name.replace("_", " ")
