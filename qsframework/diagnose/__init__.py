"""What the model gets wrong, which cause explains it, and what the extended model gains."""

from qsframework.diagnose.diagnose import LEVEL, STEPS, diagnose
from qsframework.diagnose.linearization.candidates import Cause, find_causes
from qsframework.diagnose.result import AlternativeCause, Diagnosis, Errors, Leftover, Line, NamedCause, Value

__all__ = [
    "LEVEL",
    "STEPS",
    "AlternativeCause",
    "Cause",
    "Diagnosis",
    "Errors",
    "Leftover",
    "Line",
    "NamedCause",
    "Value",
    "diagnose",
    "find_causes",
]
