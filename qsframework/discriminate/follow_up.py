"""A second day: the poses that separate what the first one left open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.design import Candidates
from qsframework.diagnose.linearization.candidates import Cause
from qsframework.diagnose.result import Diagnosis, NamedCause
from qsframework.diagnose.selection.principal_angles import ALIKE, smallest_angles
from qsframework.discriminate.alternatives import batch
from qsframework.discriminate.pair import (
    CANDIDATES,
    CLOSE,
    drawn,
    plan_of,
    with_loads,
)
from qsframework.discriminate.t_optimal import Chosen, ask, choose, limit_angle, told
from qsframework.errors import InputError, Problem
from qsframework.experiment import Plan, Readings
from qsframework.plugin import Array, Poses

_MOST_RIVALS = 8
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class PairContest:
    """A named cause against one rival: s of the named one beside it and the angle (rad), before and after."""

    first: str
    second: str
    s_before: float
    s_after: float
    angle_before: float
    angle_after: float


@dataclass(frozen=True)
class Crowded:
    """A named cause with more rivals than were looked at."""

    name: str
    rivals: int
    looked: int


@dataclass(frozen=True)
class Waiting:
    """Two causes that only a change of some columns of the readings tells apart."""

    first: str
    second: str
    needs: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class SecondDay:
    """Poses that separate named causes from their rivals.

    bound: the largest value that any choice gives the smallest s; hopeless: pairs that no pose separates; crowded:
    causes of whose rivals only the likeliest were looked at; waiting: pairs that something else than the poses tells
    apart
    """

    plan: Plan
    contests: tuple[PairContest, ...]
    bound: float
    hopeless: tuple[tuple[str, str], ...]
    crowded: tuple[Crowded, ...]
    waiting: tuple[Waiting, ...]


def second_day(
    diagnosis: Diagnosis,
    count: int = 12,
    *,
    candidates: int | Candidates | Array = CANDIDATES,
    seed: int = 0,
    progress: Progress | None = None,
) -> SecondDay:
    """`count` poses that make the smallest s over all pairs of a named cause and a rival as large as they can.

    The size of a named cause is its estimate; the readings that the diagnosis kept count as taken. InputError where
    nothing is left to separate.
    """
    tell: Progress = progress or (lambda step, done, total: None)
    first_day = replace(diagnosis.readings, use=_kept(diagnosis))
    experiment = with_loads(diagnosis.experiment, [first_day])
    pairs, crowded, waiting = _pairs(diagnosis)
    if not pairs:
        others = [f"; {x.first} against {x.second}: vary {' and '.join(x.needs)}, not the poses" for x in waiting]
        raise InputError("nothing is left to separate: the diagnosis names no cause" + "".join(others))
    pendant = drawn(experiment, candidates, seed, tell)
    poses, place, loads = batch(experiment, pendant)
    sides = [_side(diagnosis, pair, experiment.fit_names(), poses, first_day, seed) for pair in pairs]
    hopeless = tuple((s.first, s.second) for s in sides if s.limit < CLOSE)
    open_ = [s for s in sides if s.limit >= CLOSE]
    if not open_:
        said = "; ".join(f"{a} and {b}" for a, b in hopeless)
        message = f"no pose under these loads separates {said}: measure something different"
        raise InputError(Problem(message, argument=("separate", " ".join(hopeless[0]))))
    chosen = choose(
        [s.rows for s in open_],
        [s.before for s in open_],
        count,
        place,
        seed,
        progress=lambda i, n: tell("poses", i, n),
    )
    plan = plan_of(experiment, poses, loads, chosen, experiment.fit_names(), seed)
    contests = tuple(s.contest(chosen) for s in open_)
    return SecondDay(plan, contests, chosen.bound, hopeless, tuple(crowded), tuple(waiting))


@dataclass(frozen=True, eq=False)
class _Side:
    """One pair with its rows (N, k, w) over all candidates and those of the first day (m, w)."""

    first: str
    second: str
    width: tuple[int, int]
    rows: Array
    before: Array
    limit: float

    def contest(self, chosen: Chosen) -> PairContest:
        added = self.rows[chosen.index].reshape(-1, self.rows.shape[-1])
        start, end = told(self.before, self.width), told(np.concatenate([self.before, added]), self.width)
        return PairContest(self.first, self.second, start[0], end[0], start[1], end[1])


def _side(
    diagnosis: Diagnosis,
    pair: tuple[NamedCause, Cause, Cause],
    fitted: Sequence[str],
    poses: Poses,
    first_day: Readings,
    seed: int,
) -> _Side:
    finding, cause, rival = pair
    named = {f.name for f in diagnosis.findings} - {cause.name, rival.name}
    others = [c for c in diagnosis.case.causes if c.name in named]
    deviation = {v.name: v.value - v.initial for v in finding.values}
    values = np.array([deviation[n] for n in cause.names])
    x = {n: v for n, v in diagnosis.values().items() if n in fitted}
    question = ask(diagnosis.experiment, cause, rival, diagnosis.rms.noise, values=values, others=others, x=x)
    rows = question.rows(poses)
    rows = rows.reshape(len(rows), -1, rows.shape[-1])
    limit = limit_angle(rows, question.width, seed)
    return _Side(cause.name, rival.name, question.width, rows, question.taken([first_day]), limit)


def _kept(diagnosis: Diagnosis) -> np.ndarray:
    use = np.zeros(len(diagnosis.readings.use), dtype=bool)
    use[diagnosis.kept] = True
    return use


def _pairs(diagnosis: Diagnosis) -> tuple[list[tuple[NamedCause, Cause, Cause]], list[Crowded], list[Waiting]]:
    """Each named cause with its likeliest rivals and, to confirm the name, the cause nearest to it besides them."""
    causes = {c.name: c for c in diagnosis.case.causes}
    subspaces = diagnosis.case.subspaces()
    position = {c.name: i for i, c in enumerate(diagnosis.case.causes)}
    pairs: list[tuple[NamedCause, Cause, Cause]] = []
    crowded: list[Crowded] = []
    waiting: list[Waiting] = []
    for finding in (f for f in diagnosis.findings if f.name in causes):
        cause = causes[finding.name]
        names = [r.name for r in finding.rivals[:_MOST_RIVALS] if r.name in causes]
        if len(finding.rivals) > len(names):
            crowded.append(Crowded(finding.name, len(finding.rivals), len(names)))
        angles = smallest_angles(subspaces, position[finding.name])
        known = {*names, *(f.name for f in diagnosis.findings)}
        order = (int(i) for i in np.argsort(angles))
        far = [i for i in order if angles[i] > ALIKE and _apart(diagnosis.case.causes[i], cause, known)]
        names += [diagnosis.case.causes[i].name for i in far[:1]]
        for rival in (causes[n] for n in names):
            needs = sorted({*cause.needs, *rival.needs})
            if needs:
                waiting.append(Waiting(cause.name, rival.name, tuple(needs)))
            else:
                pairs.append((finding, cause, rival))
    return pairs, crowded, waiting


def _apart(other: Cause, cause: Cause, known: set[str]) -> bool:
    """Whether another cause is neither known already nor the same place with other axes."""
    return other.name not in known and not other.group and not other.shares(cause)
