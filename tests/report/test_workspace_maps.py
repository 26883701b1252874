"""The maps of errors over the workspace: before the fit and at held-out poses, of the same rows in one scale."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from qsframework import Experiment, Fit, Readings, identify, load_experiment, read_readings
from qsframework.report.blocks import Figure
from qsframework.report.fit_section import where_section

Campaign = tuple[Experiment, Readings, Fit]


def maps_of(experiment: Experiment, readings: Readings, fit: Fit) -> list[Figure]:
    """The maps of a fit's report."""
    return [b for b in where_section(fit, experiment, readings).blocks if isinstance(b, Figure)]


@pytest.fixture(scope="module", params=["masked rows", "all rows"])
def campaign(request: pytest.FixtureRequest) -> Campaign:
    name, data = ("ur10", ["examples/ur10/series_b.csv"]) if request.param == "masked rows" else ("r2000ic", None)
    experiment = load_experiment(f"examples/{name}/experiment.yaml")
    readings = read_readings(data or experiment.data, experiment)
    return experiment, readings, identify(experiment, readings)


def test_before_and_after_are_the_errors_of_the_fit_in_one_scale(campaign: Campaign) -> None:
    fit = campaign[2]
    (maps,) = maps_of(*campaign)
    figure: Any = maps.figure
    largest = 0.0
    for k, errors in enumerate((fit.measured - fit.nominal, fit.left_out)):
        sizes = np.sort(1e3 * np.linalg.norm(errors[np.isfinite(errors).all(axis=1)], axis=1))
        for trace in figure.data[2 * k : 2 * k + 2]:
            assert np.asarray(trace.marker.color) == pytest.approx(sizes)
            assert (trace.marker.coloraxis, len(trace.x)) == ("coloraxis", len(fit.left_out))
        largest = max(largest, float(sizes[-1]))
    assert (figure.layout.coloraxis.cmin, figure.layout.coloraxis.cmax) == (0.0, pytest.approx(largest))


def test_the_places_are_where_the_markers_were_read(campaign: Campaign) -> None:
    """Within the arm's sag of where they are on the nominal arm, row by row."""
    _, readings, fit = campaign
    (maps,) = maps_of(*campaign)
    assert maps.table is not None
    rows = [[float(v) for v in row[1:4]] for row in maps.table.rows]
    first = fit.used(readings).poses.take([0])
    nominal = fit.model.positions(first)[0]
    assert np.linalg.norm(nominal - np.array(rows[0]), axis=1).min() < 0.02


def test_rows_that_were_read_along_some_axes_only_give_no_map() -> None:
    experiment = load_experiment("examples/r2000ic/experiment.yaml")
    readings = read_readings(experiment.data, experiment)
    fit = identify(experiment, readings)
    for name in ("measured", "left_out"):
        getattr(fit, name).flags.writeable = True
        getattr(fit, name)[:, 1] = np.nan
    assert maps_of(experiment, readings, fit) == []
