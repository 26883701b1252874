"""`qsf compare`: what it calls and prints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from qsframework.applications.compare import compare
from qsframework.applications.task import load_task
from qsframework.cli.commands import distinct_outputs, write_json
from qsframework.cli.progress import print_table, progress
from qsframework.robot import load_robot


def run_compare(names: Sequence[str], task_file: Path, seed: int, json: Path | None, report: Path | None) -> None:
    """Compare, print the summary, write the JSON and the report."""
    from qsframework.report import write_report
    from qsframework.report.compare_section import compare_sections, summary_table
    from qsframework.report.provenance import AFTER, EQUILIBRIUM, INFORMATION, STIFFNESS, provenance_section

    distinct_outputs([json, report], [task_file])
    task = load_task(task_file)
    robots = [load_robot(name, beside=task_file.parent) for name in names]
    with progress() as tell:
        result = compare(robots, task, seed, tell)
    table = summary_table(result)
    print_table(table.header, table.rows, task.title)
    print(table.caption)
    for r in result.robots:
        print(f"{r.robot.name}: {r.campaign}")
        for note in r.notes:
            print(f"  note: {note}")
    if json is not None:
        write_json(json, result.as_json())
    if report is not None:
        effects = [e for r in robots for e in r.effects]
        parameters = [replace(p, name=f"{r.name}: {p.name}") for r in robots for p in r.parameters]
        laws = (EQUILIBRIUM, STIFFNESS, INFORMATION, AFTER)
        sections = (*compare_sections(result), provenance_section(effects, [task_file], seed, laws, parameters, robots))
        print(f"report: {write_report(report, f'Comparison: {task.title}', sections)}")
