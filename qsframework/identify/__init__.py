"""From readings to parameters."""

from qsframework.identify.absolute import PositionFit, identify_positions
from qsframework.identify.fit import Estimate, Fit, Masked
from qsframework.identify.fit_files import StoredFit, read_fit, write_fit, write_nominal
from qsframework.identify.hygiene import Finding, check_readings, masked, said_of
from qsframework.identify.identify import METHODS, identify
from qsframework.identify.joint import Choices, identify_jointly
from qsframework.identify.state_hygiene import check_positions

__all__ = [
    "METHODS",
    "Choices",
    "Estimate",
    "Finding",
    "Fit",
    "Masked",
    "PositionFit",
    "StoredFit",
    "check_positions",
    "check_readings",
    "identify",
    "identify_jointly",
    "identify_positions",
    "masked",
    "read_fit",
    "said_of",
    "write_fit",
    "write_nominal",
]
