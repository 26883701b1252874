"""What a fit without some of its readings would leave: against refits by brute force."""

from __future__ import annotations

import numpy as np
import pytest

from qsframework.estimation import (
    Independent,
    LinearFit,
    Noise,
    grouped,
    left,
    orthonormal,
)
from qsframework.estimation.linear_fit import Whitened, without_outliers
from qsframework.estimation.projection import Flags, spanned
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
    out = LinearFit(Q, left(Q, y)).held_out_errors(blocks)
    for one in np.unique(blocks):
        mine = blocks == one
        z, _ = refit(A, y, ~mine)
        assert out[mine] == pytest.approx(y[mine] - A[mine] @ z, rel=1e-9, abs=1e-10), one


def test_blocks_need_not_stand_together() -> None:
    """Labels in any order, and numbers with gaps."""
    A, y = problem(1)
    Q = orthonormal(A)
    order = np.random.default_rng(2).permutation(len(y))
    mixed = LinearFit(Q[order], left(Q, y)[order]).held_out_errors(7 * blocks[order] + 3)
    assert mixed == pytest.approx(LinearFit(Q, left(Q, y)).held_out_errors(blocks)[order], rel=1e-9)


def test_what_readings_hardly_tell_beside_what_is_known_is_not_taken_out() -> None:
    A, y = problem(3)
    nothing = np.zeros(A.shape[1])
    assert left(spanned(A, nothing), y) == pytest.approx(left(orthonormal(A), y), abs=1e-9)
    tight, loose = nothing.copy(), nothing.copy()
    tight[1], loose[1] = 1.0, 1e-9  # of readings that move by about 1e-6 in all
    assert left(spanned(A, tight), y) == pytest.approx(left(orthonormal(A[:, [0, 2, 3, 4]]), y), abs=1e-9)
    assert left(spanned(A, loose), y) == pytest.approx(left(orthonormal(A), y), abs=1e-9)


def test_falls_of_the_sum_of_squares_are_those_of_refits() -> None:
    A, y = problem()
    Q = orthonormal(A)
    alone = LinearFit(Q, left(Q, y)).held_out(blocks)
    assert alone.label.tolist() == list(range(9))
    assert alone.size.tolist() == [1, 1, 2, 3, 3, 3, 6, 6, 15]
    _, whole = refit(A, y, np.ones(len(y), dtype=bool))
    for one, by in zip(alone.label, alone.chi2_drop, strict=True):
        assert by == pytest.approx(whole - refit(A, y, blocks != one)[1], rel=1e-9), one


def test_a_block_that_alone_carries_a_parameter_cannot_be_left_out() -> None:
    """It has no errors (NaN) and no fall; those of the others are right all the same."""
    A, y = problem(carried=True)
    mine = np.flatnonzero(A[:, 4])
    label = np.where(A[:, 4] != 0.0, 3, np.where(blocks == 3, 20, blocks))
    assert len(mine) == 3
    Q = orthonormal(A)
    fit = LinearFit(Q, left(Q, y))
    out, alone = fit.held_out_errors(label), fit.held_out(label)
    assert np.isnan(out[mine]).all()
    assert alone.chi2_drop[alone.label == 3] == 0.0
    rest = np.setdiff1d(label, [3])
    for one in rest:
        z, _ = refit(A, y, label != one)
        assert out[label == one] == pytest.approx(y[label == one] - A[label == one] @ z, rel=1e-8, abs=1e-9)
    assert np.isfinite(np.delete(out, mine)).all()


def test_rows_of_no_block_are_passed_over() -> None:
    A, y = problem()
    Q = orthonormal(A)
    some = np.where(blocks == 4, -1, blocks)
    out, whole = LinearFit(Q, left(Q, y)).held_out_errors(some), LinearFit(Q, left(Q, y)).held_out_errors(blocks)
    assert np.isnan(out[blocks == 4]).all()
    assert np.array_equal(out[blocks != 4], whole[blocks != 4])
    nothing = LinearFit(Q, left(Q, y)).held_out(np.full(len(y), -1))
    assert [len(part) for part in (nothing.label, nothing.size, nothing.chi2_drop)] == [0, 0, 0]


