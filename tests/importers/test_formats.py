"""Every format of docs/import.md gives the readings that were exported, to the last digit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import samples
from samples import FORMATS, Campaign
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.experiment import Readings, read_readings


@pytest.fixture
def campaign(tmp_path: Path) -> Campaign:
    return samples.make_campaign(tmp_path)


def run(c: Campaign, *arguments: str) -> str:
    """What qsf import prints."""
    out = str(c.folder / "imported.csv")
    done = CliRunner().invoke(
        app, ["import", str(c.folder / "experiment.yaml"), *arguments, "-o", out], env={"COLUMNS": "400"}
    )
    assert done.exit_code == 0, f"{done.output}\n{done.exception}"
    return done.output


def the_same(c: Campaign, *columns: str) -> None:
    """The table that was written holds what the truth holds."""
    one, two = (read_readings(p, c.experiment, "positions") for p in (c.folder / "imported.csv", c.truth()))
    equal(one, two)
    lines = (c.folder / "imported.csv").read_text().splitlines()
    header = next(line for line in lines if not line.startswith("#")).split(",")
    assert [name for name in header if name in ("time_s", "temperature_degC", "sigma_mm")] == list(columns)


def equal(one: Readings, two: Readings) -> None:
    assert np.array_equal(one.value, two.value)
    assert one.pose == two.pose
    assert np.array_equal(one.marker, two.marker)
    assert np.array_equal(one.states.loaded[one.plus], two.states.loaded[two.plus])
    assert np.abs(one.poses.pendant - two.poses.pendant).max() < 1e-13
    assert np.array_equal(one.poses.wrench, two.poses.wrench)
    assert one.states.series == two.states.series


@pytest.mark.parametrize("name", FORMATS)
def test_a_sample_comes_back_as_it_was(name: str, campaign: Campaign) -> None:
    make, stated, columns = FORMATS[name]
    printed = run(campaign, str(make(campaign)), "-p", str(campaign.folder / "plan.csv"), *stated)
    the_same(campaign, *columns)
    assert "24 points at 6 poses, 12 loaded and 12 unloaded" in printed
