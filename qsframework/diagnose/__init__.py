"""What the model gets wrong, which cause explains it, and what the extended model gains."""

from qsframework.diagnose.causes import Cause, find_causes
from qsframework.diagnose.diagnosis import LEVEL, STEPS, diagnose
from qsframework.diagnose.discriminate import Discrimination, discriminate
from qsframework.diagnose.foresight import Foresight
from qsframework.diagnose.power import foresee
from qsframework.diagnose.result import Diagnosis, Errors, Finding, Leftover, Line, Rival, Value
from qsframework.diagnose.second_day import SecondDay, second_day

__all__ = [
    "LEVEL",
    "STEPS",
    "Cause",
    "Diagnosis",
    "Discrimination",
    "Errors",
    "Finding",
    "Foresight",
    "Leftover",
    "Line",
    "Rival",
    "SecondDay",
    "Value",
    "diagnose",
    "discriminate",
    "find_causes",
    "foresee",
    "second_day",
]
