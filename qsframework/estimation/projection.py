"""The projection beside a fit: orthonormal columns, what they leave, and blocks of readings held against them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from qsframework.plugin import Array, Indices

Flags = npt.NDArray[np.bool_]
Real = npt.NDArray[np.floating[Any]]
CARRIED = 1e-10
"""Share of a direction of a block that other readings must carry; below it that block alone tells a parameter."""
_SEEN = 0.1
"""s per sd of what is known before from which readings tell more of a direction: three times that sd is then still
below the noise where it is left out."""
_AT_ONCE = 1 << 24
"""Bytes of the matrices that are inverted together."""


def orthonormal(columns: Array, rank: int | None = None) -> Array:
    """Orthonormal columns (m, f) of what columns (m, p), of any sizes, can reach; f at most `rank`."""
    if not columns.shape[1]:
        return np.zeros(columns.shape)
    size: Array = np.linalg.norm(columns, axis=0)
    U, values, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    kept = int((values > 1e-9 * values.max(initial=0.0)).sum())
    return np.ascontiguousarray(U[:, : kept if rank is None else min(kept, rank)])


def spanned(columns: Array, weight: Array) -> Array:
    """Orthonormal columns (m, f) of what whitened columns (m, p) can reach, without the directions of which the
    readings say next to nothing beside what is known before them: weight (p,), 1 / sd of that, 0 where nothing is."""
    free = orthonormal(columns[:, weight == 0.0])
    U, values, _ = np.linalg.svd(left(free, columns[:, weight > 0.0] / weight[weight > 0.0]), full_matrices=False)
    return np.concatenate([free, U[:, values > _SEEN]], axis=1)


def left(Q: Array, values: Array) -> Array:
    """What orthonormal columns (m, p) do not reach of m numbers or of columns (m, k), in their shape.

    Taken out twice, so that what is nearly reached keeps its digits.
    """
    flat = values if values.ndim == 2 and len(values) == len(Q) else values.reshape(-1)
    once = flat - Q @ (Q.T @ flat)
    return (once - Q @ (Q.T @ once)).reshape(values.shape)


def least_squares(columns: Real, readings: Real, told: float | None = None) -> Array:
    """The coefficients (p,) or (p, k) of columns (m, p), of any sizes, that come closest to readings (m,) or (m, k).

    told: share of the largest singular value below which a direction stays zero, None: what rounding leaves
    """
    size: Array = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return np.asarray((np.linalg.lstsq(columns / size, readings, rcond=told)[0].T / size).T, dtype=np.float64)


def blocks_of(label: Indices) -> list[Indices]:
    """Positions of each label >= 0: for every size s of a block, (B, s)."""
    kept = np.flatnonzero(label >= 0)
    _, own = np.unique(label[kept], return_inverse=True)
    if not len(own):
        return []
    order, counts = kept[np.argsort(own, kind="stable")], np.bincount(own)
    first = np.cumsum(counts) - counts
    return [order[first[counts == size][:, None] + np.arange(size)] for size in np.unique(counts).tolist()]


def solved(
    Q: Array, at: Indices, values: Array, carried: float | None = CARRIED
) -> Iterator[tuple[slice, Flags, Array]]:
    """(I - Q_i Q_i')^-1 values_i for blocks at (B, s), and whether the other readings can do without each block; None
    for `carried`: they can.

    Yields parts of the blocks: which, told (b,), and the solutions (b, s), zero where they are not told.
    """
    size, columns = at.shape[1], Q.shape[1]
    step = max(1, _AT_ONCE // (8 * size * max(size, columns)))
    for start in range(0, len(at), step):
        part = slice(start, min(start + step, len(at)))
        q, v = Q[at[part]], values[at[part]][..., None]
        back = q.transpose(0, 2, 1)
        rest = np.eye(min(size, columns)) - (
            q @ back if size <= columns else back @ q
        )  # of either, the same directions
        told = (
            np.ones(len(q), dtype=bool)
            if carried is None
            else np.linalg.eigvalsh(rest).min(axis=1, initial=1.0) > carried
        )
        out = np.zeros(v.shape)
        if size <= columns:
            out[told] = np.linalg.solve(rest[told], v[told])
        else:
            out[told] = v[told] + q[told] @ np.linalg.solve(rest[told], back[told] @ v[told])
        yield part, told, out[..., 0]
