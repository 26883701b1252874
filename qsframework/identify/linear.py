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
from qsframework.identify.noise import left_out_together, readings_noise
from qsframework.identify.observations import Independent, Noise
from qsframework.information import RankTest, loss_words, rank_test, scales, what_would_help
from qsframework.plugin import Array, Indices, Parameter

_STEPS = 20
_SETTLED = 1e-9
_NOISY = 1e-5
"""Step below which one that no longer shrinks is the rounding of readings far larger than what they tell."""
_ALONE = 1e12
_FAR = 5.0
"""Prior standard deviations from the initial value beyond which an estimate deserves a second look."""
_UNFILED = "simulated readings"
UNTOLD = "not identifiable"
"""How the status of an estimate begins whose sd is above its nominal value."""


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of a fit: readings y (R, 3), sd of one coordinate (R,), and the measurement and pose of each."""

    keep: Indices
    measured: Array
    sigma: Array
    measurement: Indices
    marker: Indices
    pose: Indices
    stated_noise: Noise | None = None
    """Covariance of the 3R scalars, with what rows share; independent errors if None."""
    together: Indices | None = None
    """Number (R,) of the set that each row is left out with, by its pose if None."""

    @property
    def noise(self) -> Noise:
        """Covariance of the 3R scalars, up to a factor where the noise is estimated."""
        return self.stated_noise or Independent(np.repeat(self.sigma, 3))

    def of(self, predicted: Array) -> Array:
        """Pick the rows out of a prediction (N, K, 3, ...)."""
        return predicted[self.measurement, self.marker]


def identify_linear(experiment: Experiment, readings: Readings, names: Sequence[str], shared: float = 0.0) -> Fit:
    """Estimate parameters by linear least squares, bounds and priors aside.

    One step is exact where nothing stiffens the joints; K_par bends the model by some 1e-5, so the step is
    repeated about its own result until it settles. shared: sd of the error that the markers of a pose share, see
    `fit_rows`.

    Raises NotIdentifiable, naming the parameters, where the readings cannot tell them apart; NotConverged where the
    steps do not settle.
    """
    model = experiment.model()
    rows, source = fit_rows(experiment, readings, len(names), shared)
    x0 = model.nominal
    chosen = [model.parameters[i] for i in model.index(names)]
    nominal = rows.of(model.predict(readings.poses, x0))
    x, predicted, before = x0.copy(), nominal, np.inf
    for _ in range(_STEPS):
        A = rows.of(model.sensitivity(readings.poses, x, names))
        whitened = rows.noise.whiten((A * scales(chosen)).reshape(-1, len(names)))
        test = rank_test(whitened, names)
        if not test.full:
            raise _untold(model, test, readings, x - x0, chosen)
        solution = _solve(whitened, rows.noise.whiten((rows.measured - predicted).ravel()))
        x[model.index(names)] += solution.z * scales(chosen)
        predicted = rows.of(model.predict(readings.poses, x))
        size = float(np.abs(solution.z).max())
        if size <= _SETTLED or 0.5 * before <= size <= _NOISY:
            break
        before = size
    else:
        raise NotConverged(
            f"least squares did not settle in {_STEPS} steps; {', '.join(names)} act too far from linearly. "
            "Use method one-step"
        )
    covariance = solution.covariance * np.outer(scales(chosen), scales(chosen))
    found = Found("linear", x, covariance, solution.Q, test, nominal, predicted)
    return make_fit(model, chosen, rows, readings, source, found)


def _untold(
    model: Model, test: RankTest, readings: Readings, moved: Array, chosen: Sequence[Parameter]
) -> NotIdentifiable | NotConverged:  # fmt: skip
    """Why the rank is short: the readings cannot tell, or a step has led to where the model does not bend any more."""
    if not np.any(moved):
        return NotIdentifiable(f"these readings cannot tell the parameters: {loss_words(model, test, readings.poses)}")
    size = np.abs(moved[model.index([p.name for p in chosen])] / scales(chosen))
    far = chosen[int(np.argmax(size))]
    return NotConverged(
        f"least squares leads to {far.name} = {far.nominal + moved[model.index([far.name])[0]]:.3g} {far.unit}, where "
        f"the model tells nothing any more ({test.words()}). Look at the units of readings and loads and at sigma, or "
        "use method one-step, which keeps the bounds"
    )


def fit_rows(
    experiment: Experiment, readings: Readings, parameters: int, shared: float = 0.0
) -> tuple[Rows, str]:  # fmt: skip
    """The rows that are used, and whether their noise is "stated" or "estimated".

    shared: sd of the error that the markers of a pose share, in the unit of the rows' sigma: m where that is stated,
    sds of a coordinate where it is to be estimated

    Raises InputError where there are fewer readings than parameters, or where the noise is stated for some only.
    """
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
    rows = Rows(
        keep, readings.displacement[keep], sigma, readings.measurement[keep], readings.marker[keep], poses,
        readings_noise(readings, keep, sigma, shared), left_out_together(readings, keep, poses),
    )  # fmt: skip
    if rows.measured.size <= parameters:
        raise InputError(
            f"{len(keep)} reading{'s give' if len(keep) > 1 else ' gives'} {rows.measured.size} numbers: too few for "
            f"{parameters} parameters; measure more poses, or fit fewer parameters (--fit, or `fit:` in the experiment)"
        )
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


@dataclass(frozen=True, eq=False)
class Found:
    """What a method found: all parameters x, covariance (p, p) SI for noise of the stated size, and orthonormal columns
    Q (3R, f) of the f free parameters at x. at_bound names those whose sd cannot be quoted;
    free_sd (p,) are the sds without bounds."""

    method: str
    x: Array
    covariance: Array
    Q: Array
    rank: RankTest
    nominal: Array
    predicted: Array
    at_bound: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    unit: float | None = None
    free_sd: Array | None = None


def make_fit(
    model: Model, chosen: Sequence[Parameter], rows: Rows, readings: Readings, source: str, found: Found
) -> Fit:
    """The fit with its proof: estimates, residuals, what is left out."""
    residuals = rows.measured - found.predicted
    white = rows.noise.whiten(residuals.ravel()).reshape(residuals.shape)
    free = found.Q.shape[1]
    dof = white.size - free
    chi2 = float((white**2).sum())
    least = rounding(rows.noise, rows.measured.ravel())
    plain = float(np.sqrt(chi2 / dof))
    unit = max(plain if found.unit is None else found.unit, least) if source == "estimated" else 1.0
    covariance = found.covariance * unit**2
    values = found.x[model.index([p.name for p in chosen])]
    outside = left_out(white, found.Q, rows.pose if rows.together is None else rows.together)
    outside = rows.noise.colour(outside.ravel()).reshape(outside.shape)
    digest = sha256(readings.source) if readings.source is not None else ""
    poses = tuple(readings.pose[int(m)] for m in rows.measurement)
    sd = np.array([np.nan if p.name in found.at_bound else s
                   for p, s in zip(chosen, np.sqrt(np.diag(covariance)), strict=True)])  # fmt: skip
    free_sd = sd if found.free_sd is None else found.free_sd * unit
    estimates = _estimates(chosen, values, sd, free_sd)
    advice = tuple(
        f"{e.name}: {e.status}; {what_would_help(model, e.name, readings.poses)}."
        for e in estimates
        if UNTOLD in e.status
    )
    return Fit(
        found.method, model, found.x, estimates, covariance, found.rank,
        unit * float(np.sqrt(np.mean(rows.sigma**2))), source, readings.rows[rows.keep], poses, rows.measured,
        found.predicted, found.nominal, residuals, studentised(white, found.Q, free, rows.noise), outside,
        chi2 / unit**2, dof, digest, (*found.notes, *_exact(source == "estimated" and unit == least), *advice),
    )  # fmt: skip


def rounding(noise: Noise, measured: Array) -> float:
    """Whitened size that rounding leaves of readings (m,): no noise is estimated below it, and none is zero."""
    return float(np.finfo(float).eps * np.sqrt(np.mean(noise.whiten(measured) ** 2))) or 1.0


def _exact(no_noise: bool) -> tuple[str, ...]:
    return ("The readings have no noise: sigma is what rounding leaves, and the sds say no more.",) if no_noise else ()


_ZERO = "these readings hardly tell it from zero"


def status_in_positions(p: Parameter, value: float, sd: float) -> str:
    """What is to be said of an estimate from positions: geometry is zero nominally and often zero in truth, so that it
    counts as told where its sd is below its typical size."""
    if p.nominal == 0.0 and p.lower <= value <= p.upper and np.isfinite(sd):
        if sd <= max(abs(value), p.scale):
            return ""
        return f"{UNTOLD} from these readings: its sd is above its value and {sd / p.scale:.1f} times its typical size"
    return _status(p, value, sd, sd)


def _status(p: Parameter, value: float, sd: float, free: float) -> str:
    """What is to be said of an estimate; `free` is the sd that it would have without its bounds."""
    share = f"{100 * free / abs(p.nominal):.0f} % of its nominal value" if p.nominal else "above its value"
    share = share if np.isfinite(free) or np.isnan(free) else "without limit"
    untold = free > abs(value) if p.nominal == 0.0 else free > abs(p.nominal)
    if np.isnan(sd):
        end = f"at its {'lower' if value <= p.lower else 'upper'} bound {value:g}"
        if untold:
            return f"{UNTOLD} from these readings: {end}, and without it its sd is {share}"
        return f"{end}: it errs to one side only, so no sd is quoted"
    if sd == 0.0:
        return "fixed"
    beyond = max(p.lower - value, value - p.upper, 0.0)
    if untold and beyond <= 2.0 * sd:
        return f"{UNTOLD} from these readings: its sd is {share}"
    if beyond > 0.0:
        end = f"below its bound {p.lower:g}" if value < p.lower else f"above its bound {p.upper:g}"
        if beyond > sd:
            return f"{end}: the model or a convention is wrong"
        return f"{end}, by less than its sd" + (f": {_ZERO}" if sd > abs(value) else "")
    if sd > abs(value):
        return f"sd above the value: {_ZERO}"
    if p.sd is not None and abs(value - p.nominal) > _FAR * p.sd:
        return f"{abs(value - p.nominal) / p.sd:.0f} prior sds from its initial value"
    return ""


def _estimates(chosen: Sequence[Parameter], values: Array, sds: Array, free: Array) -> tuple[Estimate, ...]:
    return tuple(
        Estimate(
            p.name, p.unit, float(v), float(s), p.nominal, p.lower, p.upper, _status(p, float(v), float(s), float(f))
        )
        for p, v, s, f in zip(chosen, values, sds, free, strict=True)
    )


def studentised(white: Array, Q: Array, parameters: int, noise: Noise | None = None) -> Array:
    """Externally studentised residuals (R, 3): each coordinate against the fit without it, and against what the
    readings that share its errors say of them.

    white and Q are whitened by `noise`, independent errors if None. Under the model each follows Student's t with
    3R - p - 1 degrees of freedom: it is that of a shift of this one coordinate, added to the fit.
    """
    r = white.ravel()
    dof = len(r) - parameters
    noise = noise or Independent(np.ones(len(r)))
    weight = noise.weights()
    slope = noise.turned(r) / np.sqrt(weight)
    free = np.maximum(1.0 - np.square(noise.turned(Q)).sum(axis=1) / weight, 1e-12)
    variance = np.maximum(((r**2).sum() - slope**2 / free) / max(dof - 1, 1), 1e-300)
    return (slope / np.sqrt(variance * free)).reshape(white.shape)


def left_out(white: Array, Q: Array, pose: Indices) -> Array:
    """Whitened errors (R, 3) at each pose when all its markers and repeats are left out of the fit.

    Poses that share an unloaded reading have one number and are left out together: were one of them kept, it would
    tell the error of the reading that they share, and the others would not be predicted from the model alone.
    Exact for linear least squares: (I - Q_i Q_i')^-1 r_i for the block of each number. NaN where the other poses
    cannot tell the parameters: that pose alone carries one of them.
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
