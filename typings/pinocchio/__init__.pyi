"""The bindings are made at run time; these are the parts that robot/ asks for."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

_Array = npt.NDArray[np.float64]

class SE3:
    homogeneous: _Array
    rotation: _Array
    translation: _Array

class Motion:
    linear: _Array
    angular: _Array
    def __init__(self, linear: _Array, angular: _Array) -> None: ...

class Inertia:
    mass: float
    lever: _Array

class FrameType:
    BODY: FrameType

class ReferenceFrame:
    LOCAL_WORLD_ALIGNED: ReferenceFrame

class Frame:
    name: str
    type: FrameType
    parentJoint: int
    placement: SE3

class JointData:
    S: _Array

class JointModel:
    nq: int
    idx_q: int
    def createData(self) -> JointData: ...
    def calc(self, data: JointData, q: _Array) -> None: ...

class Data:
    oMi: Sequence[SE3]

class Model:
    nq: int
    nv: int
    njoints: int
    parents: Sequence[int]
    names: Sequence[str]
    gravity: Motion
    joints: Sequence[JointModel]
    lowerPositionLimit: _Array
    upperPositionLimit: _Array
    jointPlacements: Sequence[SE3]
    inertias: Sequence[Inertia]
    frames: Sequence[Frame]
    def createData(self) -> Data: ...
    def getFrameId(self, name: str, type: FrameType) -> int: ...

def buildModelFromXML(xml: str) -> Model: ...
def forwardKinematics(model: Model, data: Data, q: _Array) -> None: ...
def computeGeneralizedGravity(model: Model, data: Data, q: _Array) -> _Array: ...
def computeJointJacobians(model: Model, data: Data, q: _Array) -> _Array: ...
def getFrameJacobian(model: Model, data: Data, frame_id: int, reference_frame: ReferenceFrame) -> _Array: ...
def updateFramePlacement(model: Model, data: Data, frame_id: int) -> SE3: ...
