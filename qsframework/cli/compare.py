"""`qsf compare`: what it calls and prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from qsframework.cli.commands import distinct_outputs, note_folders, write_json
from qsframework.cli.pairs import pairs
from qsframework.cli.printing import print_folded, print_table, print_verdict
from qsframework.cli.progress import progress
from qsframework.errors import InputError, Problem
from qsframework.robot import Robot, as_robot
from qsframework.uses.compare import compare
from qsframework.uses.task import load_task
from qsframework.work import HERE, Work


def run_compare(
    names: Sequence[str],
    task_file: Path,
    seed: int,
    json: Path | None,
    report: Path | None,
    fits: Sequence[str] = (),
    work: Work = HERE,
    anyway: bool = False,
) -> None:
    """Compare, print the summary, write the JSON and the report."""
    from qsframework.report import write_report
    from qsframework.report.compare_section import compare_sections, summary_table
    from qsframework.report.provenance import AFTER, EQUILIBRIUM, INFORMATION, STIFFNESS, provenance_section
    from qsframework.report.words.comparison import comparison_verdict

    fit_files = pairs("--fit", fits, "ROBOT=fit.json")
    distinct_outputs([json, report], [task_file, *map(Path, fit_files.values())])
    task = load_task(task_file)
    arms = [as_robot(name, task_file.parent) for name in names]
    note_folders(*arms)
    robots, notes = identified(arms, fit_files, anyway)
    with progress() as tell:
        result = compare(robots, task, seed, tell, notes, work)
    table = summary_table(result)
    verdict = comparison_verdict(result)
    print_verdict(verdict)
    print_table(table.header, table.rows, task.title, table.caption)
    for r in result.robots:
        print_folded(f"{r.robot.name}: {r.campaign}")
        print_folded(*(f"  note: {note}" for note in r.notes))
    if json is not None:
        write_json(json, result.as_json())
    if report is not None:
        inputs = [task_file, *map(Path, fit_files.values())]
        effects = [e for r in robots for e in r.effects]
        parameters = [replace(p, name=f"{r.name}: {p.name}") for r in robots for p in r.parameters]
        laws = (EQUILIBRIUM, STIFFNESS, INFORMATION, AFTER)
        sections = (*compare_sections(result), provenance_section(effects, inputs, seed, laws, parameters, robots))
        print(f"report: {write_report(report, f'Comparison: {task.title}', sections, verdict)}")


def identified(
    robots: list[Robot], fits: Mapping[str, str], anyway: bool = False
) -> tuple[list[Robot], dict[str, tuple[str, ...]]]:
    """The robots with the values of their fits, and what to note of each."""
    from qsframework.fits import read_fit
    from qsframework.uses.robot_from_fit import with_fit

    unknown = [name for name in fits if name not in {r.name for r in robots}]
    if unknown:
        allowed = ", ".join(r.name for r in robots)
        raise InputError(Problem("--fit: this robot is not compared", found=unknown[0], allowed=allowed))
    out: list[Robot] = []
    notes: dict[str, tuple[str, ...]] = {}
    for robot in robots:
        if robot.name in fits:
            robot, notes[robot.name] = with_fit(robot, read_fit(fits[robot.name]), anyway=anyway)
        out.append(robot)
    return out, notes
