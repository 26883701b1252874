"""The frame of a series of readings: y = R p + t for a point p in the robot's base frame.

A point of unknown place that a marker touched is one too: its axes are those of the base, only its origin is unknown.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pydantic

from qsframework.elastostatics.so3 import cross_matrix, exponential, rotation_vector
from qsframework.errors import InputError
from qsframework.files import FileRecord, Lists, Unit
from qsframework.plugin import Array, Parameter

AXES = ("x", "y", "z", "rx", "ry", "rz")
POINT, PLANE = "point:", "plane:"
"""Before the name of a point of unknown place, or of a plate touched along its normal; each stands for a series."""
_FLAT = 1e-4
"""m: positions that spread less than this across a line cannot hold a frame."""


def _rotation(R: Array) -> Array:
    if R.shape != (3, 3) or not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0.0:
        raise ValueError("is no rotation matrix by rows, so the frame is no rigid motion")
    return R


def _point(p: Array) -> Array:
    if p.shape != (3,):
        raise ValueError("must be three numbers")
    return p


@dataclass(frozen=True, eq=False)
class Frame(FileRecord):
    """The robot's base in the frame of a series: rotation (3, 3) and origin (3,) m."""

    series: str
    rotation: Annotated[Array, Lists(2), pydantic.AfterValidator(_rotation)]
    origin: Annotated[Array, Unit("m"), Lists(1), pydantic.AfterValidator(_point)]

    def apply(self, points: Array) -> Array:
        """Points (..., 3) of the base frame as the tracker sees them."""
        return points @ self.rotation.T + self.origin

    def moved(self, twist: Array) -> Frame:
        """The frame shifted by twist[:3] and turned by the rotation vector twist[3:], both on the tracker's axes; that
        of a touched point where the point is shifted by twist (3,)."""
        if self.touched:
            return Frame(self.series, self.rotation, self.origin - np.pad(twist, (0, 3 - len(twist))))
        return Frame(self.series, exponential(twist[3:]) @ self.rotation, self.origin + twist[:3])

    @property
    def touched(self) -> bool:
        """Whether it is that of a touched point or plate."""
        return self.series.startswith((POINT, PLANE))

    @property
    def freedom(self) -> int:
        """Motions to estimate: six; of a touched point three, of a plate one along its normal, its first axis."""
        return 1 if self.series.startswith(PLANE) else 3 if self.touched else 6

    @property
    def pose(self) -> Array:
        """Origin (3,) m and rotation vector (3,) rad; of a touched point its place (3,) m in the base, of
        a plate the distance (1,) m of its plane from the base's origin."""
        if self.touched:
            return -self.origin[: self.freedom]
        return np.concatenate([self.origin, rotation_vector(self.rotation)])

    def parameters(self) -> tuple[Parameter, ...]:
        """Motions of the frame: along the tracker's axes, and small turns about them; of a touched point shifts."""
        if self.touched:
            kind, _, name = self.series.partition(":")
            axes = AXES[:3] if self.freedom == 3 else ("distance",)
            return tuple(Parameter(f"{kind}[{name}].{a}", "m", typical=1e-2) for a in axes)
        name = f"frame[{self.series}]" if self.series else "frame"
        units = ("m",) * 3 + ("rad",) * 3
        return tuple(Parameter(f"{name}.{a}", u, typical=1e-2) for a, u in zip(AXES, units, strict=True))


def spans(frames: Sequence[Frame]) -> list[slice]:
    """Where the motions of each frame stand among those of all."""
    ends = np.cumsum([0, *(f.freedom for f in frames)]).tolist()
    return [slice(a, b) for a, b in itertools.pairwise(ends)]


def motion_count(frames: Sequence[Frame]) -> int:
    """Motions of all these frames."""
    return sum(f.freedom for f in frames)


def procrustes(points: Array, readings: Array, series: str = "") -> Frame:
    """The rigid motion that brings points (R, 3) closest to readings (R, 3), by singular values (Kabsch)."""
    a, b = points.mean(axis=0), readings.mean(axis=0)
    U, _, Vt = np.linalg.svd((points - a).T @ (readings - b))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))])
    R = (Vt.T * sign) @ U.T
    return Frame(series, R, b - R @ a)


def check_spread(points: Array, readings: Array, series: str, where: str) -> None:
    """InputError where points or readings (R, 3) lie so that no frame can be found from them."""
    of = f" of series {series!r}" if series else ""
    for what, values in (("poses", points), ("readings", readings)):
        spread = np.linalg.svd(values - values.mean(axis=0), compute_uv=False)
        if len(values) < 3 or spread[1] < _FLAT * np.sqrt(len(values)):
            raise InputError(
                f"{where}: the tracker's frame cannot be found: {len(values)} {what}{of} lie at one point or on one "
                "line; measure poses that move the markers in all directions, or state the frame (frames: in the "
                "experiment)"
            )


def motion_rows(arms: Array) -> Array:
    """What a shift and a small turn (6,) do to points at arms (N, 3) from where it turns: (3 N, 6)."""
    return np.concatenate([np.tile(np.eye(3), (len(arms), 1, 1)), -cross_matrix(arms)], axis=2).reshape(-1, 6)
