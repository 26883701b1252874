"""Relaxed designs by cvxpy: the reference formulation, for up to a few thousand candidates."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from qsframework.design.criteria import Criterion, Determinant, Linear, Sum
from qsframework.design.minimax import Largest, Robust, SmallestEigenvalue
from qsframework.errors import NotCertified, NotIdentifiable
from qsframework.information import Allowed
from qsframework.plugin import Array

SOLVER = "CLARABEL"


def relax(
    rows: Array, criterion: Criterion | Robust, allowed: Allowed, prior: Array | None = None, form: str = "log_det"
) -> Array:
    """Weights (N,) of the relaxed design as SOLVER finds them; certify them before use.

    rows (N, k, p) or (N, S, k, p) are whitened and scaled. The solver works in coordinates in which the uniform
    design's information is the identity, because it is otherwise wrong without saying so. form "socp" writes a
    linear criterion (A, L, I) without groups and prior as a second-order cone programme instead.
    """
    rule = criterion if isinstance(criterion, Robust) else Robust(criterion)
    four = rows[:, None] if rows.ndim == 3 else rows
    if form == "socp":
        return _elfving(four[:, 0], rule.inner, allowed, prior)
    import cvxpy as cp

    count, scenarios = four.shape[:2]
    w = cp.Variable(count, nonneg=True)
    constraints: list[Any] = [
        cp.sum(w[members]) == share for members, share in zip(allowed.groups, allowed.shares, strict=True)
    ]
    if allowed.cap < 1.0:
        constraints.append(w <= allowed.cap)
    uniform = _uniform(allowed, count)
    terms: list[cp.Expression] = []
    offsets: list[float] = []
    scale = None
    for s in range(scenarios):
        before = np.zeros((four.shape[-1],) * 2) if prior is None else prior.reshape(-1, *prior.shape[-2:])[s]
        S, inverse = _whitened(cp, four[:, s], w, uniform, before)
        scale = scale or float(rule.inner.value(np.linalg.inv(inverse) @ np.linalg.inv(inverse).T))
        terms.append(_objective(cp, rule.inner, S, inverse, scale, constraints))
        offsets.append(_offset(rule.inner, inverse))
    if scenarios == 1:
        objective = terms[0]
    else:
        if _is_log(rule.inner):
            terms = [cp.exp(t + offset - offsets[0]) for t, offset in zip(terms, offsets, strict=True)]
        objective = cp.max(cp.hstack(terms)) if rule.worst else cp.sum(cp.hstack(terms)) / scenarios
    return _run(cp, objective, constraints, w, allowed)


def _is_log(criterion: Criterion) -> bool:
    return isinstance(criterion, Determinant)


def _uniform(allowed: Allowed, count: int) -> Array:
    weights = np.zeros(count)
    for members, share in zip(allowed.groups, allowed.shares, strict=True):
        weights[members] = share / len(weights[members])
    return weights


def _whitened(cp: Any, rows: Array, w: Any, uniform: Array, before: Array) -> tuple[Any, Array]:
    """S = L^-1 M L^-T as a function of w, and L^-1, with L L' the uniform design's information."""
    flat = (rows * np.sqrt(uniform)[:, None, None]).reshape(-1, rows.shape[-1])
    try:
        L = np.linalg.cholesky(flat.T @ flat + before)
    except np.linalg.LinAlgError as error:
        raise NotIdentifiable("all candidates together cannot tell the parameters apart") from error
    inverse = np.asarray(np.linalg.inv(L), dtype=np.float64)
    white = rows @ inverse.T
    p = rows.shape[-1]
    pairs = np.triu_indices(p)
    moments = np.einsum("nki,nkj->nij", white, white)
    constant = (inverse @ before @ inverse.T)[pairs]
    entries = moments[:, pairs[0], pairs[1]].T @ w + constant
    duplicate = np.zeros((p * p, len(pairs[0])))
    for k, (i, j) in enumerate(zip(*pairs, strict=True)):
        duplicate[[i * p + j, j * p + i], k] = 1.0
    return cp.reshape(duplicate @ entries, (p, p), order="C"), inverse


def _objective(cp: Any, criterion: Criterion, S: Any, inverse: Array, scale: float, constraints: list[Any]) -> Any:
    """psi / scale in cvxpy's words, or log psi for a determinant; M = L S L', inverse = L^-1."""
    p = inverse.shape[0]
    if isinstance(criterion, Determinant):
        if criterion.directions is None:
            return -cp.log_det(S) / p
        pick = inverse @ criterion.directions
        X = cp.Variable((pick.shape[1],) * 2, symmetric=True)  # below the information about these directions
        constraints.append(S - pick @ X @ pick.T >> 0)
        return -cp.log_det(X) / pick.shape[1]
    if isinstance(criterion, Linear):
        W = np.eye(p) if criterion.weight is None else criterion.weight
        values, vectors = np.linalg.eigh(inverse @ W @ inverse.T / scale)
        kept = values > 1e-14 * values[-1]
        return cp.matrix_frac(vectors[:, kept] * np.sqrt(values[kept]), S)
    if isinstance(criterion, Sum):
        return sum(share * _powered(cp, part, S, inverse, scale, constraints) for share, part in criterion.parts)
    if isinstance(criterion, Largest):
        parts = [Linear("I", "", A.T @ A) for A in criterion.rows]
        return cp.max(cp.hstack([_objective(cp, part, S, inverse, scale, constraints) for part in parts]))
    if isinstance(criterion, SmallestEigenvalue):
        t = cp.Variable(nonneg=True)
        constraints.append(S - t / scale * (inverse @ inverse.T) >> 0)
        return cp.inv_pos(t)
    raise NotCertified(f"cvxpy has no form for the criterion {criterion.name}")


def _offset(criterion: Criterion, inverse: Array) -> float:
    """log psi less what `_objective` says of it: the whitening's own determinant."""
    if not isinstance(criterion, Determinant) or criterion.directions is not None:
        return 0.0
    return 2.0 * float(np.log(np.abs(np.diag(inverse))).sum()) / inverse.shape[0]


