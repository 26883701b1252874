"""What a fit file holds: one record, which `identify` makes, `write_fit` writes and `read_fit` gives back as it was."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pydantic

from qsframework.arguments import checked
from qsframework.elastostatics import Model
from qsframework.errors import InputError, Problem, nearest
from qsframework.estimation import FitOptions, Interval
from qsframework.estimation.statistics import identified_directions
from qsframework.estimation.tails import chi2_sf, normal_sf, t_isf
from qsframework.experiment import Experiment, Frame, Readings
from qsframework.experiment.account import Account
from qsframework.files import (
    Document,
    FileRecord,
    Lists,
    Named,
    Unit,
    as_file,
    null,
    read_yaml,
    validate,
    write_text,
)
from qsframework.files.formats import FORMAT, check_format
from qsframework.files.plain import is_list
from qsframework.fits.columns import values_of
from qsframework.fits.estimate import Estimate
from qsframework.fits.held import Held
from qsframework.information.selection import NotEstimated
from qsframework.plausible import allowed, beyond
from qsframework.plugin import Array
from qsframework.plugin.registry import replaced

HIGH_CORRELATION = 0.9
COVERAGE = 2.0
"""k of an expanded uncertainty of a known noise, for 95.45 %."""
SIGNIFICANT = 1e-3
"""p-value below which residuals do not fit their stated noise."""


@dataclass(frozen=True)
class Masked(FileRecord):
    """Rows of a file that were masked, and why.

    readings: "displacements", "positions" or "gauges"; file: number of their file among those of the account
    """

    kind: str
    rows: tuple[int, ...]
    words: str
    readings: str
    file: int = 0

    @property
    def unused(self) -> bool:
        """Whether the fit itself did not use them."""
        return self.kind in ("gross", "doubled_rows")


@dataclass(frozen=True, eq=False, kw_only=True)
class FitRecord(FileRecord):
    """A fit as its file holds it, SI: p estimates, and of which robot, model and readings they are.

    robot: the arm's name; account: of which readings and which description of the arm; options: how it was made
    covariance (p, p): of the readings' noise; total_covariance: with the load's stated uncertainty, None without one
    model_values: of all parameters of the model, estimated or not
    sigma (m): sd of one coordinate of unit weight, "stated" or "estimated" from the residuals
    shared_sd (m): of the error that the markers of a visit share, 0 where none was looked for or seen; shared_p: of it
    held_out_error (m): 3D RMS at held-out poses, masked rows among them; held_out_nominal: of the nominal arm, in
    frames that suit it best; held_out_largest: the largest distance; held_out_worst: the error of the kind of reading
    that is predicted worst; NaN where no pose can be left out
    carriers: poses that alone carry a parameter, which cannot be left out
    frames: the base in the frames that were estimated; not_estimated: what was requested and is not; held: what an
    error of nominal values does to the estimates, of what was asked for or has a stated sd
    cleaned: what was masked before the fit because it cannot be right, None where nobody looked; gross: rows that the
    fit itself masked, and what else it says of rows
    path: the file that was read, "" of a fit that was made
    """

    robot: str
    account: Account
    method: str
    options: FitOptions
    estimates: Annotated[tuple[Estimate, ...], Named("name")]
    covariance: Annotated[Array, Lists(2)]
    total_covariance: Annotated[Array, Lists(2)] | None = None
    model_values: dict[str, float]
    sigma: Annotated[float, Unit("m")]
    sigma_source: str
    shared_sd: Annotated[float, Unit("m")] = 0.0
    shared_p: float | None = None
    chi2: float
    dof: int
    held_out_error: Annotated[float, Unit("m"), null(math.nan)] = math.nan
    held_out_nominal: Annotated[float, Unit("m"), null(math.nan)] = math.nan
    held_out_largest: Annotated[float, Unit("m"), null(math.nan)] = math.nan
    held_out_worst: Annotated[float, Unit("m"), null(math.nan)] = math.nan
    carriers: tuple[str, ...] = ()
    frames: Annotated[tuple[Frame, ...], Named("series")] = ()
    not_estimated: Annotated[tuple[NotEstimated, ...], Named("name")] = ()
    held: Annotated[tuple[Held, ...], Named("name")] = ()
    intervals: Annotated[tuple[Interval, ...], Named("name")] = ()
    cleaned: tuple[Masked, ...] | None = None
    gross: tuple[Masked, ...] = ()
    notes: tuple[str, ...] = ()
    path: Annotated[str, pydantic.Field(exclude=True)] = ""

    @property
    def linear(self) -> bool:
        """Whether loads were balanced at the undeflected pose."""
        return self.options.linear

    def __getitem__(self, name: str) -> Estimate:
        """The estimate of a parameter, by its name or by the place of which only one is estimated: fit["joint_1"].

        Raises InputError, with the names, where there is none or more than one.
        """
        found = [e for e in self.estimates if name in (e.name, e.name.partition("[")[2].partition("]")[0])]
        if len(found) != 1:
            several = ", ".join(e.name for e in found or self.estimates)
            said = f"the fit has {len(found) or 'no'} estimate{'s' * bool(found)} of {name!r}"
            raise InputError(Problem(said, allowed=several, hint=nearest(name, self.names)))
        return found[0]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(e.name for e in self.estimates)

    @property
    def values(self) -> Array:
        """The estimates (p,)."""
        return np.array([e.value for e in self.estimates])

    @property
    def sd(self) -> Array:
        """Their sds (p,), NaN where none is quoted."""
        return np.array([e.sd for e in self.estimates])

    @property
    def whole_covariance(self) -> Array:
        """Covariance (p, p) of the noise and, where it was stated, of the load."""
        return self.covariance if self.total_covariance is None else self.total_covariance

    @property
    def noise_covariance(self) -> Array:
        """Covariance (p, p) of the readings' noise alone: C - C L C, L the inverse variances before the readings."""
        known = [0.0 if e.counted_sd is None else 1.0 / e.counted_sd for e in self.estimates]
        moved = self.covariance * np.array(known)
        return self.covariance - moved @ moved.T

    @property
    def widened(self) -> Array:
        """`whole_covariance` with the noise as large as residuals are that do not fit their stated noise."""
        return self.whole_covariance + (self.widening - 1.0) * self.noise_covariance

    @property
    def held_moments(self) -> Array:
        """E[d d'] (h, h) of the errors d of what was held at nominal values, in the light of the residuals."""
        return np.array([h.moment for h in self.held]).reshape(len(self.held), len(self.held))

    @property
    def held_moved(self) -> Array:
        """By how much each estimate is wrong (p, h) for one unit by which what was held is."""
        return np.array([h.moved for h in self.held]).reshape(len(self.held), len(self.estimates)).T

    @property
    def held_covariance(self) -> Array:
        """Covariance (p, p) of the estimates by these errors."""
        return np.asarray(self.held_moved @ self.held_moments @ self.held_moved.T)

    @property
    def sd_total(self) -> tuple[float, ...]:
        """sd of each estimate by the noise, the load's stated uncertainty and what was held at nominal."""
        return tuple(float(s) for s in np.sqrt(np.diag(self.whole_covariance + self.held_covariance)))

    @property
    def correlation(self) -> Array:
        """Correlation matrix of the estimates (p, p); zero where no sd is quoted."""
        sd = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(np.where(sd > 0, sd, 1.0), np.where(sd > 0, sd, 1.0))

    def high_correlations(self, above: float = HIGH_CORRELATION) -> list[tuple[str, str, float]]:
        """Pairs of estimates that the readings hardly tell apart."""
        c, names = self.correlation, self.names
        pairs = np.argwhere(np.abs(np.triu(c, 1)) > above).tolist()
        return [(names[i], names[j], float(c[i, j])) for i, j in pairs]

    @property
    def directions(self) -> tuple[int, int]:
        """Of what was known before the readings: in how many directions they removed half of its variance or more, and
        how many there are."""
        own = [i for i, e in enumerate(self.estimates) if e.share is not None]
        sd = np.array([self.estimates[i].prior_sd for i in own], dtype=float)
        return identified_directions(self.covariance[np.ix_(own, own)], sd), len(own)

    @property
    def masked(self) -> tuple[int, ...]:
        """Rows that the fit itself found to be gross, or to stand twice, and did not use."""
        return tuple(sorted({row for one in self.gross if one.unused for row in one.rows}))

    @property
    def masked_rows(self) -> tuple[int, ...]:
        """Rows of the readings' file that were found wrong and not used."""
        return tuple(sorted({*self.masked, *(row for one in self.cleaned or () for row in one.rows)}))

    def used(self, readings: Readings) -> Readings:
        """The readings without the rows that were masked."""
        wrong = np.zeros(len(readings), dtype=bool)
        plural = np.array([f"{kind}s" for kind in readings.kind.tolist()])
        for one in (*(self.cleaned or ()), *(one for one in self.gross if one.unused)):
            wrong |= np.isin(readings.line, one.rows) & (plural == one.readings) & (readings.file == one.file)
        return readings.masked(wrong)

    @property
    def p_value(self) -> float | None:
        """Probability of residuals this large under the stated noise; None if the noise is estimated."""
        return None if self.sigma_source == "estimated" else float(chi2_sf(self.chi2, self.dof))

    @property
    def agrees(self) -> bool | None:
        """Whether the residuals agree with their stated noise; None where none was stated."""
        p = self.p_value
        return None if p is None or self.dof <= 0 else p >= SIGNIFICANT

    @property
    def widening(self) -> float:
        """What the variances that the fit predicts are multiplied by: chi-square per degree of freedom where the
        residuals do not fit their stated noise, else 1."""
        return self.chi2 / self.dof if self.agrees is False else 1.0

    @property
    def coverage(self) -> float:
        """k of an expanded uncertainty, for 95.45 %: 2; of an estimated noise by Student's t of its freedom."""
        estimated = self.sigma_source == "estimated" and self.dof > 0
        return float(t_isf(normal_sf(COVERAGE), self.dof)) if estimated else COVERAGE

    @property
    def lack(self) -> float:
        """RMS distance, m, by which held-out poses are off beyond the stated noise: what the model lacks."""
        return float(np.nan_to_num(self.held_out_worst) * np.sqrt(1.0 - 1.0 / self.widening))

    def model_names(self, experiment: Experiment) -> tuple[str, ...]:
        """The estimated parameters that are the model's, and not a frame's. InputError where it has no such."""
        known = experiment.model().names
        own = tuple(n for n in self.names if not n.startswith(("frame", "point[", "plane[")))
        if missing := [n for n in own if n not in known]:
            raise InputError(f"{self.path}: the fit is of another model: {', '.join(missing)} is not in this one")
        return own

    def x_of(self, model: Model) -> Array:
        """Values of all parameters of a model (p,). InputError where the fit is of another model.

        A parameter that is estimated by its own name only has its nominal value where the fit has none.
        """
        missing = [p.name for p in model.parameters if p.name not in self.model_values and not p.by_name]
        if missing:
            words = f"the fit is of another model: it has no {', '.join(missing)}"
            raise InputError(Problem(words, file=self.path or None))
        values = [self.model_values.get(p.name, p.nominal) for p in model.parameters]
        far = [
            Problem(p.name, self.path or None, found=f"{value:.6g} {p.unit}", allowed=allowed(known, p.unit))
            for p, value in zip(model.parameters, values, strict=True)
            if (known := beyond(value, p.unit)) is not None and abs(value) > known.most
        ]
        if far:
            raise InputError(far)
        return np.array(values)

    def as_json(self) -> dict[str, Any]:
        """What `fit.json` holds: the record, and beside it what people look for and `read_fit` passes over."""
        out = as_file(self, FitRecord)
        columns = values_of(self)
        for key in columns.keys() - {"parameter"}:
            for name, value in zip(self.names, columns[key], strict=True):
                unknown = value is None or (isinstance(value, float) and math.isnan(value))
                out["estimates"][name].setdefault(key, None if unknown else value)
        more = {"p_value": self.p_value, "masked_rows": list(self.masked_rows)}
        return {"format": FORMAT, "parameters": list(self.names), **out, **more}


