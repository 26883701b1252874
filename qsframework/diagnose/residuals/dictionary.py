"""The closing gate: a dictionary of motions that no effect has to explain, tried on what an explanation leaves.

At every drive and every link an extra small motion may depend on the load, on the joint's angle, on the torque about
other axes, on the reading's order, on where the arm came from, on time, temperature or approach. If a block of these
is still seen after the named causes, the names are not the whole truth.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.diagnose.result import Leftover
from qsframework.diagnose.selection.family_test import Block, Scores, score
from qsframework.elastostatics import Model, make_model
from qsframework.elastostatics.evaluation import evaluate_stages
from qsframework.elastostatics.structure import chunks
from qsframework.estimation import Noise, left
from qsframework.experiment import Frame
from qsframework.experiment.observations import Rows
from qsframework.plugin import Actuator, Array, Coordinate, Indices, Parameter, Poses, RobotFacts, Spring, VirtualJoint

_LEFT = 1e-2
"""Share of a column that must remain beside what is already explained."""
_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Probe(Spring):
    """Rigid coordinates at every drive and every link: they say how each place would move the markers."""

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}[{i}]", "", lower=0.0) for i in range(len(self.virtual_joints(robot))))

    def virtual_joints(self, robot: RobotFacts) -> tuple[Coordinate, ...]:
        turns = [VirtualJoint(link, axis, "rotation") for link in robot.links for axis in _AXES]
        ends = [VirtualJoint(link, axis, "translation") for link in (robot.base, robot.flange) for axis in _AXES]
        return (*(Actuator(joint) for joint in robot.joints), *turns, *ends)


@dataclass(frozen=True)
class Place:
    """Coordinates of the probe that move together: a drive, the three rotations of a link, or a shift of an end.

    joint: the one whose angle counts here, None at the base
    """

    name: str
    coordinates: tuple[int, ...]
    joint: int | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Motions:
    """columns (R, 3, ne) m per unit of each coordinate, torque (R, ne), and what a place may depend on, per row."""

    places: tuple[Place, ...]
    columns: Array
    torque: Array
    q: Array
    order: Array
    step: Array
    recorded: tuple[tuple[str, Array], ...]
    marker: Indices
    marker_names: tuple[str, ...]


def motions(model: Model, rows: Rows, x: Array, frames: Sequence[Frame]) -> Motions:
    """What an extra motion at each place would do to the rows, at the states that they are of.

    A displacement has the torque of its load, a position that of gravity and the compensators besides.
    """
    effects = (*model.effects, Probe())
    markers = list(zip(model.marker_names, model.markers, strict=True))
    probe = make_model(model.facts, effects, model.parameters, model.tip, markers, model.gravity)
    known = dict(zip(model.names, x, strict=True))
    values = np.array([known.get(p.name, 0.0) for p in probe.parameters])
    own = [probe.compliance_rows.index(i) for i in probe.index([p.name for p in Probe().parameters(model.facts)])]
    used, n = np.unique(rows.plus, return_inverse=True)
    poses = rows.readings.poses.take(used)
    columns: list[Array] = []
    torque: list[Array] = []
    static: list[Array] = []
    for _, part in chunks(poses):
        stages = evaluate_stages(probe, part, values, preload=True)
        assert stages.preload is not None
        columns.append(np.stack([m.linear[own] for m in stages.state.markers]).transpose(3, 0, 2, 1))
        torque.append(stages.tau[own].T)
        static.append(stages.preload[own].T)
    order = np.linspace(-1.0, 1.0, len(poses))
    came = np.diff(poses.q, axis=0, prepend=poses.q[:1])
    moved = np.concatenate(columns)[n, rows.marker]
    known = dict(zip(rows.estimated, frames, strict=True))
    for f, frame in enumerate(rows.readings.known):
        at = rows.frame == f
        if at.any():
            moved[at] = (frame or known[f]).rotation @ moved[at]
    if rows.readings.axes is not None:
        moved = rows.readings.axes[rows.keep] @ moved
    carried = np.concatenate(torque)[n] + np.where(rows.minus[:, None] < 0, np.concatenate(static)[n], 0.0)
    recorded = tuple((name, _spread(value[n])) for name, value in _conditions(poses) if np.ptp(value) > 0.0)
    return Motions(
        places=_places(model.facts),
        columns=rows.padded(moved),
        torque=carried,
        q=poses.q[n],
        order=order[n],
        step=came[n],
        recorded=recorded,
        marker=rows.marker,
        marker_names=model.marker_names,
    )


def _conditions(poses: Poses) -> Iterator[tuple[str, Array]]:
    for name in ("time", "temperature", "approach"):
        value = getattr(poses.loaded, name)
        if value is not None and np.isfinite(value).all():
            yield name, value


def _spread(value: Array) -> Array:
    return (value - value.mean()) / max(float(np.abs(value - value.mean()).max()), 1e-300)


def _places(facts: RobotFacts) -> tuple[Place, ...]:
    n = facts.n
    drives = [Place(f"the drive of {joint}", (k,), k) for k, joint in enumerate(facts.joints)]
    links = [
        Place(f"link {link}", tuple(n + 3 * i + a for a in range(3)), None if i == 0 else i - 1)
        for i, link in enumerate(facts.links)
    ]
    last = n + 3 * len(facts.links)
    ends = [
        Place(f"a shift of {facts.base}", tuple(range(last, last + 3)), None),
        Place(f"a shift of {facts.flange}", tuple(range(last + 3, last + 6)), n - 1),
    ]
    return (*drives, *links, *ends)


def dictionary(moved: Motions, drives: int) -> Iterator[tuple[str, str, Array]]:
    """Place, variable and columns (R, 3, k) of every block."""
    for place in moved.places:
        at = list(place.coordinates)
        D, T = moved.columns[..., at], moved.torque[:, at]
        size = np.maximum(np.sqrt(np.mean(T**2, axis=0)), 1e-300)
        t = T / size
        yield place.name, "the load", _join(D, np.tanh(2.0 * t), t * np.abs(t), t**3)
        if place.joint is not None:
            angle = moved.q[:, place.joint, None]
            bends = [f(k * angle) * t for k in (1, 2) for f in (np.cos, np.sin)]
            yield place.name, "the joint's own angle", _join(D, *bends)
        others = [i for i in (range(drives) if len(at) == 1 else at)]
        turned = [moved.torque[:, [i]] * np.ones(len(at)) for i in others if np.any(moved.torque[:, i])]
        if turned:
            yield place.name, "the torque about other axes", _join(D, *turned)
        o = moved.order[:, None]
        yield place.name, "the order of the readings", _join(D, o * np.ones_like(t), o * t)
        if len(at) == 1 and place.joint is not None:
            came = moved.step[:, place.joint, None]
            yield place.name, "where the joint came from", _join(D, np.sign(came), np.sin(came), np.cos(came))
        yield place.name, "nothing (a constant)", D
        for name, value in moved.recorded:
            yield place.name, name, _join(D, value[:, None] * np.ones_like(t), value[:, None] * t)
    yield from _markers(moved)


def _markers(moved: Motions) -> Iterator[tuple[str, str, Array]]:
    """One marker moves in its mount while the others stay."""
    if len(moved.marker_names) < 2:
        return
    for k, name in enumerate(moved.marker_names):
        own = (moved.marker == k).astype(float)[:, None, None] * np.eye(3)
        drift = own * moved.order[:, None, None]
        yield f"marker {name}", "the order of the readings", np.concatenate([own, drift], axis=2)


def _join(D: Array, *factors: Array) -> Array:
    """Each coordinate's column times each factor (R, k)."""
    return np.concatenate([D * f[:, None, :] for f in factors], axis=2)


