"""How controllers write angles and poses: names, units, rotations."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from qsframework.plugin.facts import Array
from qsframework.plugin.rotations import homogeneous


@dataclass(frozen=True, kw_only=True)
class Orientation:
    """A controller's. axes: names of a pose's numbers; letter, most: of the arm's joints; length, angle: of its units
    in m and rad; turns: Euler angles about fixed (xyz) or moving (ZYX) axes, or "vector"; digits: decimals of a
    corrected number; stated: how a tool or a frame is given; left_out: what becomes of axes that a point leaves out."""

    axes: tuple[str, ...]
    letter: str
    most: int = 6
    length: float = 1e-3
    angle: float = float(np.pi / 180.0)
    turns: str = "xyz"
    digits: int = 4
    stated: str
    left_out: str = ""

    def decimals(self, name: str) -> int:
        """Decimals that a corrected number has at least."""
        return 8 if name.startswith("Q") else self.digits


def matrix(convention: Orientation, values: Array) -> Array:
    """Matrix (4, 4) m of six numbers as the controller shows them; of seven with a quaternion in it."""
    from scipy.spatial.transform import Rotation

    if len(values) == 7:
        return quaternion_pose(values)
    angles = values[3:] * convention.angle
    vector = convention.turns == "vector"
    turn = Rotation.from_rotvec(angles) if vector else Rotation.from_euler(convention.turns, angles)
    return homogeneous(turn.as_matrix(), values[:3] * convention.length)


def quaternion_pose(values: Array) -> Array:
    """Matrix (4, 4) m of x, y, z in mm and a quaternion, its scalar first."""
    from scipy.spatial.transform import Rotation

    return homogeneous(Rotation.from_quat(np.roll(values[3:], -1)).as_matrix(), values[:3] * 1e-3)


def numbers_of(convention: Orientation, place: Array, own: Mapping[str, float]) -> dict[str, float]:
    """The numbers of a pose (4, 4) m as the controller shows them, on the turn of the point's own."""
    from scipy.spatial.transform import Rotation

    turn, old = Rotation.from_matrix(place[:3, :3]), np.array([own[name] for name in convention.axes[3:]])
    if len(old) == 4:
        quaternion = np.roll(turn.as_quat(), 1)
        numbers = quaternion if quaternion @ old >= 0.0 else -quaternion
    elif convention.turns == "vector":
        vector = turn.as_rotvec()
        size = float(np.linalg.norm(vector)) or 1.0
        ways = [vector * (1.0 + 2.0 * np.pi * k / size) for k in (-1, 0, 1)]
        numbers = min(ways, key=lambda v: float(np.abs(v - old).max()))
    else:
        with warnings.catch_warnings():  # where two of the three axes coincide, one angle is as good as another
            warnings.simplefilter("ignore", UserWarning)
            euler = np.rad2deg(turn.as_euler(convention.turns))
        other = np.array([euler[0] + 180.0, 180.0 - euler[1], euler[2] + 180.0])
        ways = [angles + 360.0 * np.round((old - angles) / 360.0) for angles in (euler, other)]
        numbers = min(ways, key=lambda angles: float(np.abs(angles - old).max()))
    places = (place[:3, 3] / convention.length).tolist()
    return dict(zip(convention.axes, [*places, *numbers.tolist()], strict=True))
