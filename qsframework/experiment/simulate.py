"""`simulate`: what a plan reads, displacements and positions, or the rows of a table, with seeded noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from qsframework.arguments import checked
from qsframework.elastostatics import Model
from qsframework.errors import InputError
from qsframework.estimation.options import Linear
from qsframework.experiment.noise import gauge_sigma, require_position_noise, seen_from, split_covariances
from qsframework.experiment.observations import make_rows
from qsframework.experiment.options import Truth
from qsframework.experiment.plan import Plan
from qsframework.experiment.readings import UNSTATED, Made, Readings, States, joined
from qsframework.experiment.setup import Experiment
from qsframework.experiment.stations import seen_markers, station_of
from qsframework.option import Seed, check_choice
from qsframework.plugin import Array, Conditions, Indices, Poses
from qsframework.plugin.facts import frozen
from qsframework.robot.sight import Flags
from qsframework.viewed import Viewed


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(Viewed):
    """Simulated readings and the parameters x (p,) that made them."""

    readings: Readings
    model: Model
    x: Array

    def truth_by_name(self) -> dict[str, float]:
        return {name: float(v) for name, v in zip(self.model.names, self.x, strict=True)}


@checked
def simulate(
    experiment: Experiment,
    plan: Plan,
    x: Array | None = None,
    truth: Truth = "nominal",
    seed: Seed = 0,
    linear: Linear = False,
) -> Simulation:
    """Measure a plan in simulation, with Gaussian noise as the experiment states it.

    The arm settles in its full equilibrium, as a real one does. Readings without any noise (sigma 0) state none: a fit
    then estimates what rounding leaves.

    Args:
        experiment: the campaign.
        plan: its plan.
        x: (p,) the true parameters, SI; as `truth` says if None.
        truth: "nominal" values, or "drawn" by the stated sds or typical sizes.
        seed: random seed.
        linear: by the first step, at the undeflected pose.

    Returns:
        The readings, m, and the parameters that made them.

    Raises:
        InputError: where the noise is not stated, or the arm does not carry a load.
    """
    model = experiment.model()
    rng = np.random.default_rng(seed)
    x = _rigid(experiment, _truth(experiment, truth, rng)) if x is None else x
    readings = planned_readings(experiment, plan, x, linear)
    rows = make_rows(readings)
    noise = rows.flat(rng.standard_normal(readings.value.shape)) if readings.stated else np.zeros(len(rows.at))
    noise = np.nan_to_num(rows.spread(rows.noise.colour(noise)))
    made = Made("linear" if linear else "equilibrium", seed)
    stated = readings.stated and not experiment.noise.estimated
    readings = replace(readings, value=frozen(readings.value + noise), made=made, stated=stated)
    return Simulation(readings, model, frozen(x))


def _rigid(experiment: Experiment, x: Array) -> Array:
    """Values (p,) with the springs that are not fitted held rigid, where the experiment says so."""
    if not experiment.rigid:
        return x
    loose = [name for name in experiment.spring_names() if name not in experiment.fit_names()]
    return np.where(np.isin(np.array(experiment.model().names), loose), 0.0, x)


def planned_readings(experiment: Experiment, plan: Plan, x: Array | None = None, linear: bool = False) -> Readings:
    """What a plan would read without noise, at parameters x (p,), the nominal ones if None: displacements under its
    loads, and positions in each station's frame at its other poses."""
    model, poses = experiment.model(), plan.repeated()
    x = model.nominal if x is None else x
    pose = np.repeat(np.arange(len(plan.pose)), plan.repeats)
    repeat = np.concatenate([np.arange(1, r + 1) for r in plan.repeats])
    bare = plan.of_positions[pose]
    visits = _Visits(experiment=experiment, plan=plan, pose=pose, repeat=repeat, model=model, x=x, linear=linear)
    parts = [make(visits, poses, np.flatnonzero(own)) for make, own in ((_moved, ~bare), (_stood, bare)) if own.any()]
    return replace(joined(parts), robot=experiment.robot.name)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Visits:
    """The visits of a plan: the pose and the repeat of each, and the arm that is measured."""

    experiment: Experiment
    plan: Plan
    pose: Indices
    repeat: Indices
    model: Model
    x: Array
    linear: bool

    def names(self, rows: Indices) -> list[str]:
        return [self.plan.pose[int(i)] for i in self.pose[rows]]

    def stations(self, rows: Indices) -> list[str]:
        return [self.plan.stations[int(i)] for i in self.pose[rows]]


