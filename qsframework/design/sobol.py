"""Sobol points, scrambled: the same for a seed as SciPy's, whose module takes as long to load as a whole design.

Directions of Joe and Kuo (2008), scrambled by a random matrix and a shift as Matousek (1998) does.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from qsframework.errors import InputError
from qsframework.plugin import Array

_BITS = 30
_WEIGHTS = 2 ** np.arange(_BITS, dtype=np.uint32)
# fmt: off
_DIRECTIONS = (
    (3, 1), (7, 1, 3), (11, 1, 3, 1), (13, 1, 1, 1), (19, 1, 1, 3, 3), (25, 1, 3, 5, 13), (37, 1, 1, 5, 5, 17),
    (41, 1, 1, 5, 5, 5), (47, 1, 1, 7, 11, 19), (55, 1, 1, 5, 1, 1), (59, 1, 1, 1, 3, 11), (61, 1, 3, 5, 5, 31),
    (67, 1, 3, 3, 9, 7, 49), (91, 1, 1, 1, 15, 21, 21), (97, 1, 3, 1, 13, 27, 49), (103, 1, 1, 1, 15, 7, 5),
    (109, 1, 3, 1, 15, 13, 25), (115, 1, 1, 5, 5, 19, 61), (131, 1, 3, 7, 11, 23, 15, 103),
    (137, 1, 3, 7, 13, 13, 15, 69), (143, 1, 1, 3, 13, 7, 35, 63), (145, 1, 3, 5, 9, 1, 25, 53),
    (157, 1, 3, 1, 13, 9, 35, 107), (167, 1, 3, 1, 5, 27, 61, 31), (171, 1, 1, 5, 11, 19, 41, 61),
    (185, 1, 3, 5, 3, 3, 13, 69), (191, 1, 1, 7, 13, 1, 19, 1), (193, 1, 3, 7, 5, 13, 19, 59),
    (203, 1, 1, 3, 9, 25, 29, 41), (211, 1, 3, 5, 13, 23, 1, 55), (213, 1, 3, 7, 3, 13, 59, 17),
    (229, 1, 3, 1, 3, 5, 53, 69), (239, 1, 1, 5, 5, 23, 33, 13), (241, 1, 1, 7, 7, 1, 61, 123),
    (247, 1, 1, 7, 9, 13, 61, 49), (253, 1, 3, 3, 5, 3, 55, 33), (285, 1, 3, 1, 15, 31, 13, 49, 245),
    (299, 1, 3, 5, 15, 31, 59, 63, 97), (301, 1, 3, 1, 11, 11, 11, 77, 249),
)
# fmt: on
"""From the second dimension on: the primitive polynomial and the first direction numbers."""
MOST = len(_DIRECTIONS) + 1
"""Dimensions that have their directions here."""


def sobol(dimensions: int, block: int, seed: int) -> Iterator[Array]:
    """Blocks (block, dimensions) of the sequence, in [0, 1); block must be a power of two."""
    if dimensions > MOST:
        raise InputError(f"poses are drawn for at most {MOST} joints; give the candidates as a file of poses")
    rng = np.random.default_rng(seed).spawn(1)[0]  # as SciPy draws
    shift = rng.integers(2, size=(dimensions, _BITS), dtype=np.uint32) @ _WEIGHTS
    matrices = np.tril(rng.integers(2, size=(dimensions, _BITS, _BITS), dtype=np.uint32), -1)
    directions = _scrambled(np.stack([_directions(k) for k in range(dimensions)]), matrices)
    for first in range(0, 2**_BITS, block):
        count = np.arange(first, first + block, dtype=np.uint32)
        gray, point = count ^ (count >> 1), np.tile(shift, (block, 1))
        for bit in range(int(gray.max()).bit_length()):
            point ^= ((gray >> bit) & 1)[:, None] * directions[:, bit]
        yield point.astype(float) * 2.0**-_BITS


def _directions(dimension: int) -> npt.NDArray[np.uint32]:
    """The direction numbers (bits,) of a dimension, as fractions of 2**bits."""
    numbers = [1] * _BITS
    if dimension:
        polynomial, *first = _DIRECTIONS[dimension - 1]
        degree = len(first)
        numbers[:degree] = first
        for j in range(degree, _BITS):
            new = numbers[j - degree]
            for k in range(1, degree + 1):
                if polynomial >> (degree - k) & 1:
                    new ^= numbers[j - k] << k
            numbers[j] = new
    return np.array([number << (_BITS - 1 - j) for j, number in enumerate(numbers)], dtype=np.uint32)


def _scrambled(directions: npt.NDArray[np.uint32], below: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
    """Each direction number, its highest bit first, times a matrix with ones on the diagonal and `below` under it."""
    high = np.arange(_BITS - 1, -1, -1, dtype=np.uint32)
    bits = (directions[:, :, None] >> high) & 1
    mixed = (bits + np.einsum("dpk,djk->djp", below, bits)) & 1
    return mixed @ _WEIGHTS[::-1]
