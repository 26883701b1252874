"""Poses that tell one named cause from another, or what else to measure where no poses can."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.design import Candidates, generate_candidates
from qsframework.diagnose.linearization.candidates import Cause, find_causes, groups_of
from qsframework.discriminate.alternatives import SEEN, Draw, Offer, batch, offers
from qsframework.discriminate.t_optimal import STARTS, Chosen, Question, Taken, ask, choose, limit_angle, told
from qsframework.errors import InputError, Problem, nearest
from qsframework.estimation.tails import normal_sf
from qsframework.experiment import Experiment, LoadCase, Plan, PlanCertificate, Readings, make_plan
from qsframework.plugin import Array, Parameter, Poses
from qsframework.plugin.facts import frozen

ENOUGH = 4.0
"""s beside the other cause from which the two are told apart: the wrong one fits better in 2 %."""
SAME = "the same"
"""The kind of reading that was taken before, beside those of `alternatives.kinds`."""
CLOSE = float(np.deg2rad(10.0))
CANDIDATES = 500
_FEW_LOADS = 4
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Effort:
    """How much is looked at: poses to choose from, poses of each other kind of reading, and how often the exchange
    begins anew."""

    candidates: int = CANDIDATES
    offered: int = 200
    starts: int = STARTS


FULL = Effort()


@dataclass(frozen=True, eq=False, kw_only=True)
class Discrimination:
    """Poses that separate two causes.

    values (p,) SI: the size of the first cause that s speaks of; s: of the first cause, beside what the second one can
    do; angle (rad) between the two; before: what was taken already, after: with the plan; bound: the largest s that
    any choice of as many of these candidates reaches; limit: the angle (rad) that ever more poses lead to; offers:
    other kinds of readings, best first, where poses alone do not help; candidates: how many poses were to choose from
    """

    first: str
    second: str
    parameters: tuple[Parameter, ...]
    values: Array
    plan: Plan
    s_before: float
    s_after: float
    angle_before: float
    angle_after: float
    bound: float
    limit: float
    offers: tuple[Offer, ...]
    candidates: int

    @property
    def helps(self) -> bool:
        """Whether poses of this kind can separate the two at this size."""
        return self.bound >= ENOUGH and self.limit >= CLOSE

    @property
    def useful(self) -> bool:
        """Whether the poses tell anything of the two, if only where the first one is larger."""
        return self.s_after >= SEEN and self.limit >= CLOSE


def mistaken(s: float) -> float:
    """Chance that of two causes fitted to readings the wrong one fits better, s of the true one beside the other."""
    return float(normal_sf(s / 2.0))


def discriminate(
    experiment: Experiment,
    taken: Taken | Sequence[Taken],
    first: str,
    second: str,
    count: int,
    *,
    candidates: int | Candidates | Array | None = None,
    values: Sequence[float] | None = None,
    sigma: float | None = None,
    others: Sequence[Cause] = (),
    x: dict[str, float] | None = None,
    seed: int = 0,
    alternatives: bool | None = None,
    effort: Effort = FULL,
    draw: Draw | None = None,
    progress: Progress | None = None,
) -> Discrimination:
    """`count` poses that show `first` beside what the fitted parameters and `second` absorb.

    taken: readings, plans or poses that are there already; values: deviations of the first cause's parameters, SI,
    their typical sizes if None; others: causes that are named already; x: parameter values to linearise at, by name;
    alternatives: whether to try other kinds of readings, where poses do not help if None; effort: how much to look at;
    draw: where candidates come from, if they are drawn before.
    """
    tell: Progress = progress or (lambda step, done, total: None)
    before = [taken] if isinstance(taken, Plan | Readings | Poses) else list(taken)
    experiment = with_loads(experiment, before)
    noise = noise_of(experiment, sigma)
    draw = draw or (lambda name, of, many: drawn(of, many, seed, tell if name == SAME else None))
    pendant = draw(SAME, experiment, effort.candidates) if candidates is None else drawn(experiment, candidates, seed)
    poses, place, loads = batch(experiment, pendant)
    causes = known_causes(experiment, poses, (first, second))
    question = ask(
        experiment,
        causes[0],
        causes[1],
        noise,
        others=others,
        x=x,
        values=None if values is None else np.asarray(values, dtype=np.float64),
    )
    there = question.taken(before)
    rows = _flat(question, poses)
    tell("poses", 0, 1)
    chosen = choose([rows], [there], count, place, seed, effort.starts, lambda i, n: tell("poses", i, n))
    plan = plan_of(experiment, poses, loads, chosen, question.known, seed)
    start, end = told(there, question.width), told(_with(there, rows, chosen), question.width)
    limit = limit_angle(rows, question.width, seed)
    found = Discrimination(
        first=first,
        second=second,
        parameters=question.first.parameters,
        values=question.values,
        plan=plan,
        s_before=start[0],
        s_after=end[0],
        angle_before=start[1],
        angle_after=end[1],
        bound=chosen.bound,
        limit=limit,
        offers=(),
        candidates=len(rows),
    )
    if not (alternatives or (alternatives is None and not found.helps)):
        return found
    few = min(effort.offered, len(pendant))
    other = offers(question, experiment, before, count, few, seed, others, tell, draw)
    return replace(found, offers=other)


def noise_of(experiment: Experiment, sigma: float | None) -> float:
    """The noise of one coordinate, m; InputError where nobody says it."""
    noise = sigma or experiment.noise.sigma
    if noise is None:
        raise InputError(f"{experiment.path}: a design needs the noise, for example noise: {{sigma_mm: 0.03}}")
    return noise


def with_loads(experiment: Experiment, taken: Sequence[Taken], few: int = _FEW_LOADS) -> Experiment:
    """The experiment, with the loads used so far where it lists none: all up to `few`, else the largest."""
    if experiment.loads:
        return experiment
    wrenches = [one.wrench if isinstance(one, Plan | Poses) else one.poses.wrench for one in taken]
    used = np.unique(np.round(np.concatenate(wrenches), 6), axis=0) if wrenches else np.zeros((0, 6))
    used = used[used.any(axis=1)]
    if not len(used):
        raise InputError(f"{experiment.path}: a design needs `loads`, for example - {{name: weight, fz_N: -4000}}")
    order = np.argsort(-np.linalg.norm(used[:, :3], axis=1), kind="stable")
    kept = used[order[: 1 if len(used) > few else len(used)]]
    return experiment.with_(loads=tuple(LoadCase(f"load_{i + 1}", frozen(w), None) for i, w in enumerate(kept)))


def drawn(
    experiment: Experiment, candidates: int | Candidates | Array, seed: int, tell: Progress | None = None
) -> Array:
    """Candidate poses (P, n), pendant angles."""
    if isinstance(candidates, int):
        told_of: Progress = tell or (lambda step, done, total: None)
        candidates = generate_candidates(experiment, candidates, seed, lambda i, n: told_of("candidate poses", i, n))
    return candidates.pendant if isinstance(candidates, Candidates) else np.asarray(candidates, dtype=np.float64)


def known_causes(experiment: Experiment, poses: Poses, names: Sequence[str]) -> tuple[Cause, ...]:
    """Causes by name. InputError for one that the robot cannot have, or that poses alone cannot show."""
    causes, untested = find_causes(experiment, experiment.fit_names(), poses.take(slice(0, 1)))
    found = {c.name: c for c in (*causes, *groups_of(causes))}
    waiting = {u.name: u.needs for u in untested}
    problems: list[Problem] = []
    for name in names:
        if name in waiting:
            problems.append(
                Problem(
                    f"{name} shows only in readings with the column {' and '.join(waiting[name])}: "
                    "vary that, not the poses"
                )
            )
        elif name not in found:
            problems.append(Problem(f"no cause {name!r}", allowed=", ".join(found), hint=nearest(name, list(found))))
    if len(set(names)) < len(names):
        problems.append(Problem(f"{names[0]} cannot be separated from itself; name two causes"))
    if problems:
        raise InputError(problems)
    return tuple(found[name] for name in names)


def plan_of(
    experiment: Experiment, poses: Poses, loads: tuple[str, ...], chosen: Chosen, known: Sequence[str], seed: int
) -> Plan:
    """The chosen poses as a plan, with their certificate: 1 / s^2 against the bound."""
    index = chosen.index[np.lexsort((*poses.pendant[chosen.index].T[::-1], [loads[int(i)] for i in chosen.index]))]
    value, best = 1.0 / max(chosen.s, 1e-12) ** 2, 1.0 / max(chosen.bound, 1e-12) ** 2
    certificate = PlanCertificate(
        criterion="T",
        value=value,
        relaxed_value=best,
        relaxed_efficiency=1.0,
        efficiency=min(best / value, 1.0),
        candidates=len(poses),
        poses=len(index),
        parameters=tuple(known),
        solver="column generation",
        notes=("T: s^2 of one cause beside what the fitted parameters and another cause absorb",),
    )
    names = [f"t{i + 1:02d}" for i in range(len(index))]
    units = experiment.robot.controller.units
    return make_plan(poses.take(index), [loads[int(i)] for i in index], None, "T", certificate, seed, names, units)


def _flat(question: Question, poses: Poses) -> Array:
    rows = question.rows(poses)
    return rows.reshape(len(rows), -1, rows.shape[-1])


def _with(before: Array, rows: Array, chosen: Chosen) -> Array:
    return np.concatenate([before, rows[chosen.index].reshape(-1, rows.shape[-1])])
