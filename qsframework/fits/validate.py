"""`validate`: errors of a fit at readings that it has not seen, or of its like over random halves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from qsframework.arguments import checked
from qsframework.elastostatics import Model
from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.estimation import FitOptions, rms
from qsframework.estimation.projection import Flags
from qsframework.experiment import Experiment, Frame, Readings, make_rows
from qsframework.experiment.account import Account
from qsframework.experiment.before import errors_before
from qsframework.experiment.observations import ReadingRows
from qsframework.files import as_file
from qsframework.fits.findings import TOO_LARGE
from qsframework.fits.fit import Fit
from qsframework.fits.identify import fit_readings
from qsframework.fits.options import Halves
from qsframework.fits.record import FitRecord
from qsframework.fits.soundness import check_account, check_robot
from qsframework.option import Seed
from qsframework.plugin import Array, Indices
from qsframework.viewed import Viewed

_AXES = ("x", "y", "z")
_DRAWN = 10
"""Times that a half is drawn until it identifies what the whole does."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ValidationErrors:
    """Errors (R, 3) m of some readings, NaN where an axis was not measured; `before`: those of the nominal arm."""

    name: str
    errors: Array
    before: Array

    @property
    def count(self) -> int:
        return len(self.errors)

    def axes(self) -> tuple[float, ...]:
        """RMS of each axis, m; NaN where none was measured."""
        return tuple(rms(self.errors[:, i]) for i in range(3))

    def distances(self, before: bool = False) -> Array:
        """Lengths (k,) m of the errors that are whole."""
        values = self.before if before else self.errors
        return np.linalg.norm(values[np.isfinite(values).all(axis=1)], axis=1)

    def summary(self, before: bool = False) -> tuple[float, float, float, float]:
        """RMS, mean, 95 % and maximum of the 3D error, m; NaN without whole readings."""
        d = self.distances(before)
        if not len(d):
            return float("nan"), float("nan"), float("nan"), float("nan")
        return float(np.sqrt(np.mean(d**2))), float(d.mean()), float(np.quantile(d, 0.95)), float(d.max())


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Validation(Viewed):
    """Errors of all readings and of each series or kind; halves: how many random halves they are of, 0 for none.

    account: that of the fit; seen: whether the fit was made of these readings; spread (halves,): RMS of the 3D error of
    each half, m; lines, file (R,): of the readings; poses: their names; places (R, 3): of their markers, m, base frame;
    own_error: m, error of the fit at held-out poses of its own, where these are other readings, else NaN; notes: what
    the errors do not say
    """

    robot: str
    account: Account
    whole: ValidationErrors
    parts: tuple[ValidationErrors, ...]
    halves: int
    seen: bool
    spread: Array
    lines: Indices
    poses: tuple[str, ...]
    places: Array
    own_error: float
    notes: tuple[str, ...] = ()

    @property
    def refuted(self) -> bool:
        """Whether these readings are missed by far more than the fit's own held-out poses are."""
        return self.whole.summary()[0] > TOO_LARGE * self.own_error

    def as_json(self) -> dict[str, Any]:
        """Lengths in mm."""
        return {
            "robot": self.robot,
            "account": as_file(self.account),
            "halves": self.halves,
            "seen": self.seen,
            "spread_mm": [1e3 * v for v in self.spread.tolist()],
            **_json(self.whole),
            "parts": {part.name: _json(part) for part in self.parts},
            "notes": list(self.notes),
        }


def _json(part: ValidationErrors) -> Mapping[str, Any]:
    def number(value: float) -> float | None:
        return 1e3 * value if np.isfinite(value) else None

    def told(before: bool) -> dict[str, float | None]:
        return dict(zip(("rms", "mean", "p95", "max"), map(number, part.summary(before)), strict=True))

    return {
        "readings": part.count,
        "rms_axis_mm": dict(zip(_AXES, map(number, part.axes()), strict=True)),
        "rms_per_axis_mm": number(rms(part.errors)),
        "error_mm": told(False),
        "nominal_error_mm": told(True),
    }


@checked
def validate(experiment: Experiment, readings: Readings, fit: FitRecord, *, anyway: bool = False) -> Validation:
    """Errors of a stored fit at other readings, in the frames that it found.

    A series that the fit does not know is laid on its predictions by a rigid motion first, and the error is what this
    leaves.

    Args:
        experiment: the campaign.
        readings: R held-out readings.
        fit: the identified values.
        anyway: use a fit whose readings or files were found wrong, and note it.

    Returns:
        Errors (R, 3) m, before and after, by series.

    Raises:
        InputError: where the fit is of another robot or model, or something was found wrong in its readings or files.
    """
    check_robot(fit, experiment.robot)
    doubted = check_account(fit, experiment, anyway=anyway)
    model, rows = experiment.model(), make_rows(readings)
    x = fit.x_of(model)
    errors = rows.measured - rows.predict(model, x, fitted_frames(fit, rows, model, x), fit.linear)
    before = errors_before(experiment, rows, fit.model_names(experiment), fit.linear, fit.account.hashes)
    found = _validation(experiment, fit, rows, errors, before, seen=fit.account.has_used(readings))
    return replace(found, notes=(*doubted, *rows.range_notes(model, x)))


