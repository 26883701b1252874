"""What is wrong with a table of readings: mistakes, rows that cannot be right, gross errors."""

from qsframework.hypotheses.catalogue.rows import LEVEL, WrongRows, doubled, masked
from qsframework.hypotheses.outliers import SHARE, find_outliers, told_outliers
from qsframework.screening.check import find_mistakes, find_slips
from qsframework.screening.closure import state_findings
from qsframework.screening.mistake import FILES, STAND_OUT, Mistake, adopted

__all__ = [
    "FILES",
    "LEVEL",
    "SHARE",
    "STAND_OUT",
    "Mistake",
    "WrongRows",
    "adopted",
    "doubled",
    "find_mistakes",
    "find_outliers",
    "find_slips",
    "masked",
    "state_findings",
    "told_outliers",
]
