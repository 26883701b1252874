"""The report of a result in one call, from Python."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

from qsframework.arguments import checked
from qsframework.diagnoses import Diagnosis
from qsframework.diagnoses.second_day import FollowUp
from qsframework.errors import InputError, Problem
from qsframework.experiment import Experiment, Plan, Readings
from qsframework.fits import Fit, FitRecord
from qsframework.fits.validate import Validation
from qsframework.information import predicted_sd
from qsframework.report.blocks import Section, Verdict
from qsframework.report.diagnosis_section import diagnosis_sections
from qsframework.report.fit_section import fit_sections
from qsframework.report.page import write_report
from qsframework.report.plan_section import plan_sections, sd_table
from qsframework.report.provenance import AFTER, EQUILIBRIUM, INFORMATION, LEAST_SQUARES, LINEAR, computed
from qsframework.report.validation_section import validation_section
from qsframework.report.words.fit import fit_verdict
from qsframework.report.words.headline import diagnosis_verdict
from qsframework.report.words.plan import plan_verdict
from qsframework.report.words.validation import validation_verdict

T = TypeVar("T")
_KINDS = (".html", ".pdf")


@checked
def report(
    result: Fit | Plan | Diagnosis | Validation,
    path: str | Path,
    experiment: Experiment | None = None,
    readings: Readings | None = None,
    *,
    files: Sequence[Path] = (),
    before: FitRecord | None = None,
    day: FollowUp | None = None,
) -> Path:
    """Write the report of a fit, a plan, a diagnosis or a validation, all or nothing.

    Args:
        result: what is reported.
        path: .html, or .pdf (needs Chromium).
        experiment: of all but a diagnosis, which holds its own.
        readings: of a fit.
        files: what it was made of, for their hashes.
        before: a fit of another campaign of this arm.
        day: of a diagnosis: the visits that decide what is open.

    Returns:
        The path.

    Raises:
        InputError: where one of them is missing.
    """
    if Path(path).suffix.lower() not in _KINDS:
        raise InputError(Problem(f"path: found {str(path)!r}", allowed=f"a file that ends in {' or '.join(_KINDS)}"))
    if isinstance(result, Diagnosis):
        title, verdict = f"Diagnosis: {result.experiment.robot.title}", diagnosis_verdict(result)
        return write_report(path, title, diagnosis_sections(result, list(files), day), verdict)
    given = _given(experiment, "the experiment")
    if isinstance(result, Plan):
        title = "Measurement plan"
        sections, verdict = _plan(result, given, files)
    elif isinstance(result, Fit):
        rows = _given(readings, "the readings")
        title, verdict = "Identification", fit_verdict(result, rows.poses)
        laws = (LINEAR if result.linear else EQUILIBRIUM, LEAST_SQUARES)
        sections = (*fit_sections(result, given, rows, before), computed(given, files, None, laws))
    else:
        title, verdict = "Validation", validation_verdict(result)
        sections = (validation_section(result), computed(given, files, None, (EQUILIBRIUM,)))
    return write_report(path, f"{title}: {given.robot.title}", sections, verdict)


def _plan(plan: Plan, experiment: Experiment, files: Sequence[Path]) -> tuple[tuple[Section, ...], Verdict]:
    sds = predicted_sd(experiment, plan)
    table = sd_table(experiment.fit_parameters(), {"this plan": sds})
    own = computed(experiment, files, None, (EQUILIBRIUM, INFORMATION, AFTER))
    return (*plan_sections(experiment, plan, table), own), plan_verdict(experiment, plan, sds)


def _given(value: T | None, what: str) -> T:
    if value is None:
        raise InputError(Problem(f"this report needs {what}"))
    return value
