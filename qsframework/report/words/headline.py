"""The verdict of a diagnosis in one sentence: what acts, what it is worth at held-out poses, and what to look at."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from qsframework.diagnoses.result import Diagnosis, NamedCause
from qsframework.diagnoses.verdict import MANY, misfits
from qsframework.errors import listed, some_of
from qsframework.report.blocks import Mark, Verdict
from qsframework.report.words.law import moving_words
from qsframework.report.words.sizes import mm
from qsframework.screening import Mistake, adopted

_NAMED = 3
_WORST = 3


def headline(found: Diagnosis) -> str:
    """The verdict in one sentence, after what is wrong with readings and files and was not corrected."""
    corrected = {c.name for c in found.conventions if not c.suspected}
    ahead = [f"Look first at the {f.title}: {f.words}. " for f in found.account.findings if f.name not in corrected]
    return "".join([*ahead, _verdict(found)])


def _verdict(found: Diagnosis) -> str:
    if not found.findings:
        return _nothing(found) if found.verdict == "none" else _unexplained(found)
    wrong = adopted(found.conventions)
    if wrong and {f.name for f in found.findings} <= {c.name for c in wrong}:
        return _table(found, wrong)
    look = _look(found.sure or found.doubtful)
    if not found.sure:
        they = "it" if len(found.doubtful) == 1 else "them"
        what = f"{names_words(found.doubtful)} would explain the readings, but {_gain(found, they)}"
        return f"Partly explained at most: {what}{look}."
    start = "Explained" if found.verdict == "explained" else "Partly explained"
    but = "".join(f", but {reason}" for reason in list(_reasons(found))[:1])
    return f"{start} by {names_words(found.sure)}: {_gain(found)}{but}{look}."


def _table(found: Diagnosis, wrong: Sequence[Mistake]) -> str:
    """Where nothing but mistakes in the table, or in how it was read, is named."""
    more = f" ({len(wrong) - 1} more below)" if len(wrong) > 1 else ""
    e = found.rms.space
    left = f"held-out error {mm(e.heldout_identified)} mm, noise {mm(e.noise)} (3D RMS)"
    if any(c.hides for c in wrong):
        rest = "no cause can be identified beside it"
    elif found.verdict == "explained":
        rest = f"corrected, it leaves nothing to name ({left})"
    else:
        rest = f"corrected, more is left than the noise allows ({left})"
    return f"Wrong in the table: {wrong[0].words}{more}; {rest}."


def _nothing(found: Diagnosis) -> str:
    e = found.rms.space
    seen = "the model fits within the noise and no cause of the library is seen"
    start = "Nothing is certain" if found.hinted else "Nothing to name"
    return f"{start}: {seen} (held-out error {mm(e.heldout_identified)} mm, noise {mm(e.noise)}, 3D RMS)."


def _unexplained(found: Diagnosis) -> str:
    e = found.rms.space
    what = _left(found) if found.leftovers else _too_much(found)
    t = found.learned
    if t is not None and t.holds:
        before, after = (mm(found.rms.in_space(v)) for v in (t.before, t.heldout))
        left = f"an empirical correction was learned, held-out error {before} \u2192 {after} mm"
        return f"Unexplained: {what}; {left} (3D RMS, noise {mm(e.noise)})."
    return (
        f"Unexplained: {what}; the held-out error stays at {mm(e.heldout_identified)} mm (3D RMS, noise {mm(e.noise)})."
    )


def _too_much(found: Diagnosis) -> str:
    """That more is left than noise, and where."""
    where = f"most of it at {poses_words(worst_poses(found, _WORST))}"
    if found.audit.refuted:
        return f"the readings scatter {found.audit.unit:.3g} times as much as their noise is stated, {where}"
    return f"more is left than the noise allows, {where}"


def _left(found: Diagnosis) -> str:
    """The likeliest motion that nothing explains."""
    return moving_words(found.leftovers[0].law, found.experiment.robot.facts, found.places)


def _gain(found: Diagnosis, they: str = "") -> str:
    e = found.rms.space
    if found.method.one_pose:
        return "only one pose was measured, so nothing says whether this holds at another one"
    before, after = e.heldout_identified, e.heldout_extended
    if not np.isfinite(after / before):
        return "no held-out error can be computed"
    if after < before and not they:
        gain = f"{mm(before)} \u2192 {mm(after)} mm, {100 * e.heldout_gain:.0f} % less"
        return f"held-out error {gain} (3D RMS, noise {mm(e.noise)})"
    given = f" with {they}" if they else ""
    change = f"{mm(before)} \u2192 {mm(after)} mm, 3D RMS, noise {mm(e.noise)}"
    return f"the held-out error is not clearly smaller{given} ({change})"


def _reasons(found: Diagnosis) -> Iterator[str]:
    """Why the verdict is only partly, the weightiest first."""
    if found.verdict != "partly_explained":
        return
    if found.leftovers:
        yield f"{_left(found)} remains unexplained"
    elif misfits(found.after) or found.audit.refuted:
        yield _too_much(found)
    if found.doubtful:
        yield f"{names_words(found.doubtful)} {'is' if len(found.doubtful) == 1 else 'are'} doubtful"
    for f in found.sure:
        if f.instead is not None:
            yield f"it may as well be {moving_words(f.instead.law, found.experiment.robot.facts, found.places)}"
        if (others := len(f.alternatives) + f.further) > MANY:
            yield f"{f.name} could be any of {others} other causes"
    faint = max(found.sure, key=lambda f: f.p_value)
    yield f"{faint.name} is barely seen (p = {faint.p_value:.1g})"


def _look(findings: Sequence[NamedCause]) -> str:
    check = next((check_words(f) for f in findings if f.check), "")
    return f"; check first: {lower_first(check).rstrip('.')}" if check else ""


def check_words(f: NamedCause) -> str:
    """What to look at on the robot, with the joint's name."""
    joint = f.name.partition("[")[2].removesuffix("]").partition("/")[0]
    return f.check.replace("this joint", joint) if joint else f.check


