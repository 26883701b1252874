"""Which law is learned of what the names leave, and what it gains at held-out poses."""

from __future__ import annotations

import numpy as np

from qsframework.diagnose.learn import LawTrial
from qsframework.diagnose.likeness import alike
from qsframework.diagnose.named_causes import Found, SearchOptions, held_out_gain
from qsframework.diagnose.remaining import NOTHING, Remaining, remaining_beside
from qsframework.diagnose.result import LearnedLaw
from qsframework.diagnose.selection.cross_validation import held_out
from qsframework.diagnose.selection.exact_refit import SettledFit

_PREDICTS = 0.98
"""Share of the held-out error with some names below which a law stands in their place."""


def tested(found: Found, options: SearchOptions) -> tuple[Found, Remaining]:
    """The test for remaining signal, and what stands after it: names that a law is far ahead of drop out, and the law
    remains, where it also predicts held-out poses better than they do."""
    if not options.largest:
        return found, NOTHING
    remaining = remaining_beside(found.base, found.causes, found.extended, options)
    if not remaining.beaten or found.plain is None:
        return found, remaining
    rest = found.without(tuple(remaining.beaten))
    after = remaining_beside(rest.base, rest.causes, rest.extended, options)
    law = best_law(rest, rest.extended, after, options)
    better = law is not None and law.heldout < _PREDICTS * held_out_gain(found, options).rms_extended
    return (rest, after) if better else (found, remaining)


def best_law(found: Found, certain: SettledFit, remaining: Remaining, options: SearchOptions) -> LearnedLaw | None:
    """The law that what is left shows, at a place that is identified: the first of the plainest that holds, else the
    plainest.

    Where doubtful names do not stay, it is learned of what is left beside the certain ones.
    """
    if found.answers and certain is not found.extended:
        remaining = remaining_beside(found.base, (), certain, options)
    tried: list[LearnedLaw] = []
    for trial in remaining.law_trials:
        learned = _learned(found, certain, trial, remaining.anew, options)
        if learned is not None and learned.holds:
            return learned
        tried += [learned] if learned is not None else []
    return tried[0] if tried else None


def _learned(
    found: Found, certain: SettledFit, trial: LawTrial, anew: float, options: SearchOptions
) -> LearnedLaw | None:
    """A law fitted exactly beside the certain names, with its held-out gain; None where no fit leads anywhere."""
    base = found.base
    kept = [c for c in found.causes if set(c.names) <= set(certain.names)]
    both = [*kept, trial.cause]
    fit = base.refit(both)
    if fit is None:
        return None
    cases = base.case_at(kept, certain), base.case_at(both, fit)
    held = held_out(*cases, (), [], None, options.seed, options.repeats)
    bounds = {p.name: (p.lower, p.upper) for p in fit.model.parameters}
    return LearnedLaw(
        cause=trial.cause,
        leftover=trial.leftover,
        s=float(np.sqrt(max(certain.chi2 - fit.chi2, 0.0))),
        fit=fit,
        before=held.rms_identified,
        heldout=held.rms_extended,
        gain=held.gain,
        clear=held.clear,
        anew=anew,
        physical=all(bounds[n][0] <= v <= bounds[n][1] for n, v in fit.by_name().items()),
        alike=alike(base.case, kept, fit, trial.leftover.law, trial.cause),
    )
