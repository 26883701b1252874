"""What a plan would detect and name, before anything is measured."""

from qsframework.forecast.forecast import Foresight
from qsframework.forecast.power import forecast

__all__ = ["Foresight", "forecast"]