@dataclass(frozen=True, eq=False)
class Closing:
    """The blocks of the dictionary that could be tested, and their scores."""

    labels: tuple[tuple[str, str], ...]
    scores: Scores

    def leftovers(self, level: float) -> tuple[Leftover, ...]:
        """Significant blocks, the strongest first."""
        order = np.argsort(self.scores.log_p)
        p = self.scores.p_adjusted
        return tuple(
            Leftover(self.labels[i][0], self.labels[i][1], float(p[i])) for i in map(int, order) if p[i] <= level
        )


def close(
    moved: Motions, drives: int, explained: Array, white: Array, noise: Noise, nu: float, draws: int, seed: int
) -> Closing:
    """Test the dictionary against whitened residuals (m,) of a fit whose whitened columns are `explained` (m, f)."""
    Q, _ = np.linalg.qr(explained / np.maximum(np.linalg.norm(explained, axis=0), 1e-300))
    residual = left(Q, white)
    labels: list[tuple[str, str]] = []
    blocks: list[Block] = []
    for place, variable, columns in dictionary(moved, drives):
        flat = noise.whiten(columns.reshape(len(white), -1))
        norm = np.linalg.norm(flat, axis=0)
        flat = flat[:, norm > 0.0] / norm[norm > 0.0]
        U, values, _ = np.linalg.svd(left(Q, flat), full_matrices=False)
        basis = U[:, values > _LEFT]
        if basis.shape[1]:
            labels.append((place, variable))
            blocks.append(Block(basis))
    return Closing(tuple(labels), score(blocks, residual, nu, draws, seed))
