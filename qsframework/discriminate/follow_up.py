"""A second day: the visits that settle best which of all likely explanations is true.

Explanations h: places that move by a law, and causes of the library. With X the fitted columns, Z those of h, its
weights drawn from N(0, sd^2), and everything whitened, a fit of h to the first day has

    P_h = [X Z_h]' [X Z_h] + diag(0, 1 / sd^2),   theta_h = P_h^-1 [X Z_h]' y.

Were h true, a rival k would fit theta_{k|h}. A visit with columns F adds

    delta_hk^2 += r' (I + F_k P_k^-1 F_k')^-1 r,   r = F_h theta_h - F_k theta_{k|h}

and the visits make J = sum of sqrt(pi_h pi_k) exp(-delta_hk^2 / 8), over pairs that differ in place or variable, as
small as they can (Bhattacharyya's bound of the chance to confuse them), one visit after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from qsframework.design import Candidates
from qsframework.diagnose.linearization.candidates import Cause
from qsframework.diagnose.linearization.columns import make_case
from qsframework.diagnose.linearization.generic_blocks import motions
from qsframework.diagnose.linearization.place_motions import VisitGroups, by_group, law_columns, places_of, variables
from qsframework.diagnose.result import Diagnosis
from qsframework.diagnose.selection.places import PlaceMotion
from qsframework.discriminate.alternatives import batch
from qsframework.discriminate.pair import CANDIDATES, drawn, with_loads
from qsframework.errors import InputError
from qsframework.experiment import Experiment, Marker, Plan, make_plan, make_rows
from qsframework.experiment.readings import joined
from qsframework.experiment.simulate import planned_readings
from qsframework.experiment.stations import station_frame
from qsframework.plugin import Array, Indices, Poses
from qsframework.plugin.facts import frozen

COUNT = 8
_AGAIN = 2
"""VisitGroups of a second day that repeat one of the first: they tell what a visit shares from what acts."""
_WITHIN = 12.0
"""Nats below the likeliest explanation within which others are looked at."""
_AT_A_PLACE, _MOST = 5, 28
_LOADS = 8
"""Different loads of the first day up to which all of them may hang on the second, where none are listed."""
_DRAWS = 400
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Suspect:
    """An explanation that the first day leaves open: a law of a place or a cause, in words of neither; share of the
    evidence; place: number of the answer that it belongs to."""

    law: PlaceMotion | Cause
    share: float
    place: int


@dataclass(frozen=True)
class Reflector:
    """A reflector that nobody has mounted yet, and the chance of the right place with it."""

    marker: Marker
    chance: float


@dataclass(frozen=True, eq=False, kw_only=True)
class FollowUp:
    """A second day: its visits, the chance that the likeliest place is the right one before and after, the same of
    place and variable, reflectors that would raise it, the best first, and what was open."""

    plan: Plan
    before: float
    after: float
    variable_before: float
    variable_after: float
    reflectors: tuple[Reflector, ...]
    suspects: tuple[Suspect, ...]


def follow_up(
    diagnosis: Diagnosis,
    count: int = COUNT,
    *,
    candidates: int | Candidates | Array = CANDIDATES,
    seed: int = 0,
    progress: Progress | None = None,
) -> FollowUp:
    """Plan a second day that best decides what a diagnosis leaves open.

    Args:
        diagnosis: of the first day.
        count: visits, two of them repeats of the first day's.
        candidates: how many to draw, or poses (N, n) rad.
        seed: random seed.
        progress: called with each step, how much is done and of how much.

    Returns:
        The plan, and the probability of the right place before and after it.

    Raises:
        InputError: where nothing is open, or no candidate is allowed.
    """
    tell: Progress = progress or (lambda step, done, total: None)
    if diagnosis.verdict == "none":
        raise InputError("nothing is open: the diagnosis names no cause and no place")
    suspects = suspects_of(diagnosis)
    experiment = _second(diagnosis)
    if isinstance(candidates, int):
        candidates = max(candidates // max(len(experiment.loads), 1), 4 * count)
    pendant = drawn(experiment, candidates, seed, tell)
    pool = _pool(diagnosis, experiment, pendant)
    tell("what the visits would show", 0, 1)
    game = _game(diagnosis, experiment, suspects, pool)
    again = np.arange(len(pool.pose))[-len(_states(diagnosis)) :]
    chosen = game.choose(count, again, tell)
    plan = _plan_of(experiment, pool, chosen, seed)
    place, variable = game.chances(chosen, seed)
    first, at_first = game.chances((), seed)
    reflectors = _reflectors(diagnosis, experiment, suspects, plan, seed)
    return FollowUp(
        plan=plan,
        before=first,
        after=place,
        variable_before=at_first,
        variable_after=variable,
        reflectors=reflectors,
        suspects=suspects,
    )


def suspects_of(diagnosis: Diagnosis) -> tuple[Suspect, ...]:
    """What may be true of the first day: laws of places within reach of the likeliest, and causes of the library."""
    found: list[tuple[float, PlaceMotion | Cause, int]] = []
    entries, causes = diagnosis.competition.entries, diagnosis.competition.causes
    for number, entry in enumerate(entries):
        laws = [e for e in entry.explanations if e.law.by][:_AT_A_PLACE]
        found += [(e.evidence, e, number) for e in laws]
    known = {c.name: c for c in diagnosis.case.causes}
    found += [(e, known[name], len(entries) + i) for i, (name, e) in enumerate(causes.items()) if name in known]
    found = sorted(found, key=lambda x: -x[0])[:_MOST]
    near = [x for x in found if x[0] > found[0][0] - _WITHIN]
    odds = np.exp([e - near[0][0] for e, _, _ in near]) if near else np.zeros(0)
    return tuple(Suspect(law, float(p), n) for (_, law, n), p in zip(near, odds / odds.sum(), strict=True))


def _second(diagnosis: Diagnosis) -> Experiment:
    """The experiment of a second day, its noise as large as the first one's was found to be."""
    first, experiment = diagnosis.readings, diagnosis.experiment
    own = float(np.sqrt(np.nanmean(first.sigma[diagnosis.kept] ** 2))) * diagnosis.audit.unit
    if bool((first.minus >= 0).any()):
        experiment = with_loads(experiment, [first], _LOADS)
    return experiment.with_(noise=replace(experiment.noise, sigma=own))


