"""A second day: the visits that settle best which of all likely explanations is true, and what else would.

The visits are chosen one after the other, and then exchanged as long as that helps, so that the chance to confuse two
explanations (`explanations`) becomes as small as it can.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.arguments import checked
from qsframework.diagnoses.explanations import Explanations, Foretold, Suspect, foretold, motions_at
from qsframework.diagnoses.mounts import Mount, mounted, mounts_of, of_gauges
from qsframework.diagnoses.result import Diagnosis
from qsframework.errors import InputError
from qsframework.experiment import Experiment, LoadCase, Plan, make_plan, make_rows
from qsframework.experiment.readings import joined
from qsframework.experiment.simulate import planned_readings
from qsframework.experiment.stations import station_frame
from qsframework.hypotheses.catalogue.causes import Cause, with_causes
from qsframework.hypotheses.search.places import PlaceMotion
from qsframework.plans import Candidates, generate_candidates
from qsframework.plans.polish import rounded
from qsframework.plugin import Array, Indices, Poses
from qsframework.plugin.facts import frozen

COUNT = 8
CANDIDATES = 500
_AGAIN = 2
"""Visits of a second day that repeat one of the first: they tell what a visit shares from what acts."""
_WITHIN = 12.0
"""Nats below the likeliest explanation within which others are looked at."""
_AT_A_PLACE, _MOST = 5, 28
_LOADS = 8
"""Different loads of the first day up to which all of them may hang on the second, where none are listed."""
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False, kw_only=True)
class FollowUp:
    """A second day: its visits, the chance that the likeliest place is the right one before and after, the same of
    place and variable, what could be mounted to raise it, the best first, and what was open."""

    plan: Plan
    before: float
    after: float
    variable_before: float
    variable_after: float
    mounts: tuple[Mount, ...]
    suspects: tuple[Suspect, ...]


@checked
def follow_up(
    diagnosis: Diagnosis,
    count: int = COUNT,
    *,
    candidates: int | Candidates | Array = CANDIDATES,
    without: Collection[str] = (),
    seed: int = 0,
    progress: Progress | None = None,
) -> FollowUp:
    """The visits that settle best what a diagnosis leaves open, and what could be mounted to settle more.

    Args:
        diagnosis: of the first day.
        count: visits; of five and more, two repeat poses of the first day.
        candidates: poses to choose from, under each load: their number, or pendant angles (N, n) rad.
        without: links that nobody can mount a reflector on, `world` for the floor, `gauges` for all dial gauges.
        seed: of the candidates and of the chances.
        progress: called with a step, how much of it is done, and of how much.

    Returns:
        The plan, and the probability of the right place before and after it.

    Raises:
        InputError: where nothing is open, no candidate is allowed, or `without` names no such link.
    """
    tell: Progress = progress or (lambda step, done, total: None)
    if diagnosis.verdict == "none" and not diagnosis.hinted:
        raise InputError("nothing is open: the diagnosis names no cause and no place")
    mounts = mounts_of(diagnosis.experiment, without)
    pool, explanations = opened(diagnosis, candidates, seed, tell)
    again = np.arange(len(pool.pose))[-len(_states(diagnosis)) :]
    chosen = chosen_visits(explanations, count, again, tell)
    plan = _plan_of(diagnosis, pool, chosen, seed)
    place, variable = explanations.chances(chosen, seed)
    first, at_first = explanations.chances((), seed)
    return FollowUp(
        plan=plan,
        before=first,
        after=place,
        variable_before=at_first,
        variable_after=variable,
        mounts=_judged(diagnosis, plan, mounts, seed),
        suspects=suspects_of(diagnosis),
    )


def opened(
    diagnosis: Diagnosis,
    candidates: int | Candidates | Array,
    seed: int,
    tell: Progress = lambda step, done, total: None,
) -> tuple[Plan, Explanations]:
    """The visits that a second day may have, the poses of the first last, and what each explanation says of them."""
    experiment = _second(diagnosis)
    if isinstance(candidates, int):
        candidates = max(candidates // max(len(experiment.loads), 1), 4 * COUNT)
        candidates = generate_candidates(
            experiment, candidates, seed, lambda done, total: tell("candidate poses", done, total)
        )
    pendant = candidates.pendant if isinstance(candidates, Candidates) else np.asarray(candidates, dtype=np.float64)
    pool = _pool(diagnosis, experiment, pendant)
    tell("what the visits would show", 0, 1)
    told = _foretold(diagnosis, experiment, pool)
    later = np.arange(len(told.rows.keep)) >= len(diagnosis.kept)
    return pool, told.explanations(~later, later)


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
    """The experiment of a second day, on the arm with the causes that are known, its noise as large as the first one's
    was found to be."""
    first, experiment = diagnosis.readings, diagnosis.experiment
    own = float(np.sqrt(np.nanmean(first.sigma[diagnosis.kept] ** 2))) * diagnosis.audit.unit
    noise, loads = replace(experiment.noise, sigma=own), experiment.loads or _loads_of(diagnosis)
    return with_causes(experiment, diagnosis.known, {}).with_(noise=noise, loads=loads)


def _loads_of(diagnosis: Diagnosis) -> tuple[LoadCase, ...]:
    """The loads of the first day's displacements: all up to a few, else the largest."""
    first = diagnosis.readings
    if not bool((first.minus >= 0).any()):
        return ()
    used = np.unique(np.round(first.poses.wrench, 6), axis=0)
    used = used[used.any(axis=1)]
    order = np.argsort(-np.linalg.norm(used[:, :3], axis=1), kind="stable")
    kept = used[order[: 1 if len(used) > _LOADS else len(used)]]
    return tuple(LoadCase(f"load_{i + 1}", frozen(w), None) for i, w in enumerate(kept))


