"""`qsf diagnose`: what it calls, prints and writes."""

from __future__ import annotations

from pathlib import Path

from qsframework.cli.commands import distinct_outputs, load_campaign, readings_files, write_json
from qsframework.cli.files import DiagnoseFiles
from qsframework.cli.printing import print_folded, print_line, print_table
from qsframework.cli.progress import Tell, progress
from qsframework.diagnoses import STEPS, DiagnoseOptions, Diagnosis, FollowUp, diagnose, follow_up
from qsframework.diagnoses.extend import check_folder
from qsframework.diagnoses.mounts import mounts_of
from qsframework.errors import InputError
from qsframework.experiment import load_experiment, read_readings
from qsframework.experiment.account import added_effects
from qsframework.work import HERE, Work


def run_diagnose(files: DiagnoseFiles, options: DiagnoseOptions, work: Work = HERE) -> None:
    """Diagnose readings, or judge a plan."""
    from qsframework.cli.diagnose_plan import run_foresight

    if files.plan is not None:
        _alone(files, options)
        outputs = (files.json, files.report)
        run_foresight(files.experiment, files.plan, *outputs, options.seed, work, verbose=files.verbose)
        return
    if work != HERE:
        raise InputError("--jobs and --dask go with a plan: the diagnosis of readings takes seconds")
    experiment = load_campaign(files.experiment)
    sources = readings_files(experiment, files.data, f"them: qsf diagnose {files.experiment} readings.csv")
    plan = (files.output or Path("follow-up.csv")) if options.follow_up else None
    mounts_of(experiment, options.without)
    outputs = (files.json, files.report, plan)
    distinct_outputs(outputs, [files.experiment, *sources], folder=files.extend)
    if files.extend is not None:
        check_folder(experiment, files.extend)
    readings = read_readings(sources, experiment)
    with progress() as tell:
        found = diagnose(experiment, readings, level=options.level, seed=options.seed, progress=_steps(tell))
        tell("diagnosis", len(STEPS), len(STEPS))
        day, lost = _second_day(found, options, tell)
    print_diagnosis(found, day, files.verbose)
    if plan is not None and day is not None:
        _write_day(found, day, plan)
    _write(found, day, files, [files.experiment, *sources])
    if plan is not None and lost is not None:  # the other files are written all the same
        raise InputError(f"--follow-up: {lost}")


def _second_day(found: Diagnosis, options: DiagnoseOptions, tell: Tell) -> tuple[FollowUp | None, InputError | None]:
    """The visits that settle what is open, or why there are none; none where nobody asks and nothing is open."""
    if not options.follow_up and not found.open:
        return None, None
    try:
        count = options.follow_up or options.count
        return follow_up(found, count, without=options.without, seed=options.seed, progress=tell), None
    except InputError as error:
        return None, error


def _write_day(found: Diagnosis, day: FollowUp, plan: Path) -> None:
    """Write the visits as a plan and say what they would tell."""
    from qsframework.experiment import write_plan
    from qsframework.report.words.follow_up import follow_up_words

    write_plan(plan, day.plan, found.experiment)
    print_folded(*follow_up_words(day))
    print(f"plan: {plan}")
    print(f"next: qsf protocol {found.experiment.path} {plan} -o sheet.html")


def _alone(files: DiagnoseFiles, options: DiagnoseOptions) -> None:
    """InputError where options stand beside a plan that do not: it is judged before there are readings."""
    others = {
        "--extend": files.extend,
        "--follow-up": options.follow_up or None,
        "the readings": files.data or None,
    }
    wrong = [name for name, value in others.items() if value is not None]
    if wrong:
        raise InputError(f"a plan goes without {', '.join(wrong)}: run them one after the other")


def _write(found: Diagnosis, day: FollowUp | None, files: DiagnoseFiles, inputs: list[Path]) -> None:
    """The files to write; day: the visits that settle what is open."""
    if files.json is not None:
        from qsframework.report.result_json import diagnosis_json

        write_json(files.json, diagnosis_json(found, day))
        print(f"diagnosis: {files.json}")
    if files.report is not None:
        from qsframework.report.results import report

        print(f"report: {report(found, files.report, files=inputs, day=day)}")
    if files.extend is not None:
        from qsframework.report.extended import extended_words, write_extended

        write_extended(found, files.extend, day, doubtful=files.doubtful)
        extended = files.extend / "experiment.yaml"
        print(f"extended robot: {files.extend / 'robot'}")
        written = load_experiment(extended)
        print_folded(extended_words(found, added_effects(written.model()), doubtful=files.doubtful))
        first, more = ("", "") if written.data else ("correct the readings, then ", " READINGS")
        print(f"next: {first}qsf identify {extended}{more}")
    else:
        again = " ".join(["qsf diagnose", *map(str, (files.experiment, *files.data))])
        corrected = f"qsf compensate {files.experiment} fit.json targets.csv, with the fit that identify --json wrote"
        hinted = f"{again} --follow-up 8" if found.hinted and day is None else corrected
        print(f"next: {again} --extend extended" if found.sure else f"next: {hinted}")


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


def print_diagnosis(found: Diagnosis, day: FollowUp | None, verbose: bool = False) -> None:
    """The verdict in a sentence, what is certain, doubtful and open, what to measure next, and the evidence."""
    from qsframework.report import diagnosis_tables as tables
    from qsframework.report.words.diagnosis import method_words
    from qsframework.report.words.headline import headline

    print_folded(headline(found))
    for title, lines in tables.verdict_groups(found, day):
        print(f"{title}:")
        for lead, text in lines.rows:
            print_line(lead, text)
    for title, table in (("Named", tables.cause_table(found)), ("Doubtful", tables.doubtful_table(found))):
        if table.rows:
            print_table(table.header, table.rows, title if found.findings else "")
    errors = tables.error_rows(found)
    print_table(errors.header, errors.rows)
    _print_rest(found, verbose)
    print_folded(*method_words(found))
    if len(found.outliers):
        problems = tables.outlier_table(found)
        print_table(problems.header, problems.rows, "Rows not used")
