"""Poses that tell one named cause from another, or what else to measure where no poses can."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from qsframework.design import Candidates, generate_candidates
from qsframework.diagnose.causes import Cause, find_causes
from qsframework.diagnose.contrast import Chosen, Question, Taken, ask, choose, limit_angle, told
from qsframework.diagnose.offers import Offer, batch, offers
from qsframework.diagnose.words import people_size
from qsframework.errors import InputError, Problem, nearest
from qsframework.experiment import Certificate, Experiment, LoadCase, Plan, Readings, make_plan
from qsframework.plugin import Array, Parameter, Poses
from qsframework.plugin.facts import frozen

ENOUGH = 4.0
"""s beside the other cause from which the two are told apart: the wrong one fits better in 2 %."""
CLOSE = float(np.deg2rad(10.0))
CANDIDATES = 500
_FEW = 200
_FEW_LOADS = 4
_SEEN = 0.5
"""s below which an offer shows nothing worth saying."""
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Discrimination:
    """Poses that separate two causes.

    values (p,) SI: the size of the first cause that s speaks of; s: of the first cause, beside what the second one can
    do; angle (rad) between the two; before: what was taken already, after: with the plan; bound: the largest s that
    any choice of as many of these candidates reaches; limit: the angle (rad) that ever more poses lead to; offers:
    other kinds of readings, best first, where poses alone do not help
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
    candidates: str

    @property
    def helps(self) -> bool:
        """Whether poses of this kind can separate the two at this size."""
        return self.bound >= ENOUGH and self.limit >= CLOSE

    def size(self, share: float = 1.0) -> str:
        """The first cause's size, or a multiple of it, as people say it."""
        pairs = zip(self.parameters, self.values.tolist(), strict=True)
        return ", ".join(people_size(p, share * v) for p, v in pairs if v)

    @property
    def useful(self) -> bool:
        """Whether the poses tell anything of the two, if only where the first one is larger."""
        return self.s_after >= _SEEN and self.limit >= CLOSE

    def words(self) -> tuple[str, ...]:
        """What the poses reach, and what else would."""
        count = len(self.plan.pose)
        if not self.useful:
            apart = f", however many: the angle stays below {degrees(max(self.limit, np.deg2rad(1.0)))} deg"
            said = [f"{self.first} ({self.size()}) against {self.second}: no more poses like these tell them apart"
                    f"{apart if self.limit < CLOSE else ', s stays near 0'}."]  # fmt: skip
            return (*said, *self._offer_words())
        said = [
            f"{self.first} ({self.size()}) against {self.second}: {count} more poses bring s from {self.s_before:.1f} "
            f"to {self.s_after:.1f} (at most {self.bound:.1f} by any {count} of {self.candidates}) and the angle from "
            f"{degrees(self.angle_before)} to {degrees(self.angle_after)} deg; the wrong one then fits better in "
            f"{_percent(mistaken(self.s_after))} of measurements instead of {_percent(mistaken(self.s_before))}."
        ]
        if not self.helps:
            said.append(f"That is too little at this size; from {self.size(ENOUGH / self.s_after)} on it is enough.")
        return (*said, *self._offer_words())

    def outlook(self) -> str:
        """In a few words, what would tell the two."""
        best = max((o for o in self.offers if o.s >= _SEEN), key=lambda o: o.s, default=None)
        offer = "" if best is None else f"{best.what} would{self._from(best.s)}"
        if self.useful:
            poses = f"{len(self.plan.pose)} more poses would tell it from {self.second}{self._from(self.s_after)}"
            return f"{poses}, {offer}" if best is not None and best.s > self.s_after else poses
        if offer:
            return f"no more poses like these tell it from {self.second}, {offer}"
        return f"nothing that was tried tells it from {self.second}"

    def _from(self, s: float) -> str:
        return "" if s >= ENOUGH else f" from {self.size(ENOUGH / s)} on"

    def _offer_words(self) -> tuple[str, ...]:
        if not self.offers:
            return ()
        some = [o for o in self.offers if o.s >= _SEEN]
        said = ["Measure something different:" if some else "Nothing that was tried separates them: they stay a set."]
        for o in some:
            from_size = f", enough from {self.size(ENOUGH / o.s)} on" if o.s < ENOUGH else ""
            said.append(f"- {o.what}: s = {o.s:.1f}, angle {degrees(o.angle)} deg{from_size}")
        rest = [o.name for o in self.offers if o.s < _SEEN]
        if some and rest:
            said.append(f"No help: {', '.join(rest)}.")
        return tuple(said)

    def as_json(self) -> dict[str, Any]:
        """SI units, angles in deg."""
        return {
            "first": self.first,
            "second": self.second,
            "values": dict(zip([p.name for p in self.parameters], self.values.tolist(), strict=True)),
            "s_before": self.s_before,
            "s_after": self.s_after,
            "angle_before_deg": json_degrees(self.angle_before),
            "angle_after_deg": json_degrees(self.angle_after),
            "s_bound": self.bound,
            "angle_limit_deg": json_degrees(self.limit),
            "helps": self.helps,
            "offers": [
                {"name": o.name, "what": o.what, "s": o.s, "angle_deg": json_degrees(o.angle)} for o in self.offers
            ],
            "words": list(self.words()),
        }


