"""`qsf identify` and `qsf validate`: what they call and print."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from qsframework.cli.commands import distinct_outputs, load_campaign, readings_files, write_json
from qsframework.cli.files import FitFiles
from qsframework.cli.printing import print_folded, print_notes, print_table, print_verdict
from qsframework.cli.progress import steps
from qsframework.experiment import Experiment, Readings, read_readings

if TYPE_CHECKING:
    from qsframework.estimation import FitOptions
    from qsframework.fits import Fit, FitRecord, Masked
    from qsframework.report.blocks import Verdict


_MASKED = {"gross": "masked by the fit, outlier", "doubled_rows": "masked by the fit"}
ROWS, _NOT_ESTIMATED = 11, 4
"""Rows of the parameters and of those that were not estimated, unless all are wanted."""


def cleaned(experiment: Experiment, readings: Readings, fit: list[str] | None) -> tuple[Readings, tuple[Masked, ...]]:
    """The readings without the rows that should not be used as they stand; what is wrong is printed, a line each."""
    from qsframework.fits import masked_words
    from qsframework.screening import find_mistakes, masked

    found = [c for c in find_mistakes(_asked(experiment, fit), readings) if c.compelling or c.mask is not None]
    wrong = [c for c in found if c.mask is not None and c.mask.any()]
    if not wrong:
        print("the readings were looked through: no row is masked")
    for one in found:
        how = "masked, " if one in wrong else "look at, " if one.mask is None else ""
        print_folded(f"{how}{one.title}: {one.words}")
    return masked(readings, [c.mask for c in wrong]), masked_words(readings, wrong)


def run_identify(files: FitFiles, fit: list[str] | None, options: FitOptions, clean: bool) -> None:
    """Identify, print the fit, write the files and the report."""
    from qsframework.fits import identify
    from qsframework.fits.io import result_files
    from qsframework.report.words.fit import fit_verdict

    experiment = load_campaign(files.experiment)
    sources = readings_files(experiment, files.data)
    other = _other(files.compare, experiment)
    inputs = [files.experiment, *sources, *([files.compare] if files.compare else [])]
    distinct_outputs(files.outputs, inputs)
    masks = None
    with steps("identify", "readings", "fit", "verdict") as begins:
        begins("readings")
        readings = read_readings(sources, _asked(experiment, fit), files.states)
        if clean:
            readings, masks = cleaned(experiment, readings, fit)
        begins("fit")
        result = replace(identify(experiment, readings, fit, options), cleaned=masks)
        begins("verdict")
        verdict = fit_verdict(result)
    if files.json is not None:
        write_json(files.json, result.as_json())
    _tell(result, verdict, other, files.verbose)
    print_folded(*result_files(result, experiment.robot, files.nominal, files.anyway))
    if files.json is not None:
        print(f"fit: {files.json}")
    if files.report is not None:
        from qsframework.report.results import report

        print(f"report: {report(result, files.report, experiment, readings, files=inputs, before=other)}")
    if files.json is None:
        print_folded("The fit is not kept: --json fit.json writes it.")
    print(f"next: {' '.join(['qsf diagnose', *map(str, (files.experiment, *files.data))])}")


def _asked(experiment: Experiment, fit: list[str] | None) -> Experiment:
    """The experiment with the parameters that are asked for, which say how states are read."""
    return experiment if fit is None else experiment.with_(fit=tuple(fit))


def _other(path: Path | None, experiment: Experiment) -> FitRecord | None:
    """The fit of another campaign of the same robot."""
    if path is None:
        return None
    from qsframework.fits import read_fit
    from qsframework.fits.soundness import check_robot

    other = read_fit(path)
    check_robot(other, experiment.robot)
    return other


def _tell(result: Fit, verdict: Verdict, other: FitRecord | None, verbose: bool) -> None:
    """The verdict, what was found of the rows and what to do; then the tables, what was not estimated last."""
    from qsframework.report.fit_section import error_tables, fit_table, interval_tables, not_estimated_table
    from qsframework.report.moved_section import moved_table, moved_words
    from qsframework.report.words.fit import alignment_words, first_words, verdict_words

    print_verdict(verdict)
    pair = () if other is None else (moved_words(result, other),)
    sentences = (*first_words(result), *pair, verdict_words(result), *result.account.extension)
    print_folded(*sentences, *alignment_words(result.alignments), *result.notes)
    for one in result.gross:
        print_folded(f"{_MASKED.get(one.kind, one.kind)}: {one.words}")
    if any(one.kind == "block" for one in result.gross):
        print("nothing was masked; --clean masks them, --keep-all says that they are right")
    print()
    moved = () if other is None else (moved_table(result, other),)
    unestimated = (not_estimated_table(result),) if result.not_estimated else ()
    whole = (*moved, *interval_tables(result), *error_tables(result))
    for table in (fit_table(result, brief=not verbose), *whole, *unestimated):
        most = None if verbose or table in whole else _NOT_ESTIMATED if table in unestimated else ROWS
        print_table(table.header, table.rows, caption=table.caption, most=most)


def run_validate(files: FitFiles, fit: Path, halves: int, seed: int) -> None:
    """Tell how far readings that a fit has not seen are from it, or random halves of its own."""
    from qsframework.fits import read_fit, validate, validate_halves
    from qsframework.report.validation_section import validation_section, validation_tables
    from qsframework.report.words.validation import validation_verdict

    experiment = load_campaign(files.experiment)
    stored = read_fit(fit)
    sources = readings_files(experiment, files.data)
    distinct_outputs([files.json, files.report], [files.experiment, fit, *sources])
    readings = read_readings(sources, _asked(experiment, list(stored.model_names(experiment))), files.states)
    with steps("validate", "fits" if halves else "errors") as begins:
        begins("fits" if halves else "errors")
        if halves:
            found = validate_halves(experiment, readings, stored, halves, seed, anyway=files.anyway)
        else:
            found = validate(experiment, readings, stored, anyway=files.anyway)
    verdict = validation_verdict(found)
    print_verdict(verdict)
    print_folded(*found.account.extension)
    print_notes(found.notes)
    for table in validation_tables(found):
        print_table(table.header, table.rows, caption=table.caption)
    if files.json is not None:
        write_json(files.json, found.as_json())
        print(f"validation: {files.json}")
    if files.report is not None:
        from qsframework.report import write_report
        from qsframework.report.provenance import EQUILIBRIUM, LINEAR, computed

        own = computed(experiment, [files.experiment, fit, *sources], seed, (LINEAR if stored.linear else EQUILIBRIUM,))
        sections = (validation_section(found), own)
        print(f"report: {write_report(files.report, f'Validation: {experiment.robot.title}', sections, verdict)}")
