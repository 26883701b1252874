"""Are the readings what they claim: rows that cannot be right, markers, angles, gross errors."""

from qsframework.screening.check import screen
from qsframework.screening.outliers import SHARE, find_outliers, told_outliers
from qsframework.screening.rows import KINDS, LEVEL, Finding, masked

__all__ = ["KINDS", "LEVEL", "SHARE", "Finding", "find_outliers", "masked", "screen", "told_outliers"]
