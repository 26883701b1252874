"""Tables of 24 poses of the heavy arm by the second generator."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from independent import Campaign, Setting, noisy, write_campaign
from independent_arm import ARMS, Hidden

from qsframework.experiment import Experiment, Readings, load_experiment, read_readings


def write_tables(root: Path) -> Path:
    """Folders `displacements` and `positions` with nothing hidden."""
    for kind in ("displacements", "positions"):
        campaign = Campaign(Setting(ARMS["heavy"], 24, 3, kind, fit="springs", loads="many"))
        write_campaign(campaign, noisy(campaign, campaign.clean(Hidden())), root / kind)
    return root


@cache
def loaded(path: Path) -> tuple[Experiment, Readings]:
    experiment = load_experiment(path / "experiment.yaml")
    return experiment, read_readings(experiment.data, experiment)
