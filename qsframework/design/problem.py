"""A design problem: every allowed pose under every load is a candidate, with its whitened rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.design.candidates import Candidates
from qsframework.elastostatics import Model
from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.estimation import RankTest, left, orthonormal, rank_test, scales
from qsframework.experiment import Experiment, LoadCase, Plan, Readings, make_rows
from qsframework.experiment.readings import UNSTATED
from qsframework.experiment.simulate import prior_draws
from qsframework.information import (
    Allowed,
    CandidateRows,
    MadeRows,
    as_rows,
    information_rows,
    loss_words,
)
from qsframework.information.rows import gathered_information
from qsframework.plugin import Array, Indices, Poses
from qsframework.work import HERE, Work, run

HELD_BYTES = 4_000_000_000
"""Rows above this size are computed again in every pass instead of being held."""
_SAMPLE = 4096
_CHUNK = 65536
_SETTLED = 40_000
"""Candidates, each at every sample, up to which all are scored where they settle: a second or less."""
_TRIED, _ALIKE = 512, 0.05
"""Beyond, so many of them say whether the first step from the commanded pose ranks alike: where the information of any
combination of parameters differs by less than this share."""
_TEST_POSES = 200
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False, kw_only=True)
class DesignProblem:
    """N candidates, load by load: the poses (P, n), the rows, and how many poses of the plan each load gets.

    total: number of poses, or the budget; prices (loads,): what a pose under each load takes of it;
    counts: per load, None where the loads that say no number share the rest; least: per load at least so many;
    prior: information (S, p, p) that is there before; samples: parameter values (S, q) that the rows are taken at;
    linear: the rows are those of the first step from the commanded pose, which ranks alike
    """

    experiment: Experiment
    pendant: Array
    loads: tuple[LoadCase, ...]
    counts: tuple[int | None, ...]
    least: tuple[int, ...]
    total: float
    prices: Array
    names: tuple[str, ...]
    samples: Array
    rows: CandidateRows
    prior: Array
    linear: bool = False

    @property
    def per_load(self) -> int:
        return len(self.pendant)

    def place(self, index: Indices) -> Indices:
        """The pose, a row of `pendant`, of candidates."""
        return np.asarray(index) % self.per_load

    def load(self, index: Indices) -> Indices:
        """The load of candidates."""
        return np.asarray(index) // self.per_load

    def batch(self, index: Indices) -> Poses:
        """The candidates' angles and wrenches."""
        pendant = self.pendant[self.place(index)]
        wrench = np.stack([load.wrench for load in self.loads])[self.load(index)]
        return Poses(pendant, self.experiment.robot.controller.to_joints(pendant), wrench)

    def rows_of(self, poses: Poses, linear: bool = False) -> Array:
        """Whitened scaled rows (m, S, 3 K, p) of any poses, where they settle."""
        return sample_rows(self.experiment, poses, self.names, self.samples, linear)

    @property
    def priced(self) -> bool:
        """Whether `total` is a budget."""
        return bool((self.prices != 1.0).any())