def test_many_blocks_at_once_are_each_right() -> None:
    """More than are inverted together."""
    rng = np.random.default_rng(4)
    count, size = 12_000, 12
    A, y = rng.normal(size=(count * size, 3)), rng.normal(size=count * size)
    label = np.repeat(np.arange(count), size)
    Q = orthonormal(A)
    out = LinearFit(Q, left(Q, y)).held_out_errors(label)
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
    fit = LinearFit.of(A, y, noise)
    found, alone = fit.studentised(), fit.held_out(np.arange(len(y)))
    for i in (0, 7, 22, len(y) - 1):
        shift = noise.whiten(np.eye(len(y))[:, i])
        B = np.column_stack([W / np.linalg.norm(W, axis=0), shift])
        z, rest, *_ = np.linalg.lstsq(B, noise.whiten(y), rcond=None)
        sd = np.sqrt(rest[0] / (len(y) - 6) * np.linalg.inv(B.T @ B)[5, 5])
        assert found[i] == pytest.approx(z[5] / sd, rel=1e-8)
        assert alone.chi2_drop[i] == pytest.approx(fit.chi2 - rest[0], rel=1e-8)


def test_misfits_of_blocks_that_were_not_used_are_those_of_adding_them() -> None:
    """What a block adds to the sum of squares is the same whether it is taken out of the fit or put into it."""
    A, y = problem(6)
    whole = LinearFit(orthonormal(A), left(orthonormal(A), y))
    drops = whole.held_out(blocks).chi2_drop
    size = np.linalg.norm(A, axis=0)
    for one in (2, 6, 7):
        fit, x, half = Whitened(A, y).fit(blocks != one)
        assert fit.chi2 == pytest.approx(whole.chi2 - drops[one], rel=1e-9)
        assert fit.misfits(blocks, 9)[one] == pytest.approx(drops[one], rel=1e-8)
        z, _ = refit(A, y, blocks != one)
        assert x * size == pytest.approx(z * size, rel=1e-8, abs=1e-9)
        assert pytest.approx(np.eye(5), abs=1e-8) == half.T @ A[blocks != one].T @ A[blocks != one] @ half


def test_blocks_that_disagree_are_left_out_however_large_they_are() -> None:
    A, y = problem(7)
    wild = y.copy()
    wild[np.isin(blocks, (3, 6))] += 1e4

    def beyond(misfit: Array, wrong: Flags, fit: LinearFit | None) -> Flags:
        return misfit > 100.0

    found = without_outliers(lambda wrong: Whitened(A, wild), blocks, 9, beyond)
    assert np.flatnonzero(found.wrong).tolist() == [3, 6]
    assert found.fit.dof == int((~np.isin(blocks, (3, 6))).sum()) - 5


def test_columns_that_are_held_move_less() -> None:
    """A hold of 1 / sd counts as a reading of zero with that sd."""
    A, y = problem(8)
    held = np.array([0.0, 0.0, 0.0, 5.0, 50.0])
    x, _ = Whitened(A, y, held=held).solved(np.ones(len(y)))
    z, _ = refit(np.vstack([A, np.diag(held)]), np.append(y, np.zeros(5)), np.ones(len(y) + 5, dtype=bool))
    assert x == pytest.approx(z, rel=1e-7)


def test_a_block_not_used_that_alone_tells_its_columns_counts_as_good() -> None:
    """Where all are weakly held nothing else speaks against it, and the others err as they do beside it."""
    A, y = problem(10)
    mine = blocks == 3
    own = np.eye(len(y))[:, mine]
    y[mine] += 1e4
    given = Whitened(np.column_stack([A / np.linalg.norm(A, axis=0), own]), y, held=np.full(8, 1e-6))
    beside, aside = (given.fit(used)[0].misfits(blocks, 9) for used in (np.ones(len(y), dtype=bool), ~mine))
    assert beside[3] == 0.0
    assert aside[3] < 1e-3
    assert np.delete(aside, 3) == pytest.approx(np.delete(beside, 3), rel=1e-4)


def test_a_block_on_the_edge_does_not_go_out_and_in_for_ever() -> None:
    """Rounding may judge a block by what it was called before: the search ends all the same, and touches no other."""
    A, y = problem(9)

    def undecided(misfit: Array, wrong: Flags, fit: LinearFit | None) -> Flags:
        return (np.arange(9) == 3) & ~wrong

    found = without_outliers(lambda wrong: Whitened(A, y), blocks, 9, undecided)
    assert set(np.flatnonzero(found.wrong).tolist()) <= {3}
