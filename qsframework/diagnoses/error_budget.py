"""The error budget: how the error falls from the nominal model to the noise, one cause after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.diagnoses.result import Diagnosis
from qsframework.hypotheses.columns import Case
from qsframework.plugin import Array


@dataclass(frozen=True)
class BudgetStep:
    """RMS per axis, m, on the readings and held out, with what is named `label` added to the steps before."""

    label: str
    readings: float
    heldout: float


def error_budget(diagnosis: Diagnosis) -> tuple[BudgetStep, ...]:
    """Nominal, identified, each cause in the order of its evidence, a learned law that holds, and the noise.

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
    if (learned := diagnosis.learned) is not None and learned.holds:
        here = float(np.sqrt(np.sum(learned.fit.residuals**2) / case.count))
        steps.append(BudgetStep(f"+ {learned.name}", here, learned.heldout))
    return (*steps, BudgetStep("noise", e.noise, e.noise))


def linear_errors(case: Case, causes: Sequence[int], residuals: Array) -> tuple[float, float, Array]:
    """RMS per axis, m, on the readings and with one pose left out, of the baseline's columns with those of causes; and
    the errors (m,) of the latter whitened, in units of noise.

    residuals (R, 3) m of the baseline
    """
    columns = case.beside(causes)
    drawn = case.noise.whiten(residuals.ravel()) - case.residuals  # by how much large ones were drawn in
    errors = case.left_of(columns) + drawn, case.held_out_errors(columns, case.pose) + drawn
    here, unseen = (float(np.sqrt(np.sum(case.noise.colour(e) ** 2) / case.count)) for e in errors)
    return here, unseen, errors[1]
