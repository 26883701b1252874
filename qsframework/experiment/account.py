"""What a result speaks of: which quantity, in which frame, from which readings, of which arm as it was described.

Whatever is made from a fit is formed from its account, and says no more than it holds.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from qsframework.elastostatics import Model
from qsframework.errors import some_of
from qsframework.experiment.description import description
from qsframework.experiment.finding import Finding
from qsframework.experiment.frames import PLANE, POINT
from qsframework.experiment.observations import ReadingRows
from qsframework.experiment.readings import Readings
from qsframework.experiment.setup import Experiment
from qsframework.files import FileRecord, Unit
from qsframework.plugin import Array, Indices
from qsframework.robot.kinematics import joint_frames

_MARKS = 128
"""Readings, the smallest by their hashes, by which all are known again."""
_STEPS = 1e-6, 1e-2, 1e-8
"""rad or m of an angle, N or N m of a load, m of a value: what a table may round."""
_KNOWN = 0.25
"""Share of readings that a fit has used, from which on they are no others: coarse gauges repeat by chance."""


@dataclass(frozen=True)
class UsedFile(FileRecord):
    """A file of readings: its path from the experiment's folder, and its hash."""

    path: str
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Account(FileRecord):
    """kinds: of the readings, "displacement", "position" or "gauge"
    files: that the readings are from; none where they were `simulated` in memory
    marks: hashes of some readings, by which they are known again in another file or in a part of it
    visits, reads: how often the arm was brought to a state, and how many readings were taken there
    frames: series whose frame was estimated from the same readings; tool: parameters of the markers that were
    extended: effects that the model has from a diagnosis of readings; causes: names that a diagnosis of these readings
    leaves open, None where nobody looked
    force, moment: the largest of the readings, N and N m; angles: the range of each pendant value, rad or m; flange: of
    each coordinate of the rigid arm's flange, m, base frame
    rigid: springs that are not estimated were held rigid
    findings: what is wrong with these readings, or with the files of the campaign
    description: hashes of what the model was read from, part by part, the values of parameters aside
    """

    kinds: tuple[str, ...]
    files: tuple[UsedFile, ...]
    marks: tuple[str, ...]
    visits: int
    reads: int
    frames: tuple[str, ...]
    tool: tuple[str, ...] = ()
    extended: tuple[str, ...] = ()
    causes: tuple[str, ...] | None = None
    force: Annotated[float, Unit("N")]
    moment: Annotated[float, Unit("N m")]
    angles: tuple[tuple[float, float], ...]
    flange: tuple[tuple[float, float], ...]
    rigid: bool
    simulated: bool
    description: dict[str, str]
    findings: tuple[Finding, ...] = ()

    @property
    def positions(self) -> bool:
        """Whether absolute positions were measured; else only the deflection under load is known."""
        return "position" in self.kinds

    @property
    def quantity(self) -> str:
        """What was measured, in words."""
        return "position" if self.positions else "deflection under load"

    @property
    def stopping(self) -> tuple[Finding, ...]:
        """The findings at which what uses the fit stops."""
        return tuple(found for found in self.findings if found.stops)

    @property
    def hashes(self) -> tuple[str, ...]:
        """Of the files of readings."""
        return tuple(file.sha256 for file in self.files)

    def scope(self, base: str = "an error in the base frame is not known") -> tuple[str, ...]:
        """What was measured, in which frame, what that frame and the tool absorb, and by what the model is extended.

        base: what is to be said of errors in the base frame, where the instrument's was estimated
        """
        counted = f"{self.reads} readings at {self.visits} visits"
        if not self.positions:
            said = (
                f"Measured: deflections under load, loaded minus unloaded, {counted}. All errors and uncertainties "
                "here are of the deflection under load; where the unloaded arm stands in its base frame was not "
                "measured."
            )
        elif self.frames and all(name.startswith((POINT, PLANE)) for name in self.frames):
            points = ", ".join(name.partition(":")[2] for name in self.frames)
            said = (
                f"Measured: touches of points and plates of unknown place, {counted} ({points}). Errors and "
                "uncertainties are of the arm relative to these: what shifts or turns the whole arm is taken up by "
                "their places, which were estimated from the same readings."
            )
        elif self.frames:
            tool = f", and so was the tool ({some_of(self.tool)})" if self.tool else ""
            said = (
                f"Measured: positions, {counted}, in the frame of the instrument, which was estimated from the same "
                f"readings (series {', '.join(n or 'unnamed' for n in self.frames)}){tool}. Errors and uncertainties "
                f"are in that frame: what turns or shifts the whole arm, or its tool, is absorbed there; {base}."
            )
        else:
            tool = f"the tool was estimated from the same readings ({some_of(self.tool)}); " if self.tool else ""
            said = (
                f"Measured: positions, {counted}, in the base frame, as the frame of the instrument was stated, which "
                f"counts as exact; {tool}errors and uncertainties are of the markers."
            )
        return said, *self.extension

    @property
    def extension(self) -> tuple[str, ...]:
        """By what the model is extended, in a sentence; none where it is not."""
        names = ", ".join(self.extended)
        return (f"The model is extended by what a diagnosis of readings found: {names}.",) if names else ()

    def is_of(self, readings: Readings) -> bool:
        """Whether these are the readings of the result, by the hashes of their files; of simulated ones by the
        readings themselves."""
        if self.files or not self.simulated:
            return readings.hashes == self.hashes
        return len(np.flatnonzero(readings.use)) == self.reads and self.has_used(readings)

    def has_used(self, readings: Readings) -> bool:
        """Whether more than a few of these readings are those of the result, in whatever file."""
        return self.shares(_marks(readings, np.flatnonzero(readings.use)))

    def shares(self, marks: Sequence[str]) -> bool:
        """Whether more than a few readings are the same, by the marks of other ones."""
        last = self.marks[-1] if len(self.marks) == _MARKS else "s"
        told = [mark for mark in marks if mark <= last]
        return len(set(self.marks).intersection(told)) > _KNOWN * len(told)


