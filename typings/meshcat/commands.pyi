from typing import Any

import numpy as np
import numpy.typing as npt

from .geometry import Geometry, MeshPhongMaterial
from .path import Path

class SetTransform:
    def __init__(self, matrix: npt.NDArray[np.float64], path: Path) -> None: ...
    def lower(self) -> dict[str, Any]: ...

class SetObject:
    def __init__(self, geometry_or_object: Geometry, material: MeshPhongMaterial, path: Path) -> None: ...
    def lower(self) -> dict[str, Any]: ...