def fitted_frames(fit: FitRecord, rows: ReadingRows, model: Model, x: Array) -> list[Frame]:
    """The frames of rows whose frame nobody states: as the fit found them, else as they suit its predictions best."""
    known = {f.series: f for f in fit.frames}
    names = [rows.readings.frames[f] for f in rows.estimated]
    found = dict(zip(names, rows.start(model, x), strict=True)) if set(names) - set(known) else {}
    return [known.get(n) or found[n] for n in names]


def validate_halves(
    experiment: Experiment, readings: Readings, fit: FitRecord, halves: Halves, seed: Seed = 0, *, anyway: bool = False
) -> Validation:
    """Fits like a stored one to random halves of the readings, each judged on the other half.

    Whole poses are drawn, so that no pose is in both, and drawn anew where a half does not identify what the stored fit
    does: what it held at nominal would count as an error of the model. The median half stands for all in the plots.
    InputError where something was found wrong in the readings or files of the fit, unless `anyway`.
    """
    doubted = check_account(fit, experiment, anyway=anyway)
    if halves < 1:
        raise InputError(f"halves: {halves}; allowed: 1 or more")
    rows = make_rows(readings)
    poses = np.unique(rows.pose)
    if len(poses) < 4:
        raise InputError(f"{readings.where}: {len(poses)} poses are too few for halves")
    rng = np.random.default_rng(seed)
    every: list[tuple[ReadingRows, Array]] = []
    lacking: set[str] = set()
    for _ in range(halves):
        own, train = _half(experiment, rows, fit, rng, 1 if lacking else _DRAWN)
        lacking |= set(fit.names) - set(own.names)
        predicted, measured = own.predict(readings.masked(train))
        test = ~train[rows.keep]
        every.append((rows.take(test), measured - predicted))
    lost = f"halves that do not identify {', '.join(sorted(lacking))} hold it at nominal: their errors are larger"
    spread = np.array([np.sqrt(np.nansum(e**2) / len(e)) for _, e in every])
    place = {k: i for i, k in enumerate(rows.keep.tolist())}
    both = np.array([place[k] for part, _ in every for k in part.keep.tolist()], dtype=np.intp)
    before = errors_before(experiment, rows, fit.model_names(experiment), fit.linear)[both]
    errors = np.concatenate([e for _, e in every])
    found = _validation(experiment, fit, rows.take(both), errors, before, halves=halves, spread=spread)
    return replace(found, notes=(*doubted, *((lost,) if lacking else ())))


def _half(
    experiment: Experiment, rows: ReadingRows, fit: FitRecord, rng: np.random.Generator, tries: int
) -> tuple[Fit, Flags]:
    """A fit to half of the poses that identifies what the stored one does, or the last drawn, and its rows (R,)."""
    poses, use = np.unique(rows.pose), np.zeros(len(rows.readings), dtype=bool)
    use[rows.keep[np.isin(rows.pose, rng.permutation(poses)[: len(poses) // 2])]] = True
    try:
        campaign = experiment.with_(fit=fit.model_names(experiment))
        own = fit_readings(campaign, rows.readings.masked(~use), FitOptions(linear=fit.linear))
    except (NotIdentifiable, NotConverged) as error:
        if tries == 1:
            raise type(error)(f"a random half cannot be fitted: {error}") from error
        return _half(experiment, rows, fit, rng, tries - 1)
    whole = tries == 1 or set(fit.names) <= set(own.names)
    return (own, use) if whole else _half(experiment, rows, fit, rng, tries - 1)


def _validation(
    experiment: Experiment,
    fit: FitRecord,
    rows: ReadingRows,
    errors: Array,
    before: Array,
    halves: int = 0,
    seen: bool = False,
    spread: Array | None = None,
) -> Validation:
    readings = rows.readings
    series = [readings.states.series[s] for s in map(int, rows.plus)]
    kind = readings.kind[rows.keep].tolist()
    label = [f"{k}s, series {s}" if s else f"{k}s" for k, s in zip(kind, series, strict=True)]
    parts = tuple(
        ValidationErrors(name=name, errors=errors[at], before=before[at])
        for name in dict.fromkeys(label)
        for at in [np.array([n == name for n in label])]
    )
    return Validation(
        robot=fit.robot,
        account=fit.account,
        whole=ValidationErrors(name="all", errors=errors, before=before),
        parts=parts,
        halves=halves,
        seen=seen,
        spread=np.zeros(0) if spread is None else spread,
        lines=readings.line[rows.keep],
        poses=rows.pose_names,
        places=rows.places(experiment),
        own_error=np.nan if halves or seen else fit.held_out_worst,
    )
