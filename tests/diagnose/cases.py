"""Hidden effects for the tests of the diagnosis: readings of the full equilibrium, made in memory."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from qsframework.design.candidates import generate_candidates
from qsframework.diagnose.fitted import exact_displacement
from qsframework.elastostatics import make_model
from qsframework.experiment import Experiment, Readings, example, load_experiment, make_plan, simulate
from qsframework.plugin import Array, Effect, Poses
from qsframework.plugin.facts import frozen

SIGMA = 3e-5


@cache
def campaign() -> Experiment:
    """The M-900iB with three markers and two loads."""
    return load_experiment(example("m900ib") / "experiment.yaml")


@cache
def candidates() -> Array:
    return generate_candidates(campaign(), 400, seed=1).pendant


def poses(seed: int, count: int = 60) -> Poses:
    """Random allowed poses under the two loads in turn."""
    experiment = campaign()
    rng = np.random.default_rng(seed)
    pendant = candidates()[rng.choice(len(candidates()), count, replace=False)]
    wrench = np.array([experiment.loads[i % 2].wrench for i in range(count)])
    return Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench)


def measured(
    effects: tuple[Effect, ...] = (), values: dict[str, float] | None = None, seed: int = 0, count: int = 60,
    noise: float = 1.0,
) -> Readings:  # fmt: skip
    """Readings of an arm whose compliances are off by 20 % and that has more effects than the experiment says."""
    experiment = campaign()
    model = experiment.model()
    rng = np.random.default_rng([seed, 7])
    markers = list(zip(model.marker_names, model.markers, strict=True))
    wide = make_model(model.facts, (*model.effects, *effects), model.parameters, model.tip, markers, model.gravity)
    x = wide.nominal
    for name in experiment.fit_names():
        x[wide.names.index(name)] *= 1.0 + 0.2 * rng.standard_normal()
    for name, value in (values or {}).items():
        x[wide.names.index(name)] = value
    plan = make_plan(poses(seed, count), ["load"] * count)
    blank = simulate(experiment, plan, seed=seed).readings
    exact = exact_displacement(wide, blank, x)
    return replace(
        blank, displacement=frozen((exact + noise * SIGMA * rng.standard_normal(exact.shape)).reshape(-1, 3))
    )
