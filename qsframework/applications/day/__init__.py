"""The measuring day: what comes next, whether a reading is as expected, and what the readings tell so far."""

from qsframework.applications.day.day import Day, Judged, begin, decide, enter
from qsframework.applications.day.judge import Check, StateVerdict
from qsframework.applications.day.mistakes import Explanation
from qsframework.applications.day.record import Record, Slot

__all__ = ["Check", "Day", "Explanation", "Judged", "Record", "Slot", "StateVerdict", "begin", "decide", "enter"]
