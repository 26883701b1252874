from collections.abc import Callable

import numpy as np
import numpy.typing as npt

_Array = npt.NDArray[np.float64]

class _Minimum:
    x: float
    fun: float
    success: bool

class _Root:
    root: float
    converged: bool

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
