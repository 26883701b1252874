"""What the model gets wrong, which cause explains it, and what the extended model gains."""

from qsframework.diagnose.diagnose import LEVEL, STEPS, diagnose
from qsframework.diagnose.linearization.candidates import Cause, find_causes
from qsframework.diagnose.result import Diagnosis, Errors, Leftover, Line, NamedCause, Rival, Value

__all__ = [
    "LEVEL",
    "STEPS",
    "Cause",
    "Diagnosis",
    "Errors",
    "Leftover",
    "Line",
    "NamedCause",
    "Rival",
    "Value",
    "diagnose",
    "find_causes",
]
