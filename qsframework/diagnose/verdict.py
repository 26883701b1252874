"""The verdict in words: what was found, what it gains, what cannot be told apart, and what would tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.diagnose.conventions import Convention
from qsframework.diagnose.explain import Library
from qsframework.diagnose.lack_of_fit import LackOfFit
from qsframework.diagnose.noise_audit import NoiseAudit
from qsframework.diagnose.result import Errors, Finding, Leftover, Line
from qsframework.diagnose.words import people_estimate
from qsframework.plugin import Parameter

_SHOWN = 3
_FEW = 1.15
"""Held-out error over the noise up to which nothing more is to be gained."""


_MISFIT = 1e-3
"""p-value of the lack of fit below which no name is final; the noise has been audited before."""
_PLAIN = 1e-3
"""p-value of a name above which it explains nothing yet: effects that nobody thought of look like that too."""
_ALIKE = float(np.deg2rad(1.0))
"""Angle below which no poses are promised: whether any tell the two is still to be computed."""
MANY = 8
"""Kinds of rivals beyond which a name is no explanation: something acts, and the readings do not say what."""


def ambiguous(library: Library, findings: Sequence[Finding]) -> bool:
    """Whether some cause is barely seen, or could be any of many that do different things to the readings."""
    if any(f.p_value > _PLAIN for f in findings):
        return True
    at = {c.name: i for i, c in enumerate(library.case.causes)}
    kinds = [{library.aliases(at[r.name]) for r in f.rivals} for f in findings]
    return any(len(k) > MANY for k in kinds)


def misfits(after: LackOfFit) -> bool:
    """Whether what the last model leaves is too much for the stated noise, or for the repeats."""
    told = [p for p in (after.p_chi2, after.p_replicates) if np.isfinite(p)]
    return bool(told) and min(told) * len(told) < _MISFIT


def verdict_of(findings: Sequence[Finding], leftovers: Sequence[Leftover], after: LackOfFit, unclear: bool) -> str:
    """none: nothing acts; explained: names that leave nothing; partly_explained: names that leave something, or that
    could as well be many others."""
    left = bool(leftovers) or misfits(after)
    if not findings:
        return "unexplained" if left else "none"
    return "partly_explained" if left or unclear else "explained"


def words_of(
    verdict: str, findings: Sequence[Finding], leftovers: Sequence[Leftover], conventions: Sequence[Convention],
    audit: NoiseAudit, after: LackOfFit, errors: Errors, table: Sequence[Line], rows: Sequence[int],
) -> tuple[str, ...]:  # fmt: skip
    """The verdict in statements, one or two sentences each. rows: lines of the file that the audit took out."""
    said = [f"{c.name}: {c.words}.{_next_best(conventions)}" for c in conventions if c.compelling]
    adopted = {c.name for c in conventions if c.compelling}
    said += [_finding_words(f) for f in findings if f.name not in adopted]
    if findings:
        said.append(
            f"Held-out error {_mm(errors.heldout_identified)} -> {_mm(errors.heldout_extended)} mm, noise "
            f"{_mm(errors.noise)}."
        )
    elif verdict == "none":
        said.append(_nothing(errors, table))
    said += [tied_words(f) for f in findings if f.rivals]
    said += [_hanging_words(f) for f in findings if f.hangs_on]
    if leftovers:
        also = "also " if findings else ""
        said.append(
            f"The readings {also}hold something that no effect of the library explains: {leftovers[0].words()}."
        )
    elif misfits(after):
        said.append("What is left is too much for the noise, though no place or variable stands out.")
    said += [f"A suspicion: {c.words}." for c in conventions if c.name == "load_unit"]
    if len(rows):
        said.append(f"Outliers left out: rows {', '.join(map(str, rows))}.")
    if audit.unit_source != "stated":
        said += list(audit.words)
    return tuple(said)


def _next_best(conventions: Sequence[Convention]) -> str:
    """How far from the adopted convention the second one stays."""
    second = next((c for c in conventions if not c.compelling and c.name != "load_unit"), None)
    return "" if second is None else f" Next best is {second.name}, {_mm(second.rms)} mm."


def _mm(value: float) -> str:
    return f"{1e3 * value:.3f}"


def _finding_words(f: Finding) -> str:
    sizes = [people_estimate(Parameter(v.name, v.unit), v.value - v.initial, v.sd) for v in f.values]
    return f"{f.name}: {f.physics.rstrip('.')} ({', '.join(sizes)}; s = {f.s:.1f}, p = {f.p_value:.2g})."


def _nothing(errors: Errors, table: Sequence[Line]) -> str:
    excluded = [x for x in table if x.bound and x.status.startswith("excluded")]
    some = "; ".join(f"no {x.name} above {x.bound}" for x in excluded[:_SHOWN])
    more = f" and {len(excluded) - _SHOWN} more in the table" if len(excluded) > _SHOWN else ""
    return f"Nothing beyond the model is seen at {_mm(errors.identified)} mm, noise {_mm(errors.noise)}: {some}{more}."


def tied_words(f: Finding, outlook: str = "") -> str:
    """That the readings leave rivals; outlook: what would tell, where that has been computed."""
    shown = [f"{r.name} (angle {np.rad2deg(r.angle):.0f} deg)" for r in f.rivals[:_SHOWN]]
    more = f" and {len(f.rivals) - _SHOWN} more" if len(f.rivals) > _SHOWN else ""
    nearest = min(f.rivals, key=lambda r: r.angle)
    asked = f"`--separate {f.name} {nearest.name}`"
    if not outlook:
        alike = nearest.angle < _ALIKE
        outlook = f"to these readings they are the same, {asked} says what would tell" if alike else \
                  f"{asked} designs poses that would"  # fmt: skip
    return f"These readings cannot tell {f.name} from {', '.join(shown)}{more}: {outlook}."


def _hanging_words(f: Finding) -> str:
    sets = ["+".join(s) for s in f.hangs_on[:_SHOWN]]
    more = f" and {len(f.hangs_on) - _SHOWN} more" if len(f.hangs_on) > _SHOWN else ""
    return f"{f.name} hangs on poses {', '.join(sets)}{more}: without them another answer, or none, fits as well."