def mistaken(s: float) -> float:
    """Chance that of two causes fitted to readings the wrong one fits better, s of the true one beside the other."""
    from scipy.stats import norm

    return float(norm.sf(s / 2.0))


def discriminate(
    experiment: Experiment, taken: Taken | Sequence[Taken], first: str, second: str, count: int, *,
    candidates: int | Candidates | Array = CANDIDATES, values: Sequence[float] | None = None,
    sigma: float | None = None, others: Sequence[Cause] = (), x: dict[str, float] | None = None, seed: int = 0,
    alternatives: bool | None = None, progress: Progress | None = None,
) -> Discrimination:  # fmt: skip
    """`count` poses that show `first` beside what the fitted parameters and `second` absorb.

    taken: readings, plans or poses that are there already; values: deviations of the first cause's parameters, SI,
    their typical sizes if None; others: causes that are named already; x: parameter values to linearise at, by name;
    alternatives: whether to try other kinds of readings, where poses do not help if None.
    """
    tell: Progress = progress or (lambda step, done, total: None)
    before = [taken] if isinstance(taken, Plan | Readings | Poses) else list(taken)
    experiment = with_loads(experiment, before)
    noise = noise_of(experiment, sigma)
    pendant = drawn(experiment, candidates, seed, tell)
    poses, place, loads = batch(experiment, pendant)
    causes = known_causes(experiment, poses, (first, second))
    question = ask(experiment, causes[0], causes[1], noise, others=others, x=x,
                   values=None if values is None else np.asarray(values, dtype=np.float64))  # fmt: skip
    there = question.taken(before)
    rows = _flat(question, poses)
    tell("poses", 0, 1)
    chosen = choose([rows], [there], count, place, seed, progress=lambda i, n: tell("poses", i, n))
    plan = plan_of(poses, loads, chosen, question.known, len(rows), seed)
    start, end = told(there, question.width), told(_with(there, rows, chosen), question.width)
    limit = limit_angle(rows, question.width, seed)
    found = Discrimination(
        first, second, question.first.parameters, question.values, plan, start[0], end[0], start[1], end[1],
        chosen.bound, limit, (), f"{len(rows)} candidates",
    )  # fmt: skip
    if not (alternatives or (alternatives is None and not found.helps)):
        return found
    few = min(_FEW, len(pendant))
    other = offers(question, experiment, before, count, few, seed, others, tell)
    return replace(found, offers=other)


def noise_of(experiment: Experiment, sigma: float | None) -> float:
    """The noise of one coordinate, m; InputError where nobody says it."""
    noise = sigma or experiment.noise.sigma
    if noise is None:
        raise InputError(f"{experiment.path}: a design needs the noise, for example noise: {{sigma_mm: 0.03}}")
    return noise


