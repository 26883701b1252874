"""Positions of markers in trackers' frames as observations, alone or together with displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from qsframework.elastostatics import Model
from qsframework.errors import InputError
from qsframework.experiment import StateReadings
from qsframework.identify.frames import Frame, cross_matrix, start, turning
from qsframework.identify.observations import Independent, Noise, Observations
from qsframework.plugin import Array, Indices, Parameter, Poses, Sensor

Mask = npt.NDArray[np.bool_]
_FLAT = 1e-4
"""m: positions that spread less than this across a line cannot hold a frame."""


@dataclass(frozen=True, eq=False)
class Positions:
    """R used rows of state readings: measured (R, 3) m, and where each comes from.

    keep (R,): rows of the readings; state (R,): places in poses; series: name and rows of each
    """

    model: Model
    poses: Poses
    loaded: Mask
    keep: Indices
    measured: Array
    state: Indices
    marker: Indices
    series: tuple[tuple[str, Indices], ...]
    pose: tuple[str, ...]
    rows: Indices

    def take(self, use: Mask) -> Positions:
        """The rows where `use` (R,) is true."""
        series = tuple((name, np.flatnonzero(np.isin(np.flatnonzero(use), rows))) for name, rows in self.series)
        return replace(
            self, keep=self.keep[use], measured=self.measured[use], state=self.state[use], marker=self.marker[use],
            series=series, pose=tuple(p for p, u in zip(self.pose, use, strict=True) if u), rows=self.rows[use],
        )  # fmt: skip

    def points(self, x: Array) -> Array:
        """Positions (R, 3) m in the base frame."""
        out = np.empty((len(self.poses), len(self.model.markers), 3))
        for state, loaded in self._states():
            out[state] = self.model.positions(self.poses.take(state), x, loaded)
        return out[self.state, self.marker]

    def point_rates(self, x: Array, names: Sequence[str]) -> tuple[Array, Array]:
        """Positions (R, 3) and their derivatives (R, 3, p)."""
        out = np.empty((len(self.poses), len(self.model.markers), 3))
        slope = np.empty((*out.shape, len(names)))
        for state, loaded in self._states():
            out[state], slope[state] = self.model.position_rates(self.poses.take(state), x, names, loaded)
        if slope.shape[1] == 1 and np.array_equal(self.state, np.arange(len(self.poses))):
            return out[:, 0], slope[:, 0]
        return out[self.state, self.marker], slope[self.state, self.marker]

    def _states(self) -> list[tuple[Indices, bool]]:
        used = np.zeros(len(self.poses), dtype=bool)
        used[self.state] = True
        split = ((np.flatnonzero(used & (self.loaded == flag)), flag) for flag in (False, True))
        return [(state, flag) for state, flag in split if len(state)]

    def rates(self, x: Array, frames: Sequence[Frame], names: Sequence[str]) -> tuple[Array, Array]:
        """Readings (R, 3) and their derivatives (R, 3, 6 S + p) by motions of the frames and parameters."""
        points, slope = self.point_rates(x, names)
        count = 6 * len(frames)
        predicted, J = np.empty_like(points), np.zeros((*points.shape, count + len(names)))
        for i, (frame, (_, rows)) in enumerate(zip(frames, self.series, strict=True)):
            turned = points[rows] @ frame.rotation.T
            predicted[rows] = turned + frame.origin
            J[rows, :, 6 * i : 6 * i + 3] = np.eye(3)
            J[rows, :, 6 * i + 3 : 6 * i + 6] = -cross_matrix(turned)
            J[rows, :, count:] = frame.rotation @ slope[rows]
        return predicted, J

    def predict(self, x: Array, frames: Sequence[Frame]) -> Array:
        """Readings (R, 3) m, each in the frame of its series."""
        points = self.points(x)
        out = np.empty_like(points)
        for frame, (_, rows) in zip(frames, self.series, strict=True):
            out[rows] = frame.apply(points[rows])
        return out

    def started(self, x: Array, names: Sequence[str], broad: float) -> tuple[tuple[Frame, ...], Array]:
        """Frames of all series, and x with the markers' offsets among the names, at the nominal arm.

        The offsets are held by a prior of `broad` typical sizes.
        """
        offsets = [n for e, part in zip(self.model.effects, self.model.slices, strict=True)
                   if isinstance(e, Sensor) and e.order == 0 for n in self.model.names[part] if n in names]  # fmt: skip
        offsets = [n for n in offsets if self.model.parameters[self.model.index([n])[0]].unit == "m"]
        points, slope = self.point_rates(x, offsets)
        for name, rows in self.series:
            _check_spread(name, points[rows], self.measured[rows])
        prior = broad * np.array([self.model.parameters[i].scale for i in self.model.index(offsets)])
        frames, found = start(points, slope, self.measured, list(self.series), prior)
        x = x.copy()
        x[self.model.index(offsets)] += found
        return tuple(frames), x


def _check_spread(name: str, points: Array, measured: Array) -> None:
    where = f" of series {name!r}" if name else ""
    for what, values in (("poses", points), ("readings", measured)):
        spread = np.linalg.svd(values - values.mean(axis=0), compute_uv=False)
        if len(values) < 3 or spread[1] < _FLAT * np.sqrt(len(values)):
            raise InputError(
                f"the tracker's frame cannot be found: {len(values)} {what}{where} lie at one point or on one line; "
                "measure poses that move the markers in all directions"
            )


def make_positions(model: Model, states: StateReadings) -> Positions:
    """The rows in use. InputError where there are none, or where some rows name no series and others do."""
    keep = np.flatnonzero(states.use)
    where = states.source or "state readings"
    if not len(keep):
        raise InputError(f"{where}: every reading is masked (use = 0)")
    names = np.array(states.series)[states.measurement[keep]]
    if "" in names and np.any(names != ""):
        rows = ", ".join(str(r) for r in states.rows[keep][names == ""][:5])
        raise InputError(
            f"{where}: rows {rows} name no series, others do; each tracker frame is a series of its own, "
            "so name one in every row or in none"
        )
    series = tuple((str(name), np.flatnonzero(names == name)) for name in dict.fromkeys(names.tolist()))
    return Positions(
        model, states.poses, states.loaded, keep, states.position[keep], states.measurement[keep],
        states.marker[keep], series, tuple(states.pose[int(m)] for m in states.measurement[keep]), states.rows[keep],
    )  # fmt: skip


def position_observations(
    positions: Positions, frames: Sequence[Frame], x: Array, names: Sequence[str], sigma: Array
) -> Observations:
    """Readings as a function of motions of the frames (6 per series, nominal 0) and of the named parameters.

    x: all parameters of the model, those not named stay; sigma (R,) m
    """
    count = 6 * len(frames)
    chosen = positions.model.index(names)

    def at(z: Array) -> tuple[Array, list[Frame]]:
        values = x.copy()
        values[chosen] = z[count:]
        return values, [f.moved(z[6 * i : 6 * i + 6]) for i, f in enumerate(frames)]

    def predict(z: Array) -> Array:
        return positions.predict(*at(z)).ravel()

    def jacobian(z: Array) -> Array:
        J = positions.rates(*at(z), names)[1]
        for i in range(len(frames)):
            turn = slice(6 * i + 3, 6 * i + 6)
            J[:, :, turn] = J[:, :, turn] @ turning(z[turn])
        return J.reshape(-1, J.shape[2])

    parameters = tuple(p for f in frames for p in f.parameters())
    parameters += tuple(positions.model.parameters[i] for i in chosen)
    _, block = np.unique(np.array(positions.pose), return_inverse=True)
    return Observations(
        positions.measured.ravel(), predict, jacobian, parameters, Independent(np.repeat(sigma, 3)),
        np.repeat(block, 3), np.repeat(positions.rows, 3),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Stacked:
    """The noise of several groups of readings that know nothing of one another."""

    parts: tuple[Noise, ...]
    ends: Indices

    def whiten(self, values: Array) -> Array:
        """Each group by its own noise."""
        return np.concatenate([part.whiten(v) for part, v in self._pieces(values)])

    def turned(self, values: Array) -> Array:
        """Each group by its own noise."""
        return np.concatenate([part.turned(v) for part, v in self._pieces(values)])

    def colour(self, values: Array) -> Array:
        """Each group by its own noise."""
        return np.concatenate([part.colour(v) for part, v in self._pieces(values)])

    def weights(self) -> Array:
        """Those of each group."""
        return np.concatenate([part.weights() for part in self.parts])

    def _pieces(self, values: Array) -> list[tuple[Noise, Array]]:
        return list(zip(self.parts, np.split(values, self.ends[:-1]), strict=True))

    def log_det(self) -> float:
        """Sum over the groups."""
        return sum(part.log_det() for part in self.parts)


def joint_observations(parts: Sequence[Observations]) -> Observations:
    """One fit of several kinds of readings of one robot: parameters of the same name are the same parameter.

    Positions tell the geometry and what gravity bends, displacements the springs; together they tell
    more than one after the other.
    """
    found: dict[str, Parameter] = {}
    for part in parts:
        for p in part.parameters:
            found.setdefault(p.name, p)
    names = list(found)
    places = [np.array([names.index(n) for n in part.names], dtype=np.intp) for part in parts]
    ends = np.cumsum([len(part.measured) for part in parts])
    first = np.cumsum([0, *(int(part.block.max(initial=-1)) + 1 for part in parts)])

    def predict(z: Array) -> Array:
        return np.concatenate([part.predict(z[place]) for part, place in zip(parts, places, strict=True)])

    def jacobian(z: Array) -> Array:
        out = np.zeros((int(ends[-1]), len(names)))
        for part, place, end in zip(parts, places, ends, strict=True):
            out[end - len(part.measured) : end, place] = part.jacobian(z[place])
        return out

    return Observations(
        np.concatenate([part.measured for part in parts]), predict, jacobian, tuple(found.values()),
        Stacked(tuple(part.noise for part in parts), ends),
        np.concatenate([part.block + k for part, k in zip(parts, first[:-1], strict=True)]),
        np.concatenate([part.rows for part in parts]),
    )  # fmt: skip
