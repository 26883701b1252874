"""One scene of all that can be seen of a robot at work: poses, loads, limits, deflection, stiffness, residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.arguments import checked
from qsframework.elastostatics.state import State
from qsframework.errors import InputError, NotConverged
from qsframework.experiment import Experiment, Plan
from qsframework.plugin import Array, Indices
from qsframework.viz.deflection import Deflection, deflection, draw_ellipsoid, half_axes, rigid
from qsframework.viz.glow import Shares, draw_shares, shares, spots
from qsframework.viz.meshes import Meshes
from qsframework.viz.robot_shapes import (
    MOST,
    deflected_look,
    draw_ghost,
    draw_robot,
    draw_solid,
    draw_way,
    flange_of,
    link_frames,
    reach,
)
from qsframework.viz.scene import Colour, Facts, Scene, placed_at

_MARKER: Colour = (0.1, 0.3, 0.9, 1.0)
_NUMBER = "#1d4f8c"
_OPACITY = 0.45
_STILL = 2e-3
"""Links that move less, m or rad, are not drawn twice: their solids would lie in each other."""
_PLAIN_FORCE = 1000.0
"""Force (N) of the ellipsoids where no pose is loaded; a tenth, or less, on a soft arm."""
_WIDE = 0.3
"""Half axis, as a part of the arm's reach, that such an ellipsoid does not exceed."""
FORCE: Colour = (0.8, 0.1, 0.1, 1.0)
MOMENT: Colour = (0.55, 0.1, 0.65, 1.0)
_INK = {"force": "#a01010", "moment": "#6b1278"}
_LONGEST = 0.7
"""Length (m) of the arrow of the plan's largest force, and of its largest moment."""

