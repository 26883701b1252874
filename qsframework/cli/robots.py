"""`qsf robots`: what it prints and writes. A robot is loaded for the report alone."""

from __future__ import annotations

from pathlib import Path

from qsframework.cli.commands import distinct_outputs, write_json
from qsframework.cli.printing import print_table
from qsframework.robot.search import robot_titles


def list_robots(json: Path | None, report: Path | None = None) -> None:
    """Name and title of every robot on the search path."""
    distinct_outputs([json, report], [])
    titles = robot_titles()
    print_table(("robot", "title"), tuple(titles.items()))
    if json is not None:
        write_json(json, titles, names=True)
    if report is not None:
        from qsframework.report import write_report
        from qsframework.report.provenance import robots_computed
        from qsframework.report.robot_section import robots_section
        from qsframework.robot import load_robot

        robots = [load_robot(name) for name in titles]
        sections = (robots_section(robots), robots_computed(robots, []))
        print(f"report: {write_report(report, 'Robots', sections)}")