def with_loads(experiment: Experiment, taken: Sequence[Taken]) -> Experiment:
    """The experiment, with the loads used so far where it lists none: all if they are few, else the largest."""
    if experiment.loads:
        return experiment
    wrenches = [one.wrench if isinstance(one, Plan | Poses) else one.poses.wrench for one in taken]
    used = np.unique(np.round(np.concatenate(wrenches), 6), axis=0) if wrenches else np.zeros((0, 6))
    used = used[used.any(axis=1)]
    if not len(used):
        raise InputError(f"{experiment.path}: a design needs `loads`, for example - {{name: weight, fz_N: -4000}}")
    order = np.argsort(-np.linalg.norm(used[:, :3], axis=1), kind="stable")
    kept = used[order[: 1 if len(used) > _FEW_LOADS else len(used)]]
    return experiment.with_(loads=tuple(LoadCase(f"load_{i + 1}", frozen(w), None) for i, w in enumerate(kept)))


def drawn(experiment: Experiment, candidates: int | Candidates | Array, seed: int, tell: Progress) -> Array:
    """Candidate poses (P, n), pendant angles."""
    if isinstance(candidates, int):
        candidates = generate_candidates(experiment, candidates, seed, lambda i, n: tell("candidate poses", i, n))
    return candidates.pendant if isinstance(candidates, Candidates) else np.asarray(candidates, dtype=np.float64)


def known_causes(experiment: Experiment, poses: Poses, names: Sequence[str]) -> tuple[Cause, ...]:
    """Causes by name. InputError for one that the robot cannot have, or that poses alone cannot show."""
    causes, untested = find_causes(experiment, experiment.fit_names(), poses.take(slice(0, 1)))
    found = {c.name: c for c in causes}
    waiting = {u.name: u.needs for u in untested}
    problems: list[Problem] = []
    for name in names:
        if name in waiting:
            problems.append(Problem(f"{name} shows only in readings with the column {' and '.join(waiting[name])}: "
                                    "vary that, not the poses"))  # fmt: skip
        elif name not in found:
            problems.append(Problem(f"no cause {name!r}", allowed=", ".join(found), hint=nearest(name, list(found))))
    if len(set(names)) < len(names):
        problems.append(Problem(f"{names[0]} cannot be told from itself; name two causes"))
    if problems:
        raise InputError(problems)
    return tuple(found[name] for name in names)


def plan_of(
    poses: Poses, loads: tuple[str, ...], chosen: Chosen, known: Sequence[str], candidates: int, seed: int
) -> Plan:
    """The chosen poses as a plan, with their certificate: 1 / s^2 against the bound."""
    index = chosen.index[np.lexsort((*poses.pendant[chosen.index].T[::-1], [loads[int(i)] for i in chosen.index]))]
    value, best = 1.0 / max(chosen.s, 1e-12) ** 2, 1.0 / max(chosen.bound, 1e-12) ** 2
    certificate = Certificate(
        criterion="T", value=value, relaxed_value=best, relaxed_efficiency=1.0, efficiency=min(best / value, 1.0),
        candidates=candidates, poses=len(index), parameters=tuple(known), solver="column generation",
        notes=("T: s^2 of one cause beside what the fitted parameters and another cause absorb",),
    )  # fmt: skip
    names = [f"t{i + 1:02d}" for i in range(len(index))]
    return make_plan(poses.take(index), [loads[int(i)] for i in index], None, "T", certificate, seed, names)


def _flat(question: Question, poses: Poses) -> Array:
    rows = question.rows(poses)
    return rows.reshape(len(rows), -1, rows.shape[-1])


def _with(before: Array, rows: Array, chosen: Chosen) -> Array:
    return np.concatenate([before, rows[chosen.index].reshape(-1, rows.shape[-1])])


def degrees(angle: float) -> str:
    """An angle in whole degrees, "-" where there is none."""
    return f"{np.rad2deg(angle):.0f}" if np.isfinite(angle) else "-"


def json_degrees(angle: float) -> float | None:
    """An angle in degrees as JSON can hold it."""
    return float(np.rad2deg(angle)) if np.isfinite(angle) else None


def _percent(rate: float) -> str:
    if rate < 1e-4:
        return "less than 0.01 %"
    return f"{100 * rate:.0f} %" if rate >= 0.01 else f"{100 * rate:.2g} %"
