"""From readings to parameters."""

from qsframework.identify.fit import Estimate, Fit
from qsframework.identify.linear import identify

__all__ = ["Estimate", "Fit", "identify"]
