"""The criteria by name, made for an experiment: which parameters are of interest, which test poses count."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.option import check_choice
from qsframework.plans.criteria import Criterion, Determinant, Linear, Sum
from qsframework.plans.options import CriterionName
from qsframework.plugin import Array

CRITERIA: dict[str, Criterion] = {
    "D": Determinant(),
    "A": Linear(),
    "O3": Sum(((0.5, Linear()), (0.5, Determinant()))),
}
"""The criteria that need nothing besides the information matrix."""
TITLES: dict[str, str] = {
    "I": "mean variance of the tip after compensation, over the test poses",
    **{name: criterion.title for name, criterion in CRITERIA.items()},
    "Ds": "det of the covariance of the parameters of interest",
    "L": "sum of the variances of the scaled parameters of interest",
}


def find_criterion(
    name: str,
    interest: Sequence[int] = (),
    parameters: int = 0,
    test_rows: Array | None = None,
    wanted: Sequence[int] | None = None,
) -> Criterion:
    """The criterion of a name; an InputError lists them.

    interest: positions, among `parameters` parameters, that Ds and L speak of; test_rows (J, 3, p): sensitivity
    of the tip at J test poses per unit of each scaled parameter, m, for I; wanted: positions of the parameters
    that D, A and O3 speak of, the others being estimated beside them, None: all
    """
    check_choice("criterion", CriterionName, name)
    if name in ("D", "A", "O3") and wanted is not None and len(wanted) < parameters:
        # D, A or O3 of the parameters along K (P, s), the others estimated beside them: convex in the information.
        K = np.eye(parameters)[:, list(wanted)]
        D, A = Determinant("D", CRITERIA["D"].title, K), Linear("A", CRITERIA["A"].title, K @ K.T)
        return {"D": D, "A": A, "O3": Sum(((0.5, A), (0.5, D)))}[name]
    if name in CRITERIA:
        return CRITERIA[name]
    if name in ("Ds", "L"):
        if not len(interest):
            message = f"criterion {name} needs the parameters of interest"
            raise InputError(Problem(message, argument=("interest", "NAME")))
        if name == "Ds":
            return Determinant("Ds", TITLES["Ds"], np.eye(parameters)[:, list(interest)])
        chosen = np.isin(np.arange(parameters), interest).astype(float)
        return Linear("L", TITLES["L"], np.diag(chosen))
    if test_rows is None or not len(test_rows):
        raise InputError(f"criterion {name} needs test poses")
    flat = test_rows.reshape(-1, test_rows.shape[-1])
    return Linear("I", TITLES["I"], flat.T @ flat / len(test_rows), depends_on_scale=False)
