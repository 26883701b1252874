"""Relaxed designs by cvxpy: the reference for every criterion."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from qsframework.errors import NotCertified, NotIdentifiable
from qsframework.information import Allowed
from qsframework.information.rows import root
from qsframework.plans.criteria import Criterion, Determinant, Expansion, Linear, Mean, Sum
from qsframework.plugin import Array

SOLVER = "CLARABEL"
_SETTINGS = {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11, "max_threads": 1}
Slope = Callable[[Array], Array]
"""G of an information matrix M, once the solver has found its dual: psi(M) / psi(M*) <= <G, M*> for every M* >= 0."""


def optimum(rows: Array, rule: Mean, allowed: Allowed, prior: Array | None = None) -> tuple[Array, Expansion]:
    """The relaxed design of whitened and scaled rows (N, S, k, p) as SOLVER finds it; certify it before use.

    Returns: weights (N,), and log psi there with the slope (S, p, p) that the solver's dual gives.

    The solver works in coordinates in which the uniform design's information is the identity, because it is otherwise
    wrong without saying so. The slope is what its dual variables say.
    """
    import cvxpy as cp

    count, scenarios, _, p = rows.shape
    before = np.zeros((scenarios, p, p)) if prior is None else prior.reshape(-1, p, p)
    w = cp.Variable(count, nonneg=True)
    constraints: list[Any] = [cp.sum(w[members]) == share for members, share in _filled(allowed, count)]
    if allowed.cap < 1.0:
        constraints.append(w <= allowed.cap)
    uniform = _uniform(allowed, count)
    terms: list[cp.Expression] = []
    offsets: list[float] = []
    slopes: list[Slope] = []
    scale = None
    for s in range(scenarios):
        S, inverse = _whitened(cp, rows[:, s], w, uniform, before[s])
        scale = scale or float(rule.inner.value(np.linalg.inv(inverse) @ np.linalg.inv(inverse).T))
        term, slope = _objective(cp, rule.inner, S, inverse, scale, constraints)
        terms.append(term)
        slopes.append(slope)
        offsets.append(_offset(rule.inner, inverse))
    if scenarios > 1 and _is_log(rule.inner):
        terms = [cp.exp(t + offset - offsets[0]) for t, offset in zip(terms, offsets, strict=True)]
    objective = terms[0] if scenarios == 1 else cp.sum(cp.hstack(terms)) / scenarios
    weights = _run(cp, objective, constraints, w, allowed)
    moments = np.swapaxes(rows, -1, -2) @ rows
    M = before + np.tensordot(weights, moments, 1)
    values = np.atleast_1d(rule.inner.value(M))
    slope = np.stack([share * of(m) for share, of, m in zip(values / values.sum(), slopes, M, strict=True)])
    return weights, Expansion(float(np.log(rule.value(M))), slope)


def _is_log(criterion: Criterion) -> bool:
    return isinstance(criterion, Determinant)


def _filled(allowed: Allowed, count: int) -> list[tuple[Any, float]]:
    """The groups that have candidates, with their shares."""
    every = np.arange(count)
    return [(g, share) for g, share in zip(allowed.groups, allowed.shares, strict=True) if len(every[g])]


def _uniform(allowed: Allowed, count: int) -> Array:
    weights = np.zeros(count)
    for members, share in _filled(allowed, count):
        weights[members] = share / len(weights[members])
    return weights


def _whitened(cp: Any, rows: Array, w: Any, uniform: Array, before: Array) -> tuple[Any, Array]:
    """S = L^-1 M L^-T as a function of w, and L^-1, with L L' the uniform design's information."""
    flat = (rows * np.sqrt(uniform)[:, None, None]).reshape(-1, rows.shape[-1])
    try:
        L = np.linalg.cholesky(flat.T @ flat + before)
    except np.linalg.LinAlgError as error:
        raise NotIdentifiable("all candidates together do not identify the parameters") from error
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


def _objective(
    cp: Any, criterion: Criterion, S: Any, inverse: Array, scale: float, constraints: list[Any]
) -> tuple[Any, Slope]:
    """psi / scale in cvxpy's words, or log psi for a determinant, and its slope; M = L S L', inverse = L^-1."""
    if isinstance(criterion, Linear):
        weight = np.eye(len(inverse)) if criterion.weight is None else criterion.weight
        return _variance(cp, criterion, weight, S, inverse, scale, constraints)
    if isinstance(criterion, Sum):
        parts = [(share, part, *_powered(cp, part, S, inverse, scale, constraints)) for share, part in criterion.parts]

        def slope(M: Array) -> Array:
            each = [share * float(part.value(M)) * of(M) for share, part, _, of in parts]
            return np.sum(each, axis=0) / float(criterion.value(M))

        return sum(share * term for share, _, term, _ in parts), slope
    if isinstance(criterion, Determinant):
        return _determinant(cp, criterion, S, inverse, constraints), lambda M: criterion.expansion(M).slope
    raise NotCertified(f"cvxpy has no form for the criterion {criterion.name}")


def _determinant(cp: Any, criterion: Determinant, S: Any, inverse: Array, constraints: list[Any]) -> Any:
    if criterion.directions is None:
        return -cp.log_det(S) / len(inverse)
    pick = inverse @ criterion.directions
    X = cp.Variable((pick.shape[1],) * 2, symmetric=True)  # below the information about these directions
    constraints.append(S - pick @ X @ pick.T >> 0)
    return -cp.log_det(X) / pick.shape[1]


def _variance(
    cp: Any, criterion: Criterion, weight: Array, S: Any, inverse: Array, scale: float, constraints: list[Any]
) -> tuple[Any, Slope]:
    """tr(W cov), W (p, p). With Z >= 0 the dual, tr(W cov*) <Z, M*> >= (tr (W^1/2 Z W^1/2)^1/2)^2."""
    p = len(inverse)
    X = cp.Variable((p, p), symmetric=True)
    above = cp.bmat([[S, np.eye(p)], [np.eye(p), X]]) >> 0  # X is above the covariance
    constraints.append(above)

    def slope(M: Array) -> Array:
        half, Z = root(weight), inverse.T @ above.dual_value[:p, :p] @ inverse
        Z = root(Z) @ root(Z).T  # without the rounding that makes it indefinite
        least = float(np.sqrt(np.linalg.eigvalsh(half.T @ Z @ half).clip(0.0)).sum()) ** 2
        return Z * float(criterion.value(M)) / least

    return cp.trace(inverse @ weight @ inverse.T / scale @ X), slope


def _offset(criterion: Criterion, inverse: Array) -> float:
    """log psi less what `_objective` says of it: the whitening's own determinant."""
    if not isinstance(criterion, Determinant) or criterion.directions is not None:
        return 0.0
    return criterion.shift + 2.0 * float(np.log(np.abs(np.diag(inverse))).sum()) / inverse.shape[0]


def _powered(
    cp: Any, part: Criterion, S: Any, inverse: Array, scale: float, constraints: list[Any]
) -> tuple[Any, Slope]:
    term, slope = _objective(cp, part, S, inverse, scale, constraints)
    return (np.exp(_offset(part, inverse)) / scale * cp.exp(term) if _is_log(part) else term), slope


def _run(cp: Any, objective: Any, constraints: list[Any], w: Any, allowed: Allowed) -> Array:
    problem = cp.Problem(cp.Minimize(objective), constraints)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the certificate, not the solver's word, decides
        try:
            problem.solve(solver=SOLVER, chordal_decomposition_enable=False, **_SETTINGS)
        except cp.error.SolverError as error:
            raise NotCertified(f"{SOLVER} failed: {error}") from error
    if w.value is None:
        raise NotCertified(f"{SOLVER} found no design: {problem.status}")
    weights = np.maximum(np.asarray(w.value, dtype=float), 0.0)
    for members, share in zip(allowed.groups, allowed.shares, strict=True):
        total = weights[members].sum()
        weights[members] *= share / total if total > 0 else 0.0
    return weights
