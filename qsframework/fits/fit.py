"""The result of an identification, with its own proof."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from qsframework.elastostatics import Model
from qsframework.errors import InputError
from qsframework.estimation import Observations, RankTest, Solution, rms
from qsframework.experiment import ObservationModel, Readings, make_rows
from qsframework.experiment.readings import Alignment, Made
from qsframework.fits.columns import ERRORS
from qsframework.fits.record import FitRecord
from qsframework.information.selection import NotEstimated
from qsframework.plugin import Array, Indices
from qsframework.viewed import Viewed

KINDS = ("position", "displacement", "gauge")
"""Kinds of readings, that which speaks for a fit first."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Found:
    """What a method found: the bridge at its values, the solution, and what is not estimated.

    covariance (p, p) of noise of the stated size; solved: the observations of the solution, with what is known before
    them; vague: the springs that these tell worse than their own size; before (p,): sds of what was
    known, as they were before an arm was seen to lie further off
    """

    seen: ObservationModel
    solution: Solution
    covariance: Array
    method: str
    left: tuple[NotEstimated, ...] = ()
    notes: tuple[str, ...] = ()
    solved: Observations | None = None
    vague: tuple[str, ...] = ()
    before: Array | None = None


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Fit(Viewed, FitRecord):
    """What the file of a fit holds, with the model and the R used rows that it was made of.

    measured, predicted, nominal, residuals, studentised, left_out (R, 3) m, NaN where an axis was not measured;
    left_out are the errors at each pose when it is left out of the fit; nominal is the arm before the fit, in frames
    that suit it best. kind (R,): of each row, "displacement", "position" or "gauge"; lines (R,) in their files,
    sources[file].
    missed (k, 3) m: errors of the fit at rows that it masked, whose kinds are missed_kind (k,)
    """

    model: Model
    rank: RankTest
    lines: Indices
    file: Indices
    sources: tuple[str, ...]
    poses: tuple[str, ...]
    kind: npt.NDArray[np.str_]
    measured: Array
    predicted: Array
    nominal: Array
    residuals: Array
    studentised: Array
    left_out: Array
    missed: Array = field(default_factory=lambda: np.zeros((0, 3)))
    missed_kind: npt.NDArray[np.str_] = field(default_factory=lambda: np.zeros(0, dtype=np.str_))
    alignments: tuple[Alignment, ...] = ()
    made: Made | None = None
    about_noise: tuple[str, ...] = ()
    """What residuals say of the noise by direction and distance."""

    @property
    def x(self) -> Array:
        """All parameters of the model, estimated or not."""
        return np.array(list(self.model_values.values()))

    @property
    def position(self) -> npt.NDArray[np.bool_]:
        """Rows (R,) of absolute positions."""
        return self.kind == "position"

    @property
    def rms_readings(self) -> float:
        """RMS per axis of the readings themselves, m."""
        return rms(self.measured)

    @property
    def rms_nominal(self) -> float:
        """RMS per axis of the error of the nominal model, m."""
        return rms(self.measured - self.nominal)

    @property
    def rms(self) -> float:
        """RMS per axis of the residuals, m."""
        return rms(self.residuals)

    @property
    def rms_left_out(self) -> float:
        """RMS per axis of the leave-one-pose-out errors, m, over the poses that can be left out; NaN if none can.

        With all rows: those that were masked as gross are unseen too.
        """
        return rms(np.concatenate([self.left_out, self.missed]))

    @property
    def rms_left_out_kept(self) -> float:
        """The same without the masked rows."""
        return rms(self.left_out)

    def error_of(self, residuals: Array) -> float:
        """3D RMS of errors (R, 3) over the axes that were measured, m; NaN where there are none."""
        known = residuals[np.isfinite(residuals).any(axis=1)]
        return float(np.sqrt(np.nansum(known**2, axis=1).mean())) if len(known) else float("nan")

    @property
    def errors(self) -> dict[str, dict[str, float]]:
        """3D RMS of the errors, m, by kind of reading and key of `ERRORS`, as far as there are any."""
        found = {kind: {row.key: self.error_of(row.errors(self, kind)) for row in ERRORS} for kind in KINDS}
        return {kind: known for kind, of in found.items() if (known := {k: v for k, v in of.items() if np.isfinite(v)})}

    @property
    def errors_mm(self) -> dict[str, dict[str, float]]:
        """The same in mm."""
        return {kind: {key: 1e3 * value for key, value in of.items()} for kind, of in self.errors.items()}

    def predict(self, readings: Readings) -> tuple[Array, Array]:
        """Other readings in the same frames: predicted and measured (R, 3) m of their used rows.

        InputError where they are in a frame that the fit does not know.
        """
        rows = make_rows(readings)
        known = {frame.series: frame for frame in self.frames}
        wanted = [readings.frames[f] for f in rows.estimated]
        if missing := [name for name in wanted if name not in known]:
            raise InputError(f"the fit knows no tracker frame of series {', '.join(map(repr, missing))}")
        return rows.predict(self.model, self.x, [known[n] for n in wanted], self.linear), rows.measured

    def as_json(self) -> dict[str, Any]:
        """What `fit.json` holds; beside the record, sizes of the errors of the readings, for people."""

        def mm(value: float) -> float | None:
            return value * 1e3 if np.isfinite(value) else None

        sizes = {
            "readings": mm(self.rms_readings),
            "nominal": mm(self.rms_nominal),
            "identified": mm(self.rms),
            "leave_one_out": mm(self.rms_left_out),
            "leave_one_out_without_masked": mm(self.rms_left_out_kept),
        }
        return {**super().as_json(), "errors_mm": self.errors_mm, "rms_per_axis_mm": sizes}
