"""What a learned law looks like: how much of what it does to the readings a cause of the library can do.

Both are seen beside everything else that is fitted and in the noise that was found. A spring takes what is linear in
the torque of a law and of a cause alike, so that two laws are compared by what the readings tell of them, not by how
they are written.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.diagnose.result import Alike
from qsframework.estimation import left, orthonormal
from qsframework.hypotheses.catalogue.causes import Cause
from qsframework.hypotheses.catalogue.law import Law
from qsframework.hypotheses.columns import Case
from qsframework.hypotheses.exact_refit import SettledFit
from qsframework.plugin import RobotFacts, SpringLaw
from qsframework.plugin.settings import place_fields

HALF = 0.5
"""Share of a law from which on a cause at its place counts as alike."""
CLOSE = 0.9
"""Share of a law from which on a cause is its rival, wherever it acts."""
_ABSORBED = 1e-3
"""Share of a column that must remain beside what is fitted, else nothing can be compared with it."""
_MOST = 3


def alike(case: Case, kept: Sequence[Cause], fit: SettledFit, law: Law, learned: Cause) -> tuple[Alike, ...]:
    """The causes of the library that look like a law that was learned, the likest first, its alternatives among them.

    case: with the library, in the noise of the fit; kept: the causes that are fitted beside the law
    """
    own = [fit.jacobian.shape[1] - len(fit.names) + fit.names.index(n) for n in learned.names]
    beside = orthonormal(np.delete(fit.jacobian, own, axis=1))
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
