"""What would tell a named cause from the alternatives that the readings leave: more poses, or other readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from qsframework.diagnose.result import Diagnosis
from qsframework.discriminate.alternatives import Draw
from qsframework.discriminate.pair import Discrimination, Effort, discriminate, drawn, with_loads
from qsframework.errors import InputError
from qsframework.experiment import Experiment
from qsframework.plugin import Array

COUNT = 12
MOST = 3
"""Pairs looked at: each named cause with the rival nearest to it, the plainest first."""
STATES = 480
"""Loaded poses that are judged at most for all pairs together, if no more than COUNT are asked for; `discriminate`
looks at more."""
_KINDS, _BESIDE = 3, 4
"""With the other kinds of readings so many times the states are judged, in so many columns beside the fitted ones."""
_OFFERED = 0.25
"""Share of them for each other kind of reading."""
_STARTS = 2
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class NotSeparated:
    """Two causes of which nothing could be computed."""

    first: str
    second: str
    error: InputError


def separations(
    diagnosis: Diagnosis, count: int = COUNT, *, most: int = MOST, progress: Progress | None = None
) -> tuple[tuple[Discrimination, ...], tuple[NotSeparated, ...]]:
    """What `count` further poses, or something different, would tell of each pair; and the pairs left out.

    The size of a named cause is its estimate, the noise the audited one. Candidates are drawn once for all pairs.
    """
    causes = {c.name: c for c in diagnosis.case.causes}
    tied = sorted((f for f in diagnosis.findings if f.alternatives and f.name in causes), key=lambda f: -f.s)
    found: list[Discrimination] = []
    missing: list[NotSeparated] = []
    effort = effort_for(diagnosis, min(len(tied), most), count)
    draw = _drawn_once(diagnosis.seed)
    for i, f in enumerate(tied[:most]):
        if progress is not None:
            progress("what would separate alternatives", i, min(len(tied), most))
        rival = min(f.alternatives, key=lambda r: r.angle).name
        others = [causes[g.name] for g in diagnosis.findings if g.name in causes and g.name not in (f.name, rival)]
        try:
            found.append(
                discriminate(
                    diagnosis.experiment,
                    [diagnosis.readings],
                    f.name,
                    rival,
                    count,
                    values=[v.value - v.initial for v in f.values],
                    sigma=diagnosis.rms.noise,
                    others=others,
                    x=dict(diagnosis.values()),
                    seed=diagnosis.seed,
                    effort=effort,
                    draw=draw,
                )
            )
        except InputError as error:
            missing.append(NotSeparated(f.name, rival, error))
    if progress is not None and tied:
        progress("what would separate alternatives", min(len(tied), most), min(len(tied), most))
    return tuple(found), tuple(missing)


def effort_for(diagnosis: Diagnosis, pairs: int, count: int = COUNT) -> Effort:
    """How much each of some pairs may look at: together no more columns at candidates than the diagnosis had."""
    case = diagnosis.case
    linearised = len(np.unique(case.pose)) * case.raw.shape[1]
    states = min(STATES, linearised // (_KINDS * (case.A.shape[1] + _BESIDE)))
    try:
        loads = len(with_loads(diagnosis.experiment, [diagnosis.readings]).loads)
    except InputError:  # no load at all: `discriminate` says so of each pair
        loads = 1
    candidates = max(states // (max(pairs, 1) * loads), 2 * count)
    return Effort(candidates, max(round(_OFFERED * candidates), count), _STARTS)


def _drawn_once(seed: int) -> Draw:
    """Candidates of each kind of reading, drawn for the first pair and kept for the others."""
    kept: dict[str, Array] = {}

    def draw(name: str, experiment: Experiment, count: int) -> Array:
        if name not in kept:
            kept[name] = drawn(experiment, count, seed)
        return kept[name]

    return draw
