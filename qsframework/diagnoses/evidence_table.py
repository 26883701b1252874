"""The table of all causes and the findings: what is named, tied, excluded, invisible.

Causes that the readings cannot tell from a named one are found by test inversion at 95 %: a cause stays in the set if,
were it the true one with its own estimated size, the best other cause would win by as much as it did in at least 5 % of
repeated measurements. The angle between what two causes can do says why: of two one-parameter causes at angle phi,
readings of size s mistake one for the other in about Phi(-s sin(phi / 2)).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from qsframework.diagnoses.error_budget import linear_errors
from qsframework.diagnoses.result import AlternativeCause, Line, NamedCause, Status, Value
from qsframework.estimation import LinearFit
from qsframework.estimation.projection import solved
from qsframework.estimation.tails import chi2_isf
from qsframework.hypotheses.catalogue.causes import REACH, Cause, Untested
from qsframework.hypotheses.columns import Case, Subspace
from qsframework.hypotheses.exact_refit import SettledFit
from qsframework.hypotheses.search.cross_validation import HeldOut, standard_errors
from qsframework.hypotheses.search.model_selection import Answer, Library, p_value_of, size_of
from qsframework.hypotheses.search.principal_angles import angle_matrix, smallest_angles
from qsframework.hypotheses.search.subsets import Gram, Subset
from qsframework.plugin import Array, Indices, Parameter

_SIDES = 1.96
_ROUNDING = 1e-6
"""Share of a typical size below which a number is rounding."""
_ALTERNATIVES_TRIED = 12
_LISTED = float(np.deg2rad(60.0))
"""Angle beyond which an alternative is counted but not listed: three quarters of what the cause does to the readings it
cannot do (cosine 0.5). That it fits as well says how little is seen, not what else it may be."""
_MOST_SETS = 20
_MOST_POSES = 120
"""Above this many poses only single poses are deleted: two of them weigh little."""
_RIDGE = 1e-9
CONFIDENCE = 0.95
_DRAWS = 400
_FAR = 60.0
"""Loss of chi-square beyond which a cause is no rival, without a simulation."""


def findings_of(
    library: Library,
    answers: Sequence[Answer],
    baseline: SettledFit,
    held: HeldOut,
    threshold: float,
    pose_names: Sequence[str],
    seed: int,
) -> tuple[NamedCause, ...]:
    """The named causes of the best explanation with alternatives, evidence and the poses that they hang on.

    threshold: log p of a significant cause; pose_names: by number of the pose
    """
    if not answers:
        return ()
    best = answers[0]
    members = best.subset.members
    alternatives = {i: _alternatives(library, answers, i, seed) for i in members}
    hanging = {i: _hanging(library, best.subset, i, alternatives[i], threshold, pose_names) for i in members}
    gains = _gains(library, members, baseline, held)
    out = [_finding(library, answers, baseline, i, alternatives[i], hanging[i], gains[i]) for i in members]
    return tuple(sorted(out, key=lambda f: -f.s))


def _gains(
    library: Library, members: Sequence[int], baseline: SettledFit, held: HeldOut
) -> dict[int, tuple[float, float]]:
    """By what share the held-out error, whitened by the noise, falls with each cause beside the others, and by how many
    of its standard errors.

    One cause alone has the gain of the whole extension, its search nested; of several, one after the other is left out
    of the linearised model, the others given.
    """
    if len(members) == 1:
        return {members[0]: (held.gain, held.clear)}
    case, out = library.case, dict[int, tuple[float, float]]()
    every = linear_errors(case, members, baseline.residuals)[2]
    for i in members:
        without = linear_errors(case, [j for j in members if j != i], baseline.residuals)[2]
        gain = 1.0 - float(np.linalg.norm(every) / np.linalg.norm(without))
        out[i] = gain, standard_errors(without, every, case.pose)
    return out


def _finding(
    library: Library,
    answers: Sequence[Answer],
    baseline: SettledFit,
    i: int,
    alternatives: Sequence[int],
    hanging: tuple[tuple[str, ...], ...],
    gain: tuple[float, float],
) -> NamedCause:
    best = answers[0]
    cause = library.case.causes[i]
    given = tuple(j for j in best.subset.members if j != i)
    s = size_of(library, i, given)
    if not given:  # the exact fit knows the size better than the linear one
        s = float(np.sqrt(max(baseline.chi2 - best.fit.chi2 - best.subset.dof, 0.0)))
    angles = smallest_angles(library.subspaces, i)
    listed = [j for j in alternatives if angles[j] <= _LISTED]
    return NamedCause(
        name=cause.name,
        values=values_of(cause, best.fit),
        s=s,
        p_value=p_value_of(library, i, given),
        ebic_gain=_conditional_ebic(library, i, given) if given else -best.ebic,
        alternatives=tuple(AlternativeCause(library.case.causes[j].name, float(angles[j])) for j in listed),
        hangs_on=hanging,
        physics=(cause.kind.__doc__ or cause.name).strip().splitlines()[0],
        check=cause.kind.check,
        heldout_gain=gain[0],
        heldout_clear=gain[1],
        further=len({library.aliases(j) for j in alternatives if j not in listed}),
    )


def values_of(cause: Cause, fit: SettledFit) -> tuple[Value, ...]:
    """Estimates of a cause's parameters."""
    return tuple(Value(p.name, p.unit, fit.value(p.name), fit.sd(p.name), p.nominal) for p in cause.parameters)


