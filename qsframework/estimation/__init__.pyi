from .linear_fit import LinearFit as LinearFit
from .noise import (
    Independent as Independent,
    Noise as Noise,
    Scaled as Scaled,
    grouped as grouped,
    rounding as rounding,
)
from .observations import Observations as Observations, scales as scales
from .options import PLAIN as PLAIN, FitOptions as FitOptions
from .projection import left as left, orthonormal as orthonormal
from .rank import RankTest as RankTest, rank_test as rank_test
from .solver import Solution as Solution, sds_at as sds_at, settle as settle, solve as solve
from .statistics import (
    Interval as Interval,
    moments_held as moments_held,
    profile_interval as profile_interval,
    propagated as propagated,
    rms as rms,
)
from .visit_noise import shared_error as shared_error
