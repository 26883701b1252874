"""Measurement poses: candidates, criteria, relaxed and exact designs."""

from qsframework.design.candidates import Candidates, broken_constraints, check_poses, generate_candidates
from qsframework.design.criteria import CRITERIA, find_criterion
from qsframework.design.design import design

__all__ = [
    "CRITERIA",
    "Candidates",
    "broken_constraints",
    "check_poses",
    "design",
    "find_criterion",
    "generate_candidates",
]
