"""Weighted linear least squares in the compliances, equations (3) and (4) of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import Model
from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.experiment import Experiment, Readings
from qsframework.files import sha256
from qsframework.identify.fit import Estimate, Fit
from qsframework.information import RankTest, rank_test, scales
from qsframework.plugin import Array, Indices, Parameter

_STEPS = 20
_SETTLED = 1e-9
_ALONE = 1e12
_FAR = 5.0
"""Prior standard deviations from the initial value beyond which an estimate deserves a second look."""
_UNFILED = "simulated readings"


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of a fit: readings y (R, 3), sd of one coordinate (R,), and the measurement and pose of each."""

    keep: Indices
    measured: Array
    sigma: Array
    measurement: Indices
    marker: Indices
    pose: Indices

    def of(self, predicted: Array) -> Array:
        """Pick the rows out of a prediction (N, K, 3, ...)."""
        return predicted[self.measurement, self.marker]


def identify(experiment: Experiment, readings: Readings, fit: Sequence[str] | None = None) -> Fit:
    """Estimate the experiment's parameters from displacement readings.

    `fit` names other parameters to estimate: effects, instances or single parameters. One step is
    exact where nothing stiffens the joints; K_par bends the model by some 1e-5, so the step is
    repeated about its own result until it settles.

    Raises InputError where there are fewer readings than parameters; NotIdentifiable, naming the
    parameters, where the readings cannot tell them apart; NotConverged where the steps do not settle.
    """
    model = experiment.model()
    names = experiment.fit_names() if fit is None else experiment.with_(fit=tuple(fit)).fit_names()
    rows, source = _rows(experiment, readings)
    if 3 * len(rows.keep) <= len(names):
        raise InputError(
            f"{len(rows.keep)} readings give {3 * len(rows.keep)} numbers: too few for {len(names)} parameters"
        )
    x0 = model.nominal
    chosen = [model.parameters[i] for i in model.index(names)]
    nominal = rows.of(model.predict(readings.poses, x0))
    x, predicted = x0.copy(), nominal
    for _ in range(_STEPS):
        A = rows.of(model.sensitivity(readings.poses, x, names))
        whitened = (A * scales(chosen) / rows.sigma[:, None, None]).reshape(-1, len(names))
        test = rank_test(whitened, names)
        if not test.full:
            raise NotIdentifiable(f"these readings cannot tell the parameters: {test.words()}")
        solution = _solve(whitened, ((rows.measured - predicted) / rows.sigma[:, None]).ravel())
        x[model.index(names)] += solution.z * scales(chosen)
        predicted = rows.of(model.predict(readings.poses, x))
        if np.abs(solution.z).max() <= _SETTLED:
            break
    else:
        raise NotConverged(
            f"least squares did not settle in {_STEPS} steps; {', '.join(names)} act too far from linearly"
        )
    return _result(model, x, chosen, rows, readings, test, solution, source, nominal, predicted)


def _rows(experiment: Experiment, readings: Readings) -> tuple[Rows, str]:
    keep = np.flatnonzero(readings.use)
    if not len(keep):
        raise InputError(f"{readings.source or _UNFILED}: every reading is masked (use = 0)")
    stated = np.where(np.isnan(readings.sigma[keep]), experiment.noise.sigma or np.nan, readings.sigma[keep])
    missing = np.isnan(stated)
    if missing.any() and not missing.all():
        raise InputError(
            f"{readings.source or _UNFILED}: {int(missing.sum())} readings have no sigma_mm and the experiment "
            "states no noise; give all of them or none"
        )
    sigma = np.ones(len(keep)) if missing.any() else stated
    estimated = missing.any() or experiment.noise.sigma is None
    _, pose_of = np.unique(np.array(readings.pose), return_inverse=True)
    poses = pose_of[readings.measurement[keep]]
    rows = Rows(keep, readings.displacement[keep], sigma, readings.measurement[keep], readings.marker[keep], poses)
    return rows, "estimated" if estimated else "stated"


