"""Rows from one on in another unit, slipped, or with the markers' names exchanged: found with their first row."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clean_tables import loaded, write_clean
from independent import Campaign, Setting, noisy, write_campaign
from independent_arm import ARMS, Hidden
from independent_effects import campaign_for

from qsframework.diagnoses import diagnose
from qsframework.hypotheses.catalogue.runs import run_of_rows
from qsframework.hypotheses.linearized import linearized
from qsframework.plugin import Array
from qsframework.report.words.headline import headline
from qsframework.screening import adopted, find_mistakes

Change = Callable[[Array, int], Array]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """16 poses of two arms with three markers, by the second generator."""
    root = tmp_path_factory.mktemp("runs")
    for name in ("heavy", "small"):
        write_clean(Setting(ARMS[name], 16, 3, fit="springs", loads="many"), root / name)
    return root


def scaled(factor: float) -> Change:
    return lambda v, k: np.concatenate([v[:k], factor * v[k:]])


def slipped(by: int) -> Change:
    """From row k on each row holds what was read `by` rows later."""
    return lambda v, k: np.concatenate([v[:k], v[k + by :], v[-by:]])


def late(by: int) -> Change:
    """From row k on each row holds what was read `by` rows earlier."""
    return lambda v, k: np.concatenate([v[:k], v[k - by : len(v) - by]])


def rotated(v: Array, k: int) -> Array:
    rest = v[k:].reshape(-1, 3, 3)
    return np.concatenate([v[:k], rest[:, [1, 2, 0]].reshape(-1, 3)])


CHANGES: dict[str, tuple[Change, int, str, str]] = {
    "metres": (scaled(1e-3), 21, "rows_unit", "in m where the others are in mm"),
    "micrometres": (scaled(1e3), 33, "rows_unit", "in um where the others are in mm"),
    "inches": (scaled(1.0 / 25.4), 27, "rows_unit", "in inches where the others are in mm"),
    "a row": (slipped(1), 17, "rows_slipped", "belongs to the row after it"),
    "a row late": (late(1), 14, "rows_slipped", "belongs to the row before it"),
    "a pose": (slipped(3), 18, "rows_slipped", "belongs to the pose after it"),
    "markers": (rotated, 24, "swapped_markers", "exchanged"),
}


@pytest.mark.parametrize("arm", ["heavy", "small"])
@pytest.mark.parametrize("case", CHANGES)
def test_rows_from_one_on_are_named_with_what_they_hold(folder: Path, arm: str, case: str) -> None:
    experiment, readings = loaded(folder / arm)
    change, first, name, words = CHANGES[case]
    spoiled = readings.with_values(change(readings.value, first))
    found = adopted(find_mistakes(experiment, spoiled))
    assert len(found) == 1
    if found[0].name != "late_angles":  # whose readings are another pose's, whatever column slipped
        assert found[0].name == name
        assert words in found[0].words
        lines = readings.line[first:].tolist()
        assert set(found[0].rows) <= {*lines, int(readings.line[first - 1])}
        assert len(found[0].rows) >= len(lines) - 6, (
            "of a pose that slipped the values of one, and of its place, are lost"
        )
    assert found[0].rms < 1.2 * 3e-5


def test_right_tables_and_hidden_effects_hold_no_run(folder: Path, tmp_path: Path) -> None:
    for arm in ("heavy", "small"):
        experiment, readings = loaded(folder / arm)
        assert run_of_rows(linearized(experiment, readings)) is None
        assert run_of_rows(linearized(experiment, readings.with_values(1e-3 * readings.value))) is None
    for seed in range(3):
        campaign = Campaign(campaign_for("displacements", ARMS["coiled"], 14, seed, "nominal"))
        hidden = Hidden(gears=(lambda still: 4e-6 * still.torque * np.sin(2.0 * still.angles),))
        path = write_campaign(campaign, noisy(campaign, campaign.clean(hidden)), tmp_path / str(seed))
        experiment, readings = loaded(path.parent)
        assert run_of_rows(linearized(experiment, readings)) is None


def test_a_pose_read_twice_is_not_all_others_in_another_unit(tmp_path: Path) -> None:
    """What makes nearly all readings smaller leaves little of any misfit, wherever that is."""
    write_clean(Setting(ARMS["seven"], 40, 0, "displacements", loads="two"), tmp_path)
    experiment, readings = loaded(tmp_path)
    for pose in (2, 18, 33, 36):
        here, before = slice(3 * pose, 3 * pose + 3), slice(3 * pose - 3, 3 * pose)
        value = readings.value.copy()
        value[here] = value[before]
        (found,) = adopted(find_mistakes(experiment, readings.with_values(value)))
        assert found.name == f"repeated_readings[{readings.pose[3 * pose]}]"
        assert list(found.rows) == readings.line[here].tolist()


def test_rows_of_several_files_are_told_with_their_file(tmp_path: Path) -> None:
    """A line number alone is of either file."""
    write_clean(Setting(ARMS["small"], 12, 0, "mixed", loads="two"), tmp_path)
    experiment, readings = loaded(tmp_path)
    row = int(np.flatnonzero(readings.is_position)[0])
    marker = readings.marker.copy()
    marker[[row, row + 2]] = marker[[row + 2, row]]
    (found,) = adopted(find_mistakes(experiment, replace(readings, marker=marker)))
    assert (found.name, found.rows) == ("swapped_markers", tuple(readings.line[[row, row + 2]].tolist()))
    assert found.file == readings.sources[int(readings.file[row])].name == "tracker.csv"


def test_readings_that_scatter_ten_times_as_stated_are_not_within_the_noise(folder: Path) -> None:
    """Every row by another row's values: no mistake that is known mends it, and no cause does."""
    experiment, readings = loaded(folder / "small")
    rng = np.random.default_rng(1)
    noisier = readings.with_values(readings.value + 4e-4 * rng.standard_normal(readings.value.shape))
    found = diagnose(experiment, noisier, repeats=1)
    assert found.audit.refuted
    assert found.verdict in ("unexplained", "partly_explained")
    assert "times as much as their noise is stated" in headline(found) or found.leftovers
    assert "within the noise" not in headline(found)
