"""What every fit shares: observations and their noise, one solver, projections and statistics. Knows no robot."""

from typing import TYPE_CHECKING

from qsframework.lazily import lazily

if TYPE_CHECKING:
    from qsframework.estimation.noise import Independent, Noise, Scaled, grouped, rounding, shared_error
    from qsframework.estimation.observations import Observations, scales
    from qsframework.estimation.options import METHODS, PLAIN, FitOptions
    from qsframework.estimation.projection import falls, left, orthonormal, without_block
    from qsframework.estimation.rank import RankTest, rank_test
    from qsframework.estimation.solver import Solution, settle, solve
    from qsframework.estimation.statistics import Interval, profile_interval, propagated, rms, shifts, studentised

__all__ = [
    "METHODS",
    "PLAIN",
    "FitOptions",
    "Independent",
    "Interval",
    "Noise",
    "Observations",
    "RankTest",
    "Scaled",
    "Solution",
    "falls",
    "grouped",
    "left",
    "orthonormal",
    "profile_interval",
    "propagated",
    "rank_test",
    "rms",
    "rounding",
    "scales",
    "settle",
    "shared_error",
    "shifts",
    "solve",
    "studentised",
    "without_block",
]
__getattr__ = lazily(
    __name__,
    {
        "noise": "Independent Noise Scaled grouped rounding shared_error",
        "observations": "Observations scales",
        "options": "METHODS PLAIN FitOptions",
        "projection": "falls left orthonormal without_block",
        "rank": "RankTest rank_test",
        "solver": "Solution settle solve",
        "statistics": "Interval profile_interval propagated rms shifts studentised",
    },
)
