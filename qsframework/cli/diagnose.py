"""`qsf diagnose`: what it calls, prints and writes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from qsframework.cli.commands import distinct_outputs, readings_file, write_json
from qsframework.cli.progress import Tell, print_table, progress
from qsframework.diagnose import STEPS, Diagnosis, diagnose
from qsframework.experiment import Experiment, Readings, is_states, load_experiment, read_readings, read_states


@dataclass(frozen=True)
class DiagnoseFiles:
    """What the command reads, and what it writes where it is asked to; extend: a folder."""

    experiment: Path
    data: Path | None = None
    json: Path | None = None
    report: Path | None = None
    extend: Path | None = None


def run_diagnose(files: DiagnoseFiles, level: float, seed: int) -> None:
    """Diagnose, print the verdict and the causes, write the files and the report."""
    experiment = load_experiment(files.experiment)
    source = readings_file(experiment, files.data)
    distinct_outputs((files.json, files.report, files.extend), [files.experiment, source])
    readings = read_displacements(experiment, source)
    with progress() as tell:
        found = diagnose(experiment, readings, level=level, seed=seed, progress=_steps(tell))
        tell("diagnosis", len(STEPS), len(STEPS))
    print_diagnosis(found)
    if files.json is not None:
        write_json(files.json, found.as_json())
        print(f"diagnosis: {files.json}")
    if files.report is not None:
        from qsframework.report.diagnosis_section import diagnosis_sections
        from qsframework.report.page import write_report

        sections = diagnosis_sections(found, [files.experiment, source])
        print(f"report: {write_report(files.report, f'Diagnosis: {experiment.robot.title}', sections)}")
    if files.extend is not None:
        from qsframework.diagnose.extend import write_extended

        write_extended(found, files.extend)
        print(f"extended robot: {files.extend / 'robot'}, experiment: {files.extend / 'experiment.yaml'}")


def read_displacements(experiment: Experiment, source: Path) -> Readings:
    """Readings of a file of displacements, or loaded minus unloaded positions of a file of states."""
    if is_states(source):
        from qsframework.identify.differences import differences

        return differences(read_states(source, experiment), experiment)[0]
    return read_readings(source, experiment)


def _steps(tell: Tell) -> Tell:
    """All steps on one bar."""
    return lambda _, done, total: tell("diagnosis", done, total)


def print_diagnosis(found: Diagnosis) -> None:
    """The verdict, the causes, what is excluded and what is wrong with the data."""
    from qsframework.report import diagnosis_tables as tables

    print(f"{found.verdict.replace('_', ' ')}: {found.words}")
    causes = tables.cause_table(found)
    print_table(causes.header, causes.rows)
    for f in found.findings:
        print(f"{f.name}: look at: {f.check}")
    errors = tables.error_rows(found)
    print_table(errors.header, errors.rows)
    excluded = tables.excluded_table(found)
    if excluded.rows:
        print_table(excluded.header, excluded.rows, "Excluded")
    for said in (*tables.unseen_words(found), *found.notes):
        print(said)
    if len(found.outliers):
        problems = tables.outlier_table(found)
        print_table(problems.header, problems.rows, "Rows left out")
