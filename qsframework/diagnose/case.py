"""The readings, the baseline fit and every candidate cause as whitened columns: what all tests work on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from qsframework.diagnose.causes import REACH, Cause, widened
from qsframework.elastostatics import Model
from qsframework.experiment import Experiment
from qsframework.identify.linear import Rows
from qsframework.identify.observations import Noise
from qsframework.information import scales
from qsframework.plugin import Array, Indices, Poses

VISIBLE = 4.0
"""s that a cause must reach at REACH times its typical size to be looked for."""
_DIRECTION = 1.0
"""s that one direction of a cause with several parameters must reach there to count."""
_ABSORBED = 1e-6
"""Share of a column that must remain beside the fitted ones, else rounding is all that is left of it."""


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


@dataclass(frozen=True, eq=False)
class Case:
    """Whitened columns of m scalar readings: fitted parameters A (m, f) per scale, causes B (m, p_g) per typical size.

    x: values of all parameters of `model`, the one that holds every cause; residuals (m,) whitened, of the baseline fit
    (zero where nothing has been measured yet); pose (m,): number of the pose of each scalar reading; raw (m, q): all
    columns in m, not whitened
    """

    experiment: Experiment
    model: Model
    poses: Poses
    fitted: tuple[str, ...]
    causes: tuple[Cause, ...]
    x: Array
    A: Array
    B: tuple[Array, ...]
    residuals: Array
    pose: Indices
    raw: Array

    @property
    def scale(self) -> Array:
        """SI value (f,) of one unit of each fitted column."""
        return scales([self.model.parameters[i] for i in self.model.index(self.fitted)])

    def subspaces(self) -> tuple[Subspace, ...]:
        """One for each cause; without a direction where the cause is invisible in this protocol."""
        return self.subspaces_of(range(len(self.causes)))

    def subspaces_of(self, index: Sequence[int]) -> tuple[Subspace, ...]:
        """The subspaces of some causes, by position."""
        Q, R = np.linalg.qr(self.A)
        back = np.linalg.solve(R, Q.T)
        return tuple(self._subspace(self.causes[i], self.B[i], Q, back) for i in index)

    def _subspace(self, cause: Cause, columns: Array, Q: Array, back: Array) -> Subspace:
        left = columns - Q @ (Q.T @ columns)
        left -= Q @ (Q.T @ left)
        U, values, V = np.linalg.svd(left, full_matrices=False)
        size = float(np.linalg.norm(columns, axis=0).max(initial=0.0))
        reach = REACH * float(values[0]) if len(values) else 0.0
        seen = (values * REACH >= _DIRECTION) & (values > _ABSORBED * size) & (reach >= VISIBLE)
        if len(cause.parameters) == 1 and seen.any() and V[0, 0] < 0.0:
            U, V = -U, -V  # so that a positive coefficient means a larger parameter
        turn = (np.array(cause.sizes)[:, None] * V[seen].T) / values[seen]
        absorbed = -(back @ columns) @ (V[seen].T / values[seen]) * self.scale[:, None]
        return Subspace(cause, np.ascontiguousarray(U[:, seen]), values[seen], turn, absorbed, reach)

    def rewhitened(self, kept: Indices, noise: Noise, residuals: Array) -> Case:
        """Of rows `kept`, under other noise, with residuals (len(kept), 3) m of a fit to them."""
        scalars = (3 * kept[:, None] + np.arange(3)).ravel()
        raw = self.raw[scalars]
        A, B = _split(noise.whiten(raw), self.fitted, self.causes)
        return replace(self, A=A, B=B, residuals=noise.whiten(residuals.ravel()), pose=self.pose[scalars], raw=raw)


def make_case(
    experiment: Experiment, poses: Poses, fitted: Sequence[str], causes: Sequence[Cause], x: dict[str, float],
    rows: Rows, noise: Noise, residuals: Array,
) -> Case:  # fmt: skip
    """Linearise about the parameter values `x` (by name, the others at their nominal or vanishing value).

    residuals (R, 3) m, of the exact model there
    """
    model = widened(experiment.model(), causes)
    values = model.nominal
    for i, name in enumerate(model.names):
        values[i] = x.get(name, values[i])
    wanted = [*fitted, *(n for c in causes for n in c.names)]
    columns = rows.of(model.sensitivity(poses, values, wanted)).reshape(-1, len(wanted))
    sizes = np.concatenate([scales([model.parameters[i] for i in model.index(fitted)]),
                            *(np.array(c.sizes) for c in causes)])  # fmt: skip
    raw = columns * sizes
    A, B = _split(noise.whiten(raw), fitted, causes)
    return Case(
        experiment, model, poses, tuple(fitted), tuple(causes), values, A, B, noise.whiten(residuals.ravel()),
        np.repeat(rows.pose, 3), raw,
    )  # fmt: skip


def _split(white: Array, fitted: Sequence[str], causes: Sequence[Cause]) -> tuple[Array, tuple[Array, ...]]:
    """Columns of the fitted parameters, and of each cause."""
    ends = np.cumsum([len(fitted), *(len(c.parameters) for c in causes)])
    return white[:, : len(fitted)], tuple(white[:, a:b] for a, b in pairwise(ends.tolist()))


def plan_rows(poses: Poses, markers: int, sigma: float) -> Rows:
    """Rows of a plan that is still to be measured: every marker once at each pose."""
    count = len(poses)
    index = np.repeat(np.arange(count), markers)
    marker = np.tile(np.arange(markers), count)
    zero = np.zeros((len(index), 3))
    return Rows(np.arange(len(index)), zero, np.full(len(index), sigma), index, marker, index)


def plan_case(
    experiment: Experiment, poses: Poses, fitted: Sequence[str], causes: Sequence[Cause], sigma: float,
    x: dict[str, float] | None = None,
) -> Case:  # fmt: skip
    """The case of poses that are still to be measured, at the values `x`; no residuals."""
    from qsframework.identify.observations import Independent

    rows = plan_rows(poses, len(experiment.markers), sigma)
    noise = Independent(np.repeat(rows.sigma, 3))
    return make_case(experiment, poses, fitted, causes, x or {}, rows, noise, np.zeros_like(rows.measured))
