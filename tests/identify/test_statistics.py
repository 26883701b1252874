"""Coverage of the intervals: a smaller version of docs/statistics.md, judged by the binomial's own spread."""

from __future__ import annotations

import numpy as np
import pytest
from make_statistics import CASES, Case, campaigns, mean_squares

COUNT = 400
HOLDS = [c for c in CASES if c.covariance and c.modelled and c.nominal == 1.0]


def mean_coverage(case: Case, count: int) -> tuple[float, float]:
    """Coverage over all parameters, and its sd from campaign to campaign (the parameters of one are correlated)."""
    inside = campaigns(case, count)[0].mean(axis=1)
    return float(inside.mean()), float(inside.std() / np.sqrt(count))


@pytest.mark.parametrize("case", HOLDS, ids=lambda c: c.name)
def test_intervals_cover_what_they_say(case: Case) -> None:
    coverage, spread = mean_coverage(case, COUNT if not case.within else COUNT // 4)
    assert abs(coverage - 0.95) < 0.015 + 3.0 * spread
    assert spread < 0.02  # enough campaigns to mean it


def test_a_wrong_nominal_does_not_matter() -> None:
    case = next(c for c in CASES if c.nominal == 2.0)
    coverage, spread = mean_coverage(case, 40)
    assert abs(coverage - 0.95) < 0.015 + 3.0 * spread


def test_an_ignored_reference_costs_coverage() -> None:
    case = next(c for c in CASES if not c.covariance)
    coverage, spread = mean_coverage(case, COUNT)
    assert coverage + 3.0 * spread < 0.90


def test_an_ignored_error_within_a_pose_costs_coverage() -> None:
    case = next(c for c in CASES if not c.modelled)
    coverage, spread = mean_coverage(case, COUNT)
    assert coverage + 3.0 * spread < 0.92


def test_one_step_and_two() -> None:
    """The same with three angles; within 2 % weighted and worse unweighted with more."""
    weighted, plain = mean_squares(50, 3)
    assert np.allclose(weighted, 1.0, rtol=1e-6)
    assert np.allclose(plain, 1.0, rtol=1e-6)
    weighted, plain = mean_squares(1500, 6)
    assert np.all(np.abs(weighted - 1.0) < 0.02)
    assert np.all(plain > 1.3)