_RESIDUAL: Colour = (0.75, 0.1, 0.5, 1.0)
_FORBIDDEN: Colour = (0.85, 0.35, 0.2, 0.12)
_WALL: Colour = (0.2, 0.45, 0.75, 0.07)
_STATION: Colour = (0.1, 0.6, 0.25, 1.0)
_FENCE: Colour = (0.55, 0.45, 0.25, 0.15)
_SHEET = 0.004


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residual vectors (R, 3) m of a fit at the marker positions (R, 3) m; pose (R,): step of each, -1 for none."""

    start: Array
    vector: Array
    pose: Indices


@checked
def show_scene(
    experiment: Experiment,
    plan: Plan,
    x: Array | None = None,
    scale: float = 100.0,
    missed: Residuals | None = None,
    commanded: bool = False,
) -> Scene:
    """A 3D scene: every pose of the plan as a step of the slider.

    Args:
        experiment: the campaign.
        plan: its plan.
        x: (p,) parameters of the model, SI; nominal if None.
        scale: magnification of the deflection, the ellipsoids and the residuals.
        missed: residuals to draw.
        commanded: the deflection is from where a rigid arm would stand, as a compensation counts it.

    Returns:
        The scene; `.html()` is a self-contained page.

    Raises:
        InputError: unless scale is above 0.
    """
    if not (np.isfinite(scale) and scale > 0.0):
        raise InputError(f"scale must be above 0, found {scale:g}")
    drawing = _Drawing(experiment, plan, scale, x, commanded)
    scene = drawing.scene
    for i in range(len(plan.pose)):
        drawing.pose(i)
    drawing.order()
    _draw_limits(scene, experiment)
    scene.layer("limits", "limits", shown=False)
    if experiment.constraints.obstacles:
        _draw_obstacles(scene, experiment)
        scene.layer("obstacles", "obstacles")
    if missed is not None:
        drawing.residuals(missed)
    scene.first = 1
    return scene


def place_poses(experiment: Experiment, q: Array) -> State:
    """Forward kinematics of the model at joint angles (N, n), undeflected."""
    return rigid(experiment.model(), q)


class _Drawing:
    """One scene in the making: what its parts share."""

    def __init__(
        self, experiment: Experiment, plan: Plan, scale: float, x: Array | None, commanded: bool = False
    ) -> None:
        model = experiment.model()
        self.scene = Scene(title=f"{experiment.robot.title}: {len(plan.pose)} poses", size=reach(model.facts))
        self.experiment, self.plan, self.scale = experiment, plan, scale
        self.state = place_poses(experiment, plan.q)
        self.frames = [link_frames(self.state.placed, i) for i in range(len(plan.pose))]
        self.largest = largest_loads(plan.wrench)
        self.force = float(self.largest[0]) or _PLAIN_FORCE
        self.given: Deflection | None = None
        self.shares: Shares | None = None
        self.axes: Array | None = None
        self.meshes = Meshes(experiment.robot)
        self.colour, self.ink = deflected_look(experiment.robot)
        notes = self.scene.notes
        notes += self.meshes.notes
        try:
            self.axes = half_axes(model, plan.poses, x, self.force)
            while not self.largest[0] and scale * np.linalg.norm(self.axes, axis=1).max() > _WIDE * self.scene.size:
                self.force, self.axes = 0.1 * self.force, 0.1 * self.axes
            if plan.wrench.any() or commanded:
                self.given = deflection(model, plan.poses, x, commanded)
                self.shares = shares(model, plan.poses, x)
        except NotConverged as error:
            notes.append(f"No deflection is drawn: {error}.")
        if self.given is not None:
            start = "minus where a rigid arm would stand" if commanded else "minus unloaded"
            notes.append(
                f"Transparent robot: the loaded arm, its deflection (full equilibrium, loaded {start}) x {scale:g}."
            )
            self.scene.factor = f", x {scale:g}"
        if self.shares is not None and self.shares.share.any():
            notes.append("Blue lights: the springs, as bright as their share of what the load point moves.")
        if self.axes is not None and self.axes.any():
            notes.append(
                f"Orange ellipsoid: where the tool goes under {self.force:.4g} N in any direction, x {scale:g}; "
                "long where the arm is soft."
            )

    def pose(self, i: int) -> None:
        """Robot, markers, load, deflection, springs and ellipsoid of pose i, its number and its ghost."""
        scene, robot, path = self.scene, self.experiment.robot, f"poses/{i}"
        links, tip = self.frames[i], self.state.tip.position[:, i]
        draw_robot(scene, f"{path}/robot", robot, links, self.plan.q[i], meshes=self.meshes)
        scene.axes(f"{path}/robot/flange", flange_of(robot, links), 0.25)
        scene.layer("robot", f"{path}/robot")
        for k, marker in enumerate(self.state.markers):
            scene.sphere(f"{path}/markers/{k}", 0.03, placed_at(marker.position[:, i]), _MARKER)
        self._sight(path, i)
        scene.layer("markers", f"{path}/markers")
        draw_loads(scene, f"{path}/load", tip, self.plan.wrench[i], self.largest)
        scene.layer("load", f"{path}/load")
        if self.axes is not None:
            draw_ellipsoid(scene, f"{path}/ellipsoid", tip, self.axes[i], self.scale)
            scene.layer("ellipsoid", f"{path}/ellipsoid", shown=False)
        label = f"{self.plan.pose[i]} ({self.plan.load[i]})" if self.plan.load[i] else self.plan.pose[i]
        if self.given is not None:
            self._deflected(path, i, self.given)
            label += f", the load point moves {1e3 * np.linalg.norm(self.given.tip[i]):.3f} mm"
        if self.shares is not None:
            draw_shares(scene, f"{path}/springs", self.shares, i, spots(robot.facts, links, {}), scene.size)
            scene.layer("springs", f"{path}/springs")
        many = len(self.plan.pose)
        if many > 1:
            scene.text(f"numbers/{i}", str(i + 1), tip, _NUMBER, i + 1)
        ghost = f"ghosts/{i}" if 1 < many <= MOST else None
        if ghost is not None:
            draw_ghost(scene, ghost, robot, links, self.plan.q[i])
        scene.step(path, label, ghost, self._facts(path, i))

    def _facts(self, path: str, i: int) -> Facts:
        """The name of pose i, its angles, the springs that give, and the two arms between which it plays."""
        units = self.experiment.robot.controller.units
        angles = tuple((f"J{k + 1}", units[k].text(v, 4)) for k, v in enumerate(self.plan.pendant[i]))
        return Facts(
            name=self.plan.pose[i],
            angles=angles,
            shares=() if self.shares is None else self.shares.largest(i),
            plays=None if self.given is None else (f"{path}/robot", f"{path}/deflected"),
        )

    def _deflected(self, path: str, i: int, given: Deflection) -> None:
        scene, where = self.scene, f"{path}/deflected"
        links = given.links(self.frames[i], i, self.scale)
        q = self.plan.q[i] + self.scale * given.angles[i, : self.plan.q.shape[1]]
        still = frozenset(np.flatnonzero(np.abs(links - self.frames[i]).max(axis=(1, 2)) < _STILL).tolist())
        draw_robot(scene, where, self.experiment.robot, links, q, _OPACITY, self.colour, still, self.meshes)
        points = [("tip", self.state.tip.position[:, i], given.tip[i])]
        points += [(f"marker_{k}", m.position[:, i], given.markers[i, k]) for k, m in enumerate(self.state.markers)]
        for name, start, moved in points:
            end = start + self.scale * moved
            scene.sphere(f"{where}/{name}", 0.025, placed_at(end), self.colour)
            scene.rod(f"{where}/{name}_way", start, end, 0.006, self.colour)
            scene.moves.append((f"{where}/{name}", placed_at(start), placed_at(end)))
        moved = self.scale * given.tip[i]
        scene.moves.append((f"{path}/load", np.eye(4), placed_at(moved)))
        size = 1e3 * float(np.linalg.norm(given.tip[i]))
        scene.text(f"{where}/moved", f"{size:.3f} mm", self.state.tip.position[:, i] + moved, self.ink)
        scene.layer("deflected", where)

    def _sight(self, path: str, i: int) -> None:
        sight = self.experiment.constraints.sight
        if sight is None:
            return
        for k, marker in enumerate(self.experiment.markers):
            if sight.markers is None or marker.name in sight.markers:
                end = self.state.markers[k].position[:, i]
                self.scene.rod(f"{path}/markers/sight_{k}", sight.station, end, 0.004, (*_STATION[:3], 0.6))

    def order(self) -> None:
        """The way through the load points, and the layer of the ghosts."""
        if len(self.plan.pose) > 1:
            draw_way(self.scene, "way", self.state.tip.position.T)
            self.scene.layer("order", "way", shown=False)
            self.scene.layer("numbers", "numbers")
        if self.scene.ghosts:
            self.scene.layer("ghosts", "ghosts", shown=False)

    def residuals(self, missed: Residuals) -> None:
        """Residual vectors, at their pose where it is a step."""
        for pose in np.unique(missed.pose).tolist():
            rows = missed.pose == pose
            path = "residuals" if pose < 0 else f"poses/{pose}/residuals"
            for i, (start, residual) in enumerate(zip(missed.start[rows], missed.vector[rows], strict=True)):
                self.scene.arrow(f"{path}/{i}", start, self.scale * residual, 0.010, _RESIDUAL)
            self.scene.layer("residuals", path)
        rms = 1e3 * float(np.sqrt(np.mean(missed.vector**2)))
        self.scene.notes.append(
            f"Purple arrows: measured minus predicted, x {self.scale:g}; RMS per axis {rms:.4f} mm."
        )


def draw_loads(scene: Scene, path: str, point: Array, wrench: Array, largest: Array) -> None:
    """A wrench (6,) at a point (3,); largest (2,): N and N m of the longest arrows of the scene."""
    for name, vector, most, colour, unit in (
        ("force", wrench[:3], largest[0], FORCE, "N"),
        ("moment", wrench[3:], largest[1], MOMENT, "N m"),
    ):
        if most > 0.0:
            arrow = _LONGEST / most * vector
            scene.arrow(f"{path}/{name}", point, arrow, 0.018, colour)
            if (size := float(np.linalg.norm(vector))) > 0.0:
                scene.text(f"{path}/{name}", f"{size:.4g} {unit}", point + arrow, _INK[name])
            if name == "moment":
                scene.arrow(f"{path}/{name}/second", point, 0.85 * arrow, 0.018, colour)


def largest_loads(wrench: Array) -> Array:
    """The largest force (N) and moment (N m) of wrenches (N, 6)."""
    return np.array([np.linalg.norm(wrench[:, part], axis=1).max(initial=0.0) for part in (slice(0, 3), slice(3, 6))])


def _draw_obstacles(scene: Scene, experiment: Experiment) -> None:
    """What stands around the arm; a plane as a sheet of the arm's size."""
    size = 0.8 * reach(experiment.robot.facts)
    for k, shape in enumerate(experiment.constraints.obstacles):
        where = f"obstacles/{k}"
        if shape.kind == "plane":
            middle = shape.placement.copy()
            normal, point = middle[:3, 2], middle[:3, 3]
            middle[:3, 3] = (normal @ point) * normal  # as near to the base as the plane comes
            middle[2, 3] += 0.5 * size * float(abs(normal[2]) < 0.5)
            scene.box(where, (2.0 * size, 2.0 * size, _SHEET), middle, _FENCE)
        else:
            draw_solid(scene, where, shape, shape.rgba)
    names = [shape.name for shape in experiment.constraints.obstacles]
    if names:
        scene.notes.append(f"Brown: what stands around the arm: {', '.join(names)}.")