def _states(diagnosis: Diagnosis) -> Indices:
    """The states that were read on the first day."""
    return np.unique(diagnosis.readings.plus[diagnosis.kept])


def _pool(diagnosis: Diagnosis, experiment: Experiment, pendant: Array) -> Plan:
    """Every candidate under every load, and after them the poses of the first day once more under theirs."""
    first = diagnosis.readings
    used = _states(diagnosis)
    again = first.poses.take(used)
    hung = [(load.name, load.wrench) for load in experiment.loads] or [("", np.zeros(6))]
    every = np.tile(pendant, (len(hung), 1))
    pulled = np.repeat(np.stack([wrench for _, wrench in hung]), len(pendant), axis=0)
    poses = Poses(every, experiment.robot.controller.to_joints(every), pulled)
    loads = [name for name, _ in hung for _ in pendant]
    wrench = again.wrench * first.states.loaded[used, None]
    names = [*(f"new{i}" for i in range(len(poses))), *(f"again {first.states.pose[i]}" for i in map(int, used))]
    pairs = (poses.pendant, again.pendant), (poses.q, again.q), (poses.wrench, wrench)
    shown, q, pulled = (np.concatenate(pair) for pair in pairs)
    load = [*loads, *(_load_name(experiment, w) for w in wrench)]
    robot = experiment.robot
    return make_plan(Poses(shown, q, pulled), load, names=names, units=robot.controller.units, robot=robot.name)


def _load_name(experiment: Experiment, wrench: Array) -> str:
    near = [c.name for c in experiment.loads if np.allclose(c.wrench, wrench, rtol=1e-3, atol=1e-6)]
    return near[0] if near else ""


