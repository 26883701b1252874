"""`qsf diagnose`: what it calls, prints and writes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from qsframework.cli.commands import distinct_outputs, readings_files, write_json
from qsframework.cli.printing import print_folded, print_line, print_table
from qsframework.cli.progress import Tell, progress
from qsframework.diagnose import LEVEL, STEPS, Diagnosis, diagnose
from qsframework.diagnose.extend import check_folder
from qsframework.discriminate import Discrimination, FollowUp
from qsframework.discriminate.mounts import mounts_of
from qsframework.discriminate.separations import separations
from qsframework.errors import InputError
from qsframework.experiment import load_experiment, read_readings
from qsframework.experiment.account import added_effects
from qsframework.work import HERE, Work


@dataclass(frozen=True, kw_only=True)
class DiagnoseFiles:
    """What the command reads, and what it writes where it is asked to.

    extend: a folder, doubtful: with the doubtful names too; plan: one to judge before measuring; output: the
    plan of --follow-up or --separate
    """

    experiment: Path
    data: tuple[Path, ...] = ()
    json: Path | None = None
    report: Path | None = None
    extend: Path | None = None
    doubtful: bool = False
    plan: Path | None = None
    output: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Asked:
    """How to diagnose; follow_up: visits of a second day, 0: none, without: links that take no reflector; separate:
    two causes that `count` poses are to tell apart, instead of a diagnosis; verbose: list all causes, also those that
    are excluded or invisible."""

    level: float = LEVEL
    seed: int = 0
    follow_up: int = 0
    without: tuple[str, ...] = ()
    count: int = 12
    separate: tuple[str, str] | None = None
    verbose: bool = False


def run_diagnose(files: DiagnoseFiles, asked: Asked, work: Work = HERE) -> None:
    """Diagnose readings, or judge a plan, or design poses that separate two causes."""
    from qsframework.cli.diagnose_plan import run_follow_up, run_foresight, run_separate
    from qsframework.report.words.discrimination import discrimination_words, not_separated_words

    if files.plan is not None:
        _alone(files, asked, "a plan")
        run_foresight(files.experiment, files.plan, files.json, files.report, asked.seed, work)
        return
    if work != HERE:
        raise InputError("--jobs and --dask go with a plan: the diagnosis of readings takes seconds")
    experiment = load_experiment(files.experiment)
    sources = readings_files(experiment, files.data, f"them: qsf diagnose {files.experiment} readings.csv")
    if asked.separate is not None:
        _alone(files, asked, "--separate")
        output = files.output or Path("separate.csv")
        run_separate(files.experiment, list(sources), asked.separate, asked.count, output, files.json, asked.seed)
        return
    plan = (files.output or Path("follow-up.csv")) if asked.follow_up else None
    mounts_of(experiment, asked.without)
    outputs = (files.json, files.report, plan)
    distinct_outputs(outputs, [files.experiment, *sources], folder=files.extend)
    if files.extend is not None:
        check_folder(experiment, files.extend)
    readings = read_readings(sources, experiment)
    with progress() as tell:
        found = diagnose(experiment, readings, level=asked.level, seed=asked.seed, progress=_steps(tell))
        tell("diagnosis", len(STEPS), len(STEPS))
        pairs, missing = separations(found, asked.count, progress=tell)
    print_diagnosis(found, pairs, asked.verbose)
    for said in (*(line for pair in pairs for line in discrimination_words(pair)), *not_separated_words(missing)):
        print_folded(said)
    day, lost = None, None
    if plan is not None:
        try:
            day = run_follow_up(found, asked.follow_up, plan, asked.without, asked.seed)
        except InputError as error:  # nothing is open: the other files are written all the same
            lost = InputError(f"--follow-up: {error}")
    _write(found, pairs, day, files, [files.experiment, *sources])
    if lost is not None:
        raise lost


def _alone(files: DiagnoseFiles, asked: Asked, option: str) -> None:
    """InputError where options stand together that do not: a plan is judged before there are readings."""
    others = {
        "--extend": files.extend,
        "--follow-up": asked.follow_up or None,
        "--separate": asked.separate if option == "a plan" else None,
        "the readings": files.data or None if option == "a plan" else None,
        "--report": files.report if option == "--separate" else None,
    }
    wrong = [name for name, value in others.items() if value is not None]
    if wrong:
        raise InputError(f"{option} goes without {', '.join(wrong)}: run them one after the other")


def _write(
    found: Diagnosis, pairs: Sequence[Discrimination], day: FollowUp | None, files: DiagnoseFiles, inputs: list[Path]
) -> None:
    """The files to write; pairs: what would separate alternatives; day: the visits that settle what is open."""
    if files.json is not None:
        from qsframework.report.result_json import diagnosis_json, discrimination_json, follow_up_json

        more = {
            "separations": [discrimination_json(pair) for pair in pairs],
            "follow_up": None if day is None else follow_up_json(day),
        }
        write_json(files.json, diagnosis_json(found, pairs) | more)
        print(f"diagnosis: {files.json}")
    if files.report is not None:
        from qsframework.report.diagnosis_section import diagnosis_sections
        from qsframework.report.page import write_report
        from qsframework.report.words.headline import diagnosis_verdict

        sections = diagnosis_sections(found, inputs, pairs, day)
        title, verdict = f"Diagnosis: {found.experiment.robot.title}", diagnosis_verdict(found)
        print(f"report: {write_report(files.report, title, sections, verdict)}")
    if files.extend is not None:
        from qsframework.report.extended import extended_words, write_extended

        write_extended(found, files.extend, pairs, doubtful=files.doubtful)
        extended = files.extend / "experiment.yaml"
        print(f"extended robot: {files.extend / 'robot'}")
        written = load_experiment(extended)
        print_folded(extended_words(found, added_effects(written.model()), doubtful=files.doubtful))
        told = bool(written.data)
        print(
            f"next: {'' if told else 'correct the readings, then '}qsf identify {extended}{'' if told else ' READINGS'}"
        )
    else:
        again = " ".join(["qsf diagnose", *map(str, (files.experiment, *files.data)), "--extend extended"])
        corrected = f"qsf compensate {files.experiment} fit.json targets.csv, with the fit that identify --json wrote"
        print(f"next: {again if found.sure else corrected}")


def _steps(tell: Tell) -> Tell:
    """All steps on one bar."""
    return lambda _, done, total: tell("diagnosis", done, total)


def _print_rest(found: Diagnosis, verbose: bool) -> None:
    """What is explained by the named causes, excluded or unseen: as tables where few or asked for, else counted."""
    from qsframework.report import diagnosis_tables as tables

    rest = (
        ("Explained by the named causes", tables.alone_table(found)),
        ("Excluded", tables.excluded_table(found, short=True)),
        ("Nothing is said about", tables.unseen_table(found)),
    )
    for title, table in rest:
        if table.rows and (verbose or not table.folded):
            print_table(table.header, table.rows, title)
        elif table.rows:
            print_folded(f"{table.folded}.")
    if not verbose and any(table.folded for _, table in rest):
        print("`--verbose` lists them all.")


def print_diagnosis(found: Diagnosis, pairs: Sequence[Discrimination], verbose: bool = False) -> None:
    """The verdict in a sentence, what is certain, doubtful and open, what to measure next, and the evidence."""
    from qsframework.report import diagnosis_tables as tables
    from qsframework.report.words.diagnosis import method_words
    from qsframework.report.words.headline import headline

    print_folded(headline(found))
    for title, lines in tables.verdict_groups(found, pairs):
        print(f"{title}:")
        for lead, said in lines.rows:
            print_line(lead, said)
    judged = {pair.first for pair in pairs}
    for f in (f for f in found.findings if f.alternatives and f.name not in judged):
        nearest = min(f.alternatives, key=lambda r: r.angle).name
        print_line("", f"`--separate {f.name} {nearest}` designs poses that separate them, or says what would")
    for title, table in (("Named", tables.cause_table(found)), ("Doubtful", tables.doubtful_table(found))):
        if table.rows:
            print_table(table.header, table.rows, title if found.findings else "")
    errors = tables.error_rows(found)
    print_table(errors.header, errors.rows)
    _print_rest(found, verbose)
    for said in method_words(found):
        print_folded(said)
    if len(found.outliers):
        problems = tables.outlier_table(found)
        print_table(problems.header, problems.rows, "Rows not used")
