"""The result of a diagnosis: named causes with their evidence, their rivals and what they gain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from qsframework.plugin import Array, Indices

if TYPE_CHECKING:
    from qsframework.diagnose.case import Case
    from qsframework.diagnose.conventions import Convention
    from qsframework.diagnose.fitted import Settled
    from qsframework.diagnose.lack_of_fit import LackOfFit
    from qsframework.diagnose.noise_audit import NoiseAudit
    from qsframework.elastostatics import Model
    from qsframework.experiment import Experiment, Readings

NAMED = "named"
TIED = "cannot be separated"
EXCLUDED = "excluded above"
INVISIBLE = "invisible here"
UNTESTED = "not tested"
VERDICTS = ("none", "explained", "partly_explained", "unexplained")


@dataclass(frozen=True)
class Value:
    """An estimated parameter of a cause, SI: its change from `initial` is what the cause adds."""

    name: str
    unit: str
    value: float
    sd: float
    initial: float


@dataclass(frozen=True)
class Rival:
    """A cause that these readings cannot tell from the named one; angle (rad) between what the two can do."""

    name: str
    angle: float


@dataclass(frozen=True)
class Finding:
    """A named cause with its evidence.

    s: visible size in units of noise; p_value: family-wise; ebic_gain: by how much the extended BIC falls with it;
    heldout_gain: 1 - held-out RMS with all named causes / with all but this one, NaN for a convention; hangs_on: poses
    without any one or two of which the name changes; check: what to look at on the real robot
    """

    name: str
    values: tuple[Value, ...]
    s: float
    p_value: float
    ebic_gain: float
    rivals: tuple[Rival, ...]
    hangs_on: tuple[tuple[str, ...], ...]
    physics: str
    check: str
    heldout_gain: float = float("nan")


@dataclass(frozen=True)
class Line:
    """One row of the table of all causes.

    s: what the baseline's residuals show of it; bound: text of the size above which it is excluded (95 %), or what
    it would need to be seen; nearest and angle (rad): the cause hardest to tell from it
    """

    name: str
    status: str
    s: float
    p_value: float
    values: tuple[Value, ...]
    bound: str
    nearest: str
    angle: float


@dataclass(frozen=True)
class Leftover:
    """What no named cause explains: an extra motion at a place that depends on a variable."""

    place: str
    variable: str
    p_value: float

    def words(self) -> str:
        return f"an extra motion at {self.place} that depends on {self.variable} (p = {self.p_value:.2g})"


@dataclass(frozen=True)
class Errors:
    """RMS per axis, m: of the nominal, the identified and the extended model, on the readings and held out; `noise` is
    what the noise alone leaves."""

    nominal: float
    identified: float
    extended: float
    heldout_identified: float
    heldout_extended: float
    noise: float

    @property
    def heldout_gain(self) -> float:
        return 1.0 - self.heldout_extended / self.heldout_identified


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What the model gets wrong.

    verdict: one of VERDICTS; statements: what it rests on; baseline and extended: the exact fits without and with
    the named causes, over the rows `kept` of `readings`; outliers: rows that the audit took out; case: linearised at
    the baseline; before, after: their lack of fit
    """

    experiment: Experiment
    readings: Readings
    verdict: str
    statements: tuple[str, ...]
    findings: tuple[Finding, ...]
    table: tuple[Line, ...]
    conventions: tuple[Convention, ...]
    audit: NoiseAudit
    leftovers: tuple[Leftover, ...]
    before: LackOfFit
    after: LackOfFit
    rms: Errors
    kept: Indices
    outliers: Indices
    baseline: Settled
    extended: Settled
    case: Case
    notes: tuple[str, ...]
    level: float
    seed: int

    @property
    def words(self) -> str:
        """The statements as one paragraph."""
        return " ".join(self.statements)

    @property
    def extended_model(self) -> Model:
        return self.extended.model

    def values(self) -> Mapping[str, float]:
        """All parameters of the extended model by name, SI."""
        return dict(zip(self.extended.model.names, (float(v) for v in self.extended.x), strict=True))

    def residuals(self) -> tuple[Array, Array]:
        """Of the kept rows (R, 3) m, before and after the extension."""
        return self.baseline.residuals, self.extended.residuals

    def as_json(self) -> dict[str, Any]:
        """What `qsf diagnose --json` holds (SI units, RMS in mm)."""
        from qsframework.diagnose.budget import error_budget

        return {
            "verdict": self.verdict,
            "words": self.words,
            "causes": [_cause(f) for f in self.findings],
            "conventions": [c.name for c in self.conventions if c.compelling],
            "data_problems": self._problems(),
            "leftovers": [{"place": x.place, "variable": x.variable, "p_value": x.p_value} for x in self.leftovers],
            "rms_mm": {
                name: _number(1e3 * getattr(self.rms, name))
                for name in ("nominal", "identified", "extended", "heldout_identified", "heldout_extended", "noise")
            },
            "budget": [
                {"label": x.label, "readings_mm": 1e3 * x.readings, "heldout_mm": 1e3 * x.heldout}
                for x in error_budget(self)
            ],
            "lack_of_fit": {"before": _misfit(self.before), "after": _misfit(self.after)},
            "table": [
                {"id": x.name, "status": x.status, "s": _number(x.s), "p_value": _number(x.p_value), "bound": x.bound,
                 "nearest": x.nearest, "angle_deg": _number(float(np.rad2deg(x.angle)))}
                for x in self.table
            ],
            "notes": list(self.notes),
            "level": self.level,
            "seed": self.seed,
        }  # fmt: skip

    def _problems(self) -> list[dict[str, Any]]:
        out: list[dict[str, Any]] = []
        if len(self.outliers):
            out.append({"id": "outliers", "rows": [int(r) for r in self.readings.rows[self.outliers]]})
        if self.audit.unit_source != "stated":
            out.append({"id": "noise_level", "rows": [], "unit": self.audit.unit, "source": self.audit.unit_source,
                        "p_value": _number(self.audit.p_unit), "shared_mm": 1e3 * self.audit.shared})  # fmt: skip
        elif self.audit.shared > 0.0:
            out.append({"id": "noise_level", "rows": [], "unit": 1.0, "source": "shared pose error",
                        "p_value": _number(self.audit.p_shared), "shared_mm": 1e3 * self.audit.shared})  # fmt: skip
        return out


def _cause(f: Finding) -> dict[str, Any]:
    return {
        "id": f.name,
        "rivals": [r.name for r in f.rivals],
        "p_value": f.p_value,
        "s": f.s,
        "delta_ebic": f.ebic_gain,
        "parameters": {v.name: {"value": v.value, "unit": v.unit, "sd": v.sd, "initial": v.initial} for v in f.values},
        "heldout_gain": _number(f.heldout_gain),
        "hangs_on": [list(h) for h in f.hangs_on],
    }


def _misfit(fit: LackOfFit) -> dict[str, Any]:
    return {
        "chi2": fit.square,
        "dof": fit.dof,
        "p_chi2": _number(fit.p_chi2),
        "p_replicates": _number(fit.p_replicates),
        "dof_replicates": fit.free_replicates,
        "trends": [{"variable": t.variable, "p_value": t.p_value, "share": t.share} for t in fit.trends],
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
