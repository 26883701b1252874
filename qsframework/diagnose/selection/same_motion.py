"""Where else a motion of the markers could come from: places that could move them alike, by a law of their own.

Laws are told apart by their shapes, but places only where the markers move otherwise. So each place may move as it
likes, anew in every visit. What the likeliest law does to the readings, and neither such motions of another place nor
the fitted parameters can do, is all that speaks against that place without a word on laws.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from qsframework.diagnose.law import Law
from qsframework.diagnose.linearization.generic_blocks import Block, Motions
from qsframework.diagnose.selection.evidence import prior_of
from qsframework.estimation.visit_noise import Reml
from qsframework.experiment.observations import ReadingRows
from qsframework.plugin import Array, Indices

_SEEN = 2.0
"""Size in units of the noise below which no reading tells two motions apart."""
_ALIKE = 1e-3
"""By how much two sizes differ: of places that come equally close the order is that of the arm, not of rounding."""
_ZERO = 1e-6
"""Of the largest singular value of a visit: directions below are none."""
_MOST = 20_000_000
"""Numbers of a place's motions at once: beyond them, where very many visits share their noise, nothing is told."""


def same_motion(moved: Motions, block: Block, fits: Reml, values: Array) -> tuple[Law, ...]:
    """The other places at which some law could do to readings (m,) m what a block's does, to within the noise, those
    first that come closest; a law of nothing (by = ()) says that its variable is open."""
    k = int(fits.choose(values[:, None])[0])
    rest, columns = fits.left(k, values), fits.left(k, block.columns)
    noise = float(rest @ rest) / fits.free
    held = noise / prior_of(block.columns, fits, values) ** 2
    did = columns @ np.linalg.solve(columns.T @ columns + held * np.eye(columns.shape[1]), columns.T @ rest)
    visits = _visits(moved.rows)
    beside = visits.split(np.column_stack([did, fits.Q[k]]))
    found: dict[tuple[str, str], tuple[float, Law]] = {}
    for law, motion in _anything(moved):
        if law.where == block.law.where or motion.size * visits.together > _MOST:
            continue
        own = visits.apart(motion)
        white = visits.split(np.column_stack([fits.noise.noises[k].whiten(c) for c in own]))
        s = _left(white, beside) / np.sqrt(noise)
        if s < min(_SEEN, found.get(law.where, (_SEEN, law))[0]):
            found[law.where] = s, law
    return tuple(law for _, law in sorted(found.values(), key=lambda x: round(x[0] / _ALIKE)))


def _anything(moved: Motions) -> Iterator[tuple[Law, Array]]:
    """Every place with its motions (R, 3, c) m, per unit, of the markers in the later state of each row."""
    for place in moved.places:
        yield Law(place.part, place.name, ()), moved.plus.columns[..., list(place.coordinates)]
    rows, markers = len(moved.rows.keep), len(moved.marker_names)
    own = [np.zeros((len(s.which), markers, 3, 3)) + np.eye(3) * float(s.context.loaded) for s in moved.stands]
    yield Law("readings", "", ()), moved.seen_columns(own).reshape(rows, 3, 3)
    for m, name in enumerate(moved.marker_names if markers > 1 else ()):
        alone = [np.where(np.arange(markers)[:, None, None] == m, shift, 0.0) for shift in own]
        yield Law("marker", name, ()), moved.seen_columns(alone).reshape(rows, 3, 3)
    forces = [s.context.poses.wrench[:, :3] * float(s.context.loaded) for s in moved.stands]
    if any(np.any(f) for f in forces):
        pull = [s.give[..., :3] * float(s.context.loaded) for s in moved.stands]
        yield Law("load", "tool", ()), moved.seen_columns(pull).reshape(rows, 3, 3)
        turn = [np.cross(np.eye(3), f[:, None]).transpose(0, 2, 1) for f in forces]
        point = [s.give[..., 3:] @ t[:, None] for s, t in zip(moved.stands, turn, strict=True)]
        yield Law("point", "tool", ()), moved.seen_columns(point).reshape(rows, 3, 3)


@dataclass(frozen=True, eq=False)
class _Visits:
    """Rows by what is whitened together: at (G, w) rows of each group, -1 beyond its last; turn (R,): the place of a
    row's visit among those of its group."""

    at: Indices
    turn: Indices

    @property
    def together(self) -> int:
        return int(self.turn.max(initial=0)) + 1

    def apart(self, motion: Array) -> list[Array]:
        """Motions (R, 3, c) as columns (3 R, c), of the first visit of each group, of the second, and so on."""
        flat = motion.reshape(3 * len(motion), -1)
        turn = np.repeat(self.turn, 3)[:, None]
        return [np.where(turn == t, flat, 0.0) for t in range(self.together)]

    def split(self, columns: Array) -> Array:
        """Columns (3 R, p) group by group (G, 3 w, p)."""
        rows = columns.reshape(-1, 3, columns.shape[1])
        return np.where(self.at[..., None, None] >= 0, rows[self.at], 0.0).reshape(len(self.at), -1, columns.shape[1])


def _visits(rows: ReadingRows) -> _Visits:
    group = np.full(len(rows.keep), -1, dtype=np.intp)
    group[rows.row] = rows.together
    group = np.unique(group, return_inverse=True)[1]
    order, counts = np.argsort(group, kind="stable"), np.bincount(group)
    first = np.cumsum(counts) - counts
    at = np.full((len(counts), counts.max()), -1, dtype=np.intp)
    at[group[order], np.arange(len(order)) - first[group[order]]] = order
    turn = np.zeros(len(rows.keep), dtype=np.intp)
    for own in at:
        used = own[own >= 0]
        turn[used] = np.unique(rows.plus[used], return_inverse=True)[1]
    return _Visits(at, turn)


def _left(white: Array, beside: Array) -> float:
    """Norm of the first of the columns beside (G, r, 1 + p) that the columns of each group (G, r, c), free in each, and
    the other columns beside, the same in all, leave."""
    U, size, _ = np.linalg.svd(white, full_matrices=False)
    U = np.where((size > _ZERO * size.max(axis=1, keepdims=True))[:, None], U, 0.0)
    left = (beside - U @ (U.transpose(0, 2, 1) @ beside)).reshape(-1, beside.shape[2])
    did, fitted = left[:, 0], left[:, 1:]
    return float(np.linalg.norm(did - fitted @ np.linalg.lstsq(fitted, did, rcond=_ZERO)[0]))
