"""Poses that tell two causes apart: T-optimal, which for one trace is c-optimal.

The readings are to show the trace b of one cause after the fitted parameters and another cause absorbed what they can:
s^2 = b' (I - P) b. Beside those columns, 1 / s^2 is the variance of b's own coefficient: a linear criterion of the
information, so that the design package's exchange, its relaxed designs and their certificates apply.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.design.column_generation import Relaxed, solve_columns
from qsframework.design.criteria import Linear
from qsframework.design.exact import Quotas, exchange
from qsframework.design.minimax import Robust
from qsframework.design.task import make_task
from qsframework.diagnose.linearization.candidates import Cause, widened
from qsframework.elastostatics import Model
from qsframework.errors import NotCertified, NotIdentifiable
from qsframework.estimation import left, orthonormal, scales
from qsframework.experiment import Experiment, Plan, Readings, make_rows
from qsframework.experiment.frames import motion_count
from qsframework.experiment.readings import UNSTATED
from qsframework.information import Allowed, as_rows, bound_of
from qsframework.information.rows import block_scores, root
from qsframework.plugin import Array, Indices, Poses

STARTS = 8
_CERTIFIED = 0.99
_SHORT = 2000
_LOST = 1e-9
_RIDGE = 1e-10
_ABSORBED = 1e-5
"""Share of a trace below which what is left of it is rounding."""
Taken = Plan | Readings | Poses
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False, kw_only=True)
class Question:
    """Is it `first`, with parameters that deviate by values (p,) SI, or is it `second`?

    known: columns that are fitted anyhow, with sizes (f,): the fitted parameters and whatever else is named already;
    x (q,): values of the model's parameters
    """

    model: Model
    known: tuple[str, ...]
    sizes: Array
    first: Cause
    second: Cause
    values: Array
    x: Array
    sigma: float

    @property
    def width(self) -> tuple[int, int]:
        """Numbers of columns that are fitted anyhow and of the second cause; the trace is one more."""
        return len(self.known), len(self.second.names)

    def rows(self, poses: Poses) -> Array:
        """Whitened columns (N, K, 3, f + p + 1) of displacements: known, second, trace."""
        wanted = [*self.known, *self.second.names, *self.first.names]
        return self.assembled(self.model.sensitivity(poses, self.x, wanted)) / self.sigma

    def assembled(self, slopes: Array) -> Array:
        """Columns from the derivatives (..., f + p + p1) by known, second and first parameters, SI."""
        f, p = self.width
        nuisance = slopes[..., : f + p] * np.concatenate([self.sizes, self.second.sizes])
        return np.concatenate([nuisance, (slopes[..., f + p :] @ self.values)[..., None]], axis=-1)

    def taken(self, taken: Sequence[Taken]) -> Array:
        """Rows (m, f + p + 1) of what has been measured, or is planned already."""
        parts = [np.zeros((0, sum(self.width) + 1))]
        for one in taken:
            if isinstance(one, Readings):
                rows = self._measured(one)
            else:
                rows = self.rows(one.repeated() if isinstance(one, Plan) else one)
            parts.append(rows.reshape(-1, rows.shape[-1]))
        return np.concatenate(parts)

    def _measured(self, readings: Readings) -> Array:
        """Whitened columns of readings, without what the frames that nobody knows absorb; noise as the question's where
        the readings state none."""
        used = make_rows(readings)
        frames = used.start(self.model, self.x)
        wanted = [*self.known, *self.second.names, *self.first.names]
        J = used.rates(self.model, self.x, frames, wanted)[1]
        k = motion_count(frames)
        columns = np.concatenate([J[..., :k], self.assembled(J[..., k:])], axis=-1)
        white = used.noise.whiten(used.flat(columns)) * (1.0 if readings.stated else UNSTATED / self.sigma)
        return left(orthonormal(white[:, :k]), white[:, k:])


def ask(
    experiment: Experiment,
    first: Cause,
    second: Cause,
    sigma: float,
    *,
    values: Array | None = None,
    others: Sequence[Cause] = (),
    x: dict[str, float] | None = None,
) -> Question:
    """The question for an experiment. others: causes that are fitted too; x: parameter values by name.

    values: deviations of the first cause's parameters, SI; their typical sizes if None
    """
    own = {*first.names, *second.names}
    others = [c for c in others if not own.intersection(c.names)]
    model = widened(experiment.model(), [first, *others, *([second] if second.name != first.name else [])])
    at = model.nominal
    for i, name in enumerate(model.names):
        at[i] = (x or {}).get(name, at[i])
    fitted = [n for n in experiment.fit_names() if n not in own]
    sizes = np.concatenate([scales([model.parameters[i] for i in model.index(fitted)]), *(c.sizes for c in others)])
    known = (*fitted, *(n for c in others for n in c.names))
    return Question(
        model=model,
        known=known,
        sizes=sizes,
        first=first,
        second=second,
        values=np.array(first.sizes if values is None else values, dtype=np.float64),
        x=at,
        sigma=sigma,
    )


def told(rows: Array, width: tuple[int, int]) -> tuple[float, float]:
    """s of the trace beside the second cause, and its angle (rad) with what that can do, in rows (m, f + p + 1)."""
    f, p = width
    alone = _left(rows[:, :f], rows[:, -1])
    beside = min(_left(rows[:, : f + p], rows[:, -1]), alone)
    return beside, float(np.arcsin(beside / alone)) if alone > 0.0 else float("nan")


def _left(nuisance: Array, trace: Array) -> float:
    """Norm of the trace after the other columns took what they can; zero where only rounding is left."""
    size: Array = np.linalg.norm(nuisance, axis=0)
    used: Array = nuisance[:, size > 0.0] / size[size > 0.0]
    whole = float(np.linalg.norm(trace))
    if not used.size or whole == 0.0:
        return whole
    left = float(np.linalg.norm(trace - used @ np.linalg.lstsq(used, trace, rcond=_LOST)[0]))
    return left if left > _ABSORBED * whole else 0.0


@dataclass(frozen=True, eq=False)
class Chosen:
    """Candidates chosen, the smallest s over the questions, and the largest that any choice could reach."""

    index: Indices
    s: float
    bound: float


def choose(
    rows: Sequence[Array],
    before: Sequence[Array],
    count: int,
    place: Indices,
    seed: int,
    starts: int = STARTS,
    progress: Progress | None = None,
) -> Chosen:
    """`count` candidates that make the smallest s of S questions as large as they can, by exchange.

    rows: for each question (N, k, w), trace last; before: for each the rows (m, w) that are there already; place
    (N,): candidates of one place exclude each other.
    """
    reduced = [_reduced(r, b) for r, b in zip(rows, before, strict=True)]
    four, prior = _stacked([r for r, _ in reduced]), _stacked_prior([m for _, m in reduced])
    e = np.zeros(four.shape[-1])
    e[-1] = 1.0
    rule = Robust(Linear("T", "variance of the trace's coefficient", np.outer(e, e)), worst=len(rows) > 1)
    allowed = Allowed((np.arange(len(four)),), (1.0,), 1.0 / count)
    rng = np.random.default_rng(seed)
    relaxed = _relaxed(four, rule, allowed, prior / count, rng)
    short = _shortlist(four, relaxed)
    weights = None if relaxed is None else relaxed.spread(len(four))[short]
    quotas = Quotas((np.arange(len(short)),), (count,), place[short])
    index = short[exchange(four[short], rule, quotas, weights, starts, rng, progress, prior)]
    M = prior + np.einsum("nskp,nskq->spq", four[index], four[index])
    psi = float(rule.value(M))
    return Chosen(np.sort(index), float(1.0 / np.sqrt(psi)), _bound(four, rule, allowed, prior / count, M, relaxed))


def _reduced(rows: Array, before: Array) -> tuple[Array, Array]:
    """Rows (N, k, r) and prior information (r, r) in the directions of the other columns that anything shows.

    A trace that is absorbed everywhere keeps a hair of its own, so that designs exist and say s = 0.
    """
    flat = np.concatenate([before, rows.reshape(-1, rows.shape[-1])])
    size = np.linalg.norm(flat[:, :-1], axis=0)
    seen = np.flatnonzero(size > 0.0)
    T = np.zeros((rows.shape[-1], 0))
    if len(seen):
        triangle = np.asarray(np.linalg.qr(flat[:, seen] / size[seen], mode="r"), dtype=np.float64)
        _, values, V = np.linalg.svd(triangle)
        kept = np.flatnonzero(values > _LOST * values[0])
        T = np.zeros((rows.shape[-1], len(kept)))
        T[seen] = V[kept].T / size[seen, None] * np.sqrt(len(rows))
    T = np.concatenate([T, np.eye(rows.shape[-1])[:, -1:]], axis=1)
    told_before = before @ T
    M = told_before.T @ told_before
    spread = np.square(rows @ T).sum(axis=(0, 1)) / len(rows)
    return rows @ T, M + np.diag(_RIDGE * np.maximum(spread, 1e-300))


def _stacked(parts: Sequence[Array]) -> Array:
    """Rows (N, S, k, w) of all questions; narrower ones get empty columns in front."""
    wide = max(p.shape[-1] for p in parts)
    return np.stack([np.pad(p, ((0, 0), (0, 0), (wide - p.shape[-1], 0))) for p in parts], axis=1)


def _stacked_prior(parts: Sequence[Array]) -> Array:
    """Prior (S, w, w); empty columns are known."""
    wide = max(len(p) for p in parts)
    out = np.tile(np.eye(wide), (len(parts), 1, 1))
    for s, p in enumerate(parts):
        out[s, wide - len(p) :, wide - len(p) :] = p
    return out


def _relaxed(rows: Array, rule: Robust, allowed: Allowed, prior: Array, rng: np.random.Generator) -> Relaxed | None:
    try:
        return solve_columns(make_task(as_rows(rows), rule, allowed, prior), rng, _CERTIFIED)
    except (NotCertified, NotIdentifiable):
        return None


def _shortlist(rows: Array, relaxed: Relaxed | None) -> Indices:
    if relaxed is None or len(rows) <= 2 * _SHORT:
        return np.arange(len(rows))
    return np.unique(np.concatenate([relaxed.index, np.argpartition(-relaxed.scores, _SHORT)[:_SHORT]]))


def _bound(rows: Array, rule: Robust, allowed: Allowed, prior: Array, M: Array, relaxed: Relaxed | None) -> float:
    """The largest s that any choice can reach: the better of two certificates, both valid for every design."""
    count = 1.0 / allowed.cap
    expansion = rule.expansion(M / count)
    values = block_scores(rows, [root(G) for G in expansion.slope])
    sure = bound_of(values, allowed, expansion.factor, float((prior * expansion.slope).sum()))
    best = 1.0 / float(rule.value(M)) / max(sure, 1e-300)
    if relaxed is not None:
        best = min(best, count / float(rule.value(relaxed.information)) / relaxed.efficiency)
    return float(np.sqrt(best))


def limit_angle(rows: Array, width: tuple[int, int], seed: int) -> float:
    """Angle (rad) between the trace and the second cause that ever more poses of these candidates lead to.

    rows (N, k, f + p + 1); designs by weight, each candidate as often as wanted.
    """
    reduced, ridge = _reduced(rows, np.zeros((0, rows.shape[-1])))
    e = np.zeros(reduced.shape[-1])
    e[-1] = 1.0
    rule = Robust(Linear("T", "", np.outer(e, e)))
    allowed = Allowed((np.arange(len(rows)),), (1.0,), np.inf)
    relaxed = _relaxed(reduced[:, None], rule, allowed, ridge[None], np.random.default_rng(seed))
    weights = np.full(len(rows), 1.0) if relaxed is None else relaxed.spread(len(rows))
    used = np.flatnonzero(weights)
    scaled = rows[used] * np.sqrt(weights[used])[:, None, None]
    return told(scaled.reshape(-1, rows.shape[-1]), width)[1]
