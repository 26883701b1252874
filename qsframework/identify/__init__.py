"""From readings to parameters."""

from typing import TYPE_CHECKING

from qsframework.estimation import METHODS, FitOptions
from qsframework.lazily import lazily

if TYPE_CHECKING:
    from qsframework.identify.fit import Estimate, Fit, Masked, State
    from qsframework.identify.identify import identify, masked_words
    from qsframework.identify.io import StoredFit, read_fit, write_fit, write_nominal
    from qsframework.identify.selection import LeftAside
    from qsframework.identify.validate import Validation, validate, validate_halves

__all__ = [
    "METHODS",
    "Estimate",
    "Fit",
    "FitOptions",
    "LeftAside",
    "Masked",
    "State",
    "StoredFit",
    "Validation",
    "identify",
    "masked_words",
    "read_fit",
    "validate",
    "validate_halves",
    "write_fit",
    "write_nominal",
]
__getattr__ = lazily(
    __name__,
    {
        "fit": "Estimate Fit Masked State",
        "identify": "identify masked_words",
        "io": "StoredFit read_fit write_fit write_nominal",
        "selection": "LeftAside",
        "validate": "Validation validate validate_halves",
    },
)