def _moved(visits: _Visits, poses: Poses, rows: Indices) -> Readings:
    """Displacements under the loads, by the tracker, or by the gauge of a load."""
    experiment, poses = visits.experiment, poses.take(rows)
    if not experiment.has_load:
        raise InputError(f"{experiment.path}: a load acts somewhere; add for example load: {{point_mm: [150, 0, 200]}}")
    moved = visits.model.predict(poses, visits.x, visits.linear)
    stations, names = visits.stations(rows), visits.names(rows)
    loads = [visits.plan.load[int(i)] for i in visits.pose[rows]]
    out = noisy_displacements(experiment, poses, moved, names, visits.repeat[rows], stations, loads)
    seen = seen_markers(experiment, poses.q, stations).ravel()
    return _gauged(experiment, out, np.repeat(loads, moved.shape[1]), seen)


def noisy_displacements(
    experiment: Experiment,
    poses: Poses,
    moved: Array,
    names: Sequence[str],
    repeat: Indices | None = None,
    stations: Sequence[str] = (),
    loads: Sequence[str] = (),
) -> Readings:
    """`displaced` with the noise that the experiment states; stations, loads: of each pose, "" where not given."""
    stations, loads = stations or [""] * len(poses), loads or [""] * len(poses)
    sigma, directed = _noise_of_displacements(experiment, poses.q, stations, np.repeat(loads, moved.shape[1]))
    silent = not (sigma > 0.0).all()
    out = displaced(poses, moved, UNSTATED, names, repeat, not silent, experiment.noise.repeatability)
    return replace(out, sigma=out.sigma if silent else frozen(sigma), directed=directed)


def _noise_of_displacements(
    experiment: Experiment, q: Array, stations: Sequence[str], loads: npt.NDArray[np.str_]
) -> tuple[Array, Array | None]:
    """sd (R, 3) m of displacements of all markers at joint angles (N, n) under loads (R,), and what they err along
    directions (R, 2, 3). InputError where nobody states it of loads that the tracker reads."""
    noise, count = experiment.noise, len(q) * len(experiment.markers)
    gauges = {case.name for case in experiment.loads if case.gauge is not None}
    if all(load in gauges for load in loads.tolist()):
        return np.ones((count, 3)), None
    there = np.zeros((count, 3))
    if noise.of_beam("displacement"):
        places = experiment.rigid_places(q)
        there = np.concatenate([seen_from(experiment, name, p) for name, p in zip(stations, places, strict=True)])
    covariance = noise.covariances("displacement", there)
    if covariance is None:
        raise InputError(f"{experiment.path}: a displacement needs its noise, for example noise: {{sigma_mm: 0.03}}")
    sigma, directed = split_covariances(covariance + noise.nest**2 * np.eye(3))
    return sigma, directed if directed.any() else None


def _gauged(experiment: Experiment, readings: Readings, load: npt.NDArray[np.str_], seen: Flags) -> Readings:
    """Displacements (R,) of which those under a load with a gauge are what it reads; those of unseen markers go."""
    gauges = {case.name: case.gauge for case in experiment.loads if case.gauge is not None}
    keep, names = seen.copy(), np.array(experiment.marker_names)[readings.marker]
    for name, gauge in gauges.items():
        own = load == name
        keep[own] = names[own] == gauge.marker
        if own.any():
            readings = readings.gauged(own, gauge.along, gauge_sigma(experiment) or UNSTATED)
    return readings if keep.all() else readings.of_rows(np.flatnonzero(keep))


