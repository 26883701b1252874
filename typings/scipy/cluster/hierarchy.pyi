import numpy as np
import numpy.typing as npt

_Array = npt.NDArray[np.float64]

def linkage(y: _Array, method: str = ..., metric: str = ..., optimal_ordering: bool = ...) -> _Array: ...
def leaves_list(Z: _Array) -> npt.NDArray[np.int32]: ...
