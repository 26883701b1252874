"""Hidden effects for the tests of the diagnosis: readings of the full equilibrium, made in memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from remembered import diagnose

from qsframework.diagnoses import Diagnosis
from qsframework.elastostatics import Model, make_model
from qsframework.elastostatics.so3 import exponential
from qsframework.errors import NotConverged
from qsframework.experiment import (
    Experiment,
    ReadingRows,
    Readings,
    example,
    load_experiment,
    make_plan,
    read_readings,
    simulate,
)
from qsframework.plans.candidates import generate_candidates
from qsframework.plugin import Array, Effect, Poses, find
from tests.identify.arm import position_readings, settled

SIGMA = 3e-5


@cache
def campaign() -> Experiment:
    """The M-900iB with three markers and two loads; its poses may go up to the joints' limits, whatever they touch."""
    experiment = load_experiment(example("m900ib") / "experiment.yaml")
    return experiment.with_(constraints=replace(experiment.constraints, joint_margin=0.0, collision=False))


@cache
def diagnosed(name: str) -> Diagnosis:
    """The diagnosis of an example, made once for all tests that look at it."""
    experiment = load_experiment(example(name) / "experiment.yaml")
    return diagnose(experiment, read_readings(experiment.data, experiment))


@cache
def quiet(seed: int) -> Diagnosis:
    """The diagnosis of an arm in which nothing acts."""
    return diagnose(campaign(), measured(seed=seed, count=30), seed=seed, repeats=1)


def with_size(effect: Effect, size: float) -> tuple[tuple[Effect, ...], dict[str, float]]:
    """The effect and its values, at so many times their typical sizes; what alone does nothing as it is."""
    parameters = effect.parameters(campaign().robot.facts)
    return (effect,), {p.name: size * p.typical for p in parameters if p.null is not None}


HARDENING = with_size(find("joint_hardening")("joint_3"), 0.8)


@cache
def hardened() -> Diagnosis:
    """The diagnosis of an arm whose third drive stiffens."""
    return diagnose(campaign(), measured(*HARDENING, seed=5, count=30), repeats=1)


@cache
def twisted() -> Diagnosis:
    """A bearing before the wrist that gives: to markers on the tool it is the forearm that twists."""
    hidden = with_size(find("offaxis_compliance")("joint_4", "z"), 0.4)
    return diagnose(campaign(), measured(*hidden, seed=1, count=30), repeats=1)


@cache
def reversed_sign() -> Diagnosis:
    """The diagnosis of unloaded minus loaded."""
    readings = measured(seed=1, count=20)
    return diagnose(campaign(), readings.with_values(-readings.value), repeats=1)


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
    effects: tuple[Effect, ...] = (),
    values: dict[str, float] | None = None,
    seed: int = 0,
    count: int = 60,
    noise: float = 1.0,
) -> Readings:
    """Displacements of an arm as `as_built` has it."""
    rng = np.random.default_rng([seed, 7])
    wide, x = as_built(effects, values or {}, rng)
    planned = poses(seed, count)
    blank = simulate(campaign(), make_plan(planned, ["load"] * count), seed=seed, linear=True).readings
    exact = wide.predict(planned, x)
    return blank.with_values((exact + noise * SIGMA * rng.standard_normal(exact.shape)).reshape(-1, 3))


def as_built(effects: tuple[Effect, ...], values: Mapping[str, float], rng: np.random.Generator) -> tuple[Model, Array]:
    """An arm whose compliances are off by 20 % and that has more effects than the experiment says; its parameters."""
    experiment = campaign()
    model = experiment.model()
    markers = list(zip(model.marker_names, model.markers, strict=True))
    wide = make_model(model.facts, (*model.effects, *effects), model.parameters, model.tip, markers, model.gravity)
    x = wide.nominal
    for name in experiment.fit_names():
        x[wide.names.index(name)] *= 1.0 + 0.2 * rng.standard_normal()
    for name, value in values.items():
        x[wide.names.index(name)] = value
    return wide, x


def day_of_positions(
    model: Model,
    x: Array,
    pendant: Array,
    seed: int,
    sigma: float | None = 2e-5,
    noise: float = 2e-5,
    turned: tuple[float, float, float] = (0.0, 0.0, 0.0),
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Readings:
    """Positions of all markers at poses (N, n), each pose unloaded and under the campaign's two loads.

    sigma: as stated, m, None: not stated; noise: the true one; turned, origin: the tracker's frame
    """
    experiment, count = campaign(), len(pendant)
    pendant = np.repeat(pendant, 3, axis=0)
    wrench = np.tile([np.zeros(6), *(load.wrench for load in experiment.loads)], (count, 1))
    loaded = np.tile([False, True, True], count)
    all_ = Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench)
    there = settled(model, all_, loaded, x)
    seen = there @ exponential(np.array(turned)).T + np.array(origin)
    seen = seen + noise * np.random.default_rng([seed, 8]).standard_normal(seen.shape)
    names = [f"p{i // 3}" for i in range(3 * count)]
    return position_readings(all_, loaded, seen, sigma, pose=names, load_id=["", "one", "two"] * count)


def unstable(monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on no equilibrium settles."""

    def settled_never(right: Callable[..., Any]) -> Callable[..., Any]:
        def call(*given: Any, linear: bool = False) -> Any:
            if not (linear or given[-1] is True):
                raise NotConverged("beyond the arm's stability")
            return right(*given, **({"linear": True} if linear else {}))

        return call

    for name in ("predict", "rates"):
        monkeypatch.setattr(ReadingRows, name, settled_never(getattr(ReadingRows, name)))