@checked
def write_fit(fit: FitRecord, path: str | Path) -> Path:
    """Write fit.json, all or nothing.

    Args:
        fit: the fit.
        path: the file.

    Returns:
        The path.

    Raises:
        InputError: where it cannot be written.
    """
    return write_text(path, json.dumps(fit.as_json(), indent=2, sort_keys=True, allow_nan=False) + "\n")


@checked
def read_fit(path: str | Path) -> FitRecord:
    """Read a fit.json.

    Args:
        path: the file.

    Returns:
        The fit as it was, SI.

    Raises:
        InputError: with all its problems, each with its line.
    """
    document = read_yaml(path)
    check_format(document)
    found = validate(document, FitRecord)
    order = document.data.get("parameters")
    names = [str(name) for name in order] if is_list(order) else []
    if wrong := list(_problems(document, found, names)):
        raise InputError(wrong)
    estimates = {e.name: e for e in found.estimates}
    return replace(found, estimates=tuple(estimates[name] for name in names), path=str(path))


def _problems(document: Document, fit: FitRecord, names: list[str]) -> Iterator[Problem]:
    """What is wrong among the fields of a file of which each is right by itself; names: `parameters`, in its order."""

    def problem(words: str, key: str, allowed: str | None = None) -> Problem:
        return Problem(words, str(document.path), document.line(key), allowed=allowed)

    old = {told: name for name in (*fit.model_values, *names) if (told := replaced(name)) is not None}
    for told, name in old.items():
        words = f"the fit is of an older format: it holds {name!r}"
        yield Problem(words, str(document.path), hint=f"{told}. Identify again.")
    p, unknown = len(names), [name for name in names if name not in fit.names]
    yield from (problem(f"parameter {name!r} has no estimate", "estimates") for name in unknown)
    if not unknown and sorted(names) != sorted(fit.names):
        yield problem("parameters must name each of the estimates once", "parameters", ", ".join(fit.names))
    for key, C in (("covariance", fit.covariance), ("total_covariance", fit.total_covariance)):
        if C is not None and C.shape != (p, p):
            yield problem(f"{key} has another size than parameters", key, f"{p} rows of {p} numbers")
        elif C is not None and not np.allclose(C, C.T, rtol=1e-6, atol=0.0):
            yield problem(f"{key} is not symmetric", key)
