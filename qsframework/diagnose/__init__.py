"""What the model gets wrong, which cause explains it, and what the extended model gains."""

from qsframework.diagnose.causes import Cause, find_causes
from qsframework.diagnose.diagnosis import LEVEL, STEPS, diagnose
from qsframework.diagnose.result import Diagnosis, Errors, Finding, Leftover, Line, Rival, Value

__all__ = [
    "LEVEL",
    "STEPS",
    "Cause",
    "Diagnosis",
    "Errors",
    "Finding",
    "Leftover",
    "Line",
    "Rival",
    "Value",
    "diagnose",
    "find_causes",
]
