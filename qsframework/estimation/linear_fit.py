"""One linear fit: what columns leave of readings, what others explain given them, what each block of readings does.

Least squares with orthonormal whitened columns Q leaves r = (I - Q Q') y. Without a block i of readings it errs by
(I - Q_i Q_i')^-1 r_i there, and its sum of squares is smaller by r_i' (I - Q_i Q_i')^-1 r_i: exact, with no refit. A
block that was not fitted errs by r_i with the covariance I + Q_i Q_i', so that it is judged alike in the fit and out
of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from qsframework.estimation.noise import Independent, Noise
from qsframework.estimation.projection import CARRIED, Flags, blocks_of, left, orthonormal, solved
from qsframework.estimation.tails import chi2_sf, f_sf
from qsframework.plugin import Array, Indices

_TOLD = 1e-13
"""Share of the largest weighted square of a direction below which the readings do not tell it."""
_REWEIGHED = 10
"""Steps of a fit of least absolute errors."""
_LEAST = 1e-2
"""Share of the usual length of an error below which it weighs no more there."""
_ROUNDS = 20
_MEDIAN = 0.6745
"""Median of the size of a unit normal."""
_CLIP = 2.5
"""In sds. At 1.345 the power of tests falls; without a clip 5 % of gross readings raise false alarms in 8 to 13 %."""
_MAD = 1.4826
_STEPS = 100
_STILL = 1e-4
"""Of the clip."""


@dataclass(frozen=True, eq=False)
class HeldOutBlocks:
    """B blocks of coordinates, each against the fit without it. label, size (B,): of each block; chi2_drop (B,): by
    how much the sum of squares falls without it, 0 where the others cannot do without it."""

    label: Indices
    size: Indices
    chi2_drop: Array


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Least squares at its solution: columns Q (m, f), Q Q' y its predictions, and white (m,) what they leave.

    noise: by which both are whitened, None: independent; stated: whether its size is known; used (m,): the coordinates
    that were fitted, None: all. Of the others Q Q' is the covariance of their predictions; priors (k,): what the fit
    leaves, in the sds of the readings, of the k values that were known before: they count as readings
    """

    Q: Array
    white: Array
    noise: Noise | None = None
    stated: bool = True
    used: Flags | None = None
    priors: Array | None = None

    @classmethod
    def of(cls, columns: Array, readings: Array, noise: Noise, stated: bool = True) -> LinearFit:
        """The least squares fit of columns (m, p), of any sizes, to readings (m,)."""
        return replace(cls.onto(orthonormal(noise.whiten(columns)), noise.whiten(readings)), noise=noise, stated=stated)

    @classmethod
    def onto(cls, Q: Array, white: Array, used: Flags | None = None) -> LinearFit:
        """The fit of orthonormal columns (m, f) to whitened readings, m in all; used (m,): None: all."""
        return cls(Q, left(Q, white.ravel()), used=None if used is None else used.ravel())

    @property
    def dof(self) -> int:
        """Coordinates that were used, less the columns that they tell: one that is held counts by what they add."""
        known = 0 if self.priors is None else len(self.priors)
        if self.used is None:
            return len(self.white) + known - self.Q.shape[1]
        return int(self.used.sum()) - round(float(np.square(self.Q[self.used]).sum()))

    @cached_property
    def chi2(self) -> float:
        """Sum of squares that the fit leaves of what it used."""
        own = self.white if self.used is None else self.white[self.used]
        return float(own @ own) + (0.0 if self.priors is None else float(self.priors @ self.priors))

    @property
    def residuals(self) -> Array:
        """Measured minus fitted (m,), in the unit of the readings."""
        return self.white if self.noise is None else self.noise.colour(self.white)

    def unit(self, chi2: float | None = None) -> float:
        """Variance of unit weight where a fit leaves this sum of squares, by default its own; 1 for a stated noise."""
        return 1.0 if self.stated else (self.chi2 if chi2 is None else chi2) / max(self.dof, 1)

    def given(self, columns: Array) -> Array:
        """What of further columns (m,) or (m, k), in the unit of the readings, the fitted ones do not reach."""
        return left(self.Q, columns if self.noise is None else self.noise.whiten(columns))

    def p_values(self, chi2_drop: Array | float, size: Indices | int) -> Array:
        """Probability that chance alone makes the sum of squares fall so far with `size` more columns."""
        return chance(chi2_drop, size, self.chi2, self.dof, self.stated)

    def held_out(self, label: Indices) -> HeldOutBlocks:
        """What blocks of coordinates, by label (m,), do when each is left out; label -1: in no block."""
        slope, q = self._shifts
        names, sizes, drops = [_NONE], [_NONE], [np.zeros(0)]
        for at in blocks_of(label):
            for part, _, values in solved(q, at, slope):
                names.append(label[at[part][:, 0]])
                sizes.append(np.full(len(values), at.shape[1]))
                drops.append(np.einsum("bs,bs->b", slope[at[part]], values))
        own = np.concatenate(names)
        order = np.argsort(own)
        return HeldOutBlocks(own[order], np.concatenate(sizes)[order], np.concatenate(drops)[order])

    def held_out_errors(self, label: Indices, carried: float = CARRIED) -> Array:
        """Whitened errors (m,) at each block, by label, when it is left out of the fit; NaN where it cannot be.

        A block that alone carries a parameter cannot be left out; what noise couples belongs in one block.
        """
        out = np.full(len(self.white), np.nan)
        for at in blocks_of(label):
            for part, told, values in solved(self.Q, at, self.white, carried):
                out[at[part][told]] = values[told]
        return out

    def misfits(self, label: Indices, count: int) -> Array:
        """Squares (count,) of the errors of blocks labelled 0 to count - 1 against the fit without each, in units of
        the noise and of what predicts them, whether they were used or not."""
        used = np.ones(len(label), dtype=bool) if self.used is None else self.used
        inside = LinearFit(self.Q * used[:, None], self.white * used, self.noise).held_out(np.where(used, label, -1))
        out = np.zeros(count)
        out[inside.label] = inside.chi2_drop
        for at in blocks_of(np.where(used, -1, label)):
            spread = np.eye(at.shape[1]) + self.Q[at] @ self.Q[at].transpose(0, 2, 1)
            rest = self.white[at]
            weighed = np.asarray(np.linalg.solve(spread, rest[..., None]), dtype=np.float64)[..., 0]
            out[label[at[:, 0]]] = np.einsum("bs,bs->b", rest, weighed)
        return out

    def studentised(self) -> Array:
        """Externally studentised residuals (m,): each reading against the fit without it, and against what the
        readings that share its errors say of it.

        Under the model each follows Student's t with dof - 1 degrees of freedom: it is that of a shift of this one
        reading, added to the fit.
        """
        slope, q = self._shifts
        free = np.maximum(1.0 - np.square(q).sum(axis=1), 1e-12)
        variance = np.maximum((self.chi2 - slope**2 / free) / max(self.dof - 1, 1), 1e-300)
        return slope / np.sqrt(variance * free)

    @cached_property
    def _shifts(self) -> tuple[Array, Array]:
        """Slopes t (m,) and columns q (m, f) by which a shift of some readings is judged: left out together, they take
        t' (I - q q')^-1 t off the sum of squares, if no shared error couples them."""
        noise = self.noise
        if noise is None or isinstance(noise, Independent):
            return self.white, self.Q
        root = np.sqrt(noise.weights())
        return noise.turned(self.white) / root, noise.turned(self.Q) / root[:, None]


