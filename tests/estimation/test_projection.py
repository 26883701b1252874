"""What a fit without some of its readings would leave: against refits by brute force."""

from __future__ import annotations

import numpy as np
import pytest

from qsframework.estimation import (
    Independent,
    Noise,
    falls,
    grouped,
    left,
    orthonormal,
    shifts,
    studentised,
    without_block,
)
from qsframework.plugin import Array, Indices

blocks: Indices = np.repeat(np.arange(9), [1, 1, 2, 3, 3, 3, 6, 6, 15])
"""Blocks of one to fifteen readings, several of them of the same size."""


def problem(seed: int = 0, carried: bool = False) -> tuple[Array, Array]:
    """Columns (m, 5) of very different size and readings (m,), whitened; carried: block 3 alone tells the last."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(blocks))
    A = rng.normal(size=(len(blocks), 5)) * [1.0, 1e-6, 1e5, 3.0, 0.1]
    if carried:
        A[blocks[order] != 3, 4] = 0.0
    return A[np.argsort(order)], rng.normal(size=len(blocks))


def refit(A: Array, y: Array, kept: np.ndarray) -> tuple[Array, float]:
    """Values of a fit of some readings, and the sum of squares that it leaves of them."""
    size = np.linalg.norm(A, axis=0)
    z = np.linalg.lstsq(A[kept] / size, y[kept], rcond=None)[0] / size
    return z, float(np.square(y[kept] - A[kept] @ z).sum())


def test_errors_without_each_block_are_those_of_refits() -> None:
    A, y = problem()
    Q = orthonormal(A)
    out = without_block(Q, left(Q, y), blocks)
    for one in np.unique(blocks):
        mine = blocks == one
        z, _ = refit(A, y, ~mine)
        assert out[mine] == pytest.approx(y[mine] - A[mine] @ z, rel=1e-9, abs=1e-10), one


def test_blocks_need_not_stand_together() -> None:
    """Labels in any order, and numbers with gaps."""
    A, y = problem(1)
    Q = orthonormal(A)
    order = np.random.default_rng(2).permutation(len(y))
    mixed = without_block(Q[order], left(Q, y)[order], 7 * blocks[order] + 3)
    assert mixed == pytest.approx(without_block(Q, left(Q, y), blocks)[order], rel=1e-9)


def test_falls_of_the_sum_of_squares_are_those_of_refits() -> None:
    A, y = problem()
    Q = orthonormal(A)
    fall, label, size = falls(Q, left(Q, y), blocks)
    assert label.tolist() == list(range(9))
    assert size.tolist() == [1, 1, 2, 3, 3, 3, 6, 6, 15]
    _, whole = refit(A, y, np.ones(len(y), dtype=bool))
    for one, by in zip(label, fall, strict=True):
        assert by == pytest.approx(whole - refit(A, y, blocks != one)[1], rel=1e-9), one


def test_a_block_that_alone_carries_a_parameter_cannot_be_left_out() -> None:
    """It has no errors (NaN) and no fall; those of the others are right all the same."""
    A, y = problem(carried=True)
    mine = np.flatnonzero(A[:, 4])
    label = np.where(A[:, 4] != 0.0, 3, np.where(blocks == 3, 20, blocks))
    assert len(mine) == 3
    Q = orthonormal(A)
    out, (fall, told, _) = without_block(Q, left(Q, y), label), falls(Q, left(Q, y), label)
    assert np.isnan(out[mine]).all()
    assert fall[told == 3] == 0.0
    rest = np.setdiff1d(label, [3])
    for one in rest:
        z, _ = refit(A, y, label != one)
        assert out[label == one] == pytest.approx(y[label == one] - A[label == one] @ z, rel=1e-8, abs=1e-9)
    assert np.isfinite(np.delete(out, mine)).all()


def test_rows_of_no_block_are_passed_over() -> None:
    A, y = problem()
    Q = orthonormal(A)
    some = np.where(blocks == 4, -1, blocks)
    out, whole = without_block(Q, left(Q, y), some), without_block(Q, left(Q, y), blocks)
    assert np.isnan(out[blocks == 4]).all()
    assert np.array_equal(out[blocks != 4], whole[blocks != 4])
    nothing = falls(Q, left(Q, y), np.full(len(y), -1))
    assert [len(part) for part in nothing] == [0, 0, 0]


def test_many_blocks_at_once_are_each_right() -> None:
    """More than are inverted together."""
    rng = np.random.default_rng(4)
    count, size = 12_000, 12
    A, y = rng.normal(size=(count * size, 3)), rng.normal(size=count * size)
    label = np.repeat(np.arange(count), size)
    Q = orthonormal(A)
    out = without_block(Q, left(Q, y), label)
    for one in (0, 5_000, count - 1):
        mine = label == one
        assert out[mine] == pytest.approx(y[mine] - A[mine] @ refit(A, y, ~mine)[0], rel=1e-9, abs=1e-10)


def test_columns_of_any_size_reach_what_they_reach() -> None:
    """A column of 1e-6 counts as one of 1e5; one of zeros and one that is a sum of others do not."""
    A, _ = problem()
    Q = orthonormal(np.column_stack([A, np.zeros(len(A)), A[:, 0] + 1e6 * A[:, 1]]))
    assert Q.shape == (len(A), 5)
    assert pytest.approx(np.eye(5), abs=1e-12) == Q.T @ Q
    assert left(Q, A / np.linalg.norm(A, axis=0)) == pytest.approx(np.zeros_like(A), abs=1e-12)
    assert orthonormal(A, rank=2).shape == (len(A), 2)
    assert orthonormal(A[:, :0]).shape == (len(A), 0)


def noises(m: int) -> list[Noise]:
    rng = np.random.default_rng(3)
    sigma = rng.uniform(0.5, 2.0, m)
    return [Independent(sigma), grouped(sigma, [(np.arange(m) // 4, np.full(m, 1.3))])]


@pytest.mark.parametrize("which", [0, 1], ids=["independent", "shared"])
def test_studentised_residuals_are_shifts_of_one_reading_in_a_refit(which: int) -> None:
    A, y = problem(5)
    noise = noises(len(y))[which]
    W = noise.whiten(A)
    Q = orthonormal(W)
    white = left(Q, noise.whiten(y))
    found = studentised(white, Q, noise)
    t, q = shifts(white, Q, noise)
    for i in (0, 7, 22, len(y) - 1):
        shift = noise.whiten(np.eye(len(y))[:, i])
        B = np.column_stack([W / np.linalg.norm(W, axis=0), shift])
        z, rest, *_ = np.linalg.lstsq(B, noise.whiten(y), rcond=None)
        sd = np.sqrt(rest[0] / (len(y) - 6) * np.linalg.inv(B.T @ B)[5, 5])
        assert found[i] == pytest.approx(z[5] / sd, rel=1e-8)
        assert t[i] ** 2 / (1.0 - q[i] @ q[i]) == pytest.approx(float(white @ white) - rest[0], rel=1e-8)