def _stood(visits: _Visits, poses: Poses, rows: Indices) -> Readings:
    """Positions without a load, each in the frame of its station, base axes where nobody knows that frame."""
    experiment, poses, stations = visits.experiment, poses.take(rows), visits.stations(rows)
    places = visits.model.positions(poses, visits.x, False, visits.linear)
    seen = seen_markers(experiment, poses.q, stations)
    series = tuple(dict.fromkeys(stations))
    known = tuple(next((f for f in experiment.frames if f.series == name), None) for name in series)
    frame = np.array([series.index(name) for name in stations])
    value, noise = np.empty_like(places), experiment.noise
    for f, name in enumerate(series):
        own, station, there = frame == f, station_of(experiment, name), known[f]
        origin = np.zeros(3) if station.xyz is None else station.xyz
        value[own] = places[own] - origin if there is None else there.apply(places[own])
    require_position_noise(experiment, [station_of(experiment, name) for name in series])
    covariance = noise.covariances("position", value.reshape(-1, 3))
    assert covariance is not None
    sigma, directed = split_covariances(covariance + noise.nest**2 * np.eye(3))
    count, (state, marker) = len(rows), np.nonzero(seen)
    states = States(
        poses=poses,
        loaded=np.zeros(count, dtype=bool),
        pose=tuple(visits.names(rows)),
        load_id=("",) * count,
        series=tuple(stations),
        repeat=visits.repeat[rows],
        cycle=np.ones(count, dtype=np.intp),
    )
    read = state * places.shape[1] + marker
    return Readings(
        states=states,
        plus=state,
        minus=np.full(len(state), -1),
        marker=marker,
        frame=frame[state],
        frames=series,
        known=known,
        value=frozen(value[state, marker]),
        sigma=frozen(np.where(sigma > 0.0, sigma, UNSTATED)[read]),
        minus_sigma=frozen(np.full((len(state), 3), np.nan)),
        stated=bool((sigma > 0.0).all()),
        use=np.ones(len(state), dtype=bool),
        line=np.arange(3, 3 + len(state)),
        file=np.zeros(len(state), dtype=np.intp),
        to=np.full(len(state), -1),
        directed=directed[read] if directed.any() else None,
        repeatability=noise.repeatability,
    )


def simulate_rows(
    experiment: Experiment,
    readings: Readings,
    x: Array | None = None,
    truth: Truth = "nominal",
    seed: Seed = 0,
    linear: Linear = False,
) -> Simulation:
    """Measure the rows of readings in simulation, of whatever kind: each with its sigma, rows that share an unloaded
    reading with its error, in the frames that suit the readings; of a touched point what the marker is off the point.
    x, truth, seed and linear as for `simulate`."""
    if not readings.stated:
        raise InputError(f"{experiment.path}: a simulation needs the noise, for example noise: {{sigma_mm: 0.03}}")
    model, rng = experiment.model(), np.random.default_rng(seed)
    x = _truth(experiment, truth, rng) if x is None else x
    rows = make_rows(readings)
    predicted = rows.predict(model, x, rows.start(model, model.nominal), linear)
    value = np.array(readings.value)
    noise = rows.noise.colour(rows.flat(rng.standard_normal(predicted.shape)))
    value[rows.keep] = predicted + rows.spread(noise)
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
) -> Readings:
    """Readings of every marker's displacement (N, K, 3) m at N poses, each minus an unloaded state of its own."""
    count, markers = (int(n) for n in displacement.shape[:2])
    loaded, both = np.arange(2 * count) < count, poses.take(np.tile(np.arange(count), 2))
    wrench = np.where(loaded[:, None], both.wrench, 0.0)
    conditions = _stacked([poses.loaded, poses.unloaded])
    repeat = np.ones(count, dtype=np.intp) if repeat is None else repeat
    states = States(
        poses=replace(both, wrench=wrench, unloaded=conditions, loaded=conditions),
        loaded=loaded,
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
    )


def _stacked(parts: list[Conditions]) -> Conditions:
    def both(name: str) -> Array | None:
        values = [getattr(p, name) for p in parts]
        return None if any(v is None for v in values) else np.concatenate(values)

    return Conditions.each(both)


def _truth(experiment: Experiment, truth: str, rng: np.random.Generator) -> Array:
    """Values (p,) of a truth; drawn: from stated sds, or from the typical size of an error that `fit` asks for."""
    check_choice("truth", Truth, truth)
    model = experiment.model()
    if truth == "nominal":
        return model.nominal
    x, fitted = prior_draws(model, 1, rng)[0], set(experiment.fit_names())
    open_ = [i for i, p in enumerate(model.parameters) if p.sd is None and p.nominal == 0.0 and p.name in fitted]
    typical = np.array([model.parameters[i].typical for i in open_])
    x[open_] += typical * rng.standard_normal(len(open_))
    return np.clip(x, [p.lower for p in model.parameters], [p.upper for p in model.parameters])


def prior_draws(model: Model, count: int, rng: np.random.Generator) -> Array:
    """Parameter values (count, p) from the priors, inside the bounds; nominal ones where no sd is stated."""
    drawn = [i for i, p in enumerate(model.parameters) if p.sd is not None or not p.by_name]
    sd = np.array([model.parameters[i].sd or 0.0 for i in drawn])
    x = np.tile(model.nominal, (count, 1))
    x[:, drawn] += sd * rng.standard_normal((count, len(drawn)))
    lower = np.array([max(p.lower, 0.1 * p.nominal) if p.lower == 0.0 else p.lower for p in model.parameters])
    return np.clip(x, lower, [p.upper for p in model.parameters])
