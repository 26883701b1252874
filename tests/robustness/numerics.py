"""What the numerics tests share: small campaigns, and the same campaign told in other units or another order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, settings

from qsframework.diagnoses import Diagnosis, diagnose
from qsframework.elastostatics import make_model
from qsframework.experiment import Experiment, Readings, example, load_experiment, make_plan, simulate
from qsframework.experiment.noise import NoiseModel
from qsframework.experiment.readings import UNSTATED
from qsframework.experiment.setup import LoadCase
from qsframework.plans.candidates import generate_candidates
from qsframework.plugin import Array, Effect, Parameter, Poses, build_effects
from qsframework.plugin.facts import frozen

SIGMA = 3e-5


def few(count: int) -> Callable[[Any], Any]:
    """The same few examples in every run, as slow as they are."""
    return settings(
        max_examples=count,
        derandomize=True,
        deadline=None,
        database=None,
        phases=(Phase.explicit, Phase.generate),
        suppress_health_check=tuple(HealthCheck),
    )


@cache
def campaign() -> Experiment:
    """The M-900iB with three markers and two loads; its poses may go up to the joints' limits."""
    experiment = load_experiment(example("m900ib") / "experiment.yaml")
    return experiment.with_(constraints=replace(experiment.constraints, joint_margin=0.0))


@cache
def candidates() -> Array:
    """60 allowed poses (60, 6), pendant angles."""
    return generate_candidates(campaign(), 60, seed=1).pendant


def poses(experiment: Experiment, count: int, seed: int = 0) -> Poses:
    """Allowed poses under the experiment's loads in turn."""
    pendant = candidates()[np.random.default_rng(seed).choice(60, count, replace=False)]
    wrench = np.array([experiment.loads[i % len(experiment.loads)].wrench for i in range(count)])
    return Poses(frozen(pendant), experiment.robot.controller.to_joints(pendant), frozen(wrench))


def readings(
    experiment: Experiment, count: int = 20, seed: int = 0, x: Array | None = None, linear: bool = False
) -> Readings:
    """Simulated readings of `poses`; of an arm that the experiment states, unless x says another."""
    batch = poses(experiment, count, seed)
    return simulate(experiment, make_plan(batch, ["load"] * count), x=x, seed=seed, linear=linear).readings


def weighed(one: Readings, sigma: float | None) -> Readings:
    """The same readings with another stated sigma; None: nobody states any."""
    size = UNSTATED if sigma is None else sigma
    return replace(one, sigma=frozen(np.full((len(one), 3), size)), stated=sigma is not None)


def hidden(entry: dict[str, Any], value: float, count: int = 24, seed: int = 0) -> Readings:
    """Readings of the campaign's arm with one more effect, and compliances 20 % off."""
    experiment = campaign()
    more = build_effects(entry, experiment.robot.facts)
    model = experiment.model()
    markers = list(zip(model.marker_names, model.markers, strict=True))
    wide = make_model(model.facts, (*model.effects, *more), model.parameters, model.tip, markers, model.gravity)
    x = wide.nominal
    rng = np.random.default_rng([seed, 1])
    for name in experiment.fit_names():
        x[wide.names.index(name)] *= 1.0 + 0.2 * rng.standard_normal()
    x[wide.names.index(more[0].name)] = value
    blank = readings(experiment, count, seed)
    settled = wide.predict(poses(experiment, count, seed), x).reshape(-1, 3)
    return blank.with_values(settled + SIGMA * rng.standard_normal(settled.shape))


OFFAXIS = {"effect": "offaxis_compliance", "joints": ["joint_3"], "axes": ["x"]}


@cache
def diagnosed() -> tuple[Readings, Diagnosis]:
    """Readings with a hidden bearing, and what the whole library makes of them as they are."""
    data = hidden(OFFAXIS, 2e-7)
    return data, diagnose(campaign(), data, repeats=1)


def scaled(parameter: Parameter, factor: float) -> Parameter:
    """A parameter in a unit `factor` times as small."""
    sd = None if parameter.sd is None else parameter.sd * factor
    return replace(
        parameter,
        nominal=parameter.nominal * factor,
        typical=parameter.typical * factor,
        sd=sd,
        lower=parameter.lower * factor,
        upper=parameter.upper * factor,
    )


_FORCES = {
    "rad/(N m)": -1,
    "m/N": -1,
    "N/m": 1,
    "N": 1,
    "m": 0,
    "rad": 0,
    "": 0,
    "rad/(N m)^3": -3,
    "kg": 0,
    "kg m": 0,
    "1/K": 0,
    "m/s": 0,
}
"""The power of the force's unit in the unit of a parameter."""


def force_power(parameter: Parameter) -> int:
    return _FORCES[parameter.unit]


def in_force_unit(experiment: Experiment, k: float) -> Experiment:
    """The same campaign with forces counted in a unit 1/k as large: loads, weights and stiffnesses are k times."""
    robot = experiment.robot
    gravity = frozen(robot.gravity * k)
    parameters = tuple(scaled(p, k ** force_power(p)) for p in robot.parameters)
    robot = replace(
        robot,
        gravity=gravity,
        facts=replace(robot.facts, gravity=gravity),
        parameters=parameters,
        payload=None if robot.payload is None else robot.payload * k,
    )
    loads = tuple(LoadCase(c.name, frozen(c.wrench * k), c.poses, c.poses_min, cost=c.cost) for c in experiment.loads)
    return experiment.with_(
        robot=robot, loads=loads, parameters=tuple(scaled(p, k ** force_power(p)) for p in experiment.parameters)
    )


def with_forces(one: Readings, k: float) -> Readings:
    """The same readings with forces in a unit 1/k as large."""
    return one.with_poses(replace(one.poses, wrench=frozen(one.poses.wrench * k)))


def with_effects(experiment: Experiment, effects: Sequence[Effect], fit: Sequence[str] | None = None) -> Experiment:
    """The campaign with effects of its own added."""
    added = tuple(p for e in effects for p in e.parameters(experiment.robot.facts))
    changes: dict[str, Any] = {} if fit is None else {"fit": tuple(fit)}
    return experiment.with_(
        effects=(*experiment.effects, *effects), parameters=(*experiment.parameters, *added), **changes
    )


def noisy(experiment: Experiment, sigma: float | None) -> Experiment:
    """The campaign with another noise; None: to be estimated."""
    return experiment.with_(noise=NoiseModel(sigma))
