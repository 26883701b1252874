"""What a plan would detect and name, before anything is measured."""

from qsframework.forecast.forecast import Foresight
from qsframework.forecast.power import foresee

__all__ = ["Foresight", "foresee"]
