"""The readings, the baseline fit and every candidate cause as whitened columns: what all tests work on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from qsframework.elastostatics import Model
from qsframework.estimation import LinearFit, Noise, left, orthonormal, scales
from qsframework.estimation.projection import least_squares, spanned
from qsframework.experiment import Experiment, Frame, Plan, make_rows
from qsframework.experiment.frames import motion_count
from qsframework.experiment.observations import ReadingRows
from qsframework.experiment.prior import priors_of
from qsframework.experiment.simulate import noisy_displacements, planned_readings
from qsframework.experiment.stations import station_frame
from qsframework.hypotheses.catalogue.causes import REACH, Cause, groups_of, widened
from qsframework.plugin import Array, Indices, Poses

VISIBLE = 4.0
"""s that a cause must reach at REACH times its typical size to be looked for."""
_DIRECTION = 1.0
"""s that one direction of a cause with several parameters must reach there to count."""
_TOLD = 1e-10
"""Share of the largest singular value below which readings do not tell a direction."""
_CARRIED = 1e-8
"""Share of a direction that other poses carry, below which the fit without a pose is made anew."""
_ABSORBED = 1e-6
"""Share of a column that must remain beside the fitted ones, else rounding is all that is left of it."""


def by_size(sizes: Indices) -> Iterator[tuple[Indices, Indices]]:
    """Blocks of so many columns (G,) side by side, those of one size together: which (b,), and where they stand (b, k);
    empty ones are left out."""
    first = np.cumsum(sizes) - sizes
    for size in np.unique(sizes[sizes > 0]).tolist():
        of = np.flatnonzero(sizes == size)
        yield of, first[of][:, None] + np.arange(size)


@dataclass(frozen=True, eq=False)
class Subspace:
    """What one cause can do to the readings beyond the fitted parameters, orthonormal (m, k) in whitened readings.

    values (k,): s per typical size of each direction; turn (p, k): SI parameters per unit of s along each direction;
    absorbed (f, k): the shift of the fitted parameters, SI, per unit of s; reach: s at REACH typical sizes
    """

    cause: Cause
    Q: Array
    values: Array
    turn: Array
    absorbed: Array
    reach: float

    @property
    def visible(self) -> bool:
        return self.Q.shape[1] > 0

    @property
    def one_sided(self) -> bool:
        """Whether only a positive coefficient is physical."""
        return self.visible and self.cause.one_sided()


@dataclass(frozen=True, eq=False, kw_only=True)
class Case:
    """Whitened columns of m coordinates, three a reading and zero where none was measured: motions of F estimated
    frames and fitted parameters A (m, 6 F + f) per scale, causes B (m, p_g) per natural size.

    frames: about which motions are counted; x: values of all parameters of `model`, which holds every cause;
    residuals (m,) whitened, of the baseline fit (zero where nothing has been measured yet); pose (m,): number of the
    pose of each coordinate; raw (m, q): all columns in m, not whitened; held (6 F + f,): 1 / sd of what is
    known of what is fitted before the readings, to be `aim` (6 F + f,) beyond its value, per column; noise: by which
    columns and residuals are whitened;
    grown: how many times the stated noise it is: what is seen is judged by the latter, as a misfit may pass for noise
    """

    experiment: Experiment
    model: Model
    frames: tuple[Frame, ...]
    fitted: tuple[str, ...]
    causes: tuple[Cause, ...]
    x: Array
    A: Array
    B: tuple[Array, ...]
    residuals: Array
    pose: Indices
    raw: Array
    held: Array
    noise: Noise
    grown: float = 1.0
    aim: Array | None = None

    @property
    def scale(self) -> Array:
        """SI value (f,) of one unit of each fitted column."""
        return scales([self.model.parameters[i] for i in self.model.index(self.fitted)])

    @property
    def motions(self) -> int:
        """Columns of the frames, which stand first in A."""
        return motion_count(self.frames)

    @property
    def count(self) -> int:
        """Coordinates that were measured."""
        return int(np.count_nonzero(np.any(self.A != 0.0, axis=1) | (self.residuals != 0.0)))

    @cached_property
    def fit(self) -> LinearFit:
        """What the readings tell of what is fitted, and what that leaves of the residuals."""
        return LinearFit.onto(spanned(self.A, self.held), self.residuals)

    def held_out_errors(self, columns: Array, label: Indices) -> Array:
        """Whitened errors (m,) of blocks of coordinates, by label, after a fit of columns (m, p) to all others, NaN of
        label -1. What is fitted stands first, with what is known of it before."""
        A, y = self.with_holds(columns)
        blocks = np.concatenate([label, np.full(len(A) - len(label), -1)])
        out = LinearFit.onto(orthonormal(A), y).held_out_errors(blocks, _CARRIED)[: len(label)]
        for alone in np.unique(label[(label >= 0) & np.isnan(out)]).tolist():
            others = blocks != alone
            out[label == alone] = (y - A @ least_squares(A[others], y[others], _TOLD))[~others]
        return out

    def beside(self, causes: Sequence[int]) -> Array:
        """The columns of what is fitted, and of some causes, whitened."""
        return np.concatenate([self.A, *(self.B[i] for i in causes)], axis=1)

    def left_of(self, columns: Array) -> Array:
        """What a fit of columns (m, p), held likewise, leaves (m,) of the residuals."""
        A, y = self.with_holds(columns)
        return left(orthonormal(A), y)[: len(self.residuals)]

    def with_holds(self, columns: Array) -> tuple[Array, Array]:
        """Columns and residuals with the holds below, as readings."""
        kept = self.held > 0.0
        held = self.held[:, None] * np.eye(len(self.held), columns.shape[1])
        aim = self.held * (np.zeros(len(self.held)) if self.aim is None else self.aim)
        return np.vstack([columns, held[kept]]), np.concatenate([self.residuals, aim[kept]])

    def subspaces(self) -> tuple[Subspace, ...]:
        """One for each cause; without a direction where the cause is invisible in this protocol."""
        Q, R = np.linalg.qr(self.with_holds(self.A)[0])
        back = np.asarray(np.linalg.solve(R, Q[: len(self.A)].T), dtype=np.float64)
        return tuple(self._subspace(c, B, back) for c, B in zip(self.causes, self.B, strict=True))

    def _subspace(self, cause: Cause, columns: Array, back: Array) -> Subspace:
        U, values, V = np.linalg.svd(self.fit.given(columns), full_matrices=False)
        size = float(np.linalg.norm(columns, axis=0).max(initial=0.0))
        reach = REACH * self.grown * float(values[0]) if len(values) else 0.0
        seen = (values * REACH * self.grown >= _DIRECTION) & (values > _ABSORBED * size) & (reach >= VISIBLE)
        if len(cause.parameters) == 1 and seen.any() and V[0, 0] < 0.0:
            U, V = -U, -V  # so that a positive coefficient means a larger parameter
        turn = (np.array(cause.sizes)[:, None] * V[seen].T) / values[seen]
        absorbed = -(back @ columns)[self.motions :] @ (V[seen].T / values[seen]) * self.scale[:, None]
        return Subspace(cause, np.ascontiguousarray(U[:, seen]), values[seen], turn, absorbed, reach)

    def grouped(self) -> Case:
        """The same, and all axes of one place that are visible as one cause more."""
        seen = [s.cause for s in self.subspaces() if s.visible]
        groups = groups_of(seen)
        place = {c.name: i for i, c in enumerate(self.causes)}
        raw = [self.metres(place[e.name]) for g in groups for e in g.effects]
        B = tuple(np.concatenate([self.B[place[e.name]] for e in g.effects], axis=1) for g in groups)
        return replace(
            self,
            causes=(*self.causes, *groups),
            B=(*self.B, *B),
            raw=np.concatenate([self.raw, *raw], axis=1),
        )

    def rewhitened(self, kept: Indices, noise: Noise, residuals: Array) -> Case:
        """Of rows `kept`, under other noise, with residuals (len(kept), 3) m of a fit to them."""
        scalars = (3 * kept[:, None] + np.arange(3)).ravel()
        raw = self.raw[scalars]
        A, B = _split(noise.whiten(raw), self.motions + len(self.fitted), self.causes)
        white = noise.whiten(residuals.ravel())
        return replace(self, A=A, B=B, residuals=white, pose=self.pose[scalars], raw=raw, noise=noise)

    def metres(self, i: int) -> Array:
        """Columns (m, p) m of cause i, per natural size, not whitened."""
        first = self.motions + len(self.fitted) + sum(len(c.parameters) for c in self.causes[:i])
        return self.raw[:, first : first + len(self.causes[i].parameters)]


def make_case(
    experiment: Experiment,
    rows: ReadingRows,
    fitted: Sequence[str],
    causes: Sequence[Cause],
    x: dict[str, float],
    residuals: Array,
    frames: Sequence[Frame] = (),
) -> Case:
    """Linearise about the parameter values `x` (by name, the others at their nominal or vanishing value).

    residuals (R, 3) m, of the exact model there, zero where nothing was measured
    """
    model = widened(experiment.model(), causes)
    values = model.nominal
    for i, name in enumerate(model.names):
        values[i] = x.get(name, values[i])
    wanted = [*fitted, *(n for c in causes for n in c.names)]
    columns = rows.padded(rows.rates(model, values, frames, wanted)[1]).reshape(3 * len(rows.keep), -1)
    sizes = np.concatenate(
        [
            [p.scale for f in frames for p in f.parameters()],
            scales([model.parameters[i] for i in model.index(fitted)]),
            *(np.array(c.sizes) for c in causes),
        ]
    )
    raw, noise = columns * sizes, rows.padded_noise
    A, B = _split(noise.whiten(raw), motion_count(frames) + len(fitted), causes)
    index, known = model.index(fitted), priors_of(model, rows.readings)
    own = [model.parameters[i] for i in index]
    return Case(
        experiment=experiment,
        model=model,
        frames=tuple(frames),
        fitted=tuple(fitted),
        causes=tuple(causes),
        x=values,
        A=A,
        B=B,
        residuals=noise.whiten(residuals.ravel()),
        pose=np.repeat(rows.pose, 3),
        raw=raw,
        held=np.concatenate([np.zeros(motion_count(frames)), scales(own) / known.sd[index]]),
        noise=noise,
        aim=np.concatenate([np.zeros(motion_count(frames)), (known.value - values)[index] / scales(own)]),
    )


def _split(white: Array, first: int, causes: Sequence[Cause]) -> tuple[Array, tuple[Array, ...]]:
    """Columns of what is fitted, the `first` ones, and of each cause."""
    ends = np.cumsum([first, *(len(c.parameters) for c in causes)])
    return white[:, :first], tuple(white[:, a:b] for a, b in pairwise(ends.tolist()))


def plan_case(
    experiment: Experiment,
    poses: Poses | Plan,
    fitted: Sequence[str],
    causes: Sequence[Cause],
) -> Case:
    """The case of poses that are still to be measured, every marker once, at nominal values; no residuals.

    Of a plan, the case of what it reads: positions in the frames of its stations, each with its own sd.
    """
    if isinstance(poses, Plan):
        planned = planned_readings(experiment, poses)
    else:
        nothing = np.zeros((len(poses), len(experiment.markers), 3))
        planned = noisy_displacements(experiment, poses, nothing, [f"{i:09d}" for i in range(len(poses))])
    rows = make_rows(planned)
    frames = [station_frame(experiment, planned.frames[f]) for f in rows.estimated]
    return make_case(experiment, rows, fitted, causes, {}, np.zeros_like(rows.measured), frames)
