"""What is said of estimates from positions that are hardly told, and of parameters that are not told at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.estimation import FitOptions
from qsframework.experiment import load_experiment, read_readings
from qsframework.fits import EstimateState, Fit, identify
from qsframework.fits.estimate import estimate_of
from qsframework.information import NotEstimated
from qsframework.information.selection import choose
from qsframework.plugin import Parameter
from qsframework.report import fit_table
from qsframework.report.fit_section import not_estimated_table
from qsframework.report.words.fit import STATES

UR10 = Path(__file__).parents[2] / "examples" / "ur10"
SPRING = Parameter("joint_compliance[joint_2]", "rad/(N m)", nominal=1e-7, lower=0.0)
PLACE = Parameter("joint_placement[joint_2].x", "m", typical=5e-4)


@pytest.fixture(scope="module")
def series_d() -> Fit:
    experiment = load_experiment(UR10 / "experiment.yaml")
    readings = read_readings(UR10 / "series_d.csv", experiment, "positions")
    return identify(experiment, readings, options=FitOptions(linear=True))


KNOWN = Parameter("joint_compliance[joint_2]", "rad/(N m)", nominal=1e-7, sd=1e-8, lower=0.0)


@pytest.mark.parametrize(
    ("parameter", "value", "sd", "state"),
    [
        (PLACE, 1e-5, 4e-4, EstimateState.UPPER_LIMIT),  # seen to be small
        (PLACE, 8e-4, 7e-4, EstimateState.NOT_IDENTIFIABLE),  # one sd from zero
        (PLACE, 8e-3, 7e-4, EstimateState.FINE),  # clear of zero, however large its sd is for such a parameter
        (PLACE, 1e-4, 6e-4, EstimateState.NOT_IDENTIFIABLE),
        (SPRING, 1.1e-7, 1e-9, EstimateState.FINE),
        (SPRING, 3e-8, 1.4e-7, EstimateState.NOT_IDENTIFIABLE),
        (SPRING, 3e-8, 5e-8, EstimateState.UPPER_LIMIT),
        (SPRING, -5e-8, 1e-8, EstimateState.BEYOND_BOUND),
        (SPRING, -5e-9, 1e-8, EstimateState.BEYOND_BOUND),
        (SPRING, 2e-7, 0.0, EstimateState.FIXED),
        (KNOWN, 2e-7, 1e-9, EstimateState.OUTSIDE_PRIOR),
        (SPRING, 0.0, np.nan, EstimateState.AT_BOUND),
    ],
)
def test_the_state_of_an_estimate(parameter: Parameter, value: float, sd: float, state: EstimateState) -> None:
    found = estimate_of(parameter, value, sd, 1e-8 if np.isnan(sd) else sd)
    assert found.state is state
    if state is EstimateState.UPPER_LIMIT:
        assert found.limit == pytest.approx(abs(value) + 1.96 * sd)


def test_every_state_is_explained_in_few_words() -> None:
    assert {*STATES} == {*EstimateState} - {EstimateState.FINE}
    assert max(len(state.value) for state in EstimateState) <= 16


def test_a_bound_behind_which_nothing_is_told() -> None:
    """At its bound, and without the bound its sd is larger than anything that it may be."""
    assert estimate_of(SPRING, 0.0, np.nan, 5e-7).state is EstimateState.NOT_IDENTIFIABLE
    assert estimate_of(SPRING, 0.0, np.nan, np.inf).state is EstimateState.NOT_IDENTIFIABLE


def test_the_target_that_series_d_cannot_tell(series_d: Fit) -> None:
    state = {e.name: e.state for e in series_d.estimates}
    sd = {e.name: e.sd for e in series_d.estimates}
    assert sd["marker_offset[tmac].z"] > 0.01
    assert state["marker_offset[tmac].z"] is EstimateState.NOT_IDENTIFIABLE
    assert state["frame[D].x"] is EstimateState.FINE
    for e in series_d.estimates:
        size = np.inf if e.name.startswith("frame") else e.size
        lost = e.sd > size and abs(e.value) < 3.0 * e.sd
        assert (e.state is EstimateState.NOT_IDENTIFIABLE) == lost, e.name
        assert (e.state is EstimateState.UPPER_LIMIT) == (not lost and e.sd > abs(e.value)), e.name
    rows = {row[0]: row[-1] for row in fit_table(series_d).rows}
    assert rows["frame[D].x"] == "ok"


def test_a_column_of_rounding_is_not_told_at_all(series_d: Fit) -> None:
    """Rounding leaves 1e-18 of an effect that is not there: no sd, and nothing that absorbs it."""
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((30, 3))
    rows[:, 1] *= 1e-18
    rows[:, 2] = 1e-3 * rows[:, 0]
    taken, left = choose(rows, ["a", "b", "c"])
    assert taken == [0]
    assert left == (NotEstimated("b", ()), NotEstimated("c", ("a",)))
    assert left[0].words() == "b: no reading depends on it"
    table = not_estimated_table(replace(series_d, not_estimated=left))
    assert table.rows == (("b", "no effect"), ("c", "a"))
