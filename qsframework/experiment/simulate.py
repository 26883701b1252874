"""`simulate`: readings of a plan, with seeded noise, from known parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import Model, exact_readings
from qsframework.errors import InputError, Problem, nearest
from qsframework.experiment.plan import Plan
from qsframework.experiment.readings import Readings
from qsframework.experiment.setup import Experiment
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen

TRUTHS = ("nominal", "drawn")


@dataclass(frozen=True, eq=False)
class Simulation:
    """Simulated readings and the parameters x (p,) that made them."""

    readings: Readings
    model: Model
    x: Array

    def truth_by_name(self) -> dict[str, float]:
        return {name: float(v) for name, v in zip(self.model.names, self.x, strict=True)}


def simulate(
    experiment: Experiment,
    plan: Plan,
    x: Array | None = None,
    truth: str = "nominal",
    seed: int = 0,
    exact: bool = False,
) -> Simulation:
    """Measure a plan in simulation: independent Gaussian noise on every coordinate.

    Readings without any noise (sigma 0) state none: a fit then estimates what rounding leaves.
    x (p,) are the true parameters; without them the nominal values, or values drawn from the priors. exact: the arm
    settles in its full equilibrium, as a real one does, and not by the linear model.
    """
    sigma = experiment.noise.sigma
    if sigma is None:
        raise InputError(f"{experiment.path}: a simulation needs the noise, for example noise: {{sigma_mm: 0.03}}")
    if not experiment.has_load:
        raise InputError(f"{experiment.path}: a load acts somewhere; add for example load: {{point_mm: [150, 0, 200]}}")
    model = experiment.model()
    rng = np.random.default_rng(seed)
    x = _truth(model, truth, rng) if x is None else x
    poses = plan.repeated()
    moved = exact_readings(model, poses, x) if exact else model.predict(poses, x)
    count, markers = (int(n) for n in moved.shape[:2])
    order = np.repeat(np.arange(len(plan.pose)), plan.repeats)
    repeat = np.concatenate([np.arange(1, r + 1) for r in plan.repeats])
    readings = Readings(
        poses, tuple(plan.pose[int(i)] for i in order), repeat, np.ones(count, dtype=np.intp),
        np.repeat(np.arange(count), markers), np.tile(np.arange(markers), count),
        frozen((moved + sigma * rng.standard_normal(moved.shape)).reshape(-1, 3)),
        frozen(np.full(count * markers, sigma or np.nan)), np.ones(count * markers, dtype=bool),
        np.arange(3, 3 + count * markers), None, None,
    )  # fmt: skip
    return Simulation(readings, model, frozen(x))


def _truth(model: Model, truth: str, rng: np.random.Generator) -> Array:
    if truth not in TRUTHS:
        raise InputError(Problem(f"unknown truth {truth!r}", allowed=", ".join(TRUTHS), hint=nearest(truth, TRUTHS)))
    x = model.nominal
    if truth == "drawn":
        sd = np.array([p.sd or 0.0 for p in model.parameters])
        lower = np.array([max(p.lower, 0.1 * p.nominal if p.lower == 0.0 else p.lower) for p in model.parameters])
        upper = np.array([p.upper for p in model.parameters])
        x = np.clip(x + sd * rng.standard_normal(len(x)), lower, upper)
    return x
