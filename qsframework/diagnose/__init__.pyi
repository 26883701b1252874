from .diagnose import STEPS as STEPS, diagnose as diagnose
from .linearization.candidates import Cause as Cause, find_causes as find_causes
from .options import LEVEL as LEVEL, DiagnoseOptions as DiagnoseOptions
from .result import (
    AlternativeCause as AlternativeCause,
    Diagnosis as Diagnosis,
    Errors as Errors,
    Leftover as Leftover,
    Line as Line,
    NamedCause as NamedCause,
    Value as Value,
)
