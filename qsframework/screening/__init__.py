"""What is wrong with a table of readings: mistakes, rows that cannot be right, gross errors."""

from qsframework.screening.check import find_mistakes
from qsframework.screening.mistake import SUSPECTED, Mistake, adopted
from qsframework.screening.outliers import SHARE, find_outliers, told_outliers
from qsframework.screening.rows import LEVEL, Finding, masked

__all__ = [
    "LEVEL",
    "SHARE",
    "SUSPECTED",
    "Finding",
    "Mistake",
    "adopted",
    "find_mistakes",
    "find_outliers",
    "masked",
    "told_outliers",
]
