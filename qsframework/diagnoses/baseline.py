"""What a diagnosis starts from: the exact fit of the experiment's own parameters, all causes linearised there, and the
noise that it leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.diagnoses.residuals.audited_rows import (
    in_noise,
    library_basis,
    repeats,
    replicates,
    split_told,
    visit_noise,
)
from qsframework.diagnoses.residuals.noise_components import NoiseAudit, audit_noise
from qsframework.errors import NotConverged
from qsframework.estimation import orthonormal, rounding
from qsframework.estimation.axis_noise import LEVEL, AxisNoise
from qsframework.estimation.linear_fit import LinearFit, winsorised
from qsframework.estimation.visit_noise import Reml, reml
from qsframework.experiment import Experiment, Readings, make_rows, observation_model
from qsframework.experiment.noise_by_axis import noise_by_axis, of_axes
from qsframework.experiment.observations import REACH, ReadingRows, start_values
from qsframework.hypotheses.catalogue.causes import Cause, Untested, find_causes
from qsframework.hypotheses.columns import Case, make_case
from qsframework.hypotheses.exact_refit import SettledFit, settle_fit
from qsframework.hypotheses.search.model_selection import refit
from qsframework.information.identifiable import in_order
from qsframework.plugin import Array, Indices


@dataclass(frozen=True, eq=False)
class StartingFit:
    """An exact fit of the experiment's own parameters to all rows; unidentifiable: the others."""

    experiment: Experiment
    readings: Readings
    rows: ReadingRows
    fit: SettledFit
    unidentifiable: tuple[str, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Baseline:
    """The exact fit to the rows, and the whitened case, winsorised, in the noise that was found.

    given, whole: rows and case as they came; good: places of the rows in them that are left; fits: of the columns that
    the noise was found beside, in every noise that may be; nu: degrees of freedom of the noise's unit; far: whether a
    cause is far from linear; axes: how the noise differs by the axes of the instrument, None: it does not
    """

    experiment: Experiment
    readings: Readings
    rows: ReadingRows
    fit: SettledFit
    case: Case
    fits: Reml
    nu: float
    good: Indices
    untested: tuple[Untested, ...]
    unidentifiable: tuple[str, ...]
    given: ReadingRows
    whole: Case
    far: bool = False
    axes: AxisNoise | None = None

    @property
    def start(self) -> ReadingRows:
        """The rows that are left, in the noise that came with them."""
        return self.given.take(self.good)

    @property
    def values(self) -> Array:
        """The winsorised residuals (m,) of the baseline, m."""
        return self.rows.padded_noise.colour(self.case.residuals)

    def refit(self, causes: Sequence[Cause]) -> SettledFit | None:
        """The exact fit with some causes, None where that leads nowhere."""
        return refit(self.case, causes, self.fit, self.rows) if causes else self.fit

    def visible_causes(self) -> dict[str, Array]:
        """Columns (m, p) m of each cause that the readings can show, by name."""
        seen = [s.visible for s in self.case.subspaces()]
        return {c.name: self.case.metres(i) for i, c in enumerate(self.case.causes) if seen[i]}

    def case_at(self, causes: Sequence[Cause], fit: SettledFit) -> Case:
        """The case whose fitted parameters are those of a fit with causes, linearised there, without further causes."""
        case = make_case(self.experiment, self.rows, self.case.fitted, causes, fit.by_name(), fit.residuals, fit.frames)
        held = [np.array(c.sizes) / c.prior if c.prior else np.zeros(len(c.names)) for c in causes]
        back = [[-fit.value(n) / s if c.prior else 0.0 for n, s in zip(c.names, c.sizes, strict=True)] for c in causes]
        A = np.concatenate([case.A, *case.B], axis=1)
        aim = np.concatenate([np.zeros(len(case.held)) if case.aim is None else case.aim, *back])
        return replace(case, A=A, causes=(), B=(), held=np.concatenate([case.held, *held]), aim=aim)

    def pose_names(self) -> list[str]:
        """Names of the poses by the number that the rows give them."""
        names = dict(zip(self.rows.pose.tolist(), self.rows.pose_names, strict=True))
        return [names.get(number, "") for number in range(max(names) + 1)]


def start_of(experiment: Experiment, readings: Readings) -> StartingFit:
    """The exact fit of the experiment's own parameters, in the noise that is stated."""
    model = experiment.model()
    rows = make_rows(readings)
    wanted = in_order(model, experiment.fit_names())
    x = start_values(experiment, wanted)
    seen = observation_model(experiment, readings, wanted, linear=True, x=x, rows=rows)
    names, unidentifiable = split_told(seen)
    try:
        fit = settle_fit(model, rows, names, x, frames=seen.frames)
    except NotConverged as error:
        if not unidentifiable:
            raise
        missing = f"These readings do not identify {', '.join(unidentifiable)}: kept at the nominal value"
        raise NotConverged(f"{error}. {missing}") from error
    return StartingFit(experiment, readings, rows, fit, unidentifiable)


def baseline_of(start: StartingFit) -> Baseline:
    """All causes beside the exact fit, and the noise that it leaves; where that differs by direction beside all
    causes, in one that does."""
    base = _baseline_of(start)
    library = LinearFit.onto(library_basis(base.case), base.case.residuals, base.rows.mask)
    axes = noise_by_axis(base.rows, library)
    if axes is None or axes.p_value >= LEVEL:
        return base
    readings = of_axes(base.rows, axes)
    return replace(_baseline_of(start_of(start.experiment, readings)), axes=axes)


def _baseline_of(start: StartingFit) -> Baseline:
    """All causes beside the exact fit, and the noise that it leaves."""
    experiment, rows, fit = start.experiment, start.rows, start.fit
    causes, untested = find_causes(experiment, fit.names, rows)
    case = make_case(experiment, rows, fit.names, causes, fit.by_name(), fit.residuals, fit.frames).grouped()
    fits = fits_beside(rows, rows.padded_noise.colour(fit.basis()))
    base = Baseline(
        experiment=experiment,
        readings=start.readings,
        rows=rows,
        fit=fit,
        case=case,
        fits=fits,
        nu=fits.freedom(0),
        good=np.arange(len(rows.keep)),
        untested=untested,
        unidentifiable=start.unidentifiable,
        given=rows,
        whole=case,
    )
    return in_noise_beside(base, fits, fit)


def fits_beside(rows: ReadingRows, columns: Array) -> Reml:
    """Fits of columns (3 R, f) m to rows, in every noise that may be."""
    return reml(visit_noise(rows), orthonormal(columns), len(rows.at), repeats(rows))


def in_noise_beside(base: Baseline, fits: Reml, beside: SettledFit) -> Baseline:
    """The baseline in the noise that an exact fit to its rows leaves, winsorised about that fit."""
    start, noise = base.start, fits.noise
    k, white, drawn_in = _winsorised(fits, beside.residuals.ravel())
    k, white, drawn_in = _winsorised(fits, beside.residuals.ravel(), noise.noises[k].colour(drawn_in))
    left = noise.noises[k].colour(drawn_in)
    unit = max(fits.unit(k, left), rounding(start.noise, start.scalars, REACH))
    rows = in_noise(start, unit, float(noise.rhos[k]))
    fit = settle_fit(base.experiment.model(), rows, base.whole.fitted, base.fit.x, frames=base.fit.frames)
    case = base.whole.rewhitened(base.good, rows.padded_noise, fit.residuals)
    grown = unit * float(np.sqrt(1.0 + noise.many * noise.rhos[k] ** 2)) if start.stated else 1.0
    case = replace(case, residuals=case.residuals - (white - drawn_in) / unit, grown=max(grown, 1.0))
    return replace(base, rows=rows, fit=fit, case=case, fits=fits, nu=fits.freedom(k))


def _winsorised(fits: Reml, values: Array, by: Array | None = None) -> tuple[int, Array, Array]:
    """Place of the noise that readings (m,) m show, or others `by` in their place; the readings whitened, and these
    winsorised."""
    k = int(fits.choose((values if by is None else by)[:, None])[0])
    white = fits.noise.noises[k].whiten(values)
    return k, white, winsorised(white, fits.Q[k])


def without_rows(base: Baseline, outliers: Indices) -> Baseline:
    """The baseline without some of its rows, fitted and its noise found again."""
    good = np.delete(base.good, outliers)
    rows = base.given.take(good)
    fit = settle_fit(base.experiment.model(), rows, base.whole.fitted, base.fit.x, frames=base.fit.frames)
    fits = fits_beside(rows, rows.padded_noise.colour(fit.basis()))
    return in_noise_beside(replace(base, good=good, fit=fit), fits, fit)


def audit_of(base: Baseline, fit: SettledFit) -> NoiseAudit:
    """What the rows say of their noise beside an exact fit, against what is stated."""
    rows, given = base.rows, base.start
    sigma = np.sqrt(np.mean(given.sigma**2, axis=1))
    ratio = np.sqrt(np.mean(rows.sigma**2, axis=1)) / sigma
    columns = orthonormal(rows.padded_noise.colour(fit.basis()) / np.repeat(sigma, 3)[:, None])
    return audit_noise(
        fit.residuals / sigma[:, None],
        columns.reshape(len(rows.keep), 3, -1),
        sigma,
        given.stated,
        rows.plus,
        replicates(rows.readings, rows),
        mask=None if rows.mask.all() else rows.mask,
        unit=float(ratio.mean()),
        shared=rows.shared,
        outliers=np.setdiff1d(np.arange(len(base.given.keep)), base.good),
        axes=base.axes,
    )
