from .diagnose import STEPS as STEPS, diagnose as diagnose
from .foresight import Foresight as Foresight
from .options import LEVEL as LEVEL, DiagnoseOptions as DiagnoseOptions
from .power import forecast as forecast
from .result import (
    AlternativeCause as AlternativeCause,
    Diagnosis as Diagnosis,
    Errors as Errors,
    Leftover as Leftover,
    Line as Line,
    NamedCause as NamedCause,
    Value as Value,
)
from .second_day import FollowUp as FollowUp, follow_up as follow_up
