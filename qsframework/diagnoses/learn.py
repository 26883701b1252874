"""Learning a law that nobody has written: the likeliest blocks, each fitted exactly with the prior that it asks for.

Its weights are drawn towards zero as its evidence says (best linear unbiased prediction), so that directions which no
reading shows stay there: a law is never larger than what was seen of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from qsframework.diagnoses.result import LearnedLaw, Leftover
from qsframework.elastostatics import Model
from qsframework.estimation.projection import left
from qsframework.estimation.variance_component import with_variance
from qsframework.estimation.visit_noise import Reml
from qsframework.experiment.observations import ReadingRows
from qsframework.hypotheses.catalogue.causes import Cause
from qsframework.hypotheses.catalogue.generic_laws import Block, motions
from qsframework.hypotheses.search.cross_validation import parts_of_poses, standard_errors
from qsframework.hypotheses.search.evidence import DRAWS, TAUS, prior_of
from qsframework.plugin import (
    Array,
    Conditions,
    Context,
    Effect,
    Indices,
    Poses,
    RobotFacts,
    Spring,
    SpringLaw,
    registry,
)

_PARTS = 10
"""Folds in which the law is chosen anew."""
_HELD = 1.0 / 3.0
"""Inverse of the sds of the whole fit by which a fold's may differ: some parameters hang on few poses."""
_ODDS = 10.0
"""Of a law against nothing, which weighs as much as all laws together that were tried, from which on it is learned."""
_CHANCE = 1.0 / DRAWS
"""Chance of the noise to look like any law, above which none is learned: where a draw of it did, six of eleven laws
that were learned did harm at other poses."""
_FOREIGN = 6.0
"""Nats by which a law in another joint's variable must be ahead of one in the own joint's: many more are tried, and the
three that were written all did harm at fresh poses. At 40 poses a true one is ahead by 57."""
_CURVE = 61
"""Points of a curve."""
_COMES = 1.0
"""rad over which a curve shows the direction of approach: from far, it makes hardly a difference how far."""
_TELLS = 0.2
"""Share of the largest torque under which a visit tells a law that grows with the torque."""


_AVERAGED = 6
"""Laws that are averaged at most."""
_DOUBT = 2.0
"""By which the nats of laws are divided before they share: the readings that chose them judge them, too."""
_LEAST_SHARE = 0.1
"""Of the largest share in an average: a law with less does little there."""


@dataclass(frozen=True)
class LawTrial:
    """A law that can be written as an effect: the cause that it is, what was left of it, and its evidence, nats."""

    leftover: Leftover
    cause: Cause
    evidence: float


def shares(evidence: Sequence[float]) -> Array:
    """Shares (n,) of laws in their average, none so small that it does nothing."""
    odds = np.exp((np.array(evidence) - max(evidence)) / _DOUBT)
    kept = np.where(odds >= _LEAST_SHARE, odds, 0.0)
    return np.asarray(kept / kept.sum())


def law_trials(
    model: Model,
    likely: Sequence[tuple[float, Block]],
    left: Sequence[Leftover],
    tried: int,
    fits: Reml,
    values: Array,
) -> list[LawTrial]:
    """The likeliest laws of readings (m,) m beside a fit that an effect can be, first the plainest of what is left;
    none where nothing left is plain enough to be learned. Where a law in a variable of the place's own joint is
    plain enough, too, one in another joint's must be far ahead of it.

    likely: laws with their evidence, nats; tried: how many laws were, about all axes of their places
    """
    known = {block.law: (evidence, block) for evidence, block in reversed(likely)}
    plain = [x for x in left if x.evidence >= np.log(_ODDS * tried) and x.p_value <= _CHANCE and x.law in known]
    own = {x.law.where: known[x.law][0] for x in reversed(plain) if not x.law.follows_another(model.facts)}
    foreign = (law for law in known if law.follows_another(model.facts))
    stands_in = {law for law in foreign if known[law][0] < own.get(law.where, -np.inf) + _FOREIGN}
    first = next((x for x in plain if x.law not in stands_in and effects_of(model, known[x.law][1].effect)), None)
    if first is None:
        return []
    others = sorted(known.keys() - stands_in - {first.law}, key=lambda law: -known[law][0])
    out: list[LawTrial] = []
    for leftover in (first, *(Leftover(law, float("nan"), known[law][0]) for law in others)):
        evidence, block = known[leftover.law]
        effects = effects_of(model, block.effect)
        if effects and effects[-1].name not in {x.cause.name for x in out}:  # about one axis, or about all
            prior = prior_of(block.columns, fits, values)
            effect: Any = replace(cast("Any", effects[-1]), prior=prior)
            parameters = effect.parameters(model.facts)
            cause = Cause(effect.name, (*effects[:-1], effect), parameters, False, prior)
            out.append(LawTrial(leftover, cause, evidence))
        if len(out) == _AVERAGED:
            break
    return out


