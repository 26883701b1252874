"""From readings to parameters."""

from qsframework.identify.absolute import PositionFit, identify_positions
from qsframework.identify.fit import Estimate, Fit
from qsframework.identify.identify import METHODS, identify

__all__ = ["METHODS", "Estimate", "Fit", "PositionFit", "identify", "identify_positions"]
