"""Nests whose places on the flange are guessed: what readings tell is decided at the solution, whatever the guess."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.diagnoses import diagnose
from qsframework.experiment import Experiment, Readings, example, load_experiment, make_plan, simulate
from qsframework.fits import Fit, identify
from qsframework.plans import generate_candidates
from qsframework.plugin import Poses

SEEDS = (1, 2)


@pytest.fixture(scope="module")
def experiment() -> Experiment:
    return load_experiment(example("geometry") / "experiment.yaml")


@pytest.fixture(scope="module", params=SEEDS)
def campaign(request: pytest.FixtureRequest, experiment: Experiment) -> tuple[Readings, Fit]:
    """Positions of an arm whose geometry and nests are drawn, and the fit that begins at the nests that it has."""
    pendant = generate_candidates(experiment, 30, seed=request.param).pendant
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), np.zeros((30, 6)))
    made = simulate(experiment, make_plan(poses, [""] * 30, station=["front"] * 30), truth="drawn", seed=request.param)
    return made.readings, identify(experiment, made.readings)


def guessed(experiment: Experiment, off: float, seed: int) -> Experiment:
    """The nests so far (m) off their places, each in a direction of its own; at the flange's origin for infinity."""
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(len(experiment.markers), 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    moved = [
        replace(m, xyz=m.xyz + off * way if np.isfinite(off) else 1e-6 * way)
        for m, way in zip(experiment.markers, ways, strict=True)
    ]
    return experiment.with_(markers=tuple(moved))


@pytest.mark.parametrize("off", [0.02, 0.05, 0.2, np.inf])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_same_is_told_whatever_the_guess(
    experiment: Experiment, campaign: tuple[Readings, Fit], off: float, seed: int
) -> None:
    readings, known = campaign
    found = identify(guessed(experiment, off, seed), readings)
    assert [e.name for e in found.estimates] == [e.name for e in known.estimates]
    assert found.held_out_error == pytest.approx(known.held_out_error, rel=1e-3)
    arm = [e.name for e in known.estimates if not e.name.startswith("marker_offset")]
    assert len(arm) >= 20
    for name in arm:  # where a nest is, its guess and its offset say together
        one, other = (next(e for e in fit.estimates if e.name == name) for fit in (found, known))
        assert abs(one.value - other.value) < 0.1 * other.sd, name


def test_no_guess_is_a_cause(experiment: Experiment, campaign: tuple[Readings, Fit]) -> None:
    """At the flange's origin nests do not tell how the last joint is placed; at the solution they do."""
    found = diagnose(guessed(experiment, np.inf, 1), campaign[0], repeats=1)
    assert found.verdict == "none"
    assert not found.findings
