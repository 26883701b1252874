"""`simulate`: displacements of a plan, or the rows of a table, with seeded noise, from known parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.elastostatics import Model
from qsframework.errors import InputError, Problem, nearest
from qsframework.experiment.observations import make_rows
from qsframework.experiment.plan import Plan
from qsframework.experiment.readings import UNSTATED, Made, Readings, States
from qsframework.experiment.setup import Experiment
from qsframework.plugin import Array, Conditions, Indices, Poses
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
    linear: bool = False,
) -> Simulation:
    """Measure a plan in simulation: displacements with independent Gaussian noise on every coordinate.

    The arm settles in its full equilibrium, as a real one does; linear: by the first step, at the undeflected pose.
    Readings without any noise (sigma 0) state none: a fit then estimates what rounding leaves.
    x (p,) are the true parameters; without them the nominal values, or values drawn from the priors.
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
    moved = model.predict(poses, x, linear)
    order = np.repeat(np.arange(len(plan.pose)), plan.repeats)
    repeat = np.concatenate([np.arange(1, r + 1) for r in plan.repeats])
    displacement = moved + sigma * rng.standard_normal(moved.shape)
    readings = displaced(
        poses,
        displacement,
        sigma or UNSTATED,
        [plan.pose[int(i)] for i in order],
        repeat,
        stated=sigma > 0.0,
        repeatability=experiment.noise.repeatability,
        made=Made("linear" if linear else "equilibrium", seed),
    )
    return Simulation(readings, model, frozen(x))


def simulate_rows(
    experiment: Experiment,
    readings: Readings,
    x: Array | None = None,
    truth: str = "nominal",
    seed: int = 0,
    linear: bool = False,
) -> Simulation:
    """Measure the rows of readings in simulation, of whatever kind: each with its sigma, in the frames that suit the
    readings; of a touched point what the marker is off the point. x, truth, seed and linear as for `simulate`."""
    if not readings.stated:
        raise InputError(f"{experiment.path}: a simulation needs the noise, for example noise: {{sigma_mm: 0.03}}")
    model, rng = experiment.model(), np.random.default_rng(seed)
    x = _truth(model, truth, rng) if x is None else x
    rows = make_rows(readings)
    predicted = rows.predict(model, x, rows.start(model, model.nominal), linear)
    value = np.array(readings.value)
    value[rows.keep] = predicted + rows.sigma * rng.standard_normal(predicted.shape)
    made = replace(readings.with_values(value), made=Made("linear" if linear else "equilibrium", seed))
    return Simulation(made, model, frozen(x))


def displaced(
    poses: Poses,
    displacement: Array,
    sigma: float,
    names: Sequence[str],
    repeat: Indices | None = None,
    stated: bool = True,
    repeatability: float | None = None,
    made: Made | None = None,
) -> Readings:
    """Readings of every marker's displacement (N, K, 3) m at N poses, each minus an unloaded state of its own."""
    count, markers = (int(n) for n in displacement.shape[:2])
    unloaded = replace(poses, wrench=np.zeros_like(poses.wrench), loaded=poses.unloaded)
    loaded = replace(poses, unloaded=poses.loaded)
    both = (loaded, unloaded)
    repeat = np.ones(count, dtype=np.intp) if repeat is None else repeat
    pendant, q, wrench = (np.concatenate([getattr(p, k) for p in both]) for k in ("pendant", "q", "wrench"))
    states = States(
        poses=Poses(pendant, q, wrench, _stacked([p.unloaded for p in both]), _stacked([p.loaded for p in both])),
        loaded=np.arange(2 * count) < count,
        pose=(*names, *names),
        load_id=("",) * (2 * count),
        series=("",) * (2 * count),
        repeat=np.tile(repeat, 2),
        cycle=np.ones(2 * count, dtype=np.intp),
    )
    state, rows = np.repeat(np.arange(count), markers), count * markers
    return Readings(
        states=states,
        plus=state,
        minus=state + count,
        marker=np.tile(np.arange(markers), count),
        frame=np.full(rows, -1),
        frames=(),
        known=(),
        value=frozen(displacement.reshape(-1, 3)),
        sigma=frozen(np.full((rows, 3), sigma)),
        minus_sigma=frozen(np.full((rows, 3), np.nan)),
        stated=stated,
        use=np.ones(rows, dtype=bool),
        line=np.arange(3, 3 + rows),
        file=np.zeros(rows, dtype=np.intp),
        to=np.full(rows, -1),
        repeatability=repeatability,
        made=made,
    )


def _stacked(parts: list[Conditions]) -> Conditions:
    def both(name: str) -> Array | None:
        values = [getattr(p, name) for p in parts]
        return None if any(v is None for v in values) else np.concatenate(values)

    return Conditions.each(both)


def _truth(model: Model, truth: str, rng: np.random.Generator) -> Array:
    if truth not in TRUTHS:
        raise InputError(Problem(f"unknown truth {truth!r}", allowed=", ".join(TRUTHS), hint=nearest(truth, TRUTHS)))
    return prior_draws(model, 1, rng)[0] if truth == "drawn" else model.nominal


def prior_draws(model: Model, count: int, rng: np.random.Generator) -> Array:
    """Parameter values (count, p) from the priors, inside the bounds; nominal ones where no sd is stated."""
    drawn = [i for i, p in enumerate(model.parameters) if p.sd is not None or not p.by_name]
    sd = np.array([model.parameters[i].sd or 0.0 for i in drawn])
    x = np.tile(model.nominal, (count, 1))
    x[:, drawn] += sd * rng.standard_normal((count, len(drawn)))
    lower = np.array([max(p.lower, 0.1 * p.nominal) if p.lower == 0.0 else p.lower for p in model.parameters])
    return np.clip(x, lower, [p.upper for p in model.parameters])