_NONE = np.zeros(0, dtype=np.intp)


def chance(chi2_drop: Array | float, size: Indices | int, chi2: float, dof: int, stated: bool) -> Array:
    """Probability that chance alone makes a sum of squares `chi2` fall so far with `size` more columns: by chi-square
    where the noise is stated, else by an F test against what is then left."""
    size = np.maximum(size, 1)
    if stated:
        return chi2_sf(chi2_drop, size)
    free = np.maximum(dof - size, 1)
    return f_sf(chi2_drop / size / np.maximum((chi2 - chi2_drop) / free, 1e-300), size, free)


@dataclass(frozen=True, eq=False)
class Whitened:
    """Whitened columns A (m, p) and readings y (m,), to be fitted to those that agree.

    noise: by which they are whitened, None: independent; held (p,): 1 / sd of each parameter in sds of the noise that
    is seen, 0 for none
    """

    A: Array
    y: Array
    noise: Noise | None = None
    held: Array | None = None

    def solved(self, weight: Array, unit: float = 1.0) -> tuple[Array, Array]:
        """Least squares of squares weighted by (m,), in a noise of this size: the parameters (p,), and half (p, f),
        half half' their covariance.

        By normal equations in columns of one size: what they lose of digits is far below a gross error.
        """
        ridge = np.zeros(self.A.shape[1]) if self.held is None else (self.held * unit) ** 2
        products = (self.A * weight[:, None]).T @ self.A + np.diag(ridge)
        size = np.sqrt(np.diag(products))
        kept = size > 1e-12 * max(float(size.max(initial=0.0)), 1e-300)
        values, V = np.linalg.eigh(products[np.ix_(kept, kept)] / np.outer(size[kept], size[kept]))
        told = values > _TOLD * values.max(initial=0.0)
        half = np.zeros((len(size), int(told.sum())))
        half[kept] = V[:, told] / np.sqrt(values[told]) / size[kept, None]
        return half @ (half.T @ (self.A.T @ (weight * self.y))), half

    def fit(self, used: Flags) -> tuple[LinearFit, Array, Array]:
        """The fit to the coordinates used (m,), its parameters (p,), and half (p, f) of their covariance."""
        weight, unit = used.astype(np.float64), max(float(np.sqrt(np.mean(self.y[used] ** 2))), 1e-300)
        if self.held is not None:  # by the noise that is seen in the end
            unit = self._usual((self.y - self.A @ self.solved(weight, unit)[0])[used])
        x, half = self.solved(weight, unit)
        return LinearFit(self.A @ half, self.y - self.A @ x, self.noise, used=used), x, half

    def least_absolute(self, label: Indices, count: int) -> Array:
        """Squares (count,) of the errors of blocks, by label (m,), that the fit leaves whose sum of the lengths of
        these errors is least: a few may be far off."""
        size = np.sqrt(np.maximum(np.bincount(label, minlength=count), 1))
        weight, unit = np.ones(len(self.y)), max(float(np.sqrt(np.mean(self.y**2))), 1e-300)
        square = np.zeros(count)
        for _ in range(_REWEIGHED):
            rest = self.y - self.A @ self.solved(weight, unit)[0]
            square, unit = np.asarray(np.bincount(label, rest**2, count), dtype=np.float64), self._usual(rest)
            length = np.sqrt(square) / size
            usual = float(np.median(length)) + 1e-300
            weight = (usual / np.maximum(length, _LEAST * usual))[label]
        return square

    @staticmethod
    def _usual(rest: Array) -> float:
        """Usual size of errors (m,), a few of which may be far off."""
        return max(float(np.sqrt(np.median(rest**2))) / _MEDIAN, 1e-300)

    def take(self, columns: Flags) -> Whitened:
        """The same with some of the columns, not held."""
        return replace(self, A=self.A[:, columns], held=None)


