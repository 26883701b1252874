"""The bridge from robots to statistics: readings of an experiment as observations of its parameters.

    predicted = F_s(h(plus)) - F_s(h(minus)),   F_s(p) = R_s p + t_s the frame of the reading's series

h is what the instrument says of a marker where the arm settles in a state. Nothing beyond asks which kind of reading a
row is. The motions of frames that nobody knows are parameters beside those of the model.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from qsframework.elastostatics import Model, range_notes
from qsframework.elastostatics.so3 import cross_matrix, left_jacobian
from qsframework.errors import InputError
from qsframework.estimation import Noise, Observations, grouped
from qsframework.estimation.noise import Blocks, Group, Independent, connected
from qsframework.experiment.frames import Frame, check_spread, motion_count, procrustes, spans
from qsframework.experiment.prior import Priors, priors_of
from qsframework.experiment.readings import Readings
from qsframework.experiment.setup import Experiment
from qsframework.plugin import Array, Conditions, Indices, Parameter, Poses

REACH = 4.0
"""m: size of an arm's coordinates, whose rounding every difference of them carries."""
_TOGETHER = 20_000_000
"""Derivatives of all markers in all states that are held at once, before those are taken that were read."""
_SAME = 1e-6
"""rad: angles of poses of one name that differ by less are one pose."""