def _marks(readings: Readings, rows: Indices) -> tuple[str, ...]:
    """Hashes of some rows, in order, by angles, load and value as a table holds them."""
    poses, at = readings.poses, readings.plus[rows]
    parts = poses.pendant[at], poses.wrench[at] * readings.states.loaded[at, None], readings.value[rows]
    whole = [np.round(np.nan_to_num(part, nan=-1e3) / step) for part, step in zip(parts, _STEPS, strict=True)]
    cells = np.ascontiguousarray(np.concatenate(whole, axis=1).astype(np.int64))
    return tuple(sorted({f"r{hashlib.blake2b(row.tobytes(), digest_size=8).hexdigest()}" for row in cells}))


def account_of(experiment: Experiment, rows: ReadingRows, names: Sequence[str]) -> Account:
    """The account of a fit of parameters by name to some rows of readings."""
    readings, model = rows.readings, experiment.model()
    visited = readings.poses.take(np.unique(rows.plus))
    tool = set(model.of_role("marker offset"))
    return Account(
        kinds=tuple(dict.fromkeys(readings.kind[rows.keep].tolist())),
        files=tuple(
            UsedFile(_beside(source, experiment), sha)
            for source, sha in zip(readings.sources, readings.hashes, strict=True)
        ),
        marks=_marks(readings, rows.keep)[:_MARKS],
        visits=len(visited),
        reads=len(rows.keep) if readings.reads is None else int(readings.reads[rows.keep].sum()),
        frames=tuple(readings.frames[f] for f in rows.estimated),
        tool=tuple(n for n in names if n in tool),
        extended=added_effects(model),
        force=_largest(rows, slice(3)),
        moment=_largest(rows, slice(3, 6)),
        angles=_ranges(visited.pendant),
        flange=_ranges(flange_places(experiment, visited.q)),
        rigid=experiment.rigid,
        simulated=not readings.sources,
        description=description(experiment.robot, experiment),
    )


def flange_places(experiment: Experiment, q: Array) -> Array:
    """Where the rigid arm holds its flange (N, 3) m at joint values (N, n), base frame."""
    frame = experiment.robot.flange
    return joint_frames(experiment.robot.facts, q).point(frame.link, frame.placement[:3, 3]).T


def _ranges(values: Array) -> tuple[tuple[float, float], ...]:
    """The least and the largest of each column (N, k)."""
    return tuple(zip(values.min(axis=0).tolist(), values.max(axis=0).tolist(), strict=True))


def _largest(rows: ReadingRows, part: slice) -> float:
    """The largest load of the loaded readings in three of its components."""
    loads = rows.readings.poses.wrench[rows.plus, part] * rows.readings.states.loaded[rows.plus, None]
    return float(np.linalg.norm(loads, axis=1).max(initial=0.0))


def added_effects(model: Model) -> tuple[str, ...]:
    """Effects that a diagnosis of readings has added."""
    effects = zip(model.effects, model.slices, strict=True)
    return tuple(effect.name for effect, part in effects if any(p.added for p in model.parameters[part]))


def _beside(source: Path, experiment: Experiment) -> str:
    return Path(os.path.relpath(source.resolve(), experiment.path.parent.resolve())).as_posix()
