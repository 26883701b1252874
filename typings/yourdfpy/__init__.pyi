from typing import TextIO

import numpy as np
import numpy.typing as npt

class Joint:
    origin: npt.NDArray[np.float64] | None

class URDF:
    joint_map: dict[str, Joint]
    @staticmethod
    def load(
        fname_or_file: str | TextIO,
        *,
        build_scene_graph: bool = ...,
        load_meshes: bool = ...,
        build_collision_scene_graph: bool = ...,
        load_collision_meshes: bool = ...,
        force_mesh: bool = ...,
        force_collision_mesh: bool = ...,
    ) -> URDF: ...
    def write_xml_string(self) -> bytes: ...
