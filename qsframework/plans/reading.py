"""What a pose would read: whitened rows of displacements under a load, by the tracker or a gauge, and of positions.

A position is read in the frame of its station, which nobody may know: six columns more, motions of the frame along the
axes of the base. They are in the information as what else is estimated: a criterion speaks of the wanted parameters
after them. A marker that the station does not see has rows of zeros.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics.so3 import cross_matrix
from qsframework.errors import InputError, NotConverged
from qsframework.estimation import scales
from qsframework.estimation.noise import inverse_roots
from qsframework.experiment import Experiment, LoadCase
from qsframework.experiment.noise import gauge_sigma, require_position_noise
from qsframework.experiment.stations import Station
from qsframework.information import CandidateRows, information_rows
from qsframework.plugin import Array, Indices, Poses

FRAME_SCALE = 1e-2
"""m, rad: one unit of a frame's motion."""
FRAME_SD = 1e3
"""Of such units, 10 m or rad: how far a frame may be from where it is thought, so that one that no pose is read in does
no harm. It is worth 1e-10 of a reading."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CandidateReading:
    """How candidates are read: under which of the loads, from which of the stations, for which parameters.

    samples (S, q): parameter values that rows are taken at; slots: of each station the number of its unknown frame
    among them, None where it is known or no position is read
    """

    experiment: Experiment
    names: tuple[str, ...]
    samples: Array
    loads: tuple[LoadCase, ...]
    stations: tuple[Station, ...]
    slots: tuple[int | None, ...]

    @property
    def width(self) -> int:
        """Columns of the rows: the parameters, and six of each unknown frame."""
        return len(self.names) + 6 * len({*self.slots} - {None})

    @property
    def plain(self) -> bool:
        """Whether all that is read is displacements by a tracker that sees every marker, all with one sd and errors of
        their own."""
        noise = self.experiment.noise
        apart = any(load.of_positions or load.gauge is not None for load in self.loads)
        apart |= bool(noise.repeatability or noise.nest or noise.of_beam("displacement"))
        return not apart and all(station.xyz is None for station in self.stations)

    def rows(self, poses: Poses, load: Indices, station: Indices, linear: bool = False) -> Array:
        """Whitened scaled rows (m, S, 3 K, P) of poses under a load (m,), from a station (m,)."""
        if self.plain:
            return sample_rows(self.experiment, poses, self.names, self.samples, linear)
        bare, places = self.bare(poses, load, linear)
        return self.whitened(bare, self.weights(poses, places, load, station), load, station)

    def bare(self, poses: Poses, load: Indices, linear: bool = False) -> tuple[Array, Array]:
        """Scaled rows (m, S, 3 K, p + 6), m, as if every marker were seen, and where the markers are (m, K, 3)."""
        count, K, p = len(poses), len(self.experiment.markers), len(self.names)
        out, places = np.zeros((count, len(self.samples), 3 * K, p + 6)), np.zeros((count, K, 3))
        for g, case in enumerate(self.loads):
            own = np.flatnonzero(load == g)
            if len(own) and case.of_positions:
                out[own], places[own] = self._positions(poses.take(own), linear)
            elif len(own):
                moved = sample_rows(self.experiment, poses.take(own), self.names, self.samples, linear, 1.0)
                places[own] = self.experiment.rigid_places(poses.q[own])
                out[own, :, :, :p] = moved if case.gauge is None else self._gauged(case, moved)
        return out, places

    def _positions(self, poses: Poses, linear: bool) -> tuple[Array, Array]:
        """Rows of positions, with the motions of the frame, and the places."""
        model = self.experiment.model()
        size = scales([model.parameters[i] for i in model.index(self.names)])
        rows, first = list[Array](), None
        for x in self.samples:
            places, slope = model.position_rates(poses, x, self.names, False, linear)
            first = places if first is None else first
            turn = -cross_matrix(places.reshape(-1, 3)).reshape(*places.shape, 3)
            shift = np.broadcast_to(np.eye(3), turn.shape)
            motion = np.concatenate([shift, turn], axis=-1) * FRAME_SCALE
            rows.append(np.concatenate([slope * size, motion], axis=-1).reshape(len(poses), -1, len(size) + 6))
        assert first is not None
        return np.stack(rows, axis=1), first

    def _gauged(self, case: LoadCase, moved: Array) -> Array:
        """Displacements (m, S, 3 K, p) as a gauge reads them: one row of one marker."""
        assert case.gauge is not None
        k = [m.name for m in self.experiment.markers].index(case.gauge.marker)
        out = np.zeros_like(moved)
        out[:, :, 3 * k] = np.einsum("j,nsjp->nsp", case.gauge.along, moved[:, :, 3 * k : 3 * k + 3])
        return out

    def weights(self, poses: Poses, places: Array, load: Indices, station: Indices) -> Array:
        """Roots C^-1/2 (m, K, 3, 3) of the covariances of each marker, zero where it is not seen; where all coordinates
        err alike in every reading, 1 / sd (m, K)."""
        noise, nest = self.experiment.noise, self.experiment.noise.nest**2 * np.eye(3)
        out = np.zeros((*places.shape[:2], 3, 3))
        for s, stand in enumerate(self.stations):
            own = np.flatnonzero(station == s)
            seen = stand.sees(self.experiment, poses.q[own]).astype(float)
            there = places[own] if stand.xyz is None else places[own] - stand.xyz
            for g, case in enumerate(self.loads):
                rows = load[own] == g
                if case.gauge is not None:
                    out[own[rows]] = np.eye(3) / (gauge_sigma(self.experiment) or np.nan)
                    continue
                kind = "position" if case.of_positions else "displacement"
                covariance = noise.covariances(kind, there[rows].reshape(-1, 3))
                assert covariance is not None  # or there is no plan: `require_noise`
                root = inverse_roots(covariance + nest)[0].reshape(-1, len(places[0]), 3, 3)
                out[own[rows]] = seen[rows, :, None, None] * root
        axial = noise.of_beam("position") or noise.of_beam("displacement")
        return out if axial else out[:, :, 0, 0]

    def whitened(self, bare: Array, weights: Array, load: Indices, station: Indices) -> Array:
        """Rows (m, S, 3 K, P) of those of `bare`, with the motions of a frame at its place among all of them."""
        p, K = len(self.names), weights.shape[1]
        root = weights if weights.ndim == 4 else weights[:, :, None, None] * np.eye(3)
        each = bare.reshape(*bare.shape[:2], K, 3, bare.shape[3])
        white = each * weights[:, None, :, None, None] if weights.ndim == 2 else root[:, None] @ each
        if self.experiment.noise.repeatability:
            visit = np.array([self.experiment.noise.repeatability * (case.gauge is None) for case in self.loads])[load]
            white = _less_shared(white, visit[:, None, None, None] * root)
        white = white.reshape(bare.shape)
        if self.slots == (0,):
            return white
        out = np.zeros((*bare.shape[:3], self.width))
        out[..., :p] = white[..., :p]
        for s, slot in enumerate(self.slots):
            own = np.flatnonzero(station == s)
            if slot is not None and len(own):
                out[own, :, :, p + 6 * slot : p + 6 * slot + 6] = white[own, :, :, p:]
        return out

    def require_noise(self) -> None:
        """InputError where nobody states the sd of what is to be read."""
        noise, path, stations = self.experiment.noise, self.experiment.path, self.stations
        if any(load.gauge is not None for load in self.loads):
            gauge_sigma(self.experiment)
        if any(not load.of_positions and load.gauge is None for load in self.loads):
            if noise.of("displacement") is None and not noise.of_beam("displacement"):
                raise InputError(
                    f"{path}: a design needs the noise, for example noise: {{sigma_mm: 0.03}}; of displacements beside "
                    "other readings displacement_sigma_mm"
                )
            if noise.of_beam("displacement"):
                require_position_noise(self.experiment, stations)
        if any(load.of_positions for load in self.loads):
            require_position_noise(self.experiment, stations)


def unknown_frames(experiment: Experiment) -> list[str]:
    """The stations in whose frame positions are read and nobody knows the base."""
    known = {frame.series for frame in experiment.frames}
    stations = experiment.stations or (Station(),)
    return [s.name for s in stations if s.name not in known] if experiment.plans_positions else []


def _less_shared(white: Array, shared: Array) -> Array:
    """Rows (m, S, K, 3, P), whitened by the markers' own errors, whitened also by the error that all markers of a visit
    share, which is `shared` U (m, K, 3, 3) of those: (I + U U')^-1/2 = I - U V f V' U', U'U = V g V',
    f = (1 - (1 + g)^-1/2) / g."""
    g, V = np.linalg.eigh(np.einsum("nkji,nkjl->nil", shared, shared))
    f = np.where(g > 1e-12, (1.0 - 1.0 / np.sqrt(1.0 + g)) / np.maximum(g, 1e-12), 0.5)
    turned = shared @ V[:, None]
    inside = np.einsum("nkji,nskjp->nsip", turned, white) * f[:, None, :, None]
    return white - np.einsum("nkji,nsip->nskjp", turned, inside)


def sample_rows(
    experiment: Experiment,
    poses: Poses,
    names: Sequence[str],
    samples: Array,
    linear: bool = False,
    sigma: float | None = None,
) -> Array:
    """Whitened rows (m, S, 3 K, p) of displacements of poses at S samples of the parameters; zero where a pose does not
    settle. sigma: that of the experiment if None."""
    model, sd = experiment.model(), sigma or experiment.noise.sigma or 1.0
    try:
        return np.stack([information_rows(model, poses, names, sd, x, linear) for x in samples], axis=1)
    except NotConverged:
        if len(poses) == 1:
            return np.zeros((1, len(samples), 3 * len(model.markers), len(names)))
    halves = (slice(0, len(poses) // 2), slice(len(poses) // 2, None))
    parts = [sample_rows(experiment, poses.take(half), names, samples, linear, sigma) for half in halves]
    return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class StationRows(CandidateRows):
    """Rows of the same poses from several stations, one station after the other.

    source: `CandidateReading.bare` of the L N candidates of one station; weights (C, L N, K, ...): of each station
    """

    reading: CandidateReading
    source: CandidateRows
    weights: Array
    used: tuple[int, ...]

    @property
    def shape(self) -> tuple[int, int, int, int]:  # pyright: ignore[reportIncompatibleVariableOverride]
        _, S, rows, _ = self.source.shape
        return len(self.used) * len(self.source), S, rows, self.reading.width

    def take(self, index: Indices) -> Array:
        index = np.asarray(index)
        stand, own = index // len(self.source), index % len(self.source)
        weights, load = self.weights[stand, own], own * len(self.reading.loads) // len(self.source)
        return self.reading.whitened(self.source.take(own), weights, load, np.array(self.used)[stand])
