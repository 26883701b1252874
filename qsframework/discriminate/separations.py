"""What would tell a named cause from the rivals that the readings leave: more poses, or other readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from qsframework.diagnose.result import Diagnosis
from qsframework.discriminate.pair import Discrimination, discriminate
from qsframework.errors import InputError

COUNT = 12
MOST = 3
"""Pairs looked at: each named cause with the rival nearest to it, the plainest first."""
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

    The size of a named cause is its estimate, the noise the audited one.
    """
    causes = {c.name: c for c in diagnosis.case.causes}
    tied = sorted((f for f in diagnosis.findings if f.rivals and f.name in causes), key=lambda f: -f.s)
    found: list[Discrimination] = []
    missing: list[NotSeparated] = []
    for i, f in enumerate(tied[:most]):
        if progress is not None:
            progress("what would separate rivals", i, min(len(tied), most))
        rival = min(f.rivals, key=lambda r: r.angle).name
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
                )
            )
        except InputError as error:
            missing.append(NotSeparated(f.name, rival, error))
    if progress is not None and tied:
        progress("what would separate rivals", min(len(tied), most), min(len(tied), most))
    return tuple(found), tuple(missing)
