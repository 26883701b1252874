"""A scrambled Sobol sequence: points that fill the unit cube evenly, and go on where they stopped.

Point n is the exclusive or of the direction numbers that the bits of n ^ (n >> 1) name, with a random shift; the
numbers' bits are mixed by a random lower triangle (Matousek 1998). It gives SciPy's points, without the second that
importing scipy.stats takes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from qsframework.errors import InputError
from qsframework.plugin import Array, Indices

_BITS = 30
_DIRECTIONS = (
    (3, (1,)),
    (7, (1, 3)),
    (11, (1, 3, 1)),
    (13, (1, 1, 1)),
    (19, (1, 1, 3, 3)),
    (25, (1, 3, 5, 13)),
    (37, (1, 1, 5, 5, 17)),
    (41, (1, 1, 5, 5, 5)),
    (47, (1, 1, 7, 11, 19)),
    (55, (1, 1, 5, 1, 1)),
    (59, (1, 1, 1, 3, 11)),
    (61, (1, 3, 5, 5, 31)),
    (67, (1, 3, 3, 9, 7, 49)),
    (91, (1, 1, 1, 15, 21, 21)),
    (97, (1, 3, 1, 13, 27, 49)),
)
"""Primitive polynomials, as bits, and first numbers of the axes from the second on: Joe and Kuo, 2008."""


def sobol_blocks(axes: int, block: int, seed: int) -> Iterator[Array]:
    """Blocks (block, axes) of the sequence of a seed, without an end. InputError for more axes than the table has."""
    if axes > 1 + len(_DIRECTIONS):
        raise InputError(f"candidates are drawn for at most {1 + len(_DIRECTIONS)} joints, found {axes}; give poses")
    (rng,), powers = np.random.default_rng(seed).spawn(1), 2 ** np.arange(_BITS)
    shift = rng.integers(2, size=(axes, _BITS), dtype=np.uint32) @ powers
    triangle = np.tril(rng.integers(2, size=(axes, _BITS, _BITS), dtype=np.uint32), -1) + np.eye(_BITS, dtype=np.uint32)
    bits = _numbers(axes)[:, :, None] >> np.arange(_BITS)[::-1] & 1
    mixed = np.einsum("dpk,djk->djp", triangle, bits) % 2 @ powers[::-1]
    first = 0
    while True:
        n = np.arange(first, first + block)
        named = (n ^ n >> 1)[:, None] >> np.arange(_BITS) & 1
        points = np.bitwise_xor.reduce(np.where(named[:, None], mixed, 0), axis=2) ^ shift
        yield points / 2.0**_BITS
        first += block


def _numbers(axes: int) -> Indices:
    """Direction numbers (axes, _BITS), the highest bit that of a half."""
    rows = [[1] * _BITS]
    for polynomial, start in _DIRECTIONS[: axes - 1]:
        degree, row = len(start), list(start)
        for j in range(degree, _BITS):
            number = row[j - degree]
            for k in range(degree):
                number ^= row[j - k - 1] << k + 1 if polynomial >> degree - 1 - k & 1 else 0
            row.append(number)
        rows.append(row)
    return np.array(rows) << np.arange(_BITS)[::-1]
