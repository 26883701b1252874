"""A diagnosis in words: what was found, what it gains, what cannot be told apart, and what would tell."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from qsframework.arguments import checked
from qsframework.diagnoses.result import Alike, Diagnosis, Errors, LearnedLaw, Leftover, Line, NamedCause, Status
from qsframework.diagnoses.second_day import FollowUp
from qsframework.diagnoses.verdict import misfits
from qsframework.errors import some_of
from qsframework.hypotheses.search.cross_validation import FOLDS
from qsframework.plugin import Parameter
from qsframework.report.words.fit import alignment_words
from qsframework.report.words.headline import headline, names_words, poses_words, worst_poses
from qsframework.report.words.law import moving_words, place_words, places_words, ranked_words, variable_words
from qsframework.report.words.next_steps import next_steps, unrepeatable
from qsframework.report.words.noise import audit_words
from qsframework.report.words.sizes import mm, people_estimate, people_size
from qsframework.screening import Mistake

_SHOWN = 3
ALONE = "explained by the named causes"
"""Of a cause that is plain by itself, but shows nothing that the named ones do not."""
UNHELD = "detected, but its fit is unphysical"
_ALIKE = float(np.deg2rad(1.0))
"""Angle below which two causes are the same to the readings."""
TOO_WEAK = "It is too weak to learn a correction: add poses or repeats."
_HARDLY = 3.0
"""s below which readings hardly tell a learned law from a cause of the library."""


class CauseGroup(Enum):
    """What a statement speaks of, in the order of a page."""

    CERTAIN = "Certain"
    LIKELY = "Likely, with alternatives"
    DOUBTFUL = "Doubtful"
    OPEN = "Not explained"
    READINGS = "Readings and noise"


@dataclass(frozen=True)
class Statement:
    """One or two sentences; about: the cause or the convention that they begin with, if they do."""

    text: str
    about: str = ""
    group: CauseGroup = CauseGroup.CERTAIN

    def __str__(self) -> str:
        return f"{self.about}: {self.text}" if self.about else self.text


@checked
def diagnosis_words(found: Diagnosis, day: FollowUp | None = None) -> str:
    """The verdict, what it rests on and what to measure next, as text.

    Args:
        found: a diagnosis.
        day: the visits that would settle what is open, where they were chosen.

    Returns:
        One paragraph.

    Raises:
        AttributeError: where `found` is no diagnosis.
    """
    steps = [f"Next: {step}" for step in next_steps(found, day)]
    return " ".join([headline(found), *map(str, statements(found)), *steps])


def statements(found: Diagnosis) -> tuple[Statement, ...]:
    """What the verdict rests on, group by group."""
    adopted = {c.name for c in found.conventions if c.compelling}
    said = [Statement(f"{c.words}.{_moved(c)}", c.name) for c in found.conventions if c.compelling]
    said[:1] = [replace(s, text=s.text + _next_best(found)) for s in said[:1]]
    for group, findings in named_groups(found).items():
        own = [f for f in findings if f.name not in adopted]
        said += [Statement(_evidence(f), f.name, group) for f in own]
        said += [Statement(tied_words(f), "", group) for f in own if f.alternatives]
        said += [Statement(_further(f), "", group) for f in own if f.further]
        said += [Statement(instead_words(f, f.instead), "", group) for f in own if f.instead]
        said += [Statement(_hanging(f), "", group) for f in own if f.hangs_on]
        if own and group is CauseGroup.DOUBTFUL:
            said.append(Statement(_doubt(own), "", group))
    if found.verdict == "none":
        said += [Statement(text) for text in _bounds(found)]
    said += [Statement(text, "", CauseGroup.OPEN) for text in _open(found)]
    return (*said, *(Statement(text, "", CauseGroup.READINGS) for text in _readings(found)))


def named_groups(found: Diagnosis) -> dict[CauseGroup, tuple[NamedCause, ...]]:
    """The named causes by how sure they are: certain is only what has no open alternative and predicts poses left
    out."""
    return {
        CauseGroup.CERTAIN: tuple(f for f in found.sure if not f.open_alternative),
        CauseGroup.LIKELY: tuple(f for f in found.sure if f.open_alternative),
        CauseGroup.DOUBTFUL: found.doubtful,
    }


def _doubt(findings: Sequence[NamedCause]) -> str:
    names, they = names_words(findings), "it" if len(findings) == 1 else "them"
    return (
        f"In the noise that was found, the held-out error is not clearly smaller with {they}: an extended "
        f"robot is written without {names}."
    )


def _open(found: Diagnosis) -> Iterator[str]:
    """What no named cause explains, and where to look."""
    if found.places and not found.leftovers:
        moves = moving_words(found.places[0].law, found.experiment.robot.facts)
        likely = f"If it is no cause of the library, most likely {moves}."
        yield ranked_words(found.places) if found.hinted else " ".join([likely, *places_words(found.places)])
    if found.leftovers:
        also = "also " if found.findings else ""
        left = leftover_words(found.leftovers[0])
        why = "" if found.learned is not None else TOO_WEAK
        first = f"The readings {also}hold an error that no known effect explains: {left}. Look there first."
        yield " ".join(filter(None, (first, why, *places_words(found.places))))
        if found.learned is not None:
            yield learned_words(found.learned, found.rms)
            yield alike_words(found.learned)
    elif found.learned is not None and found.learned.holds:
        yield f"In the place of {names_words(found.doubtful)}: {learned_words(found.learned, found.rms)}"
        yield alike_words(found.learned)
    elif misfits(found.after):
        where = poses_words(worst_poses(found, _SHOWN))
        trend = next(iter(found.after.trends), None)
        follows = f"; of all variables, most of it goes with {trend.variable}" if trend is not None else ""
        yield f"More is left than the noise allows. Look first at {where}, where most of it is{follows}."


def _readings(found: Diagnosis) -> Iterator[str]:
    """What the readings say of themselves."""
    yield from alignment_words([a for a in found.readings.alignments if a.turned or not a.count])
    yield from found.readings.about_still(found.experiment.robot.facts.driven)
    if len(found.outliers):
        rows = (str(int(found.readings.line[i])) for i in found.outliers)
        yield f"Outliers, not used: rows {', '.join(rows)}."
    if found.audit.unit_source != "stated":
        yield from audit_words(found.audit, rows=False)
    elif found.audit.shared > 0.0:
        yield from audit_words(found.audit, rows=False)[1:]


def _moved(c: Mistake) -> str:
    """Which parameters change most when a mistake in some rows is corrected."""
    if not c.rows or not c.moved:
        return ""
    sizes = [
        f"{m.name} from {people_size(Parameter(m.name, m.unit), m.before)} to "
        f"{people_size(Parameter(m.name, m.unit), m.after)}"
        for m in c.moved
    ]
    return f" With it the fit moves {', '.join(sizes)}."


def _next_best(found: Diagnosis) -> str:
    """How far from the adopted convention the second one stays."""
    second = next((c for c in found.conventions if not c.compelling and not c.suspected), None)
    return "" if second is None else f" Next best is {second.name}, {mm(second.rms)} mm."


def _evidence(f: NamedCause) -> str:
    sizes = [people_estimate(Parameter(v.name, v.unit), v.value - v.initial, v.sd) for v in f.values]
    return f"{f.physics.rstrip('.')} ({', '.join(sizes)}; s = {f.s:.1f}, p = {f.p_value:.2g})."


def _bounds(found: Diagnosis) -> Iterator[str]:
    """The first bounds of what is excluded, where nothing is named."""
    if examples := excluded_words(found):
        yield f"Excluded: {examples}."


def excluded_words(found: Diagnosis) -> str:
    """`no joint_backlash[joint_3] above 0.3 arcmin; ... and 80 more`: the bounds of the causes seen best."""
    alone = {x.name for x in found.plain_alone}
    kept = (x for x in found.table if x.status is Status.EXCLUDED and x.limits and x.name not in alone)
    return some_of([f"no {x.name} above {limit_words(x, stiffness=False)}" for x in kept], _SHOWN, "; ")


def status_words(x: Line, found: Diagnosis) -> str:
    """What the readings say of a cause; one that is plain by itself is not just excluded."""
    if x not in found.plain_alone:
        return x.status.value
    return ALONE if found.findings else UNHELD


def tied_words(f: NamedCause) -> str:
    """That the readings leave alternatives."""
    shown = some_of([f"{r.name} (angle {np.rad2deg(r.angle):.0f} deg)" for r in f.alternatives], _SHOWN)
    same = ": to these readings they are the same" if min(r.angle for r in f.alternatives) < _ALIKE else ""
    return f"These readings cannot separate {f.name} from {shown}{same}."


def _further(f: NamedCause) -> str:
    """How many causes that do something else to the readings these do not exclude."""
    kinds = "1 other kind of cause, which acts" if f.further == 1 else f"{f.further} other kinds of causes, which act"
    return f"So little is seen that {kinds} differently on the readings, may be it instead of {f.name}."


def _hanging(f: NamedCause) -> str:
    sets = some_of(["+".join(s) for s in f.hangs_on], _SHOWN)
    return f"{f.name} rests on poses {sets}: without them another answer, or none, fits as well."


def leftover_words(x: Leftover) -> str:
    """An extra motion that no cause explains."""
    return f"an extra motion at {place_words(x.law)} that depends on {variable_words(x.law)} (p = {x.p_value:.2g})"


def learned_words(learned: LearnedLaw, errors: Errors) -> str:
    """What the law that was learned is worth."""
    law = learned.leftover.law
    what = f"As {learned.name} its law was learned from the readings, {variable_words(law)} at {place_words(law)}"
    if not learned.holds:
        why = "the held-out error is not clearly smaller" if learned.physical else "a value leaves its bounds"
        return f"{what}, but {why} with it: it is not written."
    others = len(learned.causes) - 1
    average = f", averaged with {others} other likely law{'s' if others > 1 else ''}"
    return (
        f"{what}{average if others else ''} (s = {learned.s:.1f}): held-out error "
        f"{mm(errors.in_space(learned.before))} \u2192 {mm(errors.in_space(learned.heldout))} mm (3D RMS), "
        f"{100 * learned.gain:.0f} % lower, weighted by the estimated noise. It is an empirical correction, not a "
        "physical explanation."
    )


def alike_words(learned: LearnedLaw) -> str:
    """Which causes of the library the law that was learned looks like, and by how much."""
    said: list[str] = []
    here = [a for a in learned.alike if a.here]
    if here:
        first, *more = here
        also = "".join(f"; {a.name} {100 * a.share:.0f} %" for a in more)
        sign = "with a sign that it cannot have, " if first.turned else ""
        said.append(
            f"It looks most like {first.name}: {sign}that cause can do {100 * first.share:.0f} % of what this law does "
            f"to the readings ({rest_words(first)}{also})."
        )
    elsewhere = [f"{a.name} ({100 * a.share:.0f} %)" for a in learned.alike if not a.here]
    if elsewhere:
        said.append(f"At another place {' and '.join(elsewhere)} would do the same: the place may be that one.")
    return " ".join(said) or "No known effect explains even half of it."


def rest_words(a: Alike) -> str:
    """What a cause does not do of a learned law."""
    return f"the rest has s = {a.left:.1f}" + (", which these readings hardly show" if a.left < _HARDLY else "")


def instead_words(f: NamedCause, x: Leftover) -> str:
    """That a law which nobody has written stands in the place of a name as well."""
    where = f"an extra motion at {place_words(x.law)} that depends on {variable_words(x.law)}"
    better = f"better, by {x.evidence:.1f} nats" if x.evidence > 0.0 else "nearly as well"
    other = "cause" if f"[{x.law.place}]" in f.name else "place"
    return f"Instead of {f.name}, {where} explains the readings {better}: the {other} may be another one."


def limit_words(x: Line, stiffness: bool = True) -> str:
    """Above which sizes a cause is excluded, or what it would need to be seen; stiffness: beside a compliance."""
    if x.status is Status.UNTESTED:
        return f"needs {', '.join(x.needs)}"
    if x.status is Status.INVISIBLE:
        seen = f"{x.reach:.2g} units of noise at its typical size"
        return seen if x.reach else "absorbed, or no reading shows it"
    if x.limits is None:
        return "the named causes do the same"
    labels = ((p.name.removeprefix(x.name).removeprefix("."), people_size(p, s, stiffness)) for p, s in x.limits)
    return ", ".join(f"{label} {size}".strip() for label, size in labels)


def method_words(found: Diagnosis) -> tuple[str, ...]:
    """How the diagnosis came about."""
    how, held = found.method, found.method.held
    said = ["Only one pose was measured: nothing says whether this fit holds at another one."] if how.one_pose else []
    folds = f"{FOLDS}-fold by pose, {held.repeats} times" if held.repeats else f"leave one of {held.poses} poses out"
    nested = f"the search chose the same causes in {100 * held.same:.0f} % of the folds"
    said.append(f"Held-out errors: {folds}; {'the causes are given' if how.far else nested}.")
    if how.far:
        said.append("A named cause is so large that it is far from linear: the noise was estimated again at its size.")
    if how.unidentifiable:
        said.append(f"Not identifiable, held at nominal: {', '.join(how.unidentifiable)}.")
    if unrepeatable(found):
        said.append(
            "Each visit has one marker, nothing was repeated and no repeatability is stated: an error that a visit "
            "shares cannot be separated from a marker's own, and p-values take it for the marker's. More markers, or "
            "repeats of some poses, would separate them."
        )
    if found.audit.heavy_tailed:
        said.append("The errors have heavy tails: in the tests large ones count by Huber's rule, as 2.5 sds at most.")
    return tuple(said)
