"""Readings: one kind for displacements, positions and gauges.

A state is one pose, load, repeat, cycle and series at which the arm stood still. A reading is a vector measured of one
marker: what the instrument says at one state, less what it says at another or nothing, in a frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from qsframework.errors import Problem, some_of
from qsframework.experiment.frames import Frame
from qsframework.files import sha256
from qsframework.plugin import Array, Conditions, Indices, Poses
from qsframework.plugin.facts import frozen
from qsframework.viewed import Viewed

KINDS = ("displacement", "position", "gauge")
_OF_ROWS = ("marker", "value", "sigma", "minus_sigma", "use", "line", "to")
_UNLESS_SAID = {"axes": np.eye(3), "reads": np.array(1, dtype=np.intp), "directed": np.zeros((2, 3))}
"""What rows may have, and what they have where nothing is said."""
"""What each row has of its own, whatever the states, frames and files are."""
UNSTATED = 1e-3
"""m: stands for a sigma that nobody states, and that is estimated."""
_STILL = 1e-6
"""rad or m: what a controller shows of a joint that keeps its place."""


@dataclass(frozen=True, eq=False, kw_only=True)
class States:
    """N states. poses: the conditions of each both in `unloaded` and in `loaded`, its wrench 0 where no load hangs.

    pose, load_id, series: names, "" where not given; repeat, cycle (N,): counts; loaded (N,): whether a load hangs
    """

    poses: Poses
    loaded: npt.NDArray[np.bool_]
    pose: tuple[str, ...]
    load_id: tuple[str, ...]
    series: tuple[str, ...]
    repeat: Indices
    cycle: Indices

    def __len__(self) -> int:
        return len(self.pose)


def moving(pendant: Array) -> npt.NDArray[np.bool_]:
    """Whether each pendant value (n,) differs between poses (N, n)."""
    return np.ptp(pendant, axis=0) > _STILL


@dataclass(frozen=True)
class Alignment:
    """How a series lies to the base: angle (rad) turned, and what the unloaded markers then miss, m, of `count`.

    turned: whether displacements of this series are turned by it; else its axes are near enough those of the base
    """

    series: str
    angle: float
    rms: float
    largest: float
    count: int
    turned: bool


@dataclass(frozen=True)
class Made:
    """Simulated readings: the model that made them, "equilibrium" or "linear", and the seed."""

    model: str
    seed: int | None


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Readings(Viewed):
    """R rows over N states: each h(plus) - h(minus) of a marker, in a frame.

    plus, minus (R,): states, minus -1 where nothing is taken off; marker (R,); frame (R,): place in `frames`, -1 for
    the base; frames: names of the series; known: each frame, None where it is to be estimated;
    of a plate that is touched its turn alone is known, its first axis the normal
    value (R, 3) m, NaN where an axis was not measured; sigma (R, 3) m; stated: whether sigma is known, and not only up
    to a factor; minus_sigma (R, 3): the part of sigma that the reading at `minus` brings, NaN: half of the variance
    directed (R, 2, 3) m: of what it errs more along some directions than along others, which is part of sigma: errors
    along two vectors; None: all coordinates err alike
    axes (R, 3, 3): unit vectors along which the value was measured, rows, base frame; None: the frame's own
    to (R,): marker to which the distance (its only value) was measured, -1 for none
    use (R,): False where a row is masked; line (R,): in the file `sources[file]`; no sources: simulated
    reads (R,): of how many reads, taken without moving, each row is the mean; None: one
    unnumbered: rows that were taken as further reads of a visit, which no column says
    robot: the arm's name; "": nobody says
    repeatability: stated sd m of the error that the markers of a visit share; None: not stated
    """

    states: States
    plus: Indices
    minus: Indices
    marker: Indices
    frame: Indices
    frames: tuple[str, ...]
    known: tuple[Frame | None, ...]
    value: Array
    sigma: Array
    minus_sigma: Array
    stated: bool
    use: npt.NDArray[np.bool_]
    line: Indices
    file: Indices
    to: Indices
    directed: Array | None = None
    axes: Array | None = None
    reads: Indices | None = None
    unnumbered: int = 0
    sources: tuple[Path, ...] = ()
    drive_state: tuple[str, ...] | None = None
    repeatability: float | None = None
    alignments: tuple[Alignment, ...] = ()
    made: Made | None = None
    robot: str = ""

    def __len__(self) -> int:
        return len(self.use)

    @property
    def poses(self) -> Poses:
        """Those of the states."""
        return self.states.poses

    @property
    def pose(self) -> tuple[str, ...]:
        """Name of the pose of each row."""
        return tuple(self.states.pose[int(s)] for s in self.plus)

    @property
    def source(self) -> Path | None:
        """The first file, None for a simulation."""
        return self.sources[0] if self.sources else None

    @cached_property
    def moves(self) -> npt.NDArray[np.bool_]:
        """Whether each pendant value (n,) differs between used readings: of one that never does nothing can be said."""
        return moving(self.poses.pendant[self.plus[self.use]])

    @cached_property
    def hashes(self) -> tuple[str, ...]:
        """SHA-256 of the files, as they are when this is asked first."""
        return tuple(sha256(source) for source in self.sources)

    @property
    def where(self) -> str:
        """The files, in words for an error."""
        return ", ".join(str(s) for s in self.sources) or "simulated readings"

    def problem(self, i: int, message: str, column: str | None = None, **more: Any) -> Problem:
        """A problem of row i, in its file."""
        file = str(self.sources[int(self.file[i])]) if self.sources else self.where
        return Problem(message, file, int(self.line[i]), column, **more)

    @property
    def is_position(self) -> npt.NDArray[np.bool_]:
        """Rows (R,) that nothing is taken off."""
        return self.minus < 0

    @property
    def is_gauge(self) -> npt.NDArray[np.bool_]:
        """Rows (R,) of a dial gauge or a draw-wire."""
        own = np.zeros(len(self), dtype=bool)
        return own if self.axes is None else (self.to >= 0) | np.any(self.axes != np.eye(3), axis=(1, 2))

    @property
    def kind(self) -> npt.NDArray[np.str_]:
        """The kind (R,) of each row, one of KINDS."""
        return np.where(self.is_gauge, "gauge", np.where(self.is_position, "position", "displacement"))

    @property
    def about_reads(self) -> tuple[str, ...]:
        """What is to be said of rows that were taken as reads of one visit."""
        if not self.unnumbered:
            return ()
        return (
            f"{self.unnumbered} rows are further reads of a visit: one after the other, at the same angles and load. "
            "The mean of each visit counts; where the arm was moved between them, number the visits in a column "
            "`repeat` or `visit`.",
        )

    def about_still(self, driven: Sequence[str]) -> tuple[str, ...]:
        """What those of the driven joints hide that never move."""
        still = [joint for joint, moves in zip(driven, self.moves, strict=True) if not moves]
        if not still:
            return ()
        return (
            f"{some_of(still)} {'stands' if len(still) == 1 else 'stand'} still in all readings: nothing is said of "
            "the sign, the unit, the zero and the coupling of what the controller shows there.",
        )

    @property
    def displacements(self) -> Readings:
        """The rows that are differences of two states."""
        return replace(self, use=self.use & ~self.is_position)

    def masked(self, wrong: npt.NDArray[np.bool_]) -> Readings:
        """The same readings with these rows (R,) not used."""
        return replace(self, use=self.use & ~wrong)

    def of_rows(self, rows: Indices) -> Readings:
        """Some of the rows, over the same states."""
        each = ("plus", "minus", "frame", "file", *_OF_ROWS)
        known = {name: v[rows] for name in _UNLESS_SAID if (v := getattr(self, name)) is not None}
        return replace(self, **{name: getattr(self, name)[rows] for name in each}, **known)

    def with_values(self, value: Array) -> Readings:
        """Other values (R, 3) m at the same rows."""
        return replace(self, value=frozen(np.where(np.isfinite(self.value), value, np.nan)))

    def with_poses(self, poses: Poses) -> Readings:
        """The same states at other angles or under other loads."""
        return replace(self, states=replace(self.states, poses=poses))

    def gauged(self, rows: npt.NDArray[np.bool_], along: Array, sd: float) -> Readings:
        """The same, some rows (R,) as a gauge of this sd (m) reads them along a unit vector (3,)."""
        axes = np.tile(np.eye(3), (len(self), 1, 1)) if self.axes is None else np.array(self.axes)
        value, sigma = np.array(self.value), np.array(self.sigma)
        value[rows] = np.stack([value[rows] @ along, *np.full((2, int(rows.sum())), np.nan)], axis=1)
        axes[rows], sigma[rows] = axes_along(along), sd
        alike = None if self.directed is None else np.where(rows[:, None, None], 0.0, self.directed)
        return replace(self, value=frozen(value), sigma=frozen(sigma), axes=axes, directed=alike)


def axes_along(direction: Array) -> Array:
    """Unit vectors (3, 3) by rows, the first along a direction (3,), base axes: what a gauge reads along."""
    u = direction / float(np.linalg.norm(direction))
    other = np.asarray(np.cross(u, np.eye(3)[int(np.argmin(np.abs(u)))]), dtype=np.float64)
    other /= float(np.linalg.norm(other))
    return np.stack([u, other, np.asarray(np.cross(u, other), dtype=np.float64)])


def joined(parts: list[Readings]) -> Readings:
    """Several files in one: their states and rows after each other, series of one name in one frame."""
    if len(parts) == 1:
        return parts[0]
    frames = tuple(dict.fromkeys(name for p in parts for name in p.frames))
    known = {name: frame for p in parts for name, frame in zip(p.frames, p.known, strict=True)}
    first = np.cumsum([0, *(len(p.states) for p in parts)])
    files = np.cumsum([0, *(len(p.sources) for p in parts)])

    def moved(name: str) -> Indices:
        shifted = [np.where(getattr(p, name) < 0, -1, getattr(p, name) + k) for p, k in zip(parts, first, strict=False)]
        return np.concatenate(shifted)

    place = [np.array([*(frames.index(n) for n in p.frames), -1], dtype=np.intp)[p.frame] for p in parts]
    said = {
        name: np.concatenate(
            [np.tile(usual, (len(p), *[1] * usual.ndim)) if (v := getattr(p, name)) is None else v for p in parts]
        )
        for name, usual in _UNLESS_SAID.items()
        if any(getattr(p, name) is not None for p in parts)
    }
    drives: tuple[str, ...] | None = None
    if any(p.drive_state is not None for p in parts):
        drives = tuple(d for p in parts for d in (p.drive_state or ("",) * len(p)))
    own = {name: np.concatenate([getattr(p, name) for p in parts]) for name in _OF_ROWS}
    own |= {name: frozen(own[name]) for name in ("value", "sigma", "minus_sigma")}
    return replace(
        parts[0],
        states=_joined_states([p.states for p in parts]),
        plus=moved("plus"),
        minus=moved("minus"),
        frame=np.concatenate(place),
        frames=frames,
        known=tuple(known[n] for n in frames),
        stated=all(p.stated for p in parts),
        file=np.concatenate([p.file + k for p, k in zip(parts, files, strict=False)]).astype(np.intp),
        sources=tuple(s for p in parts for s in p.sources),
        drive_state=drives,
        alignments=tuple(a for p in parts for a in p.alignments),
        made=parts[0].made if all(p.made == parts[0].made for p in parts) else None,
        unnumbered=sum(p.unnumbered for p in parts),
        **own,
        **said,
    )


def _joined_states(parts: list[States]) -> States:
    def conditions(name: str) -> Conditions:
        found = [getattr(p.poses, name) for p in parts]

        def both(key: str) -> Array | None:
            own = [getattr(c, key) for c in found]
            if all(v is None for v in own):
                return None
            sizes = [len(p) for p in parts]
            if key == "order":  # one file was read after the other
                starts, total = np.cumsum([0, *sizes]), sum(sizes)
                own = [v if v is None else (v * n + a) / total for v, n, a in zip(own, sizes, starts, strict=False)]
            rest = next(v.shape[1:] for v in own if v is not None)
            return np.concatenate(
                [np.full((n, *rest), np.nan) if v is None else v for v, n in zip(own, sizes, strict=True)]
            )

        return Conditions.each(both)

    pendant, q, wrench = (np.concatenate([getattr(p.poses, k) for p in parts]) for k in ("pendant", "q", "wrench"))
    return States(
        poses=Poses(pendant, q, wrench, conditions("unloaded"), conditions("loaded")),
        loaded=np.concatenate([p.loaded for p in parts]),
        pose=tuple(n for p in parts for n in p.pose),
        load_id=tuple(n for p in parts for n in p.load_id),
        series=tuple(n for p in parts for n in p.series),
        repeat=np.concatenate([p.repeat for p in parts]),
        cycle=np.concatenate([p.cycle for p in parts]),
    )