def _conditional_ebic(library: Library, i: int, given: tuple[int, ...]) -> float:
    """By how much EBIC falls with cause i beside the given ones."""
    gram, count = library.gram, len(library.heads)
    without, both = (
        gram.ebic(gram.solve(m)[0], sum(len(gram.at[j]) for j in m), len(m), count) for m in (given, (*given, i))
    )
    return float(without - both)


def _alternatives(library: Library, answers: Sequence[Answer], i: int, seed: int) -> tuple[int, ...]:
    best = answers[0].subset.members
    given = tuple(j for j in best if j != i)
    causes, own = library.case.causes, library.case.causes[i]
    without = [j for j, c in enumerate(causes) if j != i and (c.shares(own) or (c.group and not own.group))]
    found = alternative_set(library.gram, i, given, _exact(answers, given), seed, without=without)
    every = dict.fromkeys(j for rival in (i, *found) for j in library.aliases(rival))  # what does the same goes along
    out = {i, *given, *without}
    return tuple(j for j in every if j not in out and library.subspaces[j].visible)


def _exact(answers: Sequence[Answer], given: tuple[int, ...]) -> Mapping[int, float]:
    """Squares left by exact fits of the given causes and one more."""
    out: dict[int, float] = {}
    for a in answers:
        more = set(a.subset.members) - set(given)
        if len(more) == 1 and len(a.subset.members) == len(given) + 1:
            out[more.pop()] = a.fit.chi2
    return out


def _hanging(
    library: Library, best: Subset, i: int, alternatives: Sequence[int], threshold: float, pose_names: Sequence[str]
) -> tuple[tuple[str, ...], ...]:
    """Poses that the name of cause i hangs on; that a rival takes over is no news."""
    gram = library.gram
    given = tuple(j for j in best.members if j != i)
    allowed = {i, *alternatives, *library.aliases(i)}
    own = library.case.causes[i]
    allowed |= {j for j, c in enumerate(library.case.causes) if c.shares(own) or (c.group and not own.group)}
    others = _other_sets(library, given, allowed)
    dof = len(gram.at[i])
    needed = float(chi2_isf(float(np.exp(threshold)), max(dof, 1))) * library.unit(best.members)
    without = Subset(given, 0.0, best.dof - dof, 0.0)
    found = hangs_on(library.case, library.subspaces, best, without, others, needed)
    return tuple(tuple(pose_names[p] for p in poses) for poses in found[:_MOST_SETS])


