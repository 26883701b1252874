import numpy as np
import numpy.typing as npt

_Numbers = float | npt.NDArray[np.float64]

def ndtr(x: npt.NDArray[np.float64], /) -> npt.NDArray[np.float64]: ...
def chndtr(x: _Numbers, df: _Numbers, nc: npt.NDArray[np.float64], /) -> npt.NDArray[np.float64]: ...