@dataclass(frozen=True, eq=False)
class ReadingRows:
    """The R rows of readings that a fit sees, and their m measured coordinates.

    keep (R,): places in the readings; at (m,): places of the measured coordinates in (R, 3), flattened; pose (R,):
    number of the pose; shared: sd m of the error that the markers of a visit share, the stated one or another
    """

    readings: Readings
    keep: Indices
    at: Indices
    pose: Indices
    shared: float = 0.0

    @property
    def stated(self) -> bool:
        return self.readings.stated

    @cached_property
    def plus(self) -> Indices:
        return self.readings.plus[self.keep]

    @cached_property
    def minus(self) -> Indices:
        return self.readings.minus[self.keep]

    @cached_property
    def marker(self) -> Indices:
        return self.readings.marker[self.keep]

    @cached_property
    def frame(self) -> Indices:
        return self.readings.frame[self.keep]

    @cached_property
    def measured(self) -> Array:
        """(R, 3) m, NaN where an axis was not measured."""
        return self.readings.value[self.keep]

    @cached_property
    def sigma(self) -> Array:
        """(R, 3) m."""
        return self.readings.sigma[self.keep]

    @property
    def scalars(self) -> Array:
        """The measured coordinates (m,)."""
        return self.measured.ravel()[self.at]

    @property
    def row(self) -> Indices:
        """The row (m,) of each measured coordinate."""
        return self.at // 3

    @property
    def label(self) -> Indices:
        """Number (m,) of the error that the markers of one visit share along one axis; -1 for a gauge's own axis."""
        own = 3 * self.plus[self.row] + self.at % 3 + 3 * len(self.readings.states) * (self.frame[self.row] + 1)
        return np.where(self.readings.is_gauge[self.keep][self.row], -1, own)

    @property
    def lone_visits(self) -> bool:
        """Whether no two coordinates share the error of a visit."""
        own = self.label[self.label >= 0]
        return len(np.unique(own)) == len(own)

    def range_notes(self, model: Model, x: Array) -> tuple[str, ...]:
        """A sentence for each law of a model that these readings ask beyond where it was seen."""
        used = np.unique(self.plus)
        names = [self.readings.states.pose[i] for i in map(int, used)]
        return range_notes(model, self.readings.poses.take(used), names, x)

    @cached_property
    def own_noise(self) -> tuple[Array, list[Group]]:
        """sd (m,) of the coordinates' own errors, and the errors that states bring to several differences."""
        sigma = self.sigma.ravel()[self.at]
        part = self.readings.minus_sigma[self.keep].ravel()[self.at]
        label = self._reference
        sd = np.zeros(len(sigma))
        for one in np.unique(label[label >= 0]):
            rows = label == one
            if rows.sum() > 1:
                smallest = sigma[rows].min() / np.sqrt(2.0)
                sd[rows] = np.where(np.isnan(part[rows]), smallest, part[rows])
        if self.readings.directed is None:
            return np.sqrt(sigma**2 - sd**2), [(label, sd)]
        share = np.square(sd / sigma)  # of all that a row errs, the part that its reference brings
        vectors = self.readings.directed[self.keep].transpose(1, 0, 2).reshape(2, -1)[:, self.at]
        alike = sigma**2 - np.square(vectors).sum(axis=0)
        groups = [(label, np.sqrt(share * alike))]
        for v in vectors:
            groups += [(self.row, np.sqrt(1.0 - share) * v), (label // 3, np.sqrt(share) * v)]
        return np.sqrt((1.0 - share) * alike), groups

    @property
    def _reference(self) -> Indices:
        """Number (m,) of the unloaded reading behind each difference that others share, -1 where there is none."""
        key = self.minus * (len(self.readings.frames) + 1) + self.frame + 1
        key = key * (int(self.readings.marker.max(initial=0)) + 1) + self.marker
        own = np.where(self.minus < 0, -1, key)
        gauge = self.readings.is_gauge[self.keep]
        own = np.where(gauge, -1, own)
        _, counts = np.unique(own[own >= 0], return_counts=True)
        if not len(counts) or counts.max() < 2:
            return np.full(len(self.at), -1, dtype=np.intp)
        return np.where(own[self.row] < 0, -1, 3 * own[self.row] + self.at % 3)

    @cached_property
    def noise(self) -> Independent | Blocks:
        """Covariance of the m coordinates, up to a factor where the noise is estimated."""
        own, groups = self.own_noise
        return grouped(own, [*groups, (self.label, np.full(len(own), self.shared))])

    @cached_property
    def together(self) -> Indices:
        """Number (m,) of what is left out together: the pose, and all that shares its references."""
        reference = self._reference
        none = np.zeros(len(self.at))
        return connected(len(self.at), [(self.pose[self.row], none), (reference, none)])

    @property
    def pose_names(self) -> tuple[str, ...]:
        """Name of the pose of each row."""
        return tuple(self.readings.states.pose[int(s)] for s in self.plus)

    def places(self, experiment: Experiment) -> Array:
        """Where (R, 3) m, base frame, a rigid nominal arm has the marker of each row."""
        used, at = np.unique(self.plus, return_inverse=True)
        return experiment.rigid_places(self.readings.poses.q[used])[at, self.marker]

    def sharing(self, shared: float) -> ReadingRows:
        """The same rows, the markers of a visit with a common error of this sd."""
        return replace(self, shared=shared)

    def take(self, rows: Indices | npt.NDArray[np.bool_]) -> ReadingRows:
        """Some of the rows; poses keep their numbers."""
        keep = self.keep[rows]
        return replace(self, keep=keep, at=_measured(self.readings, keep), pose=self.pose[rows])

    def spread(self, scalars: Array) -> Array:
        """Coordinates (m, ...) at their places in (R, 3, ...), NaN elsewhere."""
        out = np.full((3 * len(self.keep), *scalars.shape[1:]), np.nan)
        out[self.at] = scalars
        return out.reshape(len(self.keep), 3, *scalars.shape[1:])

    @cached_property
    def mask(self) -> npt.NDArray[np.bool_]:
        """(R, 3), where an axis was measured."""
        out = np.zeros(3 * len(self.keep), dtype=bool)
        out[self.at] = True
        return out.reshape(-1, 3)

    def padded(self, values: Array) -> Array:
        """Values (R, 3, ...) with zeros where nothing was measured."""
        return np.where(self.mask.reshape(*self.mask.shape, *[1] * (values.ndim - 2)), values, 0.0)

    @cached_property
    def padded_noise(self) -> Noise:
        """The noise of all 3 R coordinates, those that were not measured whitened to zero."""
        return self.noise if len(self.at) == 3 * len(self.keep) else Padded(self.noise, self.at, 3 * len(self.keep))

    def flat(self, values: Array) -> Array:
        """The measured coordinates (m, ...) of (R, 3, ...)."""
        return values.reshape(3 * len(self.keep), *values.shape[2:])[self.at]

    @property
    def estimated(self) -> tuple[int, ...]:
        """The frames that rows in use are in and that nobody knows."""
        used = [int(f) for f in np.unique(self.frame) if f >= 0]
        return tuple(f for f in used if (known := self.readings.known[f]) is None or known.touched)

    @property
    def unknown_motions(self) -> int:
        """How many motions of the estimated frames are parameters."""
        return motion_count([Frame(self.readings.frames[f], np.eye(3), np.zeros(3)) for f in self.estimated])

    @cached_property
    def _used(self) -> tuple[Indices, Indices, Indices]:
        """States that rows need, and for each row its place and that of its minus among them."""
        both = np.concatenate([self.plus, self.minus[self.minus >= 0]])
        used, where = np.unique(both, return_inverse=True)
        minus = np.full(len(self.keep), -1, dtype=np.intp)
        minus[self.minus >= 0] = where[len(self.plus) :]
        return used, where[: len(self.plus)], minus

    @cached_property
    def pairs(self) -> tuple[Poses, Indices] | None:
        """Where every row is a difference of two states of one arm, in axes that are known: the pairs, loaded with the
        conditions of both, and the pair of each row. Half the work of two states, with the same result."""
        readings = self.readings
        if (self.minus < 0).any() or self.estimated or (readings.to[self.keep] >= 0).any():
            return None
        both, where = np.unique(np.stack([self.plus, self.minus]), axis=1, return_inverse=True)
        loaded, unloaded = (_recorded(readings.poses.take(states)) for states in both)
        if not readings.states.loaded[both[0]].all() or readings.states.loaded[both[1]].any():
            return None
        before = unloaded.loaded
        if before.temperature is None:  # an arm is as warm as a minute later
            before = replace(before, temperature=loaded.loaded.temperature)
        pairs = replace(loaded, unloaded=before)
        return (pairs, where.ravel()) if np.array_equal(loaded.q, unloaded.q) else None

    @property
    def alone(self) -> bool:
        """Whether a displacement is known without the two positions that it is the difference of."""
        return self.pairs is not None

    def positions(self, model: Model, x: Array, linear: bool) -> Array:
        """Positions (S, K, 3) m of the markers in the states that rows need, base frame."""
        used, _, _ = self._used
        out = np.empty((len(used), len(model.markers), 3))
        for loaded, which, poses in self.split():
            out[which] = model.positions(poses, x, loaded, linear)
        return out

    def slopes(self, model: Model, x: Array, names: Sequence[str], linear: bool = False) -> tuple[Array, Array]:
        """Positions (S, K, 3) and their derivatives (S, K, 3, p)."""
        used, _, _ = self._used
        out = np.empty((len(used), len(model.markers), 3))
        slope = np.empty((*out.shape, len(names)))
        for loaded, which, poses in self.split():
            out[which], slope[which] = model.position_rates(poses, x, names, loaded, linear)
        return out, slope

    def split(self) -> list[tuple[bool, Indices, Poses]]:
        """The unloaded and the loaded states that rows need: whether a load hangs, places among them, and poses."""
        used, _, _ = self._used
        loaded = self.readings.states.loaded[used]
        parts = [(flag, np.flatnonzero(loaded == flag)) for flag in (False, True)]
        return [(flag, which, _recorded(self.readings.poses.take(used[which]))) for flag, which in parts if len(which)]

    def seen(self, positions: Array, frames: Sequence[Frame]) -> Array:
        """What the rows say (R, 3) of positions (S, K, 3): in their frames, less those of `minus`, along their axes."""
        _, plus, minus = self._used
        out = positions[plus, self.marker]
        taken = minus >= 0
        first = out
        out = np.where(taken[:, None], out - positions[np.maximum(minus, 0), self.marker], out)
        for f, frame in self._frames(frames):
            rows = self.frame == f
            out[rows] = out[rows] @ frame.rotation.T + np.where(taken[rows, None], 0.0, frame.origin)
        if self.readings.axes is None:
            return out
        out = np.einsum("rij,rj->ri", self.readings.axes[self.keep], out)
        to = self.readings.to[self.keep]
        apart = np.flatnonzero(to >= 0)
        length = np.linalg.norm(first[apart] - positions[plus[apart], to[apart]], axis=1)
        there = positions[np.maximum(minus[apart], 0)]
        at = np.arange(len(apart))
        before = np.linalg.norm(there[at, self.marker[apart]] - there[at, to[apart]], axis=1)
        out[apart, 0] = length - np.where(minus[apart] >= 0, before, 0.0)
        return out

    def seen_along(self, positions: Array, slope: Array, frames: Sequence[Frame]) -> Array:
        """Derivatives (R, 3, p) of `seen` for those (S, K, 3, p) of the positions."""
        _, plus, minus = self._used
        taken = minus >= 0
        out = slope[plus, self.marker]
        if taken.any():
            out = out - np.where(taken[:, None, None], slope[np.maximum(minus, 0), self.marker], 0.0)
        for f, frame in self._frames(frames):
            rows = self.frame == f
            out[rows] = frame.rotation @ out[rows]
        if self.readings.axes is None:
            return out
        out = self.readings.axes[self.keep] @ out
        for r in np.flatnonzero(self.readings.to[self.keep] >= 0).tolist():
            ends = [(1.0, plus[r])] + ([(-1.0, minus[r])] if minus[r] >= 0 else [])
            k, to = int(self.marker[r]), int(self.readings.to[self.keep[r]])
            out[r, 0] = 0.0
            for sign, s in ends:
                u = positions[s, k] - positions[s, to]
                out[r, 0] += sign * (u / np.linalg.norm(u)) @ (slope[s, k] - slope[s, to])
        return out

    def _frames(self, frames: Sequence[Frame]) -> list[tuple[int, Frame]]:
        """Every frame by its place: the estimated ones as given, the others as they are known."""
        found = dict(zip(self.estimated, frames, strict=True))
        known = {f: frame for f, frame in enumerate(self.readings.known) if frame is not None}
        return sorted((known | found).items())

    def predict(self, model: Model, x: Array, frames: Sequence[Frame] = (), linear: bool = False) -> Array:
        """What the model says (R, 3) m of the rows."""
        if self.pairs is not None:
            poses, where = self.pairs
            moved = model.predict(poses, x, linear)
            return self._turned(moved[where, self.marker])
        return self.seen(self.positions(model, x, linear), frames)

    def _turned(self, moved: Array) -> Array:
        """Displacements (R, 3, ...) of the base in the known frames and along the axes of the rows."""
        out = np.array(moved)
        for f, frame in self._frames(()):
            rows = self.frame == f
            out[rows] = np.einsum("ij,rj...->ri...", frame.rotation, out[rows])
        axes = self.readings.axes
        return out if axes is None else np.einsum("rij,rj...->ri...", axes[self.keep], out)

    def rates(
        self, model: Model, x: Array, frames: Sequence[Frame], names: Sequence[str], linear: bool = False
    ) -> tuple[Array, Array]:
        """What the model says (R, 3), and its derivatives (R, 3, f + p) by the f motions of the estimated frames and by
        the named parameters."""
        if self.pairs is not None:
            return self.of_pairs(*model.rates(self.pairs[0], x, names, linear))
        held = len(self._used[0]) * len(model.markers) * 3 * len(names)
        if held < _TOGETHER:
            return self.of_states(*self.slopes(model, x, names, linear), frames)
        return self._rates_in_parts(model, x, frames, names, linear, held // _TOGETHER + 1)

    def _rates_in_parts(
        self, model: Model, x: Array, frames: Sequence[Frame], names: Sequence[str], linear: bool, parts: int
    ) -> tuple[Array, Array]:
        """`rates`, of so many parts of the rows one after the other."""
        place = dict(zip(self.estimated, zip(frames, spans(frames), strict=True), strict=True))
        count = motion_count(frames)
        predicted, J = np.empty((len(self.keep), 3)), np.zeros((len(self.keep), 3, count + len(names)))
        for rows in np.array_split(np.argsort(self.plus, kind="stable"), parts):
            own = self.take(rows)
            mine = [place[f] for f in own.estimated]
            columns = [*(i for _, span in mine for i in range(span.start, span.stop)), *range(count, J.shape[2])]
            predicted[rows], found = own.rates(model, x, [frame for frame, _ in mine], names, linear)
            J[rows[:, None], :, columns] = found.transpose(0, 2, 1)
        return predicted, J

    def of_pairs(self, moved: Array, slope: Array) -> tuple[Array, Array]:
        """`rates` where the pairs' displacements (P, K, 3) and their derivatives (P, K, 3, p) are known."""
        assert self.pairs is not None
        _, where = self.pairs
        return self._turned(moved[where, self.marker]), self._turned(slope[where, self.marker])

    def of_states(self, positions: Array, slope: Array, frames: Sequence[Frame]) -> tuple[Array, Array]:
        """`rates` where the positions (S, K, 3) and their derivatives (S, K, 3, p) are known."""
        predicted = self.seen(positions, frames)
        count = motion_count(frames)
        J = np.zeros((*predicted.shape, count + slope.shape[-1]))
        J[:, :, count:] = self.seen_along(positions, slope, frames)
        if count:
            J[:, :, :count] = self.motions(positions, frames)
        return predicted, J

    def motions(self, positions: Array, frames: Sequence[Frame]) -> Array:
        """Derivatives (R, 3, f) by motions of the estimated frames: shifts along their axes and turns about them."""
        _, plus, minus = self._used
        there = positions[plus, self.marker]
        taken = minus >= 0
        there = np.where(taken[:, None], there - positions[np.maximum(minus, 0), self.marker], there)
        out = np.zeros((len(self.keep), 3, motion_count(frames)))
        for f, frame, span in zip(self.estimated, frames, spans(frames), strict=True):
            rows = np.flatnonzero(self.frame == f)
            shift = -np.eye(3) if frame.touched else np.eye(3)
            shift = shift[:, : frame.freedom]
            shifts = slice(span.start, span.start + shift.shape[1])
            out[rows, :, shifts] = np.where(taken[rows, None, None], 0.0, shift)
            if not frame.touched:
                out[rows, :, span.start + 3 : span.stop] = -cross_matrix(there[rows] @ frame.rotation.T)
        return out

    def start(self, model: Model, x: Array) -> tuple[Frame, ...]:
        """The estimated frames that bring the model's markers closest to the readings (Procrustes).

        InputError where the readings of a series lie at one point or on one line.
        """
        return self.nearest(self.positions(model, x, True)) if self.estimated else ()

    def nearest(self, positions: Array, used: npt.NDArray[np.bool_] | None = None) -> tuple[Frame, ...]:
        """The same frames where the positions (S, K, 3) are known; used (R,): rows that count, None: all."""
        counts = np.ones(len(self.keep), dtype=bool) if used is None else used
        turns = [None if (known := self.readings.known[f]) is None else known.rotation for f in self.estimated]
        identity = [
            Frame(self.readings.frames[f], np.eye(3) if turn is None else turn, np.zeros(3))
            for f, turn in zip(self.estimated, turns, strict=True)
        ]
        there = self.seen(positions, identity)
        out: list[Frame] = []
        for f, frame in zip(self.estimated, identity, strict=True):
            name = self.readings.frames[f]
            if frame.touched:
                own = self.frame == f
                own = counts & own if (counts & own).any() else own  # of which no row counts, it is where they lie
                out.append(frame.moved(-(self.measured - there)[own][:, : frame.freedom].mean(axis=0)))
                continue
            rows = np.flatnonzero(counts & (self.frame == f) & np.isfinite(self.measured).all(axis=1))
            absolute = rows[self.minus[rows] < 0]
            if len(absolute):
                check_spread(there[absolute], self.measured[absolute], name, self.readings.where)
                out.append(procrustes(there[absolute], self.measured[absolute], name))
                continue
            if len(rows) < 2:
                raise InputError(
                    f"{self.readings.where}: series {name!r} has too few displacements to say how it lies to the base; "
                    "state its frame (frames: in the experiment)"
                )
            # displacements tell a turn only: about the origin, with both signs so that their mean is zero
            both = [np.concatenate([v[rows], -v[rows]]) for v in (there, self.measured)]
            out.append(replace(procrustes(both[0], both[1], name), origin=np.zeros(3)))
        return tuple(out)


def _recorded(poses: Poses) -> Poses:
    """Poses without the conditions that were not recorded of all of them."""

    def known(conditions: Conditions) -> Conditions:
        return Conditions.each(
            lambda name: v if (v := getattr(conditions, name)) is not None and np.isfinite(v).all() else None
        )

    return replace(poses, unloaded=known(poses.unloaded), loaded=known(poses.loaded))


@dataclass(frozen=True, eq=False)
class Padded:
    """Noise of some of `count` coordinates, at their places; the others are not there: whitened, they are zero."""

    noise: Noise
    at: Indices
    count: int

    def _through(self, change: Callable[[Array], Array], values: Array) -> Array:
        out = np.zeros((self.count, *values.shape[1:]))
        out[self.at] = change(values[self.at])
        return out

    def whiten(self, values: Array) -> Array:
        return self._through(self.noise.whiten, values)

    def turned(self, values: Array) -> Array:
        return self._through(self.noise.turned, values)

    def colour(self, values: Array) -> Array:
        return self._through(self.noise.colour, values)

    def log_det(self) -> float:
        return self.noise.log_det()

    def weights(self) -> Array:
        out = np.ones(self.count)
        out[self.at] = self.noise.weights()
        return out


def make_rows(readings: Readings) -> ReadingRows:
    """The rows in use. InputError where there are none."""
    keep = np.flatnonzero(readings.use & np.isfinite(readings.value).any(axis=1))
    if not len(keep):
        raise InputError(f"{readings.where}: every reading is masked (use = 0)")
    pose = _poses(readings)[readings.plus[keep]]
    return ReadingRows(readings, keep, _measured(readings, keep), pose, readings.repeatability or 0.0)


def _measured(readings: Readings, keep: Indices) -> Indices:
    return np.flatnonzero(np.isfinite(readings.value[keep]).ravel())


def _poses(readings: Readings) -> Indices:
    """Number (N,) of the pose of each state: poses of one name and of the same angles."""
    names = readings.states.pose
    angles = np.round(readings.poses.q / _SAME).astype(np.int64)
    one_file = len(readings.sources) == 1
    number: dict[object, int] = {}
    keys = [(name, () if one_file else tuple(a)) for name, a in zip(names, angles.tolist(), strict=True)]
    for key in sorted(set(keys), key=str):
        number[key] = len(number)
    return np.array([number[k] for k in keys], dtype=np.intp)


@dataclass(frozen=True, eq=False)
class ObservationModel:
    """Readings of an experiment as observations: rows, the frames about which motions are counted, and all values x.

    names: the parameters that are observed, the others stay as in x; linear: by the first step from the commanded pose
    """

    model: Model
    rows: ReadingRows
    frames: tuple[Frame, ...]
    x: Array
    names: tuple[str, ...]
    linear: bool = False

    @property
    def motions(self) -> int:
        """Parameters of the estimated frames, which stand before those of the model."""
        return motion_count(self.frames)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        own = tuple(p for f in self.frames for p in f.parameters())
        return own + tuple(self.model.parameters[i] for i in self.model.index(self.names))

    def values(self, z: Array) -> Array:
        """All parameters of the model."""
        out = self.x.copy()
        out[self.model.index(self.names)] = z[self.motions :]
        return out

    def moved(self, z: Array) -> tuple[Frame, ...]:
        """The frames after their motions."""
        return tuple(f.moved(z[span]) for f, span in zip(self.frames, spans(self.frames), strict=True))

    @property
    def start(self) -> Array:
        """z (f + p,) of these frames and values."""
        return np.concatenate([np.zeros(self.motions), self.x[self.model.index(self.names)]])

    def predict(self, z: Array) -> Array:
        return self.rows.flat(self.rows.predict(self.model, self.values(z), self.moved(z), self.linear))

    def rates(self, z: Array) -> tuple[Array, Array]:
        """The prediction (m,) and its derivatives (m, f + p)."""
        predicted, J = self.rows.rates(self.model, self.values(z), self.moved(z), self.names, self.linear)
        for frame, span in zip(self.frames, spans(self.frames), strict=True):
            turn = slice(span.start + 3, span.stop)
            if not frame.touched:
                J[:, :, turn] = J[:, :, turn] @ left_jacobian(z[turn])
        return self.rows.flat(predicted), self.rows.flat(J)

    def jacobian(self, z: Array) -> Array:
        return self.rates(z)[1]

    @cached_property
    def priors(self) -> Priors:
        """What is known of all parameters of the model before these readings."""
        return priors_of(self.model, self.rows.readings)

    @property
    def reach(self) -> float:
        """m: size of the numbers that predictions are differences of; the tangent model has displacements as such."""
        return 0.0 if self.linear and self.rows.alone else REACH

    def observations(self) -> Observations:
        """What the solver works on; where it ends one fit and begins the next, it is told what it knows."""

        own = self.model.index(self.names)

        @lru_cache(maxsize=1)
        def last(z: bytes) -> tuple[Array, Array]:
            return self.rates(np.frombuffer(z))

        return Observations(
            measured=self.rows.scalars,
            predict=lambda z: last(z.tobytes())[0],
            jacobian=lambda z: last(z.tobytes())[1],
            parameters=self.parameters,
            noise=self.rows.noise,
            block=self.rows.together,
            row=self.rows.row,
            stated=self.rows.stated,
            reach=self.reach,
            prior=np.concatenate([np.zeros(self.motions), self.priors.value[own]]),
            prior_sd=np.concatenate([np.full(self.motions, np.inf), self.priors.sd[own]]),
        )


def observation_model(
    experiment: Experiment,
    readings: Readings,
    names: Sequence[str] | None = None,
    *,
    linear: bool = False,
    x: Array | None = None,
    frames: Sequence[Frame] | None = None,
    rows: ReadingRows | None = None,
) -> ObservationModel:
    """The observations that readings are of the named parameters, those of `fit:` by default.

    x: values of all parameters to stand at, nominal if None; frames: where to start, by Procrustes if None
    """
    model = experiment.model()
    rows = make_rows(readings) if rows is None else rows
    x = start_values(experiment, experiment.fit_names() if names is None else names) if x is None else x
    found = rows.start(model, x) if frames is None else tuple(frames)
    return ObservationModel(model, rows, found, x, tuple(experiment.fit_names() if names is None else names), linear)


def values_before(model: Model, readings: Collection[str]) -> Array:
    """Values (p,) of all parameters before any of some readings, by their hashes, was used, however often they were
    identified since."""
    return np.array([p.before(readings) for p in model.parameters])


def start_values(experiment: Experiment, names: Sequence[str], x: Array | None = None) -> Array:
    """Values of all parameters, nominal ones if None; where the experiment is rigid, springs that are not fitted are
    0."""
    model = experiment.model()
    x = model.nominal if x is None else x
    if experiment.rigid:
        x[model.index([n for n in experiment.spring_names() if n not in names])] = 0.0
    return x
