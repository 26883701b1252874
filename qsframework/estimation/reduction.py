"""From all parameters to free, scaled variables: fixed ones left out, tied ones moved together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from qsframework.errors import InputError, Problem, nearest
from qsframework.estimation.observations import scales
from qsframework.plugin import Array, Parameter


@dataclass(frozen=True, eq=False, kw_only=True)
class Reduction:
    """x = start + T z: T (p, q) of q free variables, with bounds (q,) on z; z = 0 is the start.

    names: the parameters that each free variable moves; moved (p,): whether a parameter is free; spread (q,): how far
    a prior or the size of the parameter lets it be from the start, in z; least, most (p,): the parameters' bounds
    """

    start: Array
    T: Array
    lower: Array
    upper: Array
    names: tuple[tuple[str, ...], ...]
    spread: Array
    least: Array
    most: Array

    @property
    def free(self) -> int:
        return self.T.shape[1]

    @property
    def moved(self) -> npt.NDArray[np.bool_]:
        return np.any(self.T != 0.0, axis=1)

    def x(self, z: Array) -> Array:
        """Parameters (p,); on a bound exactly where z is."""
        return np.clip(self.start + self.T @ z, self.least, self.most)


def reduce(
    parameters: Sequence[Parameter],
    start: Array,
    fixed: Sequence[str],
    tied: Sequence[Sequence[str]],
    bounds: bool = True,
) -> Reduction:
    """The free variables. InputError where a name is unknown, or what is tied cannot be.

    bounds: whether those of the parameters are kept; what cannot exist is outside of them all the same
    """
    ends = [(p.lower, p.upper) if bounds else (-np.inf, np.inf) for p in parameters]
    parameters = [
        replace(p, lower=max(low, min(p.domain[0], at)), upper=min(high, max(p.domain[1], at)))
        for p, (low, high), at in zip(parameters, ends, start, strict=True)
    ]
    names = [p.name for p in parameters]
    groups = [[_index(name, names) for name in group] for group in tied]
    kept = {_index(name, names) for name in fixed}
    _check(groups, parameters)
    member = {i for group in groups for i in group}
    units = [[i] for i in range(len(names)) if i not in kept and i not in member] + groups
    units.sort(key=lambda g: g[0])
    if not units:
        raise InputError("every parameter is fixed: nothing is left to estimate")
    size = scales(list(parameters))
    start = np.array(start, dtype=float)
    T = np.zeros((len(names), len(units)))
    lower, upper = np.full(len(units), -np.inf), np.full(len(units), np.inf)
    for k, group in enumerate(units):
        T[group, k] = size[group] if len(group) == 1 else _together(group, parameters, start, size)
        for i in group:
            low, high = sorted((end - start[i]) / T[i, k] for end in (parameters[i].lower, parameters[i].upper))
            lower[k], upper[k] = max(lower[k], low), min(upper[k], high)
    if np.any(lower > 0) or np.any(upper < 0):
        k = int(np.flatnonzero((lower > 0) | (upper < 0))[0])
        raise InputError(f"{names[units[k][0]]}: the fit starts outside its bounds")
    spread = np.array([parameters[g[0]].sd or parameters[g[0]].scale for g in units]) / np.abs(
        [T[g[0], k] for k, g in enumerate(units)]
    )
    owned = tuple(tuple(names[i] for i in g) for g in units)
    least, most = (np.array([getattr(p, end) for p in parameters]) for end in ("lower", "upper"))
    return Reduction(
        start=start,
        T=T,
        lower=lower,
        upper=upper,
        names=owned,
        spread=spread,
        least=np.minimum(least, start),
        most=np.maximum(most, start),
    )


def _together(group: Sequence[int], parameters: Sequence[Parameter], start: Array, size: Array) -> Array:
    """Direction of a tied group: in proportion to the nominal values, all alike where these are zero."""
    nominal = np.array([parameters[i].nominal for i in group])
    direction = nominal / nominal[0] if nominal[0] != 0.0 else np.ones(len(group))
    start[group] = start[group[0]] * direction
    return direction * size[group[0]]


def _index(name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise InputError(
            Problem(f"the fit has no parameter {name!r}", allowed=", ".join(names), hint=nearest(name, names))
        )
    return list(names).index(name)


def _check(groups: Sequence[Sequence[int]], parameters: Sequence[Parameter]) -> None:
    for group in groups:
        zero = {parameters[i].nominal == 0.0 for i in group}
        if len({parameters[i].unit for i in group}) > 1 or len(zero) > 1:
            raise InputError(
                f"{', '.join(parameters[i].name for i in group)} cannot be tied: tied parameters have one unit, and "
                "keep the ratios of their nominal values, which are all zero or all not"
            )