def _powered(cp: Any, part: Criterion, S: Any, inverse: Array, scale: float, constraints: list[Any]) -> Any:
    if _is_log(part):
        return np.exp(_offset(part, inverse)) / scale * cp.exp(_objective(cp, part, S, inverse, scale, constraints))
    return _objective(cp, part, S, inverse, scale, constraints)


def _run(cp: Any, objective: Any, constraints: list[Any], w: Any, allowed: Allowed) -> Array:
    problem = cp.Problem(cp.Minimize(objective), constraints)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the certificate, not the solver's word, decides
        try:
            problem.solve(solver=SOLVER, chordal_decomposition_enable=False)
        except cp.error.SolverError as error:
            raise NotCertified(f"{SOLVER} failed: {error}") from error
    if w.value is None:
        raise NotCertified(f"{SOLVER} found no design: {problem.status}")
    weights = np.maximum(np.asarray(w.value, dtype=float), 0.0)
    for members, share in zip(allowed.groups, allowed.shares, strict=True):
        total = weights[members].sum()
        weights[members] *= share / total if total > 0 else 0.0
    return weights


def _elfving(rows: Array, criterion: Criterion, allowed: Allowed, prior: Array | None) -> Array:
    """Elfving's form: min sum |H_i|_F with sum A_i' H_i = K, W = K K'; the weights are proportional to |H_i|_F."""
    if not isinstance(criterion, Linear) or len(allowed.shares) > 1 or allowed.cap < 1.0 or prior is not None:
        raise NotCertified("the cone form is for A, L and I with one group, no cap and no prior")
    import cvxpy as cp

    count, k, p = rows.shape
    size = np.linalg.norm(rows, axis=(0, 1))
    W = np.eye(p) if criterion.weight is None else criterion.weight
    values, vectors = np.linalg.eigh(W / np.outer(size, size))
    kept = values > 1e-14 * values[-1]
    K = vectors[:, kept] * np.sqrt(values[kept])
    H = cp.Variable((count * k, K.shape[1]))
    flat = (rows / size).reshape(-1, p)
    norms = cp.hstack([cp.norm(H[i * k : (i + 1) * k], "fro") for i in range(count)])
    problem = cp.Problem(cp.Minimize(cp.sum(norms)), [K / np.abs(K).max() == flat.T @ H])
    problem.solve(solver=SOLVER)
    if H.value is None:
        raise NotCertified(f"{SOLVER} found no design: {problem.status}")
    weights = np.linalg.norm(np.asarray(H.value).reshape(count, -1), axis=1)
    return weights / weights.sum()