def lower_first(text: str) -> str:
    """A sentence in the midst of another."""
    return text[:1].lower() + text[1:] if text[1:2].islower() else text


def names_words(findings: Sequence[NamedCause]) -> str:
    """`a, b and c`, or the first few and how many more."""
    names = [f.name for f in findings]
    return some_of(names, _NAMED) if len(names) > _NAMED else listed(names)


def worst_poses(found: Diagnosis, count: int) -> tuple[str, ...]:
    """Names of the poses at which most is left."""
    r = found.readings
    names = [r.states.pose[i] for i in map(int, r.plus[found.kept])]
    square = dict.fromkeys(names, 0.0)
    for name, value in zip(names, np.square(found.residuals()[1]).sum(axis=1).tolist(), strict=True):
        square[name] += value
    return tuple(sorted(square, key=lambda name: -square[name])[:count])


def poses_words(names: Sequence[str]) -> str:
    """`pose a`, `poses a, b and c`."""
    return f"{'pose' if len(names) == 1 else 'poses'} {listed(names)}"


_MARKS: dict[str, tuple[Mark, str]] = {
    "none": (Mark.GOOD, "The model holds"),
    "explained": (Mark.GOOD, "Cause found"),
    "partly_explained": (Mark.LOOK, "Found in part"),
    "unexplained": (Mark.BAD, "Cause not known"),
}


def diagnosis_verdict(found: Diagnosis) -> Verdict:
    """The headline with the held-out error, before and after, and the noise."""
    e = found.rms.space
    mark, word = _MARKS[found.verdict]
    held = e.heldout_extended, "held-out error with the causes, 3D RMS"
    if (learned := found.learned) is not None and learned.holds:
        held = found.rms.in_space(learned.heldout), "held-out error with the learned law, 3D RMS"
    named = f"{len(found.sure)}" + (f" + {len(found.doubtful)} doubtful" if found.doubtful else "")
    return Verdict(
        mark,
        word,
        headline(found),
        (
            (f"{mm(held[0])} mm", held[1]),
            (f"{mm(e.heldout_identified)} mm", "held-out error of the model as it was fitted"),
            (f"{mm(e.noise)} mm", "noise alone"),
            (named, f"named of {len(found.table)} causes tried"),
        ),
    )