def _draw_limits(scene: Scene, experiment: Experiment) -> None:
    """All limits of the experiment that are places; the scene gets a note on each."""
    limits = experiment.constraints
    size = 1.2 * reach(experiment.robot.facts)
    if limits.floor is not None:
        place = placed_at(np.array([0.0, 0.0, limits.floor - 0.5 * _SHEET]))
        scene.box("limits/floor", (2.0 * size, 2.0 * size, _SHEET), place, _FORBIDDEN)
        scene.notes.append(f"Floor: no solid of the moving links below {limits.floor:g} m.")
    if limits.axis1_distance_min is not None and not experiment.robot.facts.sliding[0]:
        radius = limits.axis1_distance_min
        scene.cylinder("limits/axis_1", radius, 2.0 * size, placed_at(np.array([0.0, 0.0, size])), _FORBIDDEN)
        scene.notes.append(f"Cylinder: {_words(limits.of)} stays {radius:g} m or more from axis 1.")
    _draw_box(scene, experiment, size)
    if limits.sight is not None:
        scene.sphere("limits/station", 0.08, placed_at(limits.sight.station), _STATION)
        scene.notes.append("Green ball: the tracker.")


def _draw_box(scene: Scene, experiment: Experiment, size: float) -> None:
    """A wall at each side of the box that is given; the others are open."""
    limits = experiment.constraints
    low = np.array([-size if v is None else v for v in (limits.x_min, limits.y_min, limits.z_min)])
    high = np.array([size if v is None else v for v in (limits.x_max, limits.y_max, limits.z_max)])
    given: list[str] = []
    for k, axis in enumerate("xyz"):
        for side, values in (("min", low), ("max", high)):
            value = getattr(limits, f"{axis}_{side}")
            if value is None:
                continue
            middle, lengths = 0.5 * (low + high), high - low
            middle[k], lengths[k] = values[k], _SHEET
            scene.box(f"limits/{axis}_{side}", tuple(lengths.tolist()), placed_at(middle), _WALL)
            given.append(f"{axis} {'>=' if side == 'min' else '<='} {value:g} m")
    if given:
        scene.notes.append(f"Walls: {_words(limits.of)} stays at {', '.join(given)}.")


def _words(point: str) -> str:
    return "the " + point.replace("_", " ")
