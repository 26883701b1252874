"""`qsf diagnose`: what it calls, prints and writes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from qsframework.cli.commands import distinct_outputs, readings_file, write_json
from qsframework.cli.displacements import read_displacements
from qsframework.cli.progress import Tell, print_line, print_table, progress
from qsframework.cli.where import ALONE, Where
from qsframework.diagnose import LEVEL, STEPS, Diagnosis, SecondDay, diagnose
from qsframework.diagnose.discriminate import Discrimination
from qsframework.diagnose.extend import check_folder, write_extended
from qsframework.diagnose.separations import separations, with_outlooks
from qsframework.errors import InputError
from qsframework.experiment import load_experiment


@dataclass(frozen=True)
class DiagnoseFiles:
    """What the command reads, and what it writes where it is asked to.

    extend: a folder; second_day: a plan to write; plan: one to judge before measuring; output: of --separate
    """

    experiment: Path
    data: Path | None = None
    json: Path | None = None
    report: Path | None = None
    extend: Path | None = None
    second_day: Path | None = None
    plan: Path | None = None
    output: Path = Path("separate.csv")


@dataclass(frozen=True)
class Asked:
    """How to diagnose; separate: two causes that poses are to tell apart, instead of a diagnosis."""

    level: float = LEVEL
    seed: int = 0
    count: int = 12
    separate: tuple[str, str] | None = None


def run_diagnose(files: DiagnoseFiles, asked: Asked, where: Where = ALONE) -> None:
    """Diagnose readings, or judge a plan, or design poses that separate two causes."""
    from qsframework.cli.diagnose_plan import run_foresight, run_second_day, run_separate

    if files.plan is not None:
        _alone(files, asked, "--plan")
        run_foresight(files.experiment, files.plan, files.json, files.report, asked.seed, where)
        return
    if where != ALONE:
        raise InputError("--jobs, --dask and --checkpoint go with --plan: the diagnosis of readings takes seconds")
    experiment = load_experiment(files.experiment)
    source = readings_file(experiment, files.data, f"them: qsf diagnose {files.experiment} readings.csv")
    if asked.separate is not None:
        _alone(files, asked, "--separate")
        run_separate(files.experiment, [source], asked.separate, asked.count, files.output, files.json, asked.seed)
        return
    outputs = (files.json, files.report, files.second_day)
    distinct_outputs(outputs, [files.experiment, source], folder=files.extend)
    if files.extend is not None:
        check_folder(experiment, files.extend)
    readings = read_displacements(experiment, source)
    with progress() as tell:
        found = diagnose(experiment, readings, level=asked.level, seed=asked.seed, progress=_steps(tell))
        tell("diagnosis", len(STEPS), len(STEPS))
        pairs, notes = separations(found, asked.count, progress=tell)
    found = with_outlooks(found, pairs)
    print_diagnosis(found)
    for said in (*(line for pair in pairs for line in pair.words()), *notes):
        print(said)
    day, lost = None, None
    if files.second_day is not None:
        try:
            day = run_second_day(found, asked.count, files.second_day, asked.seed)
        except InputError as error:  # nothing is left to separate: the other files are written all the same
            lost = error
    _write(found, pairs, day, files, [files.experiment, source])
    if lost is not None:
        raise lost


def _alone(files: DiagnoseFiles, asked: Asked, option: str) -> None:
    """InputError where options stand together that do not: a plan is judged before there are readings."""
    others = {
        "--extend": files.extend, "--second-day": files.second_day,
        "--separate": asked.separate if option == "--plan" else None,
        "the readings": files.data if option == "--plan" else None,
        "--report": files.report if option == "--separate" else None,
    }  # fmt: skip
    wrong = [name for name, value in others.items() if value is not None]
    if wrong:
        raise InputError(f"{option} goes without {', '.join(wrong)}: run them one after the other")


def _write(
    found: Diagnosis, pairs: Sequence[Discrimination], day: SecondDay | None, files: DiagnoseFiles, inputs: list[Path]
) -> None:  # fmt: skip
    """The files that were asked for; pairs: what would separate rivals; day: the poses designed for that."""
    if files.json is not None:
        more = {
            "separations": [pair.as_json() for pair in pairs],
            "second_day": None if day is None else day.as_json(),
        }
        write_json(files.json, found.as_json() | more)
        print(f"diagnosis: {files.json}")
    if files.report is not None:
        from qsframework.report.diagnosis_section import diagnosis_sections
        from qsframework.report.page import write_report

        sections = diagnosis_sections(found, inputs, pairs, day)
        print(f"report: {write_report(files.report, f'Diagnosis: {found.experiment.robot.title}', sections)}")
    if files.extend is not None:
        write_extended(found, files.extend)
        extended = files.extend / "experiment.yaml"
        print(f"extended robot: {files.extend / 'robot'}")
        told = load_experiment(extended).data is not None
        print(f"next: {'' if told else 'correct the readings, then '}qsf identify {extended}"
              f"{'' if told else ' --data FILE'}")  # fmt: skip


def _steps(tell: Tell) -> Tell:
    """All steps on one bar."""
    return lambda _, done, total: tell("diagnosis", done, total)


def print_diagnosis(found: Diagnosis) -> None:
    """The verdict, the causes, what is excluded and what is wrong with the data."""
    from qsframework.report import diagnosis_tables as tables

    print(f"{tables.verdict_words(found)}.")
    for lead, said in tables.verdict_lines(found).rows:
        print_line(lead, said)
    causes = tables.cause_table(found)
    print_table(causes.header, causes.rows)
    errors = tables.error_rows(found)
    print_table(errors.header, errors.rows)
    excluded = tables.excluded_table(found, short=True)
    if excluded.rows:
        print_table(excluded.header, excluded.rows, "Excluded")
    for said in (*tables.unseen_words(found), *found.notes):
        print(said)
    if len(found.outliers):
        problems = tables.outlier_table(found)
        print_table(problems.header, problems.rows, "Rows left out")
