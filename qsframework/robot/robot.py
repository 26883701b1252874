"""What a loaded robot is: frozen values over a Pinocchio model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from qsframework.plugin import Array, Effect, Parameter, RobotFacts
from qsframework.robot.controller import Controller
from qsframework.robot.mesh import Hull, Surface
from qsframework.viewed import Viewed

if TYPE_CHECKING:
    import pinocchio as pin


@dataclass(frozen=True, eq=False)
class LinkFrame:
    """A frame fixed to a moving link: `link` is an index into `RobotFacts.links`, placement (4, 4)."""

    link: int
    placement: Array


@dataclass(frozen=True, eq=False)
class Shape:
    """A solid: kind "box" (x, y, z), "cylinder" (radius, length along z), "sphere" (radius), m; "hull", of a mesh;
    "plane", all that lies below z = 0 of its frame.

    It is drawn where no mesh of its link is.
    """

    link: int
    placement: Array
    kind: str
    size: tuple[float, ...]
    rgba: tuple[float, float, float, float]
    hull: Hull | None = None

    @property
    def surface(self) -> Surface | None:
        """The mesh, where it is not convex."""
        return None if self.hull is None else self.hull.surface


@dataclass(frozen=True, eq=False)
class NamedShape(Shape):
    """A solid that is no part of the arm's links: an obstacle, which stands on the base, or the tool."""

    _: KW_ONLY
    name: str


@dataclass(frozen=True, eq=False)
class MeshShape:
    """A mesh to draw: its name in the URDF, its file where that lies in the robot's folder, its scale (3,)."""

    link: int
    placement: Array
    name: str
    path: Path | None
    scale: Array
    rgba: tuple[float, float, float, float]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Robot(Viewed):
    """An arm: kinematics, controller convention, effects with nominal parameters, and shapes.

    `model` is the `pin.Model`; `facts` are its constants; `frames` holds every link of the URDF.
    payload kg, torque_limits (n,) N m of the actuators, infinite where not stated; None: nothing is stated.
    """

    name: str
    title: str
    folder: Path
    model: pin.Model
    facts: RobotFacts
    controller: Controller
    effects: tuple[Effect, ...]
    parameters: tuple[Parameter, ...]
    frames: Mapping[str, LinkFrame]
    shapes: tuple[Shape, ...]
    gravity: Array
    payload: float | None = None
    torque_limits: Array | None = None
    meshes: tuple[MeshShape, ...] = ()
    branch_shapes: tuple[Shape, ...] = ()
    """Meshes and the solids of branches are to draw only: collisions count the arm's shapes. `Shape.link` of a
    branch is an index into `RobotFacts.bodies`."""

    @property
    def flange(self) -> LinkFrame:
        """The frame in which the load's point and, unless said, the markers are stated."""
        return self.frames[self.facts.flange]
