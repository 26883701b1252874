"""The result of an identification, with its own proof."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from qsframework.elastostatics import Model
from qsframework.estimation import Interval, RankTest, rms
from qsframework.estimation.tails import chi2_sf
from qsframework.experiment import Frame, Readings, make_rows
from qsframework.experiment.readings import Alignment, Made
from qsframework.files.formats import FORMAT
from qsframework.identify.selection import LeftAside
from qsframework.identify.soundness import robot_hash
from qsframework.plugin import Array, Indices
from qsframework.viewed import Viewed

HIGH_CORRELATION = 0.9
SIGNIFICANT = 1e-3
"""p-value below which residuals do not fit their stated noise."""


class State(Enum):
    """What is to be said of an estimate."""

    FINE = "fine"
    FIXED = "fixed"
    UPPER_LIMIT = "upper limit"
    AT_BOUND = "at bound"
    NOT_IDENTIFIABLE = "not identifiable"
    BEYOND_BOUND = "beyond bound"
    OUTSIDE_PRIOR = "outside prior"
    IMPLAUSIBLE = "implausible"


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """One identified parameter, SI.

    sd is NaN where the value stands at its bound, for the fit then says nothing about the other side; 0 where fixed.
    limit: of a value that is not told from zero, the size that it has at most (95 %); free_sd: the sd bounds aside;
    size: the parameter's natural size; prior_sd: stated, or None
    """

    name: str
    unit: str
    value: float
    sd: float
    initial: float
    lower: float
    upper: float
    state: State = State.FINE
    limit: float | None = None
    free_sd: float = float("nan")
    size: float = 1.0
    prior_sd: float | None = None

    @property
    def status(self) -> str:
        """ "" where all is well, else what is to be said in words."""
        from qsframework.identify.status import status_words

        return status_words(self)

    def as_json(self, sd_total: float) -> dict[str, Any]:
        """Its entry in `fit.json` (SI units); sd_total: its sd with the load's stated uncertainty."""
        return {
            "value": self.value,
            "sd": None if np.isnan(self.sd) else self.sd,
            "sd_total": None if np.isnan(self.sd) else sd_total,
            "unit": self.unit,
            "initial": self.initial,
            "state": self.state.value,
            "limit": self.limit,
            "status": self.status,
        }