def hangs_on(
    case: Case, subspaces: Sequence[Subspace], chosen: Subset, without: Subset, others: Sequence[Subset], needed: float
) -> list[tuple[int, ...]]:
    """Smallest sets of one or two poses without which a cause is not significant, or another takes its place.

    chosen: the subset with the cause; without: the same without it; others: those that count as another answer;
    needed: by how much the cause must lower the squares to be named
    """
    blocks, count = _pose_blocks(case.pose)
    pairs = [(i,) for i in range(count)]
    if count <= _MOST_POSES:
        pairs += list(combinations(range(count), 2))
    index = np.array([(*p, p[0]) if len(p) == 1 else p for p in pairs])
    same = index[:, 0] == index[:, 1]
    none = _squares_without(case, _columns(subspaces, without), blocks, index, same)
    best = _squares_without(case, _columns(subspaces, chosen), blocks, index, same)
    lost = none - best < needed
    penalty = float(np.log(len(case.pose)))
    for other in others:
        rival = _squares_without(case, _columns(subspaces, other), blocks, index, same)
        lost |= rival + penalty * (other.dof - chosen.dof) < best
    singles = {pairs[i] for i in np.flatnonzero(lost) if len(pairs[i]) == 1}
    alone = {p[0] for p in singles}
    doubles = [pairs[i] for i in np.flatnonzero(lost) if len(pairs[i]) == 2 and not alone & set(pairs[i])]
    return [*sorted(singles), *doubles]


def _columns(subspaces: Sequence[Subspace], subset: Subset) -> Array:
    none = np.zeros((len(subspaces[0].Q), 0))
    return np.concatenate([none, *(subspaces[i].Q for i in subset.members)], axis=1)


def _pose_blocks(pose: Indices) -> tuple[Indices, int]:
    """Positions (P, b) of each pose's scalars, filled up with len(pose)."""
    found = [np.flatnonzero(pose == p) for p in np.unique(pose)]
    out = np.full((len(found), max(map(len, found))), len(pose))
    for i, at in enumerate(found):
        out[i, : len(at)] = at
    return out, len(found)


def _squares_without(case: Case, columns: Array, blocks: Indices, index: Indices, same: Array) -> Array:
    """Squares left by a fit to all poses but two (D,): RSS - r' (I - H)^-1 r over the deleted rows."""
    fit = LinearFit.onto(np.linalg.qr(np.concatenate([case.fit.Q, columns], axis=1))[0], case.residuals)
    Q, r = np.pad(fit.Q, ((0, 1), (0, 0))), np.append(fit.white, 0.0)
    second = np.where(same[:, None], len(r) - 1, blocks[index[:, 1]])
    at = np.concatenate([blocks[index[:, 0]], second], axis=1)
    out = np.empty(len(at))
    for part, _, error in solved(Q * (1.0 - _RIDGE), at, r, None):
        out[part] = fit.chi2 - np.einsum("di,di->d", r[at[part]], error)
    return out


def _other_sets(library: Library, given: tuple[int, ...], allowed: set[int]) -> list[Subset]:
    """The given causes with another one in the free place, the best few that are physical."""
    gram = library.gram
    others = [j for j in library.heads if j not in given and j not in allowed]
    falls = gram.falls(given, others)
    out: list[Subset] = []
    for n in np.argsort(-falls)[: 2 * _ALTERNATIVES_TRIED]:
        members = (*given, others[int(n)])
        rss, _, physical = gram.solve(members)
        if physical and len(out) < _ALTERNATIVES_TRIED:
            out.append(Subset(members, rss, sum(len(gram.at[j]) for j in members), 0.0))
    return out


def table_of(
    library: Library, best: Answer | None, findings: Sequence[NamedCause], untested: Sequence[Untested]
) -> tuple[Line, ...]:
    """One line for every cause: named ones first, then their alternatives, what is excluded, what is invisible."""
    named = {f.name for f in findings}
    tied = {r.name for f in findings for r in f.alternatives}
    members = best.subset.members if best else ()
    angles = angle_matrix(library.subspaces)
    causes = library.case.causes
    shown = [i for i, c in enumerate(causes) if not c.group or c.name in named | tied]
    lines = [_line(library, best, i, named, tied, members, angles[i]) for i in shown]
    order = list(Status)
    lines.sort(key=lambda x: (order.index(x.status), x.p_value))
    return (*lines, *(Line(name=u.name, status=Status.UNTESTED, needs=u.needs) for u in untested))


