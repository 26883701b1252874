from typing import Literal

import numpy as np
import numpy.typing as npt

_Array = npt.NDArray[np.float64]
_Factor = tuple[_Array, bool]

class LinAlgError(np.linalg.LinAlgError): ...

def cho_factor(a: _Array, lower: bool = ..., overwrite_a: bool = ..., check_finite: bool = ...) -> _Factor: ...
def cho_solve(c_and_lower: _Factor, b: _Array, overwrite_b: bool = ..., check_finite: bool = ...) -> _Array: ...
def qr(
    a: _Array, *, mode: Literal["economic"], pivoting: Literal[True]
) -> tuple[_Array, _Array, npt.NDArray[np.int32]]: ...