def foretold(blocks: Sequence[Array], fits: Reml, values: Array, pose: Indices) -> float:
    """By how many of its standard errors the held-out error falls with a law of readings (m,) m, where each fold
    averages over blocks (m, p) m anew; pose (m,): whose readings are left out together."""
    k = int(fits.choose(values[:, None])[0])
    noise, X = fits.noise.noises[k], fits.Q[k]
    y, white = fits.left(k, values), [left(X, noise.whiten(b)) for b in blocks]
    before, after = np.zeros(len(y)), np.zeros(len(y))
    for test in parts_of_poses(pose, _PARTS):
        train = np.setdiff1d(np.arange(len(y)), test)
        fit = np.linalg.solve(X[train].T @ X[train] + _HELD**2 * np.eye(X.shape[1]), X[train].T)
        rest = y[train] - X[train] @ (fit @ y[train])
        evidence, laws = zip(*(_blup(Z[train] - X[train] @ (fit @ Z[train]), rest, Z) for Z in white), strict=True)
        law = np.stack(laws, axis=1) @ shares(evidence)
        for out, less in ((before, y), (after, y - law)):
            out[test] = less[test] - X[test] @ (fit @ less[train])
    return standard_errors(before, after, pose)


def _blup(Z: Array, rest: Array, whole: Array) -> tuple[float, Array]:
    """Evidence of columns Z (t, p) for residuals (t,), and what the law with its best weights does to all readings, by
    their columns whole (m, p)."""
    U, size, V = np.linalg.svd(Z, full_matrices=False)
    seen = size > 1e-3 * max(float(size[0]), 1e-300)
    c, lam = U[:, seen].T @ rest, np.square(size[seen] / size[0])
    free, total = len(rest) - len(lam), float(rest @ rest)
    e = -0.5 * free * np.log(with_variance(lam, np.square(c)[:, None], total, np.square(TAUS), free)[:, 0] / total)
    best = int(np.argmax(e))
    grown = TAUS[best] ** 2 * lam
    weights = V[seen].T @ (c * grown / (1.0 + grown) / size[seen])
    return float(e[best]), np.asarray(whole @ weights)


@dataclass(frozen=True, eq=False)
class Curve:
    """A law of springs as it was learned: motion (n, k), rad or m, of its coordinates over a variable x (n,), with its
    sd.

    What is straight in the torque is left out of both: no reading tells it from the spring's. over: the factor that x
    is; torque: N m, or N, under which it stands, NaN where the variable is the torque itself, 0 where none counts
    """

    over: str
    x: Array
    motion: Array
    sd: Array
    torque: float


