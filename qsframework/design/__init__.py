"""Measurement poses: candidates, criteria, relaxed and exact designs."""

from qsframework.design.candidates import Candidates, check_poses, generate_candidates
from qsframework.design.criteria import CRITERIA, find_criterion
from qsframework.design.design import design

__all__ = ["CRITERIA", "Candidates", "check_poses", "design", "find_criterion", "generate_candidates"]
