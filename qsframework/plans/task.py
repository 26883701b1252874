"""What a relaxed design is asked for: candidates, groups, criterion, in coordinates that are well conditioned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from qsframework.information import Allowed, CandidateRows
from qsframework.plans.criteria import Mean
from qsframework.plugin import Array, Indices

_FEW = 1024


@dataclass(frozen=True, eq=False)
class RelaxedTask:
    """What to solve: rows of N candidates, the group of each (N,), the allowed designs, information M0 (S, p, p).

    criterion and prior are those of T' M T with the basis T (p, p), in which a random design is well conditioned
    """

    rows: CandidateRows
    label: npt.NDArray[np.int16]
    allowed: Allowed
    criterion: Mean
    prior: Array
    basis: Array

    def take(self, index: Indices) -> Array:
        """Rows of candidates in the basis."""
        block = self.rows.take(index)
        return (block.reshape(-1, self.rows.parameters) @ self.basis).reshape(block.shape)  # one product, not many

    @property
    def shares(self) -> Array:
        return np.array(self.allowed.shares)

    def within(self, index: Indices) -> Allowed:
        """The allowed designs over some candidates."""
        labels = self.label[index]
        groups = tuple(np.flatnonzero(labels == g) for g in range(len(self.allowed.shares)))
        return Allowed(groups, self.allowed.shares, self.allowed.cap)


def make_task(rows: CandidateRows, criterion: Mean, allowed: Allowed, prior: Array | None = None) -> RelaxedTask:
    """A task; InputError-free: shapes are the caller's concern, groups must cover what carries a share."""
    count, p = len(rows), rows.parameters
    label = np.zeros(count, dtype=np.int16)
    for g, members in enumerate(allowed.groups):
        label[members] = g
    before = np.zeros((rows.scenarios, p, p)) if prior is None else prior
    cap = allowed.cap if allowed.cap < max(allowed.shares) else np.inf
    T = white_basis(rows.take(_few(label, allowed)), before)
    allowed = Allowed(allowed.groups, allowed.shares, cap)
    return RelaxedTask(rows, label, allowed, criterion.in_basis(T), T.T @ before @ T, T)


def _few(label: npt.NDArray[np.int16], allowed: Allowed) -> Indices:
    """Some candidates of every group that carries a share, evenly spread."""
    parts = [
        np.flatnonzero(label == g) if len(allowed.shares) > 1 else np.arange(len(label))
        for g, share in enumerate(allowed.shares)
        if share > 0
    ]
    return np.concatenate([part[:: max(1, len(part) // _FEW)] for part in parts])


def white_basis(block: Array, prior: Array) -> Array:
    """T (p, p) with which T' M T of the rows (m, S, k, p) and M0 (S, p, p) is near the identity.

    Where they do not tell every parameter, T only brings the parameters to one size.
    """
    p = block.shape[-1]
    values, vectors = np.linalg.eigh(prior[0])
    flat = np.concatenate([block[:, 0].reshape(-1, p) / np.sqrt(len(block)), (vectors * np.sqrt(values.clip(0))).T])
    size = np.linalg.norm(flat, axis=0)
    size = np.where(size > 0, size, 1.0)
    triangle = np.asarray(np.linalg.qr(flat / size, mode="r"), dtype=np.float64)
    if len(triangle) < p or np.linalg.cond(triangle) > 1e12:
        return np.diag(1.0 / size)
    return np.asarray(np.linalg.inv(triangle), dtype=np.float64) / size[:, None]
