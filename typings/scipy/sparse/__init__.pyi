import numpy as np
import numpy.typing as npt

_Indices = npt.NDArray[np.integer]

class coo_array:
    def __init__(
        self, arg1: tuple[npt.NDArray[np.float64], tuple[_Indices, _Indices]], shape: tuple[int, int]
    ) -> None: ...
