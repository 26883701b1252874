"""Poses and other readings that tell causes apart, and the second day of measuring them."""

from qsframework.discriminate.follow_up import FollowUp, follow_up
from qsframework.discriminate.pair import Discrimination, discriminate

__all__ = ["Discrimination", "FollowUp", "discriminate", "follow_up"]
