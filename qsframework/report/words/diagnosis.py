"""A diagnosis in words: what was found, what it gains, what cannot be told apart, and what would tell."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.diagnose.result import Diagnosis, Finding, Leftover, Line, Status
from qsframework.diagnose.selection.cross_validation import FOLDS
from qsframework.diagnose.verdict import misfits
from qsframework.discriminate.pair import Discrimination
from qsframework.plugin import Parameter
from qsframework.report.words.discrimination import outlook_words
from qsframework.report.words.noise import audit_words
from qsframework.report.words.sizes import people_estimate, people_size

_SHOWN = 3
_ALIKE = float(np.deg2rad(1.0))
"""Angle below which no poses are promised: whether any tell the two is still to be computed."""
VERDICTS = {
    "none": "Nothing to name",
    "explained": "Explained",
    "partly_explained": "Partly explained",
    "unexplained": "Unexplained",
}


@dataclass(frozen=True)
class Statement:
    """One or two sentences; about: the cause or the convention that they begin with, if they do."""

    text: str
    about: str = ""

    def __str__(self) -> str:
        return f"{self.about}: {self.text}" if self.about else self.text


def diagnosis_words(found: Diagnosis, pairs: Sequence[Discrimination] = ()) -> str:
    """The statements as one paragraph."""
    return " ".join(map(str, statements(found, pairs)))


def statements(found: Diagnosis, pairs: Sequence[Discrimination] = ()) -> tuple[Statement, ...]:
    """What the verdict rests on. pairs: what would separate rivals, where that has been computed."""
    outlooks = {pair.first: outlook_words(pair) for pair in pairs}
    adopted = {c.name for c in found.conventions if c.compelling}
    said = [Statement(f"{c.words}.{_next_best(found)}", c.name) for c in found.conventions if c.compelling]
    said += [Statement(_evidence(f), f.name) for f in found.findings if f.name not in adopted]
    said += [Statement(text) for text in _plain(found, outlooks)]
    return tuple(said)


def _plain(found: Diagnosis, outlooks: dict[str, str]) -> Iterator[str]:
    """What is said of no single cause, or of it beside others."""
    e = found.rms
    if found.findings:
        heldout = f"{_mm(e.heldout_identified)} -> {_mm(e.heldout_extended)}"
        yield f"Held-out error {heldout} mm, noise {_mm(e.noise)}."
    elif found.verdict == "none":
        yield _nothing(found)
    doubtful = [f.name for f in found.findings if f.doubtful]
    if doubtful:
        yield (
            f"Doubtful: {', '.join(doubtful)}. In the noise that was found, the error at poses left out does not fall "
            f"with {'it' if len(doubtful) == 1 else 'them'}; an extended robot is written without."
        )
    yield from (tied_words(f, outlooks.get(f.name, "")) for f in found.findings if f.rivals)
    yield from (_hanging(f) for f in found.findings if f.hangs_on)
    if found.leftovers:
        also = "also " if found.findings else ""
        left = leftover_words(found.leftovers[0])
        yield f"The readings {also}hold something that no effect of the library explains: {left}."
    elif misfits(found.after):
        yield "What is left is too much for the noise, though no place or variable stands out."
    yield from (f"A suspicion: {c.words}." for c in found.conventions if c.name == "load_unit")
    if len(found.outliers):
        rows = (str(int(found.readings.line[i])) for i in found.outliers)
        yield f"Outliers left out: rows {', '.join(rows)}."
    if found.audit.unit_source != "stated":
        yield from audit_words(found.audit)


def _next_best(found: Diagnosis) -> str:
    """How far from the adopted convention the second one stays."""
    second = next((c for c in found.conventions if not c.compelling and c.name != "load_unit"), None)
    return "" if second is None else f" Next best is {second.name}, {_mm(second.rms)} mm."


def _mm(value: float) -> str:
    return f"{1e3 * value:.3f}"


def _evidence(f: Finding) -> str:
    sizes = [people_estimate(Parameter(v.name, v.unit), v.value - v.initial, v.sd) for v in f.values]
    return f"{f.physics.rstrip('.')} ({', '.join(sizes)}; s = {f.s:.1f}, p = {f.p_value:.2g})."


def _nothing(found: Diagnosis) -> str:
    excluded = [(x.name, limit_words(x)) for x in found.table if x.status is Status.EXCLUDED]
    excluded = [(name, limit) for name, limit in excluded if limit]
    some = "; ".join(f"no {name} above {limit}" for name, limit in excluded[:_SHOWN])
    more = f" and {len(excluded) - _SHOWN} more in the table" if len(excluded) > _SHOWN else ""
    seen = f"Nothing beyond the model is seen at {_mm(found.rms.identified)} mm, noise {_mm(found.rms.noise)}"
    return f"{seen}: {some}{more}."


def tied_words(f: Finding, outlook: str = "") -> str:
    """That the readings leave rivals; outlook: what would tell, where that has been computed."""
    shown = [f"{r.name} (angle {np.rad2deg(r.angle):.0f} deg)" for r in f.rivals[:_SHOWN]]
    more = f" and {len(f.rivals) - _SHOWN} more" if len(f.rivals) > _SHOWN else ""
    if not outlook:
        alike = min(r.angle for r in f.rivals) < _ALIKE
        outlook = "to these readings they are the same" if alike else "poses can be designed that would"
    return f"These readings cannot tell {f.name} from {', '.join(shown)}{more}: {outlook}."


def _hanging(f: Finding) -> str:
    sets = ["+".join(s) for s in f.hangs_on[:_SHOWN]]
    more = f" and {len(f.hangs_on) - _SHOWN} more" if len(f.hangs_on) > _SHOWN else ""
    return f"{f.name} hangs on poses {', '.join(sets)}{more}: without them another answer, or none, fits as well."


def leftover_words(x: Leftover) -> str:
    """An extra motion that no cause explains."""
    return f"an extra motion at {x.place} that depends on {x.variable} (p = {x.p_value:.2g})"


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
        said.append("A named cause is so large that it is far from linear: the noise was told again at its size.")
    if how.untold:
        said.append(f"These readings do not tell {', '.join(how.untold)}: kept at the nominal value.")
    if how.lone and not found.audit.repeated:
        said.append(
            "Each visit has one marker, nothing was repeated and no repeatability is stated: an error that a visit "
            "shares cannot be told from a marker's own. More markers, or repeats of some poses, would tell."
        )
    if found.audit.heavy_tailed:
        said.append("The errors have heavy tails: in the tests large ones count by Huber's rule, as 2.5 sds at most.")
    return tuple(said)
