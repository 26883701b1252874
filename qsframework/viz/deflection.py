"""The deflected robot, exaggerated: the loaded arm less where it was wanted; and how stiff it is in each direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import Model, cartesian_compliance
from qsframework.elastostatics.equilibrium import settle
from qsframework.elastostatics.motion import move, nominal_actuators
from qsframework.elastostatics.so3 import exponential, rotation_vector
from qsframework.elastostatics.state import State, place
from qsframework.plugin import Array, Context, Poses
from qsframework.viz.robot_shapes import link_frames
from qsframework.viz.scene import Colour, Scene

_SETTLED = 256
"""Poses settled at a time."""
COLOUR: Colour = (0.95, 0.55, 0.1, 0.45)
_SMALLEST = 1e-3
"""Part of the longest half axis below which a flat ellipsoid is not drawn flatter."""


@dataclass(frozen=True, eq=False)
class Deflection:
    """Loaded minus unloaded, or minus commanded, at N poses, base axes.

    move (N, links, 3) m and turn (N, links, 3) rad of the links
    angles (N, n + b) rad of the joints and branches, markers (N, K, 3) m, tip (N, 3) m
    """

    move: Array
    turn: Array
    angles: Array
    markers: Array
    tip: Array

    def links(self, frames: Array, i: int, factor: float) -> Array:
        """Frames (links, 4, 4) of pose i moved by the exaggerated deflection.

        Origins move by the factor times their deflection, links turn by the factor times their rotation vector: each
        stays rigid, so large factors open the joints a little.
        """
        out = frames.copy()
        out[:, :3, 3] += factor * self.move[i]
        for link, turn in enumerate(self.turn[i]):
            out[link, :3, :3] = exponential(factor * turn) @ frames[link, :3, :3]
        return out


def deflection(model: Model, poses: Poses, x: Array | None = None, commanded: bool = False) -> Deflection:
    """The full equilibrium of every pose, loaded less unloaded. NotConverged where a pose does not settle.

    commanded: less where the angles would put a rigid arm of nominal geometry instead, so that gravity and what a fit
    knows of the geometry count too
    """
    starts = range(0, len(poses), _SETTLED)
    parts = [_deflection(model, poses.take(slice(i, i + _SETTLED)), x, commanded) for i in starts]
    return Deflection(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _deflection(
    model: Model, poses: Poses, x: Array | None, commanded: bool
) -> tuple[Array, Array, Array, Array, Array]:
    unloaded, count = settle(model, poses, x, False), len(poses)
    loaded = settle(model, poses, x, True, start=unloaded).at.state
    state = rigid(model, poses.q) if commanded else unloaded.at.state
    before, after = (np.stack([link_frames(s.placed, i) for i in range(count)]) for s in (state, loaded))
    turn = np.array(
        [
            [rotation_vector(b[:3, :3] @ a[:3, :3].T) for a, b in zip(*pair, strict=True)]
            for pair in zip(before, after, strict=True)
        ]
    )
    pairs = zip(state.markers, loaded.markers, strict=True)
    markers = np.array([(b.position - a.position).T for a, b in pairs]).reshape(-1, count, 3).transpose(1, 0, 2)
    return (
        after[:, :, :3, 3] - before[:, :, :3, 3],
        turn,
        (loaded.motion.q - state.motion.q).T,
        markers,
        (loaded.tip.position - state.tip.position).T,
    )


def rigid(model: Model, q: Array) -> State:
    """Forward kinematics of the model at joint angles (N, n), undeflected."""
    layout = model.layout
    context = Context(model.facts, Poses(q, q, np.zeros((len(q), 6))), loaded=False)
    phi = nominal_actuators(layout, np.ascontiguousarray(q.T))
    motion = move(layout, context, phi, np.zeros((layout.bars, len(q))))
    return place(motion, model.tip, model.markers)


def half_axes(model: Model, poses: Poses, x: Array | None, force: float) -> Array:
    """Half axes (N, 3, 3), columns, m, of {C f : |f| = force}, C the tip's translational compliance under the load."""
    C = cartesian_compliance(model, poses, x)[:, :3, :3]
    U, size, _ = np.linalg.svd(C)
    return U * (force * size)[:, None, :]


def draw_ellipsoid(scene: Scene, path: str, centre: Array, axes: Array, scale: float, colour: Colour = COLOUR) -> None:
    """The half axes (3, 3) about a point (3,), exaggerated; nothing where nothing gives."""
    size = np.linalg.norm(axes, axis=0)
    if size.max() <= 0.0:
        return
    least = np.maximum(_SMALLEST * size.max() / np.maximum(size, 1e-300), 1.0)
    scene.ellipsoid(path, centre, scale * axes * least, colour)