def _foretold(diagnosis: Diagnosis, experiment: Experiment, plan: Plan, mounts: Sequence[Mount] = ()) -> Foretold:
    """What the explanations do to the rows of the first day, and after these to those of a plan, its last markers
    being mounts."""
    fit = diagnosis.settled
    old = replace(
        diagnosis.readings.of_rows(diagnosis.kept),
        sigma=diagnosis.readings.sigma[diagnosis.kept] * diagnosis.audit.unit,
        minus_sigma=diagnosis.readings.minus_sigma[diagnosis.kept] * diagnosis.audit.unit,
    )
    new = of_gauges(planned_readings(experiment, plan), mounts, len(experiment.markers) - len(mounts))
    rows = make_rows(joined([old, new])).sharing(diagnosis.audit.shared)
    known = dict(zip([f.series for f in fit.frames], fit.frames, strict=True))
    names = [rows.readings.frames[f] for f in rows.estimated]
    frames = [known.get(name) or station_frame(experiment, name) for name in names]
    residuals = np.zeros((len(rows.keep), 3))
    residuals[: len(diagnosis.kept)] = fit.residuals
    x = {name: fit.value(name) for name in fit.names}
    return foretold(experiment, motions_at(experiment, rows, x, frames), x, residuals, suspects_of(diagnosis))


def chosen_visits(opened: Explanations, count: int, again: Indices, tell: Progress) -> tuple[int, ...]:
    """The visits that part explanations best, the last of them from `again`: one after the other, then exchanged."""
    taken, total = list[int](), np.zeros((len(opened.odds), len(opened.odds)))
    every = whole = np.arange(len(opened.shown))
    twice = min(_AGAIN, len(again)) if count > 2 * _AGAIN else 0
    for step in range(count):
        tell("visits", step, count)
        among = np.setdiff1d(again if step >= count - twice else every, taken)
        gains = opened.gains(taken, among)
        best = int(np.argmin(opened.bound(total + gains)))
        taken.append(int(among[best]))
        total = total + gains[best]
        if step == 0:  # visits that show little at first hardly show more later
            worth = among[np.argsort(opened.bound(gains))[: max(len(among) // 3, 4 * count)]]
            every = np.union1d(worth, again)
    least = float(opened.bound(total[None])[0])
    for step in range(count):
        rest = [*taken[:step], *taken[step + 1 :]]
        among = np.setdiff1d(again if step >= count - twice else whole, rest)
        bounds = opened.bound(opened.squares(rest) + opened.gains(rest, among))
        if bounds.min() < least:
            taken[step], least = int(among[np.argmin(bounds)]), float(bounds.min())
    return tuple(taken)


def _judged(diagnosis: Diagnosis, plan: Plan, mounts: Sequence[Mount], seed: int) -> tuple[Mount, ...]:
    """What each mount would be worth at the visits of a plan, the best first."""
    experiment = _second(diagnosis)
    told = _foretold(diagnosis, mounted(experiment, mounts), plan, mounts)
    later, count = np.arange(len(told.rows.keep)) >= len(diagnosis.kept), len(experiment.markers)
    out: list[Mount] = []
    for i, mount in enumerate(mounts):
        seen = later & ((told.rows.marker < count) | (told.rows.marker == count + i))
        with_it = told.explanations(~later, seen)
        out.append(replace(mount, chance=with_it.chances(range(len(with_it.shown)), seed)[0]))
    return tuple(sorted(out, key=lambda m: -m.chance))


def _plan_of(diagnosis: Diagnosis, pool: Plan, chosen: Sequence[int], seed: int) -> Plan:
    """The visits as a plan, new ones rounded as any plan; those that repeat the first day come last."""
    at = np.array(sorted(chosen))
    experiment = diagnosis.experiment
    names = [f"f{i + 1:02d}" for i in range(len(at))]
    load, units = [pool.load[int(i)] for i in at], experiment.robot.controller.units
    pendant = pool.pendant[at]
    new = at < len(pool.pose) - len(_states(diagnosis))
    pendant[new] = rounded(experiment, pendant[new])
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), pool.wrench[at])
    return make_plan(poses, load, None, "follow-up", None, seed, names, units, robot=experiment.robot.name)