def _states(diagnosis: Diagnosis) -> Indices:
    """The states that were read on the first day."""
    return np.unique(diagnosis.readings.plus[diagnosis.kept])


def _pool(diagnosis: Diagnosis, experiment: Experiment, pendant: Array) -> Plan:
    """Every candidate under every load, and after them the poses of the first day once more under theirs."""
    first = diagnosis.readings
    used = _states(diagnosis)
    again = first.poses.take(used)
    if experiment.loads:
        poses, _, loads = batch(experiment, pendant)
    else:
        joints = experiment.robot.controller.to_joints(pendant)
        poses, loads = Poses(pendant, joints, np.zeros((len(pendant), 6))), ("",) * len(pendant)
    wrench = again.wrench * first.states.loaded[used, None]
    names = [*(f"new{i}" for i in range(len(poses))), *(f"again {first.states.pose[i]}" for i in map(int, used))]
    pairs = (poses.pendant, again.pendant), (poses.q, again.q), (poses.wrench, wrench)
    shown, q, pulled = (np.concatenate(pair) for pair in pairs)
    every = Poses(shown, q, pulled)
    load = [*loads, *(_load_name(experiment, w) for w in wrench)]
    return make_plan(every, load, names=names, units=experiment.robot.controller.units)


def _load_name(experiment: Experiment, wrench: Array) -> str:
    near = [c.name for c in experiment.loads if np.allclose(c.wrench, wrench, rtol=1e-3, atol=1e-6)]
    return near[0] if near else ""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Game:
    """Columns of each of H explanations, whitened, their weights drawn with sd 1: first (m, p) at the first day, at
    each of N visits (N, w, p); y (m,): the first day's readings; odds (H,); place, kind (H,): numbers of the answers;
    free: how many columns, the first of each, are fitted freely."""

    first: tuple[Array, ...]
    visits: tuple[Array, ...]
    y: Array
    odds: Array
    place: Indices
    kind: Indices
    free: int

    @cached_property
    def _prior(self) -> list[Array]:
        widths = [int(C.shape[1]) for C in self.first]
        return [np.diag([1e-9] * self.free + [1.0] * (width - self.free)) for width in widths]

    @cached_property
    def theta(self) -> list[Array]:
        """What each would fit to the first day."""
        pairs = zip(self.first, self._prior, strict=True)
        return [np.asarray(np.linalg.solve(C.T @ C + prior, C.T @ self.y), dtype=np.float64) for C, prior in pairs]

    @cached_property
    def shown(self) -> Array:
        """What each foretells of the visits (N, w, H)."""
        return np.stack([F @ t for F, t in zip(self.visits, self.theta, strict=True)], axis=-1)

    @cached_property
    def _weights(self) -> Array:
        """(H, H): of the pairs that differ in place or variable."""
        apart = (self.place[:, None] != self.place) | (self.kind[:, None] != self.kind)
        return np.sqrt(self.odds[:, None] * self.odds) * apart

    def _gains(self, taken: Sequence[int], among: Indices) -> Array:
        """By how much each visit (n,) would raise delta^2 [k, h] (H, H), after those that are taken."""
        predicted = np.stack([C @ t for C, t in zip(self.first, self.theta, strict=True)], axis=-1)
        out = np.empty((len(among), len(self.odds), len(self.odds)))
        for k, (C, F) in enumerate(zip(self.first, self.visits, strict=True)):
            own = F[list(taken)].reshape(-1, F.shape[2])
            seen = self.shown[list(taken)].reshape(-1, len(self.odds))
            P = C.T @ C + own.T @ own + self._prior[k]
            inverse = np.linalg.inv(P)
            theta = inverse @ (C.T @ predicted + own.T @ seen)
            r = self.shown[among] - F[among] @ theta
            S = np.eye(F.shape[1]) + F[among] @ inverse @ F[among].transpose(0, 2, 1)
            out[:, k] = (r * np.linalg.solve(S, r)).sum(axis=1)
        return out

    def choose(self, count: int, again: Indices, tell: Progress) -> tuple[int, ...]:
        """The visits, greedily, the last of them from those of the first day."""
        taken, total = list[int](), np.zeros((len(self.odds), len(self.odds)))
        every = np.arange(len(self.shown))
        twice = _AGAIN if count > 2 * _AGAIN and len(again) else 0
        for step in range(count):
            tell("visits", step, count)
            among = np.setdiff1d(again if step >= count - twice else every, taken)
            gains = self._gains(taken, among)
            best = int(np.argmin(self._bound(total + gains)))
            taken.append(int(among[best]))
            total = total + gains[best]
            if step == 0:  # visits that show little at first hardly show more later
                worth = among[np.argsort(self._bound(gains))[: max(len(among) // 3, 4 * count)]]
                every = np.union1d(worth, again)
        return tuple(taken)

    def _bound(self, squares: Array) -> Array:
        """J (n,) of delta^2 (n, H, H)."""
        return np.asarray((self._weights.T * np.exp(-squares / 8.0)).sum(axis=(1, 2)))

    def squares(self, taken: Sequence[int]) -> Array:
        """delta^2 [k, h] of visits together."""
        out = np.zeros((len(self.odds), len(self.odds)))
        for i in range(len(taken)):
            out += self._gains(taken[:i], np.array([taken[i]]))[0]
        return out

    def chances(self, taken: Sequence[int], seed: int) -> tuple[float, float]:
        """That the answer with the largest share has the right place, and the right place and variable."""
        rng, square = np.random.default_rng(seed), self.squares(taken)
        both = self.place * (int(self.kind.max(initial=0)) + 1) + self.kind
        right = np.zeros(2)
        for h in range(len(self.odds)):
            d = square[:, h]
            against = np.log(self.odds / self.odds[h]) - 0.5 * d + np.sqrt(d) * rng.standard_normal((_DRAWS, len(d)))
            against[:, h] = 0.0
            for n, label in enumerate((self.place, both)):
                shares = np.stack([np.exp(against) @ (label == g) for g in np.unique(label)], axis=1)
                won = np.unique(label)[np.argmax(shares, axis=1)] == label[h]
                right[n] += self.odds[h] * float(won.mean())
        return float(right[0]), float(right[1])


def _game(diagnosis: Diagnosis, experiment: Experiment, suspects: Sequence[Suspect], plan: Plan) -> _Game:
    """The columns of all explanations at the first day and at each pose of a plan."""
    fit = diagnosis.baseline
    old = replace(
        diagnosis.readings.of_rows(diagnosis.kept),
        sigma=diagnosis.readings.sigma[diagnosis.kept] * diagnosis.audit.unit,
        minus_sigma=diagnosis.readings.minus_sigma[diagnosis.kept] * diagnosis.audit.unit,
    )
    new = planned_readings(experiment, plan)
    rows = make_rows(joined([old, new])).sharing(diagnosis.audit.shared)
    known = dict(zip([f.series for f in fit.frames], fit.frames, strict=True))
    names = [rows.readings.frames[f] for f in rows.estimated]
    frames = [known.get(name) or station_frame(experiment, name) for name in names]
    causes = [s.law for s in suspects if isinstance(s.law, Cause)]
    residuals = np.zeros((len(rows.keep), 3))
    residuals[: len(diagnosis.kept)] = fit.residuals
    case = make_case(experiment, rows, fit.names, causes, fit.by_name(), residuals, frames)
    model = experiment.model()
    x = model.nominal
    x[model.index(list(fit.names))] = [fit.value(n) for n in fit.names]
    moved = motions(model, rows, x, frames)
    by, places = {v.name: v for v in variables(moved)}, {(*p.law.where, p.law.part): p for p in places_of(moved)}
    columns: list[Array] = []
    for s in suspects:
        if isinstance(s.law, Cause):
            columns.append(case.B[[c.name for c in causes].index(s.law.name)])
            continue
        law = s.law.law
        place = places[(*law.where, law.part)]
        own = [by[f] for f in by if f in law.by or not f]
        Z = dict(law_columns(place, s.law.at, moved, own))[law.by] * s.law.sd
        columns.append(case.noise.whiten(Z.reshape(-1, Z.shape[2])))
    first, visits, y = _split(case.A, columns, case.residuals, rows.plus, len(diagnosis.kept))
    laws = [s.law.name if isinstance(s.law, Cause) else "*".join(s.law.law.by) for s in suspects]
    kinds = {name: i for i, name in enumerate(dict.fromkeys(laws))}
    return _Game(
        first=first,
        visits=visits,
        y=y,
        odds=np.array([s.share for s in suspects]),
        place=np.array([s.place for s in suspects]),
        kind=np.array([kinds[name] for name in laws]),
        free=case.A.shape[1],
    )


def _split(
    A: Array, columns: Sequence[Array], y: Array, plus: Indices, first: int
) -> tuple[tuple[Array, ...], tuple[Array, ...], Array]:
    """Columns at the first day's rows, and at those of each later visit (N, w, p), padded with zeros."""
    at = by_group(plus[first:])
    visits = VisitGroups(at, np.zeros(len(plus) - first, dtype=np.intp))
    whole = [np.concatenate([A, Z], axis=1) for Z in columns]
    return tuple(w[: 3 * first] for w in whole), tuple(visits.split(w[3 * first :]) for w in whole), y[: 3 * first]


def _plan_of(experiment: Experiment, pool: Plan, chosen: Sequence[int], seed: int) -> Plan:
    """The visits as a plan; those that repeat the first day come last."""
    at = np.array(sorted(chosen))
    names = [f"f{i + 1:02d}" for i in range(len(at))]
    load, units = [pool.load[int(i)] for i in at], experiment.robot.controller.units
    return make_plan(pool.poses.take(at), load, None, "follow-up", None, seed, names, units)


_OUT = 0.9
"""m: how far a reflector on the base stands out, on a bar."""
_REFLECTED = 3
"""Links, counted from the base, that a reflector may be mounted on."""


def _reflectors(
    diagnosis: Diagnosis, experiment: Experiment, suspects: Sequence[Suspect], plan: Plan, seed: int
) -> tuple[Reflector, ...]:
    """What one reflector more, at the same visits, would be worth, the best first."""
    out: list[Reflector] = []
    for marker in _mounts(experiment):
        wider = experiment.with_(markers=(*experiment.markers, marker))
        game = _game(diagnosis, wider, suspects, plan)
        out.append(Reflector(marker, game.chances(range(len(plan.pose)), seed)[0]))
    return tuple(sorted(out, key=lambda r: -r.chance))


def _mounts(experiment: Experiment) -> list[Marker]:
    """Reflectors on a bar of the base and at the far ends of the first links, where none is yet."""
    robot, out = experiment.robot, list[Marker]()
    taken = {m.link for m in experiment.markers}
    for k, own in enumerate(robot.facts.links[: 1 + _REFLECTED]):
        link = own if own in robot.frames else next((n for n, f in robot.frames.items() if f.link == k), None)
        if link is None or link in taken:
            continue
        far = np.array([_OUT, 0.0, 0.0]) if k == 0 else robot.facts.placements[k][:3, 3]
        out.append(Marker(f"reflector_{link}", link, frozen(far)))
    return out
