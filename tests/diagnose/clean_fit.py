"""An arm of the second generator in which nothing acts, measured and fitted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from independent import Campaign, Setting, noisy, write_campaign
from independent_arm import Arm, Hidden

from qsframework.experiment import Experiment, ReadingRows, load_experiment, make_rows, read_readings
from qsframework.hypotheses.exact_refit import SettledFit, settle_fit


def clean_fit(arm: Arm, folder: Path, **setting: Any) -> tuple[Experiment, ReadingRows, SettledFit]:
    """Under many loads, the springs fitted; setting: how the campaign is otherwise."""
    day = Campaign(Setting(arm, loads="many", fit="springs", **setting))
    experiment = load_experiment(write_campaign(day, noisy(day, day.clean(Hidden())), folder))
    assert experiment.data is not None
    rows, model = make_rows(read_readings(experiment.data, experiment)), experiment.model()
    return experiment, rows, settle_fit(model, rows, experiment.fit_names(), model.nominal)
