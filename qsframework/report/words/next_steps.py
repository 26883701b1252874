"""What to measure next, and what it would settle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from qsframework.diagnoses.residuals.noise_components import LEVEL
from qsframework.diagnoses.result import Diagnosis, Status
from qsframework.diagnoses.second_day import FollowUp
from qsframework.diagnoses.verdict import misfits
from qsframework.errors import listed
from qsframework.hypotheses.catalogue.law import Law
from qsframework.report.words.follow_up import WORTH, mount_words, percent
from qsframework.report.words.headline import names_words, poses_words, worst_poses
from qsframework.report.words.law import place_words, variable_words

FEW = 20
"""Poses below which an error that markers share is hardly told from a cause, without repeats."""
_REPEATS = 6
_MORE = 12
_MOST = 5


@dataclass(frozen=True)
class NextStep:
    """Something to do, and what it would settle."""

    do: str
    settles: str

    def __str__(self) -> str:
        return f"{self.do}: {self.settles}."


def next_steps(found: Diagnosis, day: FollowUp | None = None) -> tuple[NextStep, ...]:
    """The few steps that would settle most, the plainest first. day: the visits that settle what is open."""
    chosen = () if day is None else _second_day(day)
    every = (*_repeats(found), *chosen, *_leftover(found), *_unsure(found), *_recorded(found))
    return tuple({step.do: step for step in every}.values())[:_MOST]


def _repeats(found: Diagnosis) -> Iterator[NextStep]:
    """Where the noise itself is in question."""
    audit, names = found.audit, worst_poses(found, _REPEATS)
    again = f"Repeat {len(names)} poses, such as {', '.join(names)}"
    odd = misfits(found.after) and not found.leftovers
    if audit.repeated:
        if odd:
            yield NextStep(
                f"Measure {poses_words(names[:3])} again", "separates wrong readings from an unmodelled effect"
            )
    elif unrepeatable(found):
        yield NextStep(
            f"{again}, or read more markers at each", "separates pose repeatability from single-marker error"
        )
    elif odd:
        yield NextStep(again, "separates a larger noise from an unmodelled effect")
    elif audit.p_shared < LEVEL:
        yield NextStep(again, "separates repeatability, which is noise, from an unmodelled effect")
    elif len(set(found.readings.states.pose)) < FEW and found.verdict != "none":
        yield NextStep(again, "separates repeatability from a cause, which so few poses hardly do")


def unrepeatable(found: Diagnosis) -> bool:
    """Whether nothing separates pose repeatability from single-marker error, and nobody states it."""
    stated = found.experiment.noise.repeatability is not None
    return found.method.lone and not found.audit.repeated and not stated


def _second_day(day: FollowUp) -> Iterator[NextStep]:
    """Visits that were chosen for what is open, and what to mount where they are too little."""
    count, place = len(day.plan.pose), "the chance of naming the right place"
    if max(day.after - day.before, day.variable_after - day.variable_before) > WORTH:
        rises = f"{place} rises from {percent(day.before)} to {percent(day.after)}"
        variable = f"{percent(day.variable_before)} to {percent(day.variable_after)}"
        yield NextStep(f"Measure {count} more visits, chosen for it", f"{rises}, with its variable from {variable}")
    best = max(day.mounts, key=lambda m: m.chance, default=None)
    if best is not None and best.chance > day.after + WORTH:
        yield NextStep(f"Mount {mount_words(best)} for {count} such visits", f"{place} rises to {percent(best.chance)}")


def _leftover(found: Diagnosis) -> Iterator[NextStep]:
    for law in (*(x.law for x in found.leftovers[:1]), *(f.instead.law for f in found.sure if f.instead)):
        do, what = _trial(law, bool(found.readings.poses.wrench.any()))
        yield NextStep(do, f"shows {what}")


def _trial(law: Law, loaded: bool) -> tuple[str, str]:
    """What to vary, and what is told then, of a law that nobody has written; loaded: whether any load was hung on."""
    of = {"readings": "what all readings share", "load": "the load"}.get(law.part, f"the motion of {place_words(law)}")
    load = "Measure some poses under half the load and under the opposite one" if loaded else "Add a weight at 6 poses"
    if law.joints:
        alone = f"{' or '.join(law.joints)} alone turns"
        return f"Measure 6 more poses in which {alone}", f"how {of} follows it"
    known = {
        "torque": (load, f"how {of} follows the load"),
        "force": (load, f"how {of} follows its size"),
        "direction": ("Pull in other directions at 6 poses", f"how {of} follows the direction"),
        "moment": (load, f"how {of} follows the load"),
        "others": ("Add a side pull at 6 poses", f"which torque causes {of}"),
        "order": ("Measure the first poses again at the end", f"a drift from {of} by the load"),
        "came": ("Approach some poses from both sides", f"friction or play from {of} by the load"),
        "loaded": ("Take some unloaded readings twice", f"an offset of these readings from {of}"),
        "always": ("Take some unloaded readings twice", f"an offset of these readings from {of}"),
    }
    if not law.by:
        return "Repeat 6 poses, each twice", f"{of} at one pose from what the pose decides"
    more = f"Measure 6 more poses that differ in {variable_words(law)}"
    first = next((f for f in law.by if f not in ("loaded", "always")), law.by[0])
    return known.get(first.partition(" ")[0] if " " in first else first, (more, f"how {of} follows it"))


def _unsure(found: Diagnosis) -> Iterator[NextStep]:
    """Names that hang on few poses, or without which held-out poses fit as well."""
    if found.doubtful:
        yield NextStep(f"Measure {_MORE} more poses", f"shows whether {names_words(found.doubtful)} is there at all")
    for f in found.sure:
        if f.hangs_on:
            resting = f"{f.name} rests on {'them' if len(f.hangs_on[0]) > 1 else 'it'}"
            yield NextStep(f"Measure {poses_words(f.hangs_on[0])} again", resting)


def _recorded(found: Diagnosis) -> Iterator[NextStep]:
    """Columns that were not recorded, where something is left to explain."""
    untested = [x for x in found.table if x.status is Status.UNTESTED]
    if untested and (found.leftovers or misfits(found.after)):
        columns = sorted({column for x in untested for column in x.needs})
        kinds = sorted({x.name.partition("[")[0] for x in untested})
        yield NextStep(f"Record {listed(columns)}", f"lets {listed(kinds)} be tested")