@dataclass(frozen=True)
class Masked:
    """Rows of a file that were masked, and why; `readings` is "displacements", "positions" or "gauges"."""

    kind: str
    rows: tuple[int, ...]
    words: str
    readings: str


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Fit(Viewed):
    """Estimates with covariance (p, p) and the residuals of R used rows.

    x holds all parameters of the model, estimated or not; frames: the base in the frames that were estimated;
    left_aside: parameters that were asked for and not estimated, with what absorbs them. measured, predicted, nominal,
    residuals, studentised, left_out (R, 3) m, NaN where an axis was not measured; left_out are the errors at each pose
    when it is left out of the fit; nominal is the arm before the fit, in frames that suit it best. kind (R,): of
    each row, "displacement", "position" or "gauge"; lines (R,) in their files, sources[file].
    sigma (m) is the sd of one coordinate of unit weight, "stated" or "estimated" from the residuals.
    shared_sd (m): of the error that the markers of a visit share, 0 where none was looked for or seen; shared_p: of it
    total_covariance (p, p): with the load's stated uncertainty; None where none is stated
    cleaned: what was masked before the fit because it cannot be right; None where nobody looked
    gross: rows that the fit itself masked, and what else it says of rows; missed (k, 3) m: its errors at the masked,
    whose kinds are missed_kind (k,)
    """

    method: str
    linear: bool
    model: Model
    x: Array
    estimates: tuple[Estimate, ...]
    covariance: Array
    rank: RankTest
    sigma: float
    sigma_source: str
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
    chi2: float
    dof: int
    data_sha256: str
    frames: tuple[Frame, ...] = ()
    left_aside: tuple[LeftAside, ...] = ()
    shared_sd: float = 0.0
    shared_p: float | None = None
    total_covariance: Array | None = None
    intervals: tuple[Interval, ...] = ()
    cleaned: tuple[Masked, ...] | None = None
    gross: tuple[Masked, ...] = ()
    missed: Array = field(default_factory=lambda: np.zeros((0, 3)))
    missed_kind: npt.NDArray[np.str_] = field(default_factory=lambda: np.zeros(0, dtype=np.str_))
    alignments: tuple[Alignment, ...] = ()
    made: Made | None = None
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(e.name for e in self.estimates)

    @property
    def position(self) -> npt.NDArray[np.bool_]:
        """Rows (R,) of absolute positions."""
        return self.kind == "position"

    @property
    def rows(self) -> Indices:
        """Lines (R,) of the rows in their files."""
        return self.lines

    @property
    def masked_rows(self) -> tuple[int, ...]:
        """Rows of the readings' file that were found wrong and not used."""
        every = [*(self.cleaned or ()), *(one for one in self.gross if one.kind == "gross")]
        return tuple(sorted({row for one in every for row in one.rows}))

    @property
    def masked(self) -> tuple[int, ...]:
        """Rows that the fit itself found to be gross and did not use."""
        return tuple(sorted({row for one in self.gross if one.kind == "gross" for row in one.rows}))

    @property
    def sd_total(self) -> tuple[float, ...]:
        """sd of each estimate with the load's stated uncertainty; that of the noise alone where none is stated."""
        covariance = self.covariance if self.total_covariance is None else self.total_covariance
        return tuple(float(s) for s in np.sqrt(np.diag(covariance)))

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

    @property
    def carriers(self) -> tuple[str, ...]:
        """Poses that alone carry a parameter: without one of them the others cannot tell it."""
        lost = np.flatnonzero((np.isnan(self.left_out) & np.isfinite(self.measured)).any(axis=1))
        return tuple(dict.fromkeys(self.poses[i] for i in lost))

    @property
    def p_value(self) -> float | None:
        """Probability of residuals this large under the stated noise; None if the noise is estimated."""
        return None if self.sigma_source == "estimated" else float(chi2_sf(self.chi2, self.dof))

    @property
    def unseen(self) -> tuple[float, float, float]:
        """Error of the nominal model and at poses left out, m, and the largest distance at these: of positions RMS of
        the distance, else RMS per axis; NaN where no pose can be left out."""
        kind = next(k for k in ("position", "displacement", "gauge") if (self.kind == k).any())
        at = self.kind == kind
        size = self.error_of if kind == "position" else rms
        out = np.concatenate([self.left_out[at], self.missed[self.missed_kind == kind]])
        far = np.sqrt(np.nansum(out**2, axis=1))
        return size((self.measured - self.nominal)[at]), size(out), float(far.max()) if len(far) else float("nan")

    def error_of(self, residuals: Array) -> float:
        """RMS of the norms of errors (R, 3) that are whole, m; NaN where there are none."""
        whole = residuals[np.isfinite(residuals).all(axis=1)]
        return float(np.sqrt((whole**2).sum(axis=1).mean())) if len(whole) else float("nan")

    def predict(self, readings: Readings) -> tuple[Array, Array]:
        """Other readings in the same frames: predicted and measured (R, 3) m of their used rows.

        InputError where they are in a frame that the fit does not know.
        """
        rows = make_rows(readings)
        known = {frame.series: frame for frame in self.frames}
        wanted = [readings.frames[f] for f in rows.estimated]
        if missing := [name for name in wanted if name not in known]:
            from qsframework.errors import InputError

            raise InputError(f"the fit knows no tracker frame of series {', '.join(map(repr, missing))}")
        return rows.predict(self.model, self.x, [known[n] for n in wanted], self.linear), rows.measured

    @property
    def significance(self) -> float:
        """p-value below which residuals do not fit their stated noise."""
        return SIGNIFICANT

    @property
    def correlation(self) -> Array:
        """Correlation matrix of the estimates (p, p); zero where no sd is quoted."""
        sd = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(np.where(sd > 0, sd, 1.0), np.where(sd > 0, sd, 1.0))

    def high_correlations(self, above: float = HIGH_CORRELATION) -> list[tuple[str, str, float]]:
        """Pairs of estimates that the readings hardly tell apart."""
        c = self.correlation
        return [
            (self.names[i], self.names[j], float(c[i, j]))
            for i in range(len(c))
            for j in range(i + 1, len(c))
            if abs(c[i, j]) > above
        ]

    def as_json(self) -> dict[str, Any]:
        """What `fit.json` holds (SI units)."""
        before, after, _ = self.unseen
        content = {
            "format": FORMAT,
            "robot": self.model.facts.name,
            "robot_sha256": robot_hash(self.model.facts),
            "method": self.method,
            "linear": self.linear,
            "parameters": list(self.names),
            "estimates": {e.name: e.as_json(s) for e, s in zip(self.estimates, self.sd_total, strict=True)},
            "covariance": self.covariance.tolist(),
            "covariance_total": None if self.total_covariance is None else self.total_covariance.tolist(),
            "intervals": {
                i.name: {"level": i.level, "lower": _end(i.lower), "upper": _end(i.upper), "linear": list(i.linear)}
                for i in self.intervals
            },
            "sigma_mm": self.sigma * 1e3,
            "sigma_source": self.sigma_source,
            "shared_by_pose_mm": self.shared_sd * 1e3,
            "chi2": self.chi2,
            "dof": self.dof,
            "p_value": self.p_value,
            "unseen_mm": [1e3 * before, 1e3 * after] if np.isfinite([before, after]).all() else None,
            "poses_that_cannot_be_left_out": list(self.carriers),
            "model": {name: float(v) for name, v in zip(self.model.names, self.x, strict=True)},
            "notes": list(self.notes),
            "data_sha256": self.data_sha256,
            "left_aside": [entry.words() for entry in self.left_aside],
            **self._of_readings(),
        }
        if self.frames:
            content["frames"] = {
                f.series: {"rotation": f.rotation.tolist(), "origin_m": f.origin.tolist()} for f in self.frames
            }
        return content

    def _of_readings(self) -> dict[str, Any]:
        """What `fit.json` says of the readings' errors and of those that were not used."""
        out: dict[str, Any] = {
            "masked": None if self.cleaned is None else [{**asdict(m), "rows": list(m.rows)} for m in self.cleaned],
            "gross": [{**asdict(m), "rows": list(m.rows)} for m in self.gross],
            "masked_rows": list(self.masked_rows),
            "rms_mm": {
                "readings": self.rms_readings * 1e3,
                "nominal": self.rms_nominal * 1e3,
                "identified": self.rms * 1e3,
                "leave_one_out": None if np.isnan(self.rms_left_out) else self.rms_left_out * 1e3,
                "leave_one_out_without_masked": (
                    None if np.isnan(self.rms_left_out_kept) else self.rms_left_out_kept * 1e3
                ),
            },
        }
        if self.position.any():
            out["rms_norm_mm"] = self.error_of(self.residuals[self.position]) * 1e3
        return out


def _end(value: float) -> float | None:
    return value if np.isfinite(value) else None