def curve(learned: LearnedLaw, robot: RobotFacts) -> Curve | None:
    """The law over the range that the readings have: over its angle, the order or the direction of approach where
    there is one, under the largest torque, else over the torque; None for one that no single curve shows."""
    effect: Any = learned.cause.effects[-1]
    law = learned.leftover.law
    over = next((f for f in (*law.angles, *law.by) if f in (*law.angles[:1], "order", "came", "torque")), None)
    if over is None or len(law.angles) > 1 or "others" in law.by or law.part in ("marker", "readings", "load", "point"):
        return None
    q, torque = np.zeros((_CURVE, robot.n)), np.full((_CURVE, len(effect.springs(robot))), float(effect.scale))
    order, came = np.zeros(_CURVE), np.zeros((_CURVE, robot.n))
    x: Array
    if over == "torque":
        x = np.linspace(float(effect.lowest), float(effect.highest), _CURVE)
        torque = np.repeat(x[:, None], torque.shape[1], axis=1)
    elif over == "order":
        x = order = np.linspace(0.0, 1.0, _CURVE)
    elif over == "came":
        x = np.linspace(-_COMES, _COMES, _CURVE)
        came[:, robot.joint_index(robot.joint_of(law.place))] = x
    else:
        x = np.linspace(float(effect.angle_from), float(effect.angle_to), _CURVE)
        q[:, robot.joint_index(law.joints[0])] = x
    here = Poses(q, q, np.zeros((_CURVE, 6)), loaded=Conditions(order=order, came=came))
    shapes: Array = effect.shapes(torque, Context(robot, here))
    free = {"loaded", "always"} & set(law.by)
    straight = x if over == "torque" else np.ones(_CURVE)
    if not free:
        shapes = shapes - straight[:, None, None] * np.einsum("n,nkm->km", straight, shapes) / float(
            straight @ straight
        )
    names = learned.cause.names
    at = [learned.alone.names.index(n) for n in names]
    k, m = shapes.shape[1:]
    covariance = np.stack(
        [learned.alone.covariance[np.ix_(at, at)][i * m : i * m + m, i * m : i * m + m] for i in range(k)]
    )
    sd = np.sqrt(np.maximum(np.einsum("nkp,kpq,nkq->nk", shapes, covariance, shapes), 0.0))
    weights = np.array([learned.alone.value(n) for n in names]).reshape(k, m)
    under = np.nan if over == "torque" else 0.0 if free else float(effect.scale)
    return Curve(over, x, np.einsum("nkm,km->nk", shapes, weights), sd, under)


def dots(learned: LearnedLaw, rows: ReadingRows, found: Curve) -> tuple[Array, Array]:
    """What each visit says of a curve: variable (V, k) and motion (V, k) rad or m, k coordinates, NaN for visits that
    stand under too little torque to tell; rows: those of the fit.

    The motion is the curve's plus the one that fits the visit's residuals best, under the curve's torque.
    """
    fit, law = learned.alone, learned.leftover.law
    effect: Any = learned.cause.effects[-1]
    moved = motions(fit.model, rows, fit.x, fit.frames)
    at = next(list(p.coordinates) for p in moved.places if (p.part, p.name) == (law.part, law.place))
    if law.axis:
        only = list[str](effect.axes(fit.model.facts)).index(law.axis)
        at = at[only : only + 1]
    used, visit = np.unique(rows.plus, return_inverse=True)
    x, y = np.full((len(used), len(at)), np.nan), np.full((len(used), len(at)), np.nan)
    facts, order, came = fit.model.facts, rows.readings.poses.loaded.order, rows.readings.poses.loaded.came
    for v in range(len(used)):
        here = np.flatnonzero(visit == v)
        torque = moved.plus.torque[here[0], at]
        D, mask = moved.plus.columns[here][..., at], rows.mask[here]
        extra = np.linalg.lstsq(D[mask], fit.residuals[here][mask], rcond=1e-3)[0]
        if found.over == "torque":
            x[v] = torque
        elif found.over == "order":
            x[v] = 0.0 if order is None else order[used[v]]
        elif found.over == "came":
            x[v] = 0.0 if came is None else came[used[v], facts.joint_index(facts.joint_of(law.place))]
        else:
            weights = np.array(next(c for joints, c in moved.angles if "+".join(joints) == found.over))
            x[v] = float(moved.plus.q[here[0]] @ weights)
        if found.torque > 0.0:
            extra = np.where(np.abs(torque) > _TELLS * effect.scale, extra * effect.scale / torque, np.nan)
        y[v] = [np.interp(a, found.x, m) for a, m in zip(x[v], found.motion.T, strict=True)] + extra
    return x, y


def effects_of(model: Model, effect: Effect) -> tuple[Effect, ...]:
    """The effect that a law is, after the springs that it bends where the arm lacks them; none where it cannot have
    these."""
    springs: list[Effect] = []
    have = {(e.role, e.where) for e in model.effects if isinstance(e, Spring)}
    for role, where in effect.springs(model.facts) if isinstance(effect, SpringLaw) else ():
        if (role, where) not in have:
            spring = _spring(model.facts, role, where)
            if spring is None:
                return ()
            springs.append(spring)
    return (*springs, effect)


def _spring(facts: RobotFacts, role: str, where: str) -> Spring | None:
    """The spring of the registry at a place, None without any."""
    kinds = (k for k in registry().values() if issubclass(k, Spring) and k.role == role)
    return next((e for k in kinds for e in k.places(facts) if e.where == where), None)
