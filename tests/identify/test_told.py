"""What is said of estimates from positions that are hardly told, and of parameters that are not told at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.experiment import load_experiment, read_states
from qsframework.identify import PositionFit, identify_positions
from qsframework.identify.choice import LeftAside, choose
from qsframework.identify.linear import status_in_positions
from qsframework.plugin import Parameter
from qsframework.report import fit_table
from qsframework.report.position_section import left_aside_table

UR10 = Path(__file__).parents[2] / "examples" / "ur10"
SPRING = Parameter("joint_compliance[joint_2]", "rad/(N m)", 1e-7, lower=0.0)
PLACE = Parameter("joint_placement[joint_2].x", "m", typical=5e-4)


@pytest.fixture(scope="module")
def series_d() -> PositionFit:
    experiment = load_experiment(UR10 / "experiment.yaml")
    return identify_positions(experiment, read_states(UR10 / "series_d.csv", experiment))


@pytest.mark.parametrize(
    ("parameter", "value", "sd", "said"),
    [
        (PLACE, 1e-5, 4e-4, ""),  # told to be small
        (PLACE, 8e-4, 7e-4, ""),  # seen
        (
            PLACE,
            1e-4,
            6e-4,
            "not identifiable from these readings: its sd is above its value and 1.2 times its typical",
        ),
        (SPRING, 1.1e-7, 1e-9, ""),
        (SPRING, 3e-8, 1.4e-7, "not identifiable from these readings: its sd is 140 % of its nominal value"),
        (SPRING, 3e-8, 5e-8, "sd above the value: these readings hardly tell it from zero"),
        (SPRING, -5e-8, 1e-8, "below its bound 0: the model or a convention is wrong"),
        (SPRING, -5e-9, 1e-8, "below its bound 0, by less than its sd"),
    ],
)
def test_the_status_of_an_estimate(parameter: Parameter, value: float, sd: float, said: str) -> None:
    found = status_in_positions(parameter, value, sd)
    assert found.startswith(said)
    assert bool(found) == bool(said)


def test_the_target_that_series_d_cannot_tell(series_d: PositionFit) -> None:
    status = {e.name: e.status for e in series_d.estimates}
    sd = {e.name: e.sd for e in series_d.estimates}
    assert sd["tool_offset[tmac].z"] > 0.01
    assert status["tool_offset[tmac].z"].startswith("not identifiable from these readings")
    assert status["tool_offset[tmac].y"] == status["frame[D].x"] == status["joint_placement[joint_2].x"] == ""
    for e in series_d.estimates:
        scale = series_d.model.parameters[series_d.model.index([e.name])[0]].scale if e.name[:5] != "frame" else 0.0
        assert bool(e.status) == (0.0 < scale < e.sd > abs(e.value)), e.name
    rows = {row[0]: row[-1] for row in fit_table(series_d).rows}
    assert rows["joint_placement[joint_2].x"] == "ok"


def test_a_column_of_rounding_is_not_told_at_all(series_d: PositionFit) -> None:
    """Rounding leaves 1e-18 of an effect that is not there: no sd, and nothing that absorbs it."""
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((30, 3))
    rows[:, 1] *= 1e-18
    rows[:, 2] *= 1e-3
    taken, left = choose(rows, ["a", "b", "c"], np.array([np.inf, 10.0, 10.0]))
    assert taken == [0]
    assert left[0] == LeftAside("b", (), np.inf)
    assert left[0].words() == "b: no reading depends on it"
    assert 100.0 < left[1].sd < 1000.0
    table = left_aside_table(replace(series_d, left_aside=left))
    assert table.rows[0][1:] == ("no effect", "-")
    assert table.rows[1][2] not in ("-", "inf")