@dataclass(frozen=True, eq=False, kw_only=True)
class Agreed:
    """The fit to the blocks that agree. wrong (B,): those that were not used; misfit (B,): squares of the errors of all
    against the fit without each; x (p,): its parameters, half (p, f): half half' their covariance; columns: of it."""

    wrong: Flags
    misfit: Array
    fit: LinearFit
    x: Array
    half: Array
    columns: Whitened


Beyond = Callable[[Array, Flags, LinearFit | None], Flags]


def without_outliers(columns: Callable[[Flags], Whitened], label: Indices, count: int, beyond: Beyond) -> Agreed:
    """The fit to the blocks of coordinates, by label (m,), that most others agree with.

    A fit of least absolute errors says first which most agree on; then blocks come and go by their errors against the
    least squares of those that stay. columns: about the blocks that are not wrong (count,); beyond: the blocks whose
    misfits (count,) are beyond those of their like, if some are wrong (count,), by a fit or as least absolute errors
    leave them (None)
    """
    wrong, rounds = np.zeros(count, dtype=bool), 0
    own = columns(wrong)
    now = beyond(own.least_absolute(label, count), wrong, None)
    while True:
        own = own if np.array_equal(now, wrong) else columns(now)
        fit, x, half = own.fit(~now[label])
        misfit, wrong, rounds = fit.misfits(label, count), now, rounds + 1
        now = beyond(misfit, wrong, fit)
        if np.array_equal(now, wrong) or wrong.mean() > 0.5 or rounds == _ROUNDS:
            return Agreed(wrong=wrong, misfit=misfit, fit=fit, x=x, half=half, columns=own)


def winsorised(residuals: Array, Q: Array) -> Array:
    """Whitened residuals (m,) with large ones drawn in, about a fit's orthonormal directions Q (m, q): pseudo-values.

    The pseudo-value of a reading is its fit plus its clipped residual, raised so that its slope is right on average.
    Least squares on pseudo-values is Huber's estimate, and their spread is what its tests need: no single reading
    weighs much. As given where the fit leaves too few degrees of freedom to know the errors by. Zeros were not
    measured.
    """
    count, size = int(np.count_nonzero(residuals)), Q.shape[1]
    if count < 2 * size:
        return residuals
    y, told = residuals, residuals != 0.0
    for _ in range(_STEPS):
        fit = Q @ (Q.T @ y)
        error = residuals - fit
        clip = _CLIP * _MAD * float(np.median(np.abs(error[told]))) * float(np.sqrt(count / (count - size)))
        inside = float(np.mean(np.abs(error[told]) < clip))
        new = fit + np.clip(error, -clip, clip) / max(inside, 0.1)
        done = float(np.abs(new - y).max()) <= _STILL * clip
        y = new
        if done:
            break
    return y
