"""The error budget: how the error falls from the nominal model to the noise, one cause after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.diagnose.linearization.columns import Case
from qsframework.diagnose.result import Diagnosis
from qsframework.estimation.projection import left as take_out, solved
from qsframework.plugin import Array

_TOLD = 1e-10
"""Share of the largest singular value below which readings do not tell a direction."""
_CARRIED = 1e-8
"""Share of a direction that other poses carry, below which the fit without a pose is made anew."""


@dataclass(frozen=True)
class BudgetStep:
    """RMS per axis, m, on the readings and held out, with what is named `label` added to the steps before."""

    label: str
    readings: float
    heldout: float


def error_budget(diagnosis: Diagnosis) -> tuple[BudgetStep, ...]:
    """Nominal, identified, each cause in the order of its evidence, and the noise.

    Steps between the identified and the extended model are fits of the linearised model with the causes so far; held
    out means one pose after the other, the causes given. Both ends are those of the diagnosis itself.
    """
    case, e = diagnosis.case, diagnosis.rms
    where = {c.name: i for i, c in enumerate(case.causes)}
    steps = [BudgetStep("nominal", e.nominal, e.nominal), BudgetStep("identified", e.identified, e.heldout_identified)]
    so_far: list[int] = []
    found = sorted((f for f in diagnosis.findings if f.name in where), key=lambda f: -f.s)
    for f in found:
        so_far.append(where[f.name])
        steps.append(BudgetStep(f"+ {f.name}", *linear_errors(case, so_far, diagnosis.baseline.residuals)[:2]))
    if found:
        steps[-1] = BudgetStep(steps[-1].label, e.extended, e.heldout_extended)
    return (*steps, BudgetStep("noise", e.noise, e.noise))


def linear_errors(case: Case, causes: Sequence[int], residuals: Array) -> tuple[float, float, Array]:
    """RMS per axis, m, on the readings and with one pose left out, of the baseline's columns with those of causes; and
    the errors (m,) of the latter whitened, in units of noise.

    residuals (R, 3) m of the baseline
    """
    first = case.motions + len(case.fitted)
    ends = np.cumsum([first, *(len(c.parameters) for c in case.causes)])
    raw = [case.raw[:, :first], *(case.raw[:, ends[i] : ends[i + 1]] for i in causes)]
    white = np.concatenate([case.A, *(case.B[i] for i in causes)], axis=1)
    plain, left = np.concatenate(raw, axis=1), residuals.ravel()
    held = np.zeros((len(case.held), white.shape[1]))
    held[:, : len(case.held)] = np.diag(case.held)
    held = held[case.held > 0.0]
    both, target = np.vstack([white, held]), np.concatenate([case.residuals, np.zeros(len(held))])
    size: Array = np.maximum(np.linalg.norm(both, axis=0), 1e-300)
    U, values, V = np.linalg.svd(both / size, full_matrices=False)
    told = values > _TOLD * values[0]
    U, back = U[:, told], (V[told].T / values[told]) / size[:, None]
    x = back @ (U.T @ target)
    rest = take_out(U, target)
    out = np.zeros_like(left)
    for pose in np.unique(case.pose):
        test = np.flatnonzero(case.pose == pose)
        ((_, carried, error),) = solved(U, test[None], rest, _CARRIED)
        if carried[0]:
            without = x - back @ (U[test].T @ error[0])
        else:
            others = np.setdiff1d(np.arange(len(target)), test)
            without = _solve(both[others], target[others])
        out[test] = left[test] - plain[test] @ without
    whole = left - plain @ x
    here, unseen = (float(np.sqrt(np.sum(e**2) / case.count)) for e in (whole, out))
    return here, unseen, case.noise.whiten(out)


def _solve(columns: Array, target: Array) -> Array:
    size: Array = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return np.linalg.lstsq(columns / size, target, rcond=_TOLD)[0] / size
