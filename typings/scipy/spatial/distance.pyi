import numpy as np
import numpy.typing as npt

def squareform(X: npt.NDArray[np.float64], *, checks: bool = ...) -> npt.NDArray[np.float64]: ...