def _line(
    library: Library,
    best: Answer | None,
    i: int,
    named: set[str],
    tied: set[str],
    members: Sequence[int],
    angles: Array,
) -> Line:
    subspace, cause = library.subspaces[i], library.case.causes[i]
    if not subspace.visible:
        s = subspace.reach / REACH
        return Line(name=cause.name, status=Status.INVISIBLE, s=0.0, p_value=1.0, reach=s if s > _ROUNDING else 0.0)
    others = [j for j, c in enumerate(library.case.causes) if c.group or c.shares(cause)]
    angles[others] = np.nan
    near = int(np.nanargmin(angles)) if np.isfinite(angles).any() else i
    status = Status.NAMED if cause.name in named else Status.TIED if cause.name in tied else Status.EXCLUDED
    return Line(
        name=cause.name,
        status=status,
        s=float(library.scores.size[i]),
        p_value=float(library.scores.p_adjusted[i]),
        values=values_of(cause, best.fit) if best and i in members else (),
        limits=() if status is Status.NAMED else _limits(library, i, [m for m in members if m != i]),
        nearest=library.case.causes[near].name,
        angle=float(angles[near]),
    )


def _limits(library: Library, i: int, given: Sequence[int]) -> tuple[tuple[Parameter, float], ...] | None:
    """The largest size that the readings allow beside the named causes, 95 %, of each parameter by itself."""
    gram, at, cause = library.gram, library.gram.at[i], library.case.causes[i]
    beside = gram.given(given)
    values, vectors = np.linalg.eigh(beside.G[np.ix_(at, at)])
    turn = library.subspaces[i].turn @ vectors
    unit = library.unit(given)
    z = vectors.T @ beside.c[at]
    told = values > 1e-4
    if not told.any():
        return None
    center = np.abs(turn[:, told] @ (z[told] / values[told]))
    sizes = center + _SIDES * np.sqrt(np.square(turn[:, told]) @ (unit / values[told]))
    told_apart = sizes > _ROUNDING * np.array(cause.sizes)  # the fitted parameters absorb the others
    return tuple((p, float(s)) for p, s, t in zip(cause.parameters, sizes, told_apart, strict=True) if t)


def alternative_set(
    gram: Gram,
    named: int,
    given: Sequence[int],
    exact: Mapping[int, float],
    seed: int = 0,
    without: Sequence[int] = (),
) -> tuple[int, ...]:
    """Causes that may stand in the place of `named` beside the `given` ones, the likeliest first; never the named.

    exact: squares that the exact fit leaves with each cause in this place, where such a fit was made; without: causes
    that do not compete, such as all axes of a place of which one is named
    """
    race = gram.given(given, without)
    H, _ = race.whitening
    falls = race.squares(race.c[None] @ H)[0]
    left = race.total - falls
    for i, rss in exact.items():
        left[i] = rss
    others = [i for i in gram.visible if i not in {*given, *without, named} and left[i] - left[named] < _FAR]
    rng = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(race.G)
    noise = rng.standard_normal((_DRAWS, len(values))) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T @ H
    kept = [i for i in others if _possible(race, i, left[i] - left[named], noise, given)]
    return tuple(sorted(kept, key=lambda i: left[i]))


def _possible(race: Gram, i: int, behind: float, noise: Array, given: Sequence[int]) -> bool:
    """Whether cause i, were it true, would be as far behind the best in a fair share of repeated measurements."""
    H, owner = race.whitening
    own = H[:, owner == i]
    if not own.size:
        return False
    part = race.c @ own
    if race.sided[i] and race.sizes[i] == 1:
        part = np.maximum(part, 0.0)
    falls = race.squares(noise + race.G @ (own @ part) @ H)
    falls[:, list(given)] = 0.0
    lost = falls.max(axis=1) - falls[:, i]
    return bool(behind <= np.quantile(lost, CONFIDENCE) + 1e-9)
