import numpy as np
import numpy.typing as npt

class CollisionGeometry: ...

class Box(CollisionGeometry):
    def __init__(self, x: float, y: float, z: float) -> None: ...

class Cylinder(CollisionGeometry):
    def __init__(self, radius: float, length: float) -> None: ...

class Sphere(CollisionGeometry):
    def __init__(self, radius: float) -> None: ...

class Transform3s:
    def __init__(self, rotation: npt.NDArray[np.float64], translation: npt.NDArray[np.float64]) -> None: ...

class CollisionRequest:
    security_margin: float

class CollisionResult: ...

def collide(
    o1: CollisionGeometry,
    tf1: Transform3s,
    o2: CollisionGeometry,
    tf2: Transform3s,
    request: CollisionRequest,
    result: CollisionResult,
) -> int: ...