def sample_rows(
    experiment: Experiment, poses: Poses, names: Sequence[str], samples: Array, linear: bool = False
) -> Array:
    """Whitened rows (m, S, 3 K, p) of poses at S samples of the parameters; zero where a pose does not settle."""
    model, sigma = experiment.model(), experiment.noise.sigma or 1.0
    try:
        return np.stack([information_rows(model, poses, names, sigma, x, linear) for x in samples], axis=1)
    except NotConverged:
        if len(poses) == 1:
            return np.zeros((1, len(samples), 3 * len(model.markers), len(names)))
    halves = (slice(0, len(poses) // 2), slice(len(poses) // 2, None))
    return np.concatenate([sample_rows(experiment, poses.take(half), names, samples, linear) for half in halves])


def make_problem(
    experiment: Experiment,
    candidates: Candidates | Array,
    total: float,
    samples: Array | None = None,
    prior: Array | None = None,
    budget: bool = False,
    progress: Progress | None = None,
    work: Work = HERE,
) -> DesignProblem:
    """Every allowed pose under every load case is a candidate of its own."""
    if not experiment.loads:
        raise InputError(f"{experiment.path}: a design needs `loads`, for example - {{name: weight, fz_N: -4000}}")
    if experiment.noise.sigma is None:
        raise InputError(f"{experiment.path}: a design needs the noise, for example noise: {{sigma_mm: 0.03}}")
    pendant = candidates.pendant if isinstance(candidates, Candidates) else np.asarray(candidates, dtype=float)
    if not np.isfinite(pendant).all():
        bad = ", ".join(str(i) for i in np.flatnonzero(~np.isfinite(pendant).all(axis=1))[:5])
        raise InputError(f"candidate poses with angles that are not numbers: rows {bad}")
    counts = tuple(load.poses for load in experiment.loads)
    least = tuple(load.poses_min or 0 for load in experiment.loads)
    prices = np.array([load.cost if budget else 1.0 for load in experiment.loads])
    asked = float(prices @ [(c or 0) + m for c, m in zip(counts, least, strict=True)])
    if budget and any(counts):
        raise InputError("with a budget the loads say poses_min, not poses: the numbers follow from their costs")
    if budget and asked > total:
        raise InputError(f"the poses_min of the loads cost {asked:g} in all, the budget is {total:g}")
    if asked > total or (None not in counts and asked != total):
        raise InputError(f"the loads ask for {asked:g} poses in all, the plan has {total:g}")
    names = experiment.fit_names()
    at = experiment.model().nominal[None] if samples is None else samples
    start = np.zeros((len(at), len(names), len(names))) if prior is None else prior
    draft = DesignProblem(
        experiment=experiment,
        pendant=pendant,
        loads=experiment.loads,
        counts=counts,
        least=least,
        total=total,
        prices=prices,
        names=names,
        samples=at,
        rows=as_rows(np.zeros((0, 1, 1, 1))),
        prior=start,
    )
    draft = replace(draft, linear=_first_step_ranks_alike(draft))
    return replace(draft, rows=_rows(draft, progress, work))


def _first_step_ranks_alike(problem: DesignProblem) -> bool:
    """Whether there are so many candidates that the first step from the commanded pose scores them, and a sample shows
    that it may."""
    count = problem.per_load * len(problem.loads)
    if count * len(problem.samples) <= _SETTLED:
        return False
    some = problem.batch(np.sort(np.random.default_rng(0).choice(count, _TRIED, replace=False)))
    linear, settled = (
        np.einsum("nskp,nskq->spq", rows, rows) for rows in (problem.rows_of(some, True), problem.rows_of(some))
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
    count = problem.per_load * len(problem.loads)
    shape = (count, len(problem.samples), 3 * len(problem.experiment.markers), len(problem.names))
    if 8 * np.prod(shape, dtype=float) > HELD_BYTES:
        return MadeRows(lambda index: problem.rows_of(problem.batch(index), problem.linear), shape)
    out = np.empty(shape)
    shared = (problem.experiment, problem.names, problem.samples, problem.linear)
    starts = range(0, count, _CHUNK)
    tasks = (problem.batch(np.arange(start, min(start + _CHUNK, count))) for start in starts)
    for start, rows in zip(starts, run(_chunk, shared, tasks, work), strict=True):
        out[start : start + len(rows)] = rows
        if progress is not None:
            progress(start + len(rows), count)
    return as_rows(out)


def _chunk(shared: tuple[Experiment, tuple[str, ...], Array, bool], poses: Poses) -> Array:
    experiment, names, samples, linear = shared
    return sample_rows(experiment, poses, names, samples, linear)


def draw_samples(model: Model, count: int, seed: int) -> Array:
    """Parameter values (count, q): the nominal ones, then draws from the priors, inside the bounds."""
    drawn = prior_draws(model, count - 1, np.random.default_rng(seed))
    return np.concatenate([model.nominal[None], drawn])


def tip_rows(experiment: Experiment, poses: Poses | None, candidates: Array, names: Sequence[str]) -> Array:
    """Sensitivity (J, 3, p) of the load point at test poses, m per unit of each scaled parameter.

    poses None: the first candidates under every load of the experiment stand for the work.
    """
    if poses is None:
        few = candidates[:_TEST_POSES]
        pendant = np.tile(few, (len(experiment.loads), 1))
        wrench = np.repeat(np.stack([load.wrench for load in experiment.loads]), len(few), axis=0)
        poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench)
    model = replace(experiment.model(), markers=(experiment.load_site,), marker_names=("load point",))
    chosen = [model.parameters[i] for i in model.index(names)]
    return model.sensitivity(poses, names=names)[:, 0] * scales(chosen)


def taken_information(experiment: Experiment, taken: Plan | Readings, names: Sequence[str], samples: Array) -> Array:
    """Information (S, p, p) of readings already taken, or of the poses of a plan."""
    if isinstance(taken, Plan):
        rows = sample_rows(experiment, taken.poses, names, samples)
        weights = np.array(taken.repeats, dtype=float)
        return gathered_information(as_rows(rows), np.arange(len(rows)), weights)
    rows, model = make_rows(taken), experiment.model()
    unit = 1.0 if taken.stated else UNSTATED / (experiment.noise.sigma or 1.0)
    size = scales([model.parameters[i] for i in model.index(names)])
    out: list[Array] = []
    for x in samples:
        frames = rows.start(model, x)
        k = 6 * len(frames)
        white = rows.noise.whiten(rows.flat(rows.rates(model, x, frames, names)[1])) * unit
        A = left(orthonormal(white[:, :k]), white[:, k:] * size)
        out.append(A.T @ A)
    return np.stack(out)


def joint_sd(experiment: Experiment, taken: Sequence[Plan | Readings]) -> Array:
    """Standard deviations (p,) that plans and readings promise together, SI; inf where they cannot tell a parameter."""
    names = experiment.fit_names()
    nominal = experiment.model().nominal[None]
    M = sum((taken_information(experiment, one, names, nominal)[0] for one in taken), np.zeros((len(names),) * 2))
    size = np.sqrt(np.where(np.diag(M) > 0, np.diag(M), 1.0))
    values, vectors = np.linalg.eigh(M / np.outer(size, size))
    lost = values <= 1e-12 * values[-1]
    variance = (vectors[:, ~lost] ** 2 / values[~lost]).sum(axis=1) / size**2
    variance[(vectors[:, lost] ** 2).sum(axis=1) > 1e-6] = np.inf
    return np.sqrt(variance) * scales(experiment.fit_parameters())


def require_rank(problem: DesignProblem) -> None:
    """NotIdentifiable, in words, where no plan over the candidates can tell the parameters apart."""
    used = [g for g, count in enumerate(problem.counts) if count is None or count > 0]
    rng = np.random.default_rng(0)
    picks = [
        g * problem.per_load + np.sort(rng.choice(problem.per_load, min(_SAMPLE, problem.per_load), replace=False))
        for g in used
    ]
    before = _root(problem.prior[0])
    if _tested(problem, np.concatenate(picks), before).full:
        return
    everything = np.concatenate([np.arange(g * problem.per_load, (g + 1) * problem.per_load) for g in used])
    test = _tested(problem, everything, before)
    if not test.full:
        said = loss_words(problem.experiment.model(), test, problem.batch(everything[:_SAMPLE]))
        path = problem.experiment.path
        raise NotIdentifiable(f"{path}: no plan with these loads can tell the parameters: {said}")


def _root(M: Array) -> Array:
    values, vectors = np.linalg.eigh(M)
    return (vectors * np.sqrt(np.maximum(values, 0.0))).T


def _tested(problem: DesignProblem, index: Indices, before: Array) -> RankTest:
    p = len(problem.names)
    triangle = before
    for start in range(0, len(index), _SAMPLE):
        block = problem.rows.take(index[start : start + _SAMPLE])[:, 0].reshape(-1, p)
        triangle = np.asarray(np.linalg.qr(np.concatenate([triangle, block]), mode="r"), dtype=np.float64)
    return rank_test(triangle, problem.names)


def allowed_designs(problem: DesignProblem, fixed: tuple[int | None, ...], cap: float) -> Allowed:
    """Loads with a number are groups of their own; the others share one group. Shares are of `total`."""
    size, total = problem.per_load, problem.total
    taken = [(c or 0) * float(price) / total for c, price in zip(fixed, problem.prices, strict=True)]
    groups: list[tuple[slice | Indices, float]] = [
        (slice(g * size, (g + 1) * size), taken[g]) for g, c in enumerate(fixed) if c is not None
    ]
    free = [g for g, c in enumerate(fixed) if c is None]
    if free:
        together = np.concatenate([np.arange(g * size, (g + 1) * size) for g in free])
        whole = slice(free[0] * size, (free[-1] + 1) * size)
        groups.append((whole if len(free) == free[-1] - free[0] + 1 else together, 1.0 - sum(taken)))
    return Allowed(tuple(g for g, _ in groups), tuple(share for _, share in groups), cap)
