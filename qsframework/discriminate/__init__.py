"""Poses and other readings that tell two causes apart, and the second day of measuring them."""

from qsframework.discriminate.follow_up import SecondDay, second_day
from qsframework.discriminate.pair import Discrimination, discriminate

__all__ = ["Discrimination", "SecondDay", "discriminate", "second_day"]