@dataclass(frozen=True, eq=False)
class _Solution:
    """Least squares by QR: scaled estimate z (p,), unit covariance (p, p), orthonormal columns Q (3R, p)."""

    z: Array
    covariance: Array
    Q: Array


def _solve(whitened: Array, target: Array) -> _Solution:
    Q, R = np.linalg.qr(whitened)
    inverse = np.linalg.inv(R)
    return _Solution(inverse @ (Q.T @ target), inverse @ inverse.T, Q)


def _result(
    model: Model, x: Array, chosen: Sequence[Parameter], rows: Rows, readings: Readings, test: RankTest,
    solution: _Solution, source: str, nominal: Array, predicted: Array,
) -> Fit:  # fmt: skip
    residuals = rows.measured - predicted
    white = residuals / rows.sigma[:, None]
    dof = white.size - len(chosen)
    chi2 = float((white**2).sum())
    unit = float(np.sqrt(chi2 / dof)) if source == "estimated" else 1.0
    covariance = solution.covariance * np.outer(scales(chosen), scales(chosen)) * unit**2
    values = x[model.index([p.name for p in chosen])]
    outside = left_out(white, solution.Q, rows.pose) * rows.sigma[:, None]
    digest = sha256(readings.source) if readings.source is not None else ""
    poses = tuple(readings.pose[m] for m in rows.measurement)
    return Fit(
        "linear", model, x, _estimates(chosen, values, np.sqrt(np.diag(covariance))), covariance, test,
        unit * float(np.sqrt(np.mean(rows.sigma**2))), source, readings.rows[rows.keep], poses, rows.measured,
        predicted, nominal, residuals, studentised(white, solution.Q, len(chosen)), outside, chi2 / unit**2, dof,
        digest,
    )  # fmt: skip


def _estimates(chosen: Sequence[Parameter], values: Array, sds: Array) -> tuple[Estimate, ...]:
    def status(p: Parameter, value: float, sd: float) -> str:
        if value < p.lower:
            return f"below its bound {p.lower:g}: the model or a convention is wrong"
        if value > p.upper:
            return f"above its bound {p.upper:g}: the model or a convention is wrong"
        if sd > abs(value):
            return "sd above the value: these readings do not tell it"
        if p.sd is not None and abs(value - p.nominal) > _FAR * p.sd:
            return f"{abs(value - p.nominal) / p.sd:.0f} prior sds from its initial value"
        return ""

    return tuple(
        Estimate(p.name, p.unit, float(v), float(s), p.nominal, p.lower, p.upper, status(p, float(v), float(s)))
        for p, v, s in zip(chosen, values, sds, strict=True)
    )


def studentised(white: Array, Q: Array, parameters: int) -> Array:
    """Externally studentised residuals (R, 3): each coordinate against the fit without it.

    Under the model each follows Student's t with 3R - p - 1 degrees of freedom.
    """
    r = white.ravel()
    leverage = np.einsum("ij,ij->i", Q, Q)
    dof = len(r) - parameters
    free = np.maximum(1.0 - leverage, 1e-12)
    variance = np.maximum(((r**2).sum() - r**2 / free) / max(dof - 1, 1), 1e-300)
    return (r / np.sqrt(variance * free)).reshape(white.shape)


def left_out(white: Array, Q: Array, pose: Indices) -> Array:
    """Whitened errors (R, 3) at each pose when all its markers and repeats are left out of the fit.

    Exact for linear least squares: (I - Q_i Q_i')^-1 r_i for the block of each pose. NaN where the
    other poses cannot tell the parameters: that pose alone carries one of them.
    """
    out = np.empty_like(white)
    blocks = Q.reshape(*white.shape, -1)
    for one in np.unique(pose):
        rows = pose == one
        q = blocks[rows].reshape(-1, Q.shape[1])
        rest = np.eye(len(q)) - q @ q.T
        alone = np.linalg.cond(rest) > _ALONE
        out[rows] = np.nan if alone else np.linalg.solve(rest, white[rows].ravel()).reshape(-1, 3)
    return out
