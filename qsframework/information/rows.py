"""The whitened rows of many candidates, read in chunks: from memory, or made when asked.

A candidate has one block of k rows for each scenario of the parameters: (S, k, p), S = 1 unless a
design is to be robust. All passes over the candidates go through `scores` and `weighted_information`.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Indices
from qsframework.work.threads import single_thread

_CHUNK_BYTES = 1 << 21
_LARGE = 20_000
"""Candidates above which a pass is shared by threads."""


class CandidateRows(ABC):
    """N candidates with S scenarios of k rows for p parameters, per unit of each parameter's scale."""

    shape: tuple[int, int, int, int]

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def scenarios(self) -> int:
        return self.shape[1]

    @property
    def parameters(self) -> int:
        return self.shape[3]

    def read(self, start: int, stop: int) -> Array:
        """Rows (stop - start, S, k, p); the array is the reader's until the next call."""
        return self.take(np.arange(start, stop))

    @abstractmethod
    def take(self, index: Indices) -> Array:
        """Rows (m, S, k, p) of chosen candidates, in memory."""

    def chunks(self, start: int = 0, stop: int | None = None) -> Iterator[tuple[int, int]]:
        """Ranges that fit the processor's cache."""
        stop = len(self) if stop is None else stop
        step = max(64, _CHUNK_BYTES // (8 * int(np.prod(self.shape[1:]))))
        for first in range(start, stop, step):
            yield first, min(first + step, stop)


@dataclass(frozen=True, eq=False)
class HeldRows(CandidateRows):
    """Rows in memory, (N, S, k, p) float64."""

    values: Array

    @property
    def shape(self) -> tuple[int, int, int, int]:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.values.shape

    def read(self, start: int, stop: int) -> Array:
        return self.values[start:stop]

    def take(self, index: Indices) -> Array:
        return np.take(self.values, index, axis=0)


@dataclass(frozen=True, eq=False)
class MadeRows(CandidateRows):
    """Rows that `make(index (m,)) -> (m, S, k, p)` computes whenever a pass asks for them; nothing is held."""

    make: Callable[[Indices], Array]
    shape: tuple[int, int, int, int]

    def take(self, index: Indices) -> Array:
        return self.make(np.asarray(index))


@dataclass(frozen=True, eq=False)
class ScaledRows(CandidateRows):
    """Rows of another source, each candidate's times its factor (N,)."""

    source: CandidateRows
    factor: Array

    @property
    def shape(self) -> tuple[int, int, int, int]:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.source.shape

    def read(self, start: int, stop: int) -> Array:
        return self.source.read(start, stop) * self.factor[start:stop, None, None, None]

    def take(self, index: Indices) -> Array:
        return self.source.take(index) * self.factor[index][:, None, None, None]


def as_rows(values: Array | CandidateRows) -> CandidateRows:
    """Rows (N, k, p), or (N, S, k, p) with scenarios, as a source that passes can read."""
    if isinstance(values, CandidateRows):
        return values
    return HeldRows(values[:, None] if values.ndim == 3 else values)


def root(gradient: Array) -> Array:
    """B (p, r) with G = B B', r the rank that counts; the scale of a parameter costs no accuracy."""
    size = np.sqrt(np.maximum(np.diagonal(gradient), 0.0))
    safe = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(gradient / np.outer(safe, safe))
    kept = values > 1e-15 * max(float(values[-1]), 0.0)
    return np.ascontiguousarray(size[:, None] * vectors[:, kept] * np.sqrt(values[kept]))


def block_scores(block: Array, roots: list[Array]) -> Array:
    """Sum over scenarios of |A_i B|_F^2 (n,) for a block (n, S, k, p)."""
    total = np.zeros(len(block))
    for s, B in enumerate(roots):
        X = (block[:, s].reshape(-1, block.shape[-1]) @ B).reshape(len(block), -1)
        total += np.vecdot(X, X)
    return total


def scores(
    rows: Array | CandidateRows,
    gradient: Array,
    threads: int | None = None,
    basis: Array | None = None,
    index: Indices | None = None,
) -> Array:
    """tr(G M_i) = |A_i B|_F^2 for every candidate (N,), with G = B B' (p, p) or (S, p, p): one full pass.

    basis T (p, p): the gradient is that of T' M T, and G = T gradient T'; index (m,): these candidates only
    """
    source = as_rows(rows)
    roots = [root(G) for G in gradient.reshape(-1, *gradient.shape[-2:])]
    roots = roots if basis is None else [basis @ B for B in roots]
    out = np.empty(len(source) if index is None else len(index))

    def share(start: int, stop: int) -> None:
        for first, last in source.chunks(start, stop):
            block = source.read(first, last) if index is None else source.take(index[first:last])
            out[first:last] = block_scores(block, roots)

    run_shared(share, len(out), threads)
    return out


def run_shared(job: Callable[[int, int], None], count: int, threads: int | None = None) -> None:
    """Run job(start, stop) over all candidates, shared by threads; linear algebra itself keeps to one thread."""
    workers = threads or min(os.cpu_count() or 1, 8)
    with single_thread():
        if workers == 1 or count < _LARGE:
            job(0, count)
            return
        ends = np.linspace(0, count, workers + 1).astype(int).tolist()
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(job, ends[:-1], ends[1:]))


def weighted_information(rows: Array | CandidateRows, weights: Array | Indices) -> Array:
    """M(w) = sum of w_i A_i' A_i: (p, p), or (S, p, p) where rows have scenarios."""
    source = as_rows(rows)
    used = np.flatnonzero(np.asarray(weights))
    M = gathered_information(source, used, np.asarray(weights, dtype=np.float64)[used])
    return M[0] if isinstance(rows, np.ndarray) and rows.ndim == 3 else M


def gathered_information(source: CandidateRows, index: Indices, weights: Array) -> Array:
    """M (S, p, p) of chosen candidates and their weights."""
    p = source.parameters
    total = np.zeros((source.scenarios, p, p))
    step = max(1, (1 << 24) // (8 * int(np.prod(source.shape[1:]))))
    for first in range(0, len(index), step):
        part = slice(first, first + step)
        block = source.take(index[part]) * np.sqrt(weights[part])[:, None, None, None]
        for s in range(source.scenarios):
            flat = block[:, s].reshape(-1, p)
            total[s] += flat.T @ flat
    return total
