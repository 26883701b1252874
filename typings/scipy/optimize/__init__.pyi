from collections.abc import Callable

import numpy as np
import numpy.typing as npt

_Array = npt.NDArray[np.float64]

class _Bounded:
    """What lsq_linear returns; active_mask is -1 at a lower bound, 1 at an upper one."""

    x: _Array
    cost: float
    active_mask: npt.NDArray[np.intp]
    status: int
    success: bool

class _LeastSquares:
    """What least_squares returns."""

    x: _Array
    fun: _Array
    nfev: int
    success: bool

class _Minimum:
    x: float
    fun: float
    success: bool

class _Root:
    root: float
    converged: bool

def lsq_linear(
    A: _Array,
    b: _Array,
    bounds: tuple[npt.ArrayLike, npt.ArrayLike] = ...,
    method: str = ...,
    tol: float = ...,
    *,
    max_iter: int | None = ...,
) -> _Bounded: ...
def least_squares(
    fun: Callable[[_Array], _Array],
    x0: _Array,
    jac: Callable[[_Array], _Array],
    bounds: tuple[npt.ArrayLike, npt.ArrayLike] = ...,
    method: str = ...,
    ftol: float | None = ...,
    xtol: float | None = ...,
    gtol: float | None = ...,
    *,
    x_scale: npt.ArrayLike = ...,
    loss: str | Callable[[_Array], _Array] = ...,
    max_nfev: int | None = ...,
) -> _LeastSquares: ...
def minimize_scalar(
    fun: Callable[[float], float],
    *,
    bounds: tuple[float, float] | None = ...,
    method: str | None = ...,
    options: dict[str, float] | None = ...,
) -> _Minimum: ...
def root_scalar(
    f: Callable[[float], float], *, bracket: tuple[float, float], xtol: float | None = ..., rtol: float | None = ...
) -> _Root: ...
def brentq(f: Callable[[float], float], a: float, b: float, *, xtol: float = ..., rtol: float = ...) -> float: ...
