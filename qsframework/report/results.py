"""The report of a result in one call, from Python."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from qsframework.arguments import checked
from qsframework.errors import InputError, Problem
from qsframework.experiment import Experiment, Plan, Readings
from qsframework.fits import Fit, FitRecord
from qsframework.fits.validate import Validation
from qsframework.report.blocks import Section, Verdict
from qsframework.report.page import write_report
from qsframework.report.provenance import AFTER, EQUILIBRIUM, INFORMATION, LEAST_SQUARES, LINEAR, computed

if TYPE_CHECKING:
    from qsframework.diagnoses import Diagnosis
    from qsframework.diagnoses.second_day import FollowUp

T = TypeVar("T")
_KINDS = (".html", ".pdf")
_EXPERIMENT = "the experiment"


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
    if isinstance(result, Fit):
        made = _fit(result, _given(experiment, _EXPERIMENT), _given(readings, "the readings"), files, before)
    elif isinstance(result, Plan):
        made = _plan(result, _given(experiment, _EXPERIMENT), files)
    elif isinstance(result, Validation):
        made = _validation(result, _given(experiment, _EXPERIMENT), files)
    else:
        made = _diagnosis(result, files, day)
    return write_report(path, *made)


Made = tuple[str, Sequence[Section], Verdict]
"""Title, sections and verdict of a report. Each kind imports what it shows: the other kinds need none of it."""


def _fit(fit: Fit, experiment: Experiment, readings: Readings, files: Sequence[Path], before: FitRecord | None) -> Made:
    from qsframework.report.fit_section import fit_sections
    from qsframework.report.words.fit import fit_verdict

    laws = (LINEAR if fit.linear else EQUILIBRIUM, LEAST_SQUARES)
    sections = (*fit_sections(fit, experiment, readings, before), computed(experiment, files, None, laws))
    return f"Identification: {experiment.robot.title}", sections, fit_verdict(fit, readings.poses)


def _plan(plan: Plan, experiment: Experiment, files: Sequence[Path]) -> Made:
    from qsframework.information import predicted_sd
    from qsframework.report.plan_section import plan_sections, sd_table
    from qsframework.report.words.plan import plan_verdict

    sds = predicted_sd(experiment, plan)
    table = sd_table(experiment.fit_parameters(), {"this plan": sds})
    own = computed(experiment, files, None, (EQUILIBRIUM, INFORMATION, AFTER))
    sections = (*plan_sections(experiment, plan, table), own)
    return f"Measurement plan: {experiment.robot.title}", sections, plan_verdict(experiment, plan, sds)


def _validation(validation: Validation, experiment: Experiment, files: Sequence[Path]) -> Made:
    from qsframework.report.validation_section import validation_section
    from qsframework.report.words.validation import validation_verdict

    sections = (validation_section(validation), computed(experiment, files, None, (EQUILIBRIUM,)))
    return f"Validation: {experiment.robot.title}", sections, validation_verdict(validation)


def _diagnosis(diagnosis: Diagnosis, files: Sequence[Path], day: FollowUp | None) -> Made:
    from qsframework.report.diagnosis_section import diagnosis_sections
    from qsframework.report.words.headline import diagnosis_verdict

    sections = diagnosis_sections(diagnosis, list(files), day)
    return f"Diagnosis: {diagnosis.experiment.robot.title}", sections, diagnosis_verdict(diagnosis)


def _given(value: T | None, what: str) -> T:
    if value is None:
        raise InputError(Problem(f"this report needs {what}"))
    return value
