"""The verdict: whether names are found, and whether they leave nothing."""

from __future__ import annotations

from collections.abc import Sequence

from qsframework.diagnoses.residuals.lack_of_fit import LackOfFit
from qsframework.diagnoses.residuals.noise_components import NoiseAudit
from qsframework.diagnoses.result import Leftover, NamedCause, Verdict
from qsframework.hypotheses.search.model_selection import Library

_MISFIT = 1e-3
"""p-value of the lack of fit below which no name is final; the noise has been audited before."""
MANY = 8
"""Kinds of alternatives beyond which a name is no explanation: the readings do not name the effect."""


def ambiguous(library: Library, findings: Sequence[NamedCause]) -> bool:
    """Whether some cause is barely seen, has a law in its place as well, or could be any of many that do different
    things to the readings."""
    if any(f.faint or f.instead is not None for f in findings):
        return True
    at = {c.name: i for i, c in enumerate(library.case.causes)}
    kinds = [f.further + len({library.aliases(at[r.name]) for r in f.alternatives}) for f in findings]
    return any(k > MANY for k in kinds)


def misfits(after: LackOfFit) -> bool:
    """Whether what the last model leaves is too much for the repeats, where there are any."""
    return after.p_replicates < _MISFIT


def verdict_of(
    findings: Sequence[NamedCause], leftovers: Sequence[Leftover], after: LackOfFit, audit: NoiseAudit, unclear: bool
) -> Verdict:
    """What the findings come to; audit: of the noise; unclear: whether one of them could be any of many."""
    left = bool(leftovers) or misfits(after) or audit.refuted
    if not findings:
        return "unexplained" if left else "none"
    return "partly_explained" if left or unclear or any(f.doubtful for f in findings) else "explained"
