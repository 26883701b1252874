"""Campaigns of the second generator with nothing hidden, written and read."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from independent import Campaign, Setting, noisy, write_campaign
from independent_arm import Hidden

from qsframework.experiment import Experiment, Readings, load_experiment, read_readings


def write_clean(setting: Setting, folder: Path) -> Path:
    """The path of the experiment's file."""
    campaign = Campaign(setting)
    return write_campaign(campaign, noisy(campaign, campaign.clean(Hidden())), folder)


@cache
def loaded(path: Path) -> tuple[Experiment, Readings]:
    experiment = load_experiment(path / "experiment.yaml")
    return experiment, read_readings(experiment.data, experiment)
