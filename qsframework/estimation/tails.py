"""Tail probabilities of chi-square, F, Student's t and the normal distribution.

`scipy.special` has them as plain functions; the distributions of `scipy.stats`, which give the same numbers, take a
quarter of a second to load, on every command.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np


def chi2_sf(x: Any, dof: Any) -> Any:
    """P(chi-square of `dof` > x); NaN for no degree of freedom."""
    return np.where(np.greater(dof, 0), _special().chdtrc(dof, np.maximum(x, 0.0)), np.nan)[()]


def chi2_cdf(x: Any, dof: Any) -> Any:
    """P(chi-square of `dof` < x)."""
    return _special().chdtr(dof, np.maximum(x, 0.0))


def chi2_isf(p: Any, dof: Any) -> Any:
    """The x that a chi-square of `dof` exceeds with probability p."""
    return _special().chdtri(dof, p)


def f_sf(x: Any, dof: Any, other: Any) -> Any:
    """P(F of `dof` and `other` > x); NaN for no degree of freedom."""
    both = np.greater(dof, 0) & np.greater(other, 0)
    return np.where(both, _special().fdtrc(dof, other, np.maximum(x, 0.0)), np.nan)[()]


def f_isf(p: Any, dof: Any, other: Any) -> Any:
    """The x that an F of `dof` and `other` exceeds with probability p."""
    return _special().fdtri(dof, other, 1.0 - p)


def t_isf(p: Any, dof: Any) -> Any:
    """The x that Student's t of `dof` exceeds with probability p."""
    return -_special().stdtrit(dof, p)


def normal_sf(x: Any) -> Any:
    """P(standard normal > x)."""
    return _special().ndtr(-x)


def normal_isf(p: Any) -> Any:
    """The x that a standard normal exceeds with probability p."""
    return -_special().ndtri(p)


def _special() -> Any:
    return import_module("scipy.special")
