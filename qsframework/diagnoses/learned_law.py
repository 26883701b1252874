"""Which law is learned of what the names leave, what it gains at held-out poses, and what it looks like: how much of
what it does to the readings a cause of the library can do.

Both are seen beside everything else that is fitted and in the noise that was found. A spring takes what is linear in
the torque of a law and of a cause alike, so that two laws are compared by what the readings tell of them, not by how
they are written.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from qsframework.diagnoses.baseline import Baseline
from qsframework.diagnoses.learn import shares
from qsframework.diagnoses.named_causes import FoundCauses, SearchOptions, held_out_gain
from qsframework.diagnoses.remaining import NOTHING, Beside, Remaining, beaten_names, races_of, remaining_beside
from qsframework.diagnoses.result import Alike, LearnedLaw
from qsframework.estimation import left, orthonormal
from qsframework.hypotheses.catalogue.causes import Cause, widened
from qsframework.hypotheses.catalogue.law import Law
from qsframework.hypotheses.columns import Case
from qsframework.hypotheses.exact_refit import SettledFit, averaged_fit
from qsframework.hypotheses.search.cross_validation import held_out_average
from qsframework.plugin import RobotFacts, SpringLaw
from qsframework.plugin.settings import place_fields

_PREDICTS = 0.98
"""Share of the held-out error with some names below which a law stands in their place."""
HALF = 0.5
"""Share of a law from which on a cause at its place counts as alike."""
CLOSE = 0.9
"""Share of a law from which on a cause is its rival, wherever it acts."""
_ABSORBED = 1e-3
"""Share of a column that must remain beside what is fitted, else nothing can be compared with it."""
_MOST = 3


def tested(found: FoundCauses, options: SearchOptions) -> tuple[FoundCauses, Remaining, Beside]:
    """The test for remaining signal, and what stands after it: where names leave nothing, those that some place is far
    ahead of drop out; so do those that one law is far ahead of, and the law remains, where it also predicts held-out
    poses better than they do; and how places compete beside names."""
    beside = races_of(found)
    if not options.largest:
        return found, NOTHING, beside
    remaining = remaining_beside(found.base, found.causes, found.extended, options)
    beaten = beaten_names(found.causes, beside) if not remaining.leftovers else set[str]()
    if beaten and found.plain is not None:
        found = found.without(tuple(beaten))
        remaining, beside = remaining_beside(found.base, found.causes, found.extended, options), races_of(found)
    if not remaining.beaten or found.plain is None:
        return found, remaining, beside
    rest = found.without(tuple(remaining.beaten))
    after = remaining_beside(rest.base, rest.causes, rest.extended, options)
    law = best_law(rest, rest.extended, after, options)
    better = law is not None and law.heldout < _PREDICTS * held_out_gain(found, options).rms_extended
    return (rest, after, races_of(rest)) if better else (found, remaining, beside)


def best_law(
    found: FoundCauses, certain: SettledFit, remaining: Remaining, options: SearchOptions
) -> LearnedLaw | None:
    """The average of the likeliest laws of what is left, fitted exactly beside the certain names, with its held-out
    gain; None where nothing is learned or no fit leads anywhere.

    Where doubtful names do not stay, it is learned of what is left beside the certain ones.
    """
    base = found.base
    if found.answers and certain is not found.extended:
        remaining = remaining_beside(base, (), certain, options)
    kept = [c for c in found.causes if set(c.names) <= set(certain.names)]
    if not remaining.law_trials:
        return None
    plainest, *others = remaining.law_trials
    plain = base.refit([*kept, plainest.cause])
    if plain is None:
        return None
    physical, possible = _within_bounds(plain), [(plainest, plain)]
    likely = shares([trial.evidence for trial in remaining.law_trials])[1:] if physical else ()
    for trial in (trial for trial, share in zip(others, likely, strict=False) if share > 0.0):
        other = base.refit([*kept, trial.cause])
        if other is not None and _within_bounds(other):
            possible.append((trial, other))
    odds = shares([trial.evidence for trial, _ in possible]).tolist()
    averaged = [(share, trial, fit) for share, (trial, fit) in zip(odds, possible, strict=True) if share > 0.0]
    _, first, alone = averaged[0]  # the plainest, unless nothing of the average is its
    laws = [(share, trial.cause, fit) for share, trial, fit in averaged]
    fit = alone if len(laws) == 1 else _average(base, kept, laws)
    cases = [(share, base.case_at([*kept, cause], own)) for share, cause, own in laws]
    held = held_out_average(base.case_at(kept, certain), cases, options.seed, options.repeats)
    return LearnedLaw(
        causes=tuple(cause for _, cause, _ in laws),
        shares=tuple(share for share, _, _ in laws),
        leftover=first.leftover,
        s=float(np.sqrt(max(certain.chi2 - fit.chi2, 0.0))),
        alone=alone,
        fit=fit,
        before=held.rms_identified,
        heldout=held.rms_extended,
        gain=held.gain,
        clear=held.clear,
        anew=remaining.anew,
        poses=held.poses,
        physical=physical,
        alike=alike(base.case, kept, alone, first.leftover.law, first.cause),
    )


def _average(base: Baseline, kept: Sequence[Cause], laws: Sequence[tuple[float, Cause, SettledFit]]) -> SettledFit:
    """Of fits by their shares, each with one law beside the causes that are kept. In a fit of all laws together each
    has the share of its variance, so that they are drawn to zero as one law is."""
    causes = list[Cause]()
    for share, cause, _ in laws:
        *springs, law = cause.effects
        weighed: Any = replace(cast("Any", law), prior=float(np.sqrt(share)) * (cause.prior or 0.0))
        causes.append(replace(cause, effects=(*springs, weighed), parameters=weighed.parameters(base.case.model.facts)))
    model = widened(base.experiment.model(), [*kept, *causes])
    names = [*base.case.fitted, *(n for c in (*kept, *causes) for n in c.names)]
    return averaged_fit(model, names, base.rows, [(share, fit) for share, _, fit in laws])


def _within_bounds(fit: SettledFit) -> bool:
    bounds = {p.name: (p.lower, p.upper) for p in fit.model.parameters}
    return all(bounds[n][0] <= v <= bounds[n][1] for n, v in fit.by_name().items())


def alike(case: Case, kept: Sequence[Cause], fit: SettledFit, law: Law, learned: Cause) -> tuple[Alike, ...]:
    """The causes of the library that look like a law that was learned, the likest first, its alternatives among them.

    case: with the library, in the noise of the fit; kept: the causes that are fitted beside the law
    """
    own = [fit.jacobian.shape[1] - len(fit.names) + fit.names.index(n) for n in learned.names]
    beside = fit.basis(learned.names)
    moved = left(beside, fit.jacobian[:, own] @ np.array([fit.value(n) for n in learned.names]))
    square = float(moved @ moved)
    if square <= 0.0:
        return ()
    named = {n for c in kept for n in c.names}
    found: list[Alike] = []
    for i, cause in enumerate(case.causes):
        if cause.group or not named.isdisjoint(cause.names):
            continue
        white = case.noise.whiten(case.metres(i))
        seen = left(beside, white)
        plain = np.linalg.norm(seen, axis=0) > _ABSORBED * np.linalg.norm(white, axis=0)
        along = orthonormal(seen[:, plain]).T @ moved
        share = min(float(along @ along) / square, 1.0)
        here = _acts_at(cause, law, learned, case.model.facts)
        if share >= (HALF if here else CLOSE):
            turned = cause.one_sided() and float(seen[:, 0] @ moved) < 0.0
            found.append(Alike(cause.name, share, float(np.sqrt((1.0 - share) * square)), here, turned))
    return tuple(sorted(found, key=lambda a: -a.share)[:_MOST])


def _acts_at(cause: Cause, law: Law, learned: Cause, facts: RobotFacts) -> bool:
    """Whether a cause acts where the law does: at a place of the same name, or on the same springs."""
    effect, mine = cause.effects[0], learned.effects[-1]
    if law.place in {str(getattr(effect, f)) for f in place_fields(cause.kind)}:
        return True
    if not isinstance(effect, SpringLaw) or not isinstance(mine, SpringLaw):
        return False
    return not set(effect.springs(facts)).isdisjoint(mine.springs(facts))
