"""Before measuring: the smallest size of every cause that a plan would detect and name.

Detection is the library's own test: the largest of all scores against its distribution by Monte Carlo (max-T), and a
noncentral chi-square under a cause of visible size s. A cause is named where it is detected and no other one explains
its trace as well: with k1 and k2 directions at an angle phi, the other one wins in about
Phi(-(s sin(phi/2) - D / (4 s sin(phi/2)))), D = (k1 - k2) (log m - 1) for the price of a direction in the BIC of m
readings. All alternatives add up, which is on the safe side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from qsframework.arguments import checked
from qsframework.diagnoses.foresight import DetectableSize, Foresight, Outlook, Pair, PowerCurve, Prospect, Why
from qsframework.diagnoses.options import LEVEL, LIBRARY_SHARE
from qsframework.diagnoses.unknown import unknown_outlook
from qsframework.elastostatics import Model
from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.estimation import Noise, rank_test
from qsframework.estimation.tails import chi2_isf
from qsframework.experiment import Experiment, NoiseModel, Plan
from qsframework.hypotheses.catalogue.causes import REACH, Cause, find_causes, widened
from qsframework.hypotheses.columns import Case, Subspace, plan_case
from qsframework.hypotheses.search.family_test import FamilyBlock, chance
from qsframework.hypotheses.search.principal_angles import alias_classes, angle_matrix, named_from
from qsframework.information import loss_words
from qsframework.plugin import Array, Indices, Poses
from qsframework.work import HERE, Work, run

CLOSE = float(np.deg2rad(10.0))
"""Causes at a smaller angle count as not separable: naming one of them takes s = 19 and more."""
_MOST = 1e4
_BEYOND = 3.0
"""Times the largest realistic size beyond which the linear model says how much would be needed."""
_STEPS = 28
_SURE = 8.0
"""s beyond a threshold from which detection is certain in double precision."""
_TRIES = 8
_REACHED = 0.01
_SHORT = 0.97
"""Share of the asked s that counts as reached where the search does not settle."""
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Test:
    """The library's test on these readings: per cause its directions, its threshold and the s that passes it.

    G (K, K): products of all directions; owner (K,): cause of each
    """

    subspaces: tuple[Subspace, ...]
    G: Array
    owner: Indices
    dof: Indices
    sided: Array
    thresholds: Array
    needed: Array
    heads: tuple[tuple[int, ...], ...]
    readings: int


@checked
def forecast(
    experiment: Experiment,
    plan: Plan | Poses,
    *,
    level: float = LEVEL * LIBRARY_SHARE,
    power: float = 0.85,
    share: float = 0.95,
    sigma: float | None = None,
    seed: int = 0,
    exact: bool = True,
    progress: Progress | None = None,
    work: Work = HERE,
) -> Foresight:
    """Predict which causes a plan would detect and identify.

    Args:
        experiment: the campaign.
        plan: a plan, or poses with their wrenches.
        level: false-alarm probability over all causes.
        power: required rate of detection.
        share: required rate of right names.
        sigma: noise of one coordinate, m; that of the experiment if None.
        seed: random seed.
        exact: sizes at which the full equilibrium shows as much; else those of the linear model, as where positions are
            planned.
        progress: called with each step, how much is done and of how much.
        work: where it is computed, cause by cause.

    Returns:
        For each cause the smallest size, SI, that is detected and that is named.

    Raises:
        InputError: where the noise is not known.
        NotIdentifiable: where the plan does not identify the fitted parameters.
    """
    tell: Progress = progress or (lambda step, done, total: None)
    poses = plan.repeated() if isinstance(plan, Plan) else plan
    stands = isinstance(plan, Plan) and bool(plan.of_positions.any() or plan.station)
    noise = experiment.noise if sigma is None else NoiseModel(sigma)
    experiment = experiment.with_(noise=noise)
    if not noise.known:
        raise InputError(f"{experiment.path}: a forecast needs the noise, for example noise: {{sigma_mm: 0.03}}")
    fitted = experiment.fit_names()
    tell("causes", 0, 2)
    causes, untested = find_causes(experiment, fitted, poses)
    case = plan_case(experiment, plan, fitted, causes)
    rank = rank_test(case.with_holds(case.A)[0], [*(p.name for f in case.frames for p in f.parameters()), *fitted])
    if not rank.full:
        raise NotIdentifiable(
            f"the plan does not identify the fitted parameters: {loss_words(case.model, rank, poses)}"
        )
    subspaces = case.subspaces()
    tell("causes", 1, 2)
    angles = angle_matrix(subspaces)
    test = _make_test(subspaces, len(case.A), level, power, seed)
    tell("causes", 2, 2)
    whole = len(case.A) == 3 * len(poses) * len(experiment.markers)  # every marker is read, and no gauge
    bench = Bench(experiment, poses, case.noise) if exact and not stands and whole else None
    prospects: list[Prospect] = []
    tell("sizes", 0, len(causes))
    for found in run(_sizes, (case, test, share, bench), range(len(causes)), work):
        prospects.append(_prospect(case, test, angles, len(prospects), found))
        tell("sizes", len(prospects), len(causes))
    names = [c.name for c in causes]
    return Foresight(
        prospects=tuple(prospects),
        untested=untested,
        pairs=_pairs(names, angles, share),
        groups=_groups(names, subspaces),
        angles=angles,
        curves=_curves(test),
        case=case,
        poses=len(poses),
        sigma=noise.of("position" if stands else "displacement") or noise.range or noise.gauge or np.nan,
        level=level,
        power=power,
        share=share,
        seed=seed,
        unknown=unknown_outlook(experiment, plan, fitted, seed) if isinstance(plan, Plan) else None,
    )


def _make_test(subspaces: tuple[Subspace, ...], readings: int, level: float, power: float, seed: int) -> _Test:
    blocks = [FamilyBlock(s.Q, s.one_sided) for s in subspaces]
    log_p = float(np.quantile(chance(blocks, seed=seed), level))
    Q = np.concatenate([b.columns for b in blocks], axis=1)
    dof = np.array([b.columns.shape[1] for b in blocks])
    sided = np.array([b.one_sided for b in blocks], dtype=bool)
    thresholds, needed = np.full(len(blocks), np.inf), np.full(len(blocks), np.inf)
    for k, side in sorted({(int(d), bool(o)) for d, o in zip(dof, sided, strict=True) if d}):
        at = (dof == k) & (sided == side)
        thresholds[at] = threshold(k, side, log_p)
        needed[at] = needed_size(k, side, float(thresholds[at][0]), power)
    owner = np.repeat(np.arange(len(blocks)), dof)
    return _Test(
        subspaces=subspaces,
        G=Q.T @ Q,
        owner=owner,
        dof=dof,
        sided=sided,
        thresholds=thresholds,
        needed=needed,
        heads=alias_classes(subspaces),
        readings=readings,
    )


def threshold(dof: int, sided: bool, log_p: float) -> float:
    """The statistic with this log p."""
    return float(chi2_isf(min(float(np.exp(log_p)) * (2.0 if sided else 1.0), 1.0), dof))


def detection_rate(s: Array | float, dof: int, sided: bool, limit: float) -> Array:
    """Chance that a cause of visible size s passes its threshold."""
    from scipy.special import chndtr, ndtr

    s = np.asarray(s, dtype=np.float64)
    edge = np.sqrt(limit)
    if sided:
        return np.asarray(ndtr(s - edge))
    sure = s > edge + _SURE
    return np.where(sure, 1.0, 1.0 - chndtr(limit, dof, np.where(sure, 0.0, s) ** 2))


def needed_size(dof: int, sided: bool, limit: float, power: float) -> float:
    """The s that is detected at a rate of `power`."""
    return _smallest(lambda s: float(detection_rate(s, dof, sided, limit)) >= power)


def _smallest(enough: Callable[[float], bool]) -> float:
    """Smallest s that is enough, by bisection; inf where none is."""
    if not enough(_MOST):
        return float("inf")
    low, high = 0.1, _MOST
    for _ in range(_STEPS):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def _sizes(shared: tuple[Case, _Test, float, Bench | None], i: int) -> list[tuple[float, float, float]]:
    """Of each parameter of cause i, where it is visible: s, and the smallest sizes that are detected and named."""
    case, test, share, bench = shared
    if not test.subspaces[i].visible:
        return []
    own = next(c for c in test.heads if i in c)
    sizes = [_size(case, test, i, j, own, share, bench) for j in range(len(case.causes[i].parameters))]
    return [(size.s, size.detect, size.name) for size in sizes]


def _prospect(case: Case, test: _Test, angles: Array, i: int, found: list[tuple[float, float, float]]) -> Prospect:
    cause, subspace = case.causes[i], test.subspaces[i]
    if not subspace.visible:
        typical, left = float(np.linalg.norm(case.B[i], axis=0).max(initial=0.0)), subspace.reach / REACH
        return Prospect(cause=cause, status=Outlook.INVISIBLE, why=_hidden(typical), typical=typical, left=left)
    own = next(c for c in test.heads if i in c)
    sizes = tuple(DetectableSize(p, *size) for p, size in zip(cause.parameters, found, strict=True))
    aliases = tuple(case.causes[j].name for j in own if j != i)
    row = angles[i].copy()
    row[list(own)] = np.nan
    near = int(np.nanargmin(row)) if np.isfinite(row).any() else -1
    nearest, angle = (case.causes[near].name, float(row[near])) if near >= 0 else ("", float("nan"))
    status, why = _status(cause, sizes, aliases)
    return Prospect(cause=cause, status=status, sizes=sizes, nearest=nearest, angle=angle, aliases=aliases, why=why)


def _status(cause: Cause, sizes: Sequence[DetectableSize], aliases: Sequence[str]) -> tuple[Outlook, Why | None]:
    """What a realistic size of a visible cause comes to, and why it is not more."""
    most = [REACH * size for size in cause.sizes]
    if not any(x.detect <= m for x, m in zip(sizes, most, strict=True)):
        return Outlook.INVISIBLE, Why.SMALL
    if aliases:
        return Outlook.DETECTED, Why.ALIASES
    if not any(x.name <= m for x, m in zip(sizes, most, strict=True)):
        return Outlook.DETECTED, Why.RIVAL
    return Outlook.NAMED, None


def _hidden(typical: float) -> Why:
    """Why a cause shows nothing beyond the fitted parameters; typical: itself, in units of noise."""
    if typical <= 1e-9:
        return Why.NO_READING
    return Why.LITTLE_LOAD if REACH * typical < 4.0 else Why.ABSORBED


def _size(
    case: Case, test: _Test, i: int, j: int, own: Sequence[int], share: float, bench: Bench | None
) -> DetectableSize:
    """The smallest visible deviations of parameter j of cause i, alone."""
    cause, mine = case.causes[i], np.flatnonzero(test.owner == i)
    along = test.subspaces[i].Q.T @ case.B[i][:, j]
    s = float(np.linalg.norm(along))
    parameter, typical = cause.parameters[j], cause.sizes[j]
    if s * REACH < 1.0:
        return DetectableSize(parameter, s, np.inf, np.inf)
    surely, perhaps = _reached(test, i, test.G[:, mine] @ (along / s))
    detect = float((test.needed / np.maximum(surely, 1e-12)).min())
    alternatives = [c[0] for c in test.heads if c[0] not in own]

    def missed(size: float) -> float:
        rate = _detected(test, surely, size)
        wrong = mistaken_by(size, perhaps[alternatives], test.dof[i] - test.dof[alternatives], test.readings)
        return 1.0 - rate + float(wrong.sum())

    name = _smallest(lambda size: missed(size) <= 1.0 - share)
    found = [seen / s * typical for seen in (detect, name)]
    if bench is not None:
        most = _BEYOND * REACH * typical
        for k, seen in enumerate((detect, name)):
            if found[k] <= most:
                found[k] = bench.size_for(cause, j, test.subspaces[i].Q, found[k], seen)
    return DetectableSize(parameter, s, found[0], found[1])


def _reached(test: _Test, i: int, products: Array) -> tuple[Array, Array]:
    """Share (G,) of a direction of cause i that lies within each cause: whatever its sign, and with its better sign.

    A cause that can only grow sees one sign only.
    """
    sided = test.sided[test.owner]
    better = np.where(sided & test.sided[i], np.maximum(products, 0.0), np.abs(products))
    worse = better if test.sided[i] else np.where(sided, 0.0, better)
    surely, perhaps = (np.sqrt(np.bincount(test.owner, c**2, len(test.dof))) for c in (worse, better))
    return np.minimum(surely, 1.0), np.minimum(perhaps, 1.0)


def _detected(test: _Test, reached: Array, s: float) -> float:
    """Chance that the cause which sees most of a trace of size s passes its threshold."""
    best = int(np.argmin(test.needed / np.maximum(reached, 1e-12)))
    rate = detection_rate(s * reached[best], int(test.dof[best]), bool(test.sided[best]), float(test.thresholds[best]))
    return float(rate)


def mistaken_by(s: float, reached: Array, more: Array, readings: int) -> Array:
    """Chance (R,) that each rival explains a trace of visible size s better.

    reached (R,): cosine of the trace's angle with the rival; more (R,): directions that the rival needs less
    """
    from scipy.special import ndtr

    half = np.sqrt(np.maximum(0.5 * (1.0 - reached), 1e-18))
    price = more * (np.log(readings) - 1.0)
    return np.asarray(ndtr(price / (4.0 * s * half) - s * half))


def _pairs(names: Sequence[str], angles: Array, share: float) -> tuple[Pair, ...]:
    """All pairs that are too close to be separated, closest first."""
    found = [(float(angles[i, j]), i, j) for i, j in np.argwhere(np.triu(angles < CLOSE, 1)).tolist()]
    return tuple(Pair(names[i], names[j], angle, named_from(angle, share)) for angle, i, j in sorted(found))


def _groups(names: Sequence[str], subspaces: Sequence[Subspace]) -> tuple[tuple[str, ...], ...]:
    """Sets of causes each of which can do all that another one of the set does, or nearly."""
    from scipy.sparse.csgraph import connected_components

    dof = np.array([s.Q.shape[1] for s in subspaces])
    close = (angle_matrix(subspaces, largest=True) < CLOSE) & (dof[:, None] == dof)
    _, label = connected_components(close, directed=False)
    sets = [np.flatnonzero(label == k).tolist() for k in range(int(label.max(initial=-1)) + 1)]
    return tuple(tuple(names[i] for i in members) for members in sets if len(members) > 1)


def _curves(test: _Test) -> tuple[PowerCurve, ...]:
    """Detection rate of causes with one direction, which can only grow or not, and with more."""
    s = np.linspace(0.0, 12.0, 121)
    out: list[PowerCurve] = []
    for k, side in sorted({(int(d), bool(o)) for d, o in zip(test.dof, test.sided, strict=True) if d}):
        limit = float(test.thresholds[(test.dof == k) & (test.sided == side)][0])
        out.append(PowerCurve(k, side, s, detection_rate(s, k, side, limit)))
    return tuple(out)


class Bench:
    """Readings of poses by the exact laws, with one effect at a time."""

    def __init__(self, experiment: Experiment, poses: Poses, noise: Noise):
        self.model, self.poses, self.noise = experiment.model(), poses, noise
        self.bare = self._readings(self.model, self.model.nominal)
        self._cause: Any = None
        self._wide = self.model

    def _readings(self, model: Model, x: Array) -> Array | None:
        try:
            return self.noise.whiten(model.predict(self.poses, x).ravel())
        except (NotConverged, InputError):
            return None

    def shown(self, cause: Cause, j: int, Q: Array, size: float) -> float | None:
        """s of parameter j at a deviation (SI) along the cause's directions Q (m, k); None where nothing settles."""
        if cause is not self._cause:
            self._cause, self._wide = cause, widened(self.model, [cause])
        x = self._wide.nominal
        x[self._wide.index([cause.names[j]])] += size
        readings = self._readings(self._wide, x)
        if readings is None or self.bare is None:
            return None
        return float(np.linalg.norm(Q.T @ (readings - self.bare)))

    def size_for(self, cause: Cause, j: int, Q: Array, start: float, s: float) -> float:
        """Deviation (SI) of parameter j that shows s; from the linear model's answer by secants of the logarithms.

        inf where no larger one shows more; the start where the equilibrium does not settle.
        """
        size, power = start, 1.0
        tried: list[tuple[float, float]] = []
        for _ in range(_TRIES):
            seen = self.shown(cause, j, Q, size)
            if seen is None:
                return start
            if abs(seen / s - 1.0) <= _REACHED:
                return size
            seen = max(seen, 1e-6 * s)
            if tried and tried[-1][0] != size and tried[-1][1] != seen:
                power = float(np.log(seen / tried[-1][1]) / np.log(size / tried[-1][0]))
            tried.append((size, seen))
            size *= float(np.clip((s / seen) ** (1.0 / np.clip(power, 0.3, 3.0)), 0.2, 5.0))
        enough = [size for size, seen in tried if seen >= _SHORT * s]
        return min(enough, default=float("inf"))
