import numpy as np
import numpy.typing as npt

from . import coo_array

def connected_components(
    csgraph: coo_array | npt.NDArray[np.bool_] | npt.NDArray[np.float64], directed: bool = ...
) -> tuple[int, npt.NDArray[np.int32]]: ...
