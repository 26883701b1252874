"""A design problem: every allowed pose under every load, from every station, is a candidate with its whitened rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from qsframework.elastostatics import Model
from qsframework.errors import InputError, NotIdentifiable, Problem
from qsframework.estimation import RankTest, rank_test
from qsframework.experiment import Experiment, LoadCase, Plan, Readings
from qsframework.experiment.frames import AXES
from qsframework.experiment.observations import start_values
from qsframework.experiment.plan import make_plan
from qsframework.experiment.simulate import prior_draws
from qsframework.experiment.stations import Station
from qsframework.information import Allowed, CandidateRows, MadeRows, as_rows, loss_words
from qsframework.information.identifiable import NotEstimated, choose, in_order
from qsframework.information.rows import root
from qsframework.information.sensitivities import plan_columns, readings_columns, sd_after
from qsframework.plans.candidates import Candidates
from qsframework.plans.reading import FRAME_SD, CandidateReading, StationRows, sample_rows, unknown_frames
from qsframework.plugin import Array, Indices, Poses, Sensor
from qsframework.work import HERE, Work, run

HELD_BYTES = 4_000_000_000
"""Rows above this size are computed again in every pass instead of being held."""
_SAMPLE = 4096
_CHUNK, _FEW = 65536, 4096
"""Candidates whose rows are computed together: of displacements, and of positions with what they are made of."""
_SETTLED = 40_000
"""Candidates, each at every sample, up to which all are scored where they settle: a second or less."""
_TRIED, _ALIKE = 512, 0.05
"""Beyond, so many of them say whether the first step from the commanded pose ranks alike: where the information of any
combination of parameters differs by less than this share."""
_SAME, _NEAR, _SAME_LOAD = float(np.deg2rad(0.02)), float(np.deg2rad(1.0)), 0.01
"""rad, share: an arm stands at the same angles up to the first, near a planned pose up to the second; loads are the
same up to the third."""
_HELD = 2000
"""Candidates that are asked which parameters positions tell."""
Prior = Callable[[Sequence[str]], Array]
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False, kw_only=True)
class DesignProblem:
    """Candidates station by station, of each load by load: the poses (N, n), the rows, and how many poses of the plan
    each load gets.

    total: number of poses, or the budget; prices (loads,): what a pose under each load takes of it;
    counts: per load, None where the loads that say no number share the rest; least: per load at least so many;
    prior: information (S, P, P) that is there before; stations: those in use, among all of the reading;
    linear: the rows are those of the first step from the commanded pose, which ranks alike;
    held: parameters of `fit` that no plan over the candidates tells, with what they are confounded with
    """

    experiment: Experiment
    pendant: Array
    reading: CandidateReading
    counts: tuple[int | None, ...]
    least: tuple[int, ...]
    total: float
    prices: Array
    rows: CandidateRows
    prior: Array
    stations: tuple[int, ...]
    linear: bool = False
    held: tuple[NotEstimated, ...] = ()

    @property
    def per_load(self) -> int:
        return len(self.pendant)

    @property
    def loads(self) -> tuple[LoadCase, ...]:
        return self.reading.loads

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that the rows are for, before the motions of the frames."""
        return self.reading.names

    @property
    def samples(self) -> Array:
        """Parameter values (S, q) that the rows are taken at."""
        return self.reading.samples

    @property
    def wanted(self) -> Indices:
        """Places of the parameters that a plan is for, among the columns: where positions are read, not those of
        markers, nor the frames."""
        if not any(load.of_positions for load in self.loads):
            return np.arange(len(self.names))
        markers = self.experiment.model().names_of(Sensor)
        own = np.flatnonzero([name not in markers for name in self.names])
        return own if len(own) else np.arange(len(self.names))

    def place(self, index: Indices) -> Indices:
        """The pose, a row of `pendant`, of candidates."""
        return np.asarray(index) % self.per_load

    def load(self, index: Indices) -> Indices:
        """The load of candidates."""
        return np.asarray(index) // self.per_load % len(self.loads)

    def station(self, index: Indices) -> Indices:
        """The station of candidates, among all of the reading."""
        return np.array(self.stations)[np.asarray(index) // (self.per_load * len(self.loads))]

    def indices(self, load: int) -> Indices:
        """The candidates of a load."""
        size, each = self.per_load, self.per_load * len(self.loads)
        starts = each * np.arange(len(self.stations)) + load * size
        return (starts[:, None] + np.arange(size)).ravel()

    def members(self, load: int) -> slice | Indices:
        """The same, as a slice where they stand together."""
        first = load * self.per_load
        return slice(first, first + self.per_load) if len(self.stations) == 1 else self.indices(load)

    def batch(self, index: Indices) -> Poses:
        """The candidates' angles and wrenches."""
        return self.poses_at(self.pendant[self.place(index)], self.load(index))

    def poses_at(self, pendant: Array, load: Indices) -> Poses:
        """Pendant angles (m, n) under loads (m,)."""
        wrench = np.stack([case.wrench for case in self.loads])[load]
        return Poses(pendant, self.experiment.robot.controller.to_joints(pendant), wrench)

    def rows_at(self, pendant: Array, index: Indices, linear: bool = False) -> Array:
        """Whitened scaled rows (m, S, 3 K, P) at angles (m, n), read as the candidates (m,) are, where they settle."""
        load = self.load(index)
        return self.reading.rows(self.poses_at(pendant, load), load, self.station(index), linear)

    def made(self, index: Indices, linear: bool = False) -> Array:
        """The same of candidates as they are."""
        return self.rows_at(self.pendant[self.place(index)], index, linear)

    def of_stations(self, stations: tuple[int, ...]) -> DesignProblem:
        """The problem with some of its stations only."""
        if stations == self.stations:
            return self
        assert isinstance(self.rows, StationRows)
        where = [self.stations.index(s) for s in stations]
        return replace(
            self, rows=replace(self.rows, weights=self.rows.weights[where], used=stations), stations=stations
        )

    @property
    def priced(self) -> bool:
        """Whether `total` is a budget."""
        return bool((self.prices != 1.0).any())


def make_problem(
    experiment: Experiment,
    candidates: Candidates | Array,
    total: float,
    samples: Array | None = None,
    prior: Prior | None = None,
    budget: bool = False,
    progress: Progress | None = None,
    work: Work = HERE,
) -> DesignProblem:
    """Every allowed pose under every load case, from every station, is a candidate of its own.

    prior: information (S, p, p) of the named parameters that is there before
    """
    loads = experiment.cases
    if not loads:
        raise InputError(
            f"{experiment.path}: a design needs `loads`, for example - {{name: weight, fz_N: -4000}}; `positions: "
            "{}` plans positions without a load"
        )
    pendant = candidates.pendant if isinstance(candidates, Candidates) else np.asarray(candidates, dtype=float)
    if not np.isfinite(pendant).all():
        bad = ", ".join(str(i) for i in np.flatnonzero(~np.isfinite(pendant).all(axis=1))[:5])
        raise InputError(f"candidate poses with angles that are not numbers: rows {bad}")
    counts = tuple(load.poses for load in loads)
    least = tuple(load.poses_min or 0 for load in loads)
    prices = np.array([load.cost if budget else 1.0 for load in loads])
    _check_counts(counts, least, prices, total, budget)
    reading = make_reading(experiment, samples)
    pendant = seen_by_some(reading, pendant)
    draft = DesignProblem(
        experiment=experiment,
        pendant=pendant,
        reading=reading,
        counts=counts,
        least=least,
        total=total,
        prices=prices,
        rows=as_rows(np.zeros((0, 1, 1, 1))),
        prior=np.zeros((len(reading.samples), reading.width, reading.width)),
        stations=tuple(range(len(reading.stations))),
    )
    draft = _identifiable(draft, prior or (lambda of: np.zeros((len(reading.samples), len(of), len(of)))))
    draft = replace(draft, linear=_first_step_ranks_alike(draft))
    return replace(draft, rows=_rows(draft, progress, work))


def _with_prior(problem: DesignProblem, prior: Prior) -> DesignProblem:
    """With what is there before of its parameters, and next to nothing of the frames."""
    p, width = len(problem.names), problem.reading.width
    whole = np.zeros((len(problem.samples), width, width))
    whole[:, :p, :p] = prior(problem.names)
    whole[:, p:, p:] = np.eye(width - p) / FRAME_SD**2
    return replace(problem, prior=whole)


def _check_counts(
    counts: tuple[int | None, ...], least: tuple[int, ...], prices: Array, total: float, budget: bool
) -> None:
    """InputError where the numbers of poses that the loads ask for do not fit the plan."""
    asked = float(prices @ [(c or 0) + m for c, m in zip(counts, least, strict=True)])
    if budget and any(counts):
        raise InputError("with a budget the loads say poses_min, not poses: the numbers follow from their costs")
    if budget and asked > total:
        raise InputError(f"the poses_min of the loads cost {asked:g} in all, the budget is {total:g}")
    if asked > total or (None not in counts and asked != total):
        raise InputError(f"the loads ask for {asked:g} poses in all, the plan has {total:g}")


def make_reading(experiment: Experiment, samples: Array | None = None) -> CandidateReading:
    """How an experiment's candidates are read. InputError where nobody states the noise."""
    names, loads = experiment.fit_names(), experiment.cases
    at = start_values(experiment, names)[None] if samples is None else samples
    stations = experiment.stations or (Station(),)
    unknown = unknown_frames(experiment)
    reading = CandidateReading(
        experiment=experiment,
        names=names,
        samples=at,
        loads=loads,
        stations=stations,
        slots=tuple(unknown.index(s.name) if s.name in unknown else None for s in stations),
    )
    reading.require_noise()
    return reading


def seen_by_some(reading: CandidateReading, pendant: Array) -> Array:
    """The poses at which some station sees a marker. InputError where there is none."""
    experiment = reading.experiment
    if any(s.xyz is None for s in reading.stations) or any(load.gauge is not None for load in reading.loads):
        return pendant
    q = experiment.robot.controller.to_joints(pendant)
    seen = np.logical_or.reduce([s.sees(experiment, q).any(axis=1) for s in reading.stations])
    if not seen.any():
        names = ", ".join(s.name for s in reading.stations)
        hint = "Move a station, add one (stations: in the experiment), or put markers on another side of the arm."
        message = f"no station sees a marker at any of the {len(pendant)} allowed poses: {names}"
        raise InputError(Problem(message, str(experiment.path), hint=hint))
    return pendant[seen]


def _identifiable(problem: DesignProblem, prior: Prior) -> DesignProblem:
    """The problem for the parameters that the candidates tell beside the frames, as a fit would take them.

    InputError where one that no plan tells was asked for by its own name. Of displacements nothing is held: where they
    do not tell a parameter, `require_rank` says what would.
    """
    if not any(load.of_positions for load in problem.loads):
        return _with_prior(problem, prior)
    experiment, names = problem.experiment, in_order(problem.experiment.model(), problem.names)
    count = problem.per_load * len(problem.loads) * len(problem.stations)
    some = np.sort(np.random.default_rng(0).choice(count, min(_HELD, count), replace=False))
    block = problem.made(some)[:, 0].reshape(-1, problem.reading.width)
    p, order = len(names), [problem.names.index(n) for n in names]
    columns = np.concatenate([block[:, p:], block[:, :p][:, order]], axis=1) * np.sqrt(problem.total / len(some))
    before = np.pad(root(prior(names)[0]).T, ((0, 0), (columns.shape[1] - p, 0)))
    labels = [f"frame[{s.name}].{a}".replace("[]", "") for s in _unknown(problem) for a in AXES]
    every = [*labels, *names]
    taken, held = choose(np.concatenate([columns, before]), every)
    held = tuple(h for h in held if h.name in names)
    by_name = [h for h in held if h.name in (experiment.fit or ())]
    if by_name or len(held) == len(names):
        raise NotIdentifiable(
            f"{experiment.path}: no plan of these readings identifies "
            f"{', '.join(h.name for h in by_name or held[:6])}: "
            f"{'; '.join(h.words() for h in (by_name or held)[:6])}. {_what_to_change(problem, by_name or held)}"
        )
    kept = {every[i] for i in taken}
    reading = replace(problem.reading, names=tuple(n for n in problem.names if n in kept))
    return _with_prior(replace(problem, reading=reading, held=held), prior)


def _unknown(problem: DesignProblem) -> list[Station]:
    """The stations whose frame nobody knows."""
    return [s for s, slot in zip(problem.reading.stations, problem.reading.slots, strict=True) if slot is not None]


def _what_to_change(problem: DesignProblem, held: Sequence[NotEstimated]) -> str:
    """What would tell parameters that nothing tells."""
    absorbers = {name for h in held for name in h.correlated_with}
    if any(name.startswith("frame") for name in absorbers):
        return "State where the base is in the tracker's frame (frames: in the experiment), or leave them out of `fit`"
    if not absorbers and problem.experiment.has_load and not problem.experiment.loads:
        return "They need readings under load: add `loads`, or leave them out of `fit`"
    if any(load.of_positions for load in problem.loads) and len(problem.loads) == 1:
        advice = "Leave them out of `fit`, or add markers off the last axis and on other links"
        return f"{advice}; springs need `loads`"
    return "Leave them out of `fit`, or leave out what they are confounded with"


def _first_step_ranks_alike(problem: DesignProblem) -> bool:
    """Whether there are so many candidates that the first step from the commanded pose scores them, and a sample shows
    that it may."""
    count = problem.per_load * len(problem.loads)
    if count * len(problem.samples) <= _SETTLED:
        return False
    some = np.sort(np.random.default_rng(0).choice(count, _TRIED, replace=False))
    linear, settled = (
        np.einsum("nskp,nskq->spq", rows, rows) + problem.prior
        for rows in (problem.made(some, True), problem.made(some))
    )
    for one, other in zip(linear, settled, strict=True):
        size = np.sqrt(np.diag(other))
        if not size.all():
            return False
        values, vectors = np.linalg.eigh(other / np.outer(size, size))
        half = vectors / np.sqrt(np.maximum(values, 1e-12 * values[-1]))
        ratio = np.linalg.eigvalsh(half.T @ (one / np.outer(size, size)) @ half)
        if ratio[0] < 1.0 - _ALIKE or ratio[-1] > 1.0 + _ALIKE:
            return False
    return True


def _rows(problem: DesignProblem, progress: Progress | None, work: Work) -> CandidateRows:
    """Rows of all candidates; of several stations those of one, and what each of the stations makes of them."""
    reading, plain = problem.reading, problem.reading.plain
    count = problem.per_load * len(problem.loads)
    width = len(problem.names) if plain else len(problem.names) + 6
    shape = (count, len(problem.samples), 3 * len(problem.experiment.markers), width)
    kept, weights = 8 * np.prod(shape, dtype=float) <= HELD_BYTES, np.zeros((0, 0, 0))
    if plain and not kept:
        return MadeRows(lambda index: problem.made(index, problem.linear), shape)
    out = np.empty(shape if kept else (0, 0, 0, 0))
    step = _CHUNK if plain else _FEW
    starts = range(0, count, step)
    parts = (np.arange(start, min(start + step, count)) for start in starts)
    tasks = ((problem.batch(part), problem.load(part)) for part in parts)
    for start, (rows, weight) in zip(starts, run(_chunk, (reading, problem.linear), tasks, work), strict=True):
        part = slice(start, start + len(rows))
        if kept:
            out[part] = rows
        if not plain:
            weights = weights if weights.size else np.zeros((len(problem.stations), count, *weight.shape[2:]))
            weights[:, part] = weight
        if progress is not None:
            progress(start + len(rows), count)
    if plain:
        return as_rows(out)
    source = as_rows(out)
    if not kept:
        source = MadeRows(lambda i: reading.bare(problem.batch(i), problem.load(i), problem.linear)[0], shape)
    return StationRows(reading, source, weights, problem.stations)


def _chunk(shared: tuple[CandidateReading, bool], task: tuple[Poses, Indices]) -> tuple[Array, Array]:
    """Rows of poses, and their weights from every station."""
    (reading, linear), (poses, load) = shared, task
    if reading.plain:
        return sample_rows(reading.experiment, poses, reading.names, reading.samples, linear), np.zeros((0, 0, 0))
    bare, places = reading.bare(poses, load, linear)
    each = range(len(reading.stations))
    return bare, np.stack([reading.weights(poses, places, load, np.full(len(poses), s)) for s in each])


def draw_samples(model: Model, count: int, seed: int) -> Array:
    """Parameter values (count, q): the nominal ones, then draws from the priors, inside the bounds."""
    drawn = prior_draws(model, count - 1, np.random.default_rng(seed))
    return np.concatenate([model.nominal[None], drawn])


def taken_information(experiment: Experiment, taken: Plan | Readings, names: Sequence[str], samples: Array) -> Array:
    """Information (S, p, p) of readings already taken, or of the poses of a plan."""
    if isinstance(taken, Plan):
        each = [plan_columns(experiment, taken, names, x) for x in samples]
    else:
        each = [readings_columns(experiment, taken, names, x) for x in samples]
    return np.stack([A.T @ A for A in each])


def counted_once(taken: Sequence[Plan | Readings]) -> tuple[list[Plan | Readings], list[str]]:
    """What was taken, readings first, each plan without the poses that readings or another plan hold: these by name."""
    out, again, seen = list[Plan | Readings](), list[str](), list[Plan]()
    for one in sorted(taken, key=lambda part: isinstance(part, Plan)):
        plan = _visited(one)
        if isinstance(one, Plan):
            twice = np.any([np.zeros(len(plan.pose), dtype=bool), *(_among(plan, other) for other in seen)], axis=0)
            again += [plan.pose[i] for i in np.flatnonzero(twice)]
            one = plan = plan.take(np.flatnonzero(~twice))
        seen.append(plan)
        out += [one] if plan.pose else []
    return out, again


def _visited(one: Plan | Readings) -> Plan:
    """The poses of what was taken, as a plan."""
    if isinstance(one, Plan):
        return one
    at, states = np.unique(one.plus[one.use]), one.states
    poses = one.poses.take(at)
    poses = replace(poses, wrench=poses.wrench * states.loaded[at, None])
    names, series = np.array(states.pose)[at].tolist(), np.array(states.series)[at].tolist()
    return make_plan(poses, [""] * len(at), names=names, station=series)


def _among(plan: Plan, other: Plan) -> npt.NDArray[np.bool_]:
    """Which poses of a plan (n,) are among others: near one of its name, or at the angles, load and station of one."""
    gap = np.abs(plan.pendant[:, None] - other.pendant).max(axis=2)
    named, placed = (
        np.array(own)[:, None] == np.array(theirs)
        for own, theirs in ((plan.pose, other.pose), (plan.stations, other.stations))
    )
    pull = np.linalg.norm(plan.wrench, axis=1)[:, None]
    placed &= np.linalg.norm(plan.wrench[:, None] - other.wrench, axis=2) <= _SAME_LOAD * pull
    return ((named & (gap <= _NEAR)) | (placed & (gap <= _SAME))).any(axis=1)


def joint_sd(experiment: Experiment, taken: Sequence[Plan | Readings], *, free: bool = False) -> Array:
    """Standard deviations (p,) that plans and readings predict together, SI; inf where they cannot tell a parameter."""
    names, model = experiment.fit_names(), experiment.model()
    nominal = model.nominal[None]
    M = sum((taken_information(experiment, one, names, nominal)[0] for one in taken), np.zeros((len(names),) * 2))
    return sd_after(model, root(M).T, names, free)


def require_rank(problem: DesignProblem) -> None:
    """NotIdentifiable, in words, where no plan over the candidates can tell the parameters apart."""
    every = [problem.indices(g) for g, count in enumerate(problem.counts) if count is None or count > 0]
    rng = np.random.default_rng(0)
    picks = [own[np.sort(rng.choice(len(own), min(_SAMPLE, len(own)), replace=False))] for own in every]
    before = root(problem.prior[0]).T
    if _tested(problem, np.concatenate(picks), before).full:
        return
    everything = np.concatenate(every)
    test = _tested(problem, everything, before)
    if not test.full:
        said = loss_words(problem.experiment.model(), test, problem.batch(everything[:_SAMPLE]))
        touched = ", ".join(load.name for load in problem.loads if load.gauge is not None)
        one = "reads one direction of one marker: add a gauge along another, or a load that the tracker reads"
        said += f". Under {touched} a dial gauge {one}" if touched else ""
        path = problem.experiment.path
        raise NotIdentifiable(f"{path}: no plan with these loads identifies the parameters: {said}")


def _tested(problem: DesignProblem, index: Indices, before: Array) -> RankTest:
    p = problem.reading.width
    labels = [*problem.names, *(f"frame[{s.name}].{a}" for s in _unknown(problem) for a in AXES)]
    triangle = before
    for start in range(0, len(index), _SAMPLE):
        block = problem.rows.take(index[start : start + _SAMPLE])[:, 0].reshape(-1, p)
        triangle = np.asarray(np.linalg.qr(np.concatenate([triangle, block]), mode="r"), dtype=np.float64)
    return rank_test(triangle, labels)


def allowed_designs(problem: DesignProblem, fixed: tuple[int | None, ...], cap: float) -> Allowed:
    """Loads with a number are groups of their own; the others share one group. Shares are of `total`."""
    total = problem.total
    taken = [(c or 0) * float(price) / total for c, price in zip(fixed, problem.prices, strict=True)]
    groups = [(problem.members(g), taken[g]) for g, c in enumerate(fixed) if c is not None]
    free = [g for g, c in enumerate(fixed) if c is None]
    if free:
        together = np.concatenate([problem.indices(g) for g in free])
        whole = slice(int(together[0]), int(together[-1]) + 1)
        in_one = len(together) == together[-1] - together[0] + 1 and len(problem.stations) == 1
        groups.append((whole if in_one else together, 1.0 - sum(taken)))
    return Allowed(tuple(g for g, _ in groups), tuple(share for _, share in groups), cap)
