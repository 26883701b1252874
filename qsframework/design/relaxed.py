"""Relaxed designs: weights on the candidates instead of counts, by cvxpy (the reference formulation)."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from qsframework.design.criteria import Criterion
from qsframework.errors import NotCertified, NotIdentifiable
from qsframework.information import Allowed, efficiency_bound, scores, weighted_information
from qsframework.plugin import Array

SOLVER = "CLARABEL"
_POLISH = 2000


def relax(rows: Array, criterion: Criterion, allowed: Allowed, efficiency: float = 0.9999) -> tuple[Array, float]:
    """Weights (N,) and their certified efficiency, recomputed over all candidates.

    rows (N, k, p) are whitened and scaled. The solver works in coordinates in which the uniform
    design's information is the identity, because it is otherwise wrong without saying so. Raises
    NotCertified if the certificate misses `efficiency`.
    """
    start = _uniform(allowed, len(rows))
    M = weighted_information(rows, start)
    try:
        L = np.asarray(np.linalg.cholesky(M), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise NotIdentifiable("all candidates together cannot tell the parameters apart") from error
    inverse = np.asarray(np.linalg.inv(L), dtype=np.float64)
    white = rows @ inverse.T
    weights = _normalised(_solve(white, inverse, float(_logdet(L)), criterion, allowed), allowed)
    weights, bound = _polish(rows, weights, criterion, allowed, efficiency)
    if bound < efficiency:
        raise NotCertified(
            f"{SOLVER} reached a certified {criterion.name}-efficiency of {bound:.6f}, asked for {efficiency}; "
            "take fewer candidates or ask for less"
        )
    return weights, bound


def _uniform(allowed: Allowed, count: int) -> Array:
    weights = np.zeros(count)
    for members, share in zip(allowed.groups, allowed.shares, strict=True):
        weights[members] = share / len(members)
    return weights


def _logdet(L: Array) -> float:
    return 2.0 * float(np.log(np.diag(L)).sum())


def _solve(white: Array, Linv: Array, logdet: float, criterion: Criterion, allowed: Allowed) -> Array:
    """The convex programme in cvxpy; S = L^-1 M L^-T."""
    import cvxpy as cp

    count, _, p = white.shape
    pairs = np.triu_indices(p)
    moments = np.einsum("nki,nkj->nij", white, white)
    w = cp.Variable(count, nonneg=True)
    entries = moments[:, pairs[0], pairs[1]].T @ w
    duplicate = np.zeros((p * p, len(pairs[0])))
    for k, (i, j) in enumerate(zip(*pairs, strict=True)):
        duplicate[[i * p + j, j * p + i], k] = 1.0
    S = cp.reshape(duplicate @ entries, (p, p), order="C")
    constraints: list[Any] = [
        cp.sum(w[members]) == share for members, share in zip(allowed.groups, allowed.shares, strict=True)
    ]
    if allowed.cap < 1.0:
        constraints.append(w <= allowed.cap)
    objective = 0
    scale = np.trace(Linv.T @ Linv)
    if criterion.trace_share:
        objective += criterion.trace_share * cp.matrix_frac(Linv / np.sqrt(scale), S)
    if criterion.determinant_share and criterion.trace_share:
        objective += criterion.determinant_share * np.exp(-logdet / p) / scale * cp.exp(-cp.log_det(S) / p)
    elif criterion.determinant_share:
        objective -= cp.log_det(S)
    problem = cp.Problem(cp.Minimize(objective), constraints)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the certificate, not the solver's word, decides
        problem.solve(solver=SOLVER, chordal_decomposition_enable=False)
    if w.value is None:
        raise NotCertified(f"{SOLVER} found no design: {problem.status}")
    return np.asarray(w.value, dtype=float)


def _normalised(weights: Array, allowed: Allowed) -> Array:
    weights = np.maximum(weights, 0.0)
    for members, share in zip(allowed.groups, allowed.shares, strict=True):
        weights[members] *= share / weights[members].sum()
    return weights


def _polish(
    rows: Array, weights: Array, criterion: Criterion, allowed: Allowed, efficiency: float
) -> tuple[Array, float]:
    """Multiplicative steps inside each group until the certificate holds; keeps the best weights."""
    best, best_bound = weights, -1.0
    for _ in range(_POLISH if allowed.cap >= 1.0 else 1):
        M = weighted_information(rows, weights)
        gradient = criterion.gradient(M)
        bound = efficiency_bound(float(criterion.value(M)), gradient, rows, allowed)
        if bound > best_bound:
            best, best_bound = weights, bound
        if best_bound >= efficiency:
            break
        value = scores(rows, gradient)
        weights = _normalised(weights * np.sqrt(np.maximum(value, 0.0)), allowed)
    return best, best_bound
