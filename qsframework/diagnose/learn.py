"""Learning a law that nobody has written: the plainest block, fitted exactly with the prior that it asks for.

Its weights are drawn towards zero as its evidence says (best linear unbiased prediction), so that directions which no
reading shows stay there: a law is never larger than what was seen of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from qsframework.diagnose.law import Law
from qsframework.diagnose.linearization.candidates import Cause
from qsframework.diagnose.linearization.generic_blocks import Block, Motions, motions
from qsframework.diagnose.result import Leftover, Taught
from qsframework.diagnose.selection.evidence import prior_of
from qsframework.elastostatics import Model
from qsframework.errors import InputError
from qsframework.estimation.visit_noise import Reml
from qsframework.experiment.observations import Rows
from qsframework.plugin import KNOTS, Array, Context, Effect, Poses, RobotFacts, Spring, SpringLaw, find, registry

_TRIED = 3
_ODDS = 10.0
"""Of a law against nothing, which weighs as much as all blocks together, from which on it is learned."""
_PARTS: dict[str, str] = {"drive": "learned", "link": "learned", "shift": "learned_shift"}
"""The effect that a law of such a part is; laws of markers and readings are none of the arm."""
_TELLS = 0.2
"""Share of the largest torque under which a visit tells a law that grows with the torque."""
_RECORDED = ("order", "time", "temperature", "approach")


@dataclass(frozen=True)
class Lesson:
    """A law that can be written as an effect: the cause that it is, and what was left of it."""

    leftover: Leftover
    cause: Cause


def lessons(
    model: Model,
    rows: Rows,
    moved: Motions,
    blocks: Sequence[Block],
    left: Sequence[Leftover],
    fits: Reml,
    values: Array,
) -> list[Lesson]:
    """The few plainest laws that readings (m,) m hold beside a fit, well enough to be learned, and an effect can be."""
    columns = {b.law: b.columns for b in blocks}
    out: list[Lesson] = []
    for leftover in left:
        if leftover.evidence < np.log(_ODDS * len(blocks)):
            continue
        effects = _effects(model, leftover.law, rows, moved)
        if effects:
            prior = prior_of(columns[leftover.law], fits, values)
            effect: Any = replace(cast("Any", effects[-1]), prior=prior)
            parameters = effect.parameters(model.facts)
            out.append(Lesson(leftover, Cause(effect.name, (*effects[:-1], effect), parameters, False, prior)))
        if len(out) == _TRIED:
            break
    return out


@dataclass(frozen=True, eq=False)
class Curve:
    """A law as it was learned: motion (n, k), rad or m, of its coordinates over a variable x (n,), with its sd.

    What is straight in the torque is left out of both: no reading tells it from the spring's. torque: N m, or N, under
    which it stands, NaN where the variable is the torque itself
    """

    x: Array
    motion: Array
    sd: Array
    torque: float


def curve(taught: Taught, robot: RobotFacts, count: int = 61) -> Curve | None:
    """The law over the range that the readings have; None for one by what was recorded."""
    effect: Any = taught.cause.effects[-1]
    law, names = taught.leftover.law, taught.cause.names
    q, torque = np.zeros((count, robot.n)), np.full((count, len(effect.springs(robot))), float(effect.scale))
    x: Array
    if law.variable == "torque":
        x = np.linspace(float(effect.lowest), float(effect.highest), count)
        torque = np.repeat(x[:, None], torque.shape[1], axis=1)
    elif law.variable == "angle":
        x = np.linspace(float(effect.angle_from), float(effect.angle_to), count)
        q[:, robot.joint_index(law.joints[0])] = x
    else:
        return None
    context = Context(robot, Poses(q, q, np.zeros((count, 6))))
    shapes = np.stack([effect.extra(torque, unit, context) for unit in np.eye(len(names))], axis=-1)
    straight = x if law.variable == "torque" else np.ones(count)
    shapes = shapes - np.multiply.outer(straight, np.tensordot(straight, shapes, (0, 0))) / float(straight @ straight)
    at = [taught.fit.names.index(n) for n in names]
    covariance = taught.fit.covariance[np.ix_(at, at)]
    sd = np.sqrt(np.maximum(np.einsum("nkp,pq,nkq->nk", shapes, covariance, shapes), 0.0))
    values = np.array([taught.fit.value(n) for n in names])
    return Curve(x, shapes @ values, sd, np.nan if law.variable == "torque" else float(effect.scale))


def dots(taught: Taught, rows: Rows, found: Curve) -> tuple[Array, Array]:
    """What each visit says of a curve: variable (V, k) and motion (V, k) rad or m, k coordinates, NaN for visits that
    stand under too little torque to tell; rows: those of the fit.

    The motion is the curve's plus the one that fits the visit's residuals best, under the curve's torque.
    """
    fit, law = taught.fit, taught.leftover.law
    effect: Any = taught.cause.effects[-1]
    moved = motions(fit.model, rows, fit.x, fit.frames)
    at = next(list(p.coordinates) for p in moved.places if (p.part, p.name) == (law.part, law.place))
    used, visit = np.unique(rows.plus, return_inverse=True)
    x, y = np.full((len(used), len(at)), np.nan), np.full((len(used), len(at)), np.nan)
    for v in range(len(used)):
        here = np.flatnonzero(visit == v)
        torque = moved.plus.torque[here[0], at]
        D, mask = moved.plus.columns[here][..., at], rows.mask[here]
        extra = np.linalg.lstsq(D[mask], fit.residuals[here][mask], rcond=1e-3)[0]
        if law.variable == "torque":
            x[v] = torque
        else:
            joints = np.array(dict(moved.angles)[law.joints])
            x[v] = float(moved.plus.q[here[0]] @ joints)
            extra = np.where(np.abs(torque) > _TELLS * effect.scale, extra * effect.scale / torque, np.nan)
        y[v] = [np.interp(a, found.x, m) for a, m in zip(x[v], found.motion.T, strict=True)] + extra
    return x, y


def _effects(model: Model, law: Law, rows: Rows, moved: Motions) -> tuple[Effect, ...]:
    """The effect that a law is, after the springs that it bends where the arm lacks them; none where no effect can."""
    if law.part not in _PARTS or law.variable not in ("torque", "angle", *_RECORDED):
        return ()
    try:
        effect = _effect(law, rows, moved)
        effect.require_fit(model.facts)
    except InputError:
        return ()
    springs: list[Effect] = []
    have = {(e.role, e.where) for e in model.effects if isinstance(e, Spring)}
    for role, where in effect.springs(model.facts):
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


def _effect(law: Law, rows: Rows, moved: Motions) -> SpringLaw:
    """The effect, with the range that the readings have of what it depends on."""
    at = next(list(p.coordinates) for p in moved.places if (p.part, p.name) == (law.part, law.place))
    torque = np.concatenate([moved.plus.torque[:, at], moved.minus.torque[:, at]])
    settings: dict[str, Any] = {"part": law.part, "scale": moved.scale(at), "knots": KNOTS}
    by: str = law.variable
    if law.variable == "torque":
        settings |= {"lowest": float(torque.min()), "highest": float(torque.max())}
    elif law.variable == "angle":
        by = "+".join(law.joints)
        weights = np.array(dict(moved.angles)[law.joints])
        angle = np.concatenate([moved.plus.q, moved.minus.q[rows.minus >= 0]]) @ weights
        signs = "".join("+" if w > 0.0 else "-" for w in weights[weights != 0.0])
        settings |= {"angle_from": float(angle.min()), "angle_to": float(angle.max()), "signs": signs}
    elif law.variable == "order":
        settings |= {"first": 0.0, "last": 1.0}
    else:
        value = np.asarray(getattr(rows.readings.poses.loaded, law.variable))[rows.plus]
        settings |= {"first": float(value.min()), "last": float(value.max())}
    found = cast("Any", find(_PARTS[law.part]))(at=law.place, by=by, **settings)
    assert isinstance(found, SpringLaw)
    return found
