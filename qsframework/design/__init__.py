"""Measurement poses: candidates, criteria, relaxed and exact designs."""

from typing import TYPE_CHECKING

from qsframework.lazily import lazily

if TYPE_CHECKING:
    from qsframework.design.candidates import (
        Candidates,
        broken_constraints,
        check_poses,
        filter_candidates,
        generate_candidates,
        grid_candidates,
        read_candidates,
    )
    from qsframework.design.catalogue import CRITERIA, TITLES, find_criterion
    from qsframework.design.certified import Wish
    from qsframework.design.design import design
    from qsframework.design.problem import joint_sd
    from qsframework.design.symmetry import equivalent_poses

__all__ = [
    "CRITERIA",
    "TITLES",
    "Candidates",
    "Wish",
    "broken_constraints",
    "check_poses",
    "design",
    "equivalent_poses",
    "filter_candidates",
    "find_criterion",
    "generate_candidates",
    "grid_candidates",
    "joint_sd",
    "read_candidates",
]
__getattr__ = lazily(
    __name__,
    {
        "candidates": "Candidates broken_constraints check_poses filter_candidates generate_candidates grid_candidates "
        "read_candidates",
        "catalogue": "CRITERIA TITLES find_criterion",
        "certified": "Wish",
        "design": "design",
        "problem": "joint_sd",
        "symmetry": "equivalent_poses",
    },
)
