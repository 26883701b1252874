"""The second day: visits and mounts that settle what a diagnosis leaves open."""

from qsframework.discriminate.follow_up import FollowUp, follow_up

__all__ = ["FollowUp", "follow_up"]
