"""From readings to parameters."""

from qsframework.identify.absolute import PositionFit, identify_positions
from qsframework.identify.fit import Estimate, Fit
from qsframework.identify.linear import identify

__all__ = ["Estimate", "Fit", "PositionFit", "identify", "identify_positions"]
