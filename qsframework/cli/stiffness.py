"""`qsf stiffness`: what an arm does at one pose under one load."""

from __future__ import annotations

from pathlib import Path

from qsframework.cli.commands import distinct_outputs, note_folders, write_json
from qsframework.cli.numbers import numbers, point_of, wrench_of
from qsframework.cli.printing import print_folded, print_notes, print_table
from qsframework.report.blocks import ReportTable, SceneView, Section, Text
from qsframework.report.stiffness_section import deflection_words, stiffness_tables, stiffness_verdict
from qsframework.robot import load_robot
from qsframework.uses import stiffness_at


def run_stiffness(robot: str, pose: str, load: str, point: str, json: Path | None, report: Path | None) -> None:
    """Compute, print, write."""
    distinct_outputs([json, report], [])
    arm = load_robot(robot)
    note_folders(arm)
    result = stiffness_at(
        arm,
        arm.controller.units.si(numbers("--pose", pose, (arm.controller.axes,))),
        wrench_of("--load", load, arm),
        point_of("--point", point),
    )
    notes = [Text(f"Note: {note}.") for note in result.notes]
    section = Section(
        f"{arm.title} at {pose} {arm.controller.units.one} under {load} N",
        (Text(deflection_words(result)), *notes, *stiffness_tables(result)),
    )
    if json is not None:
        write_json(json, result.as_json())
    print_folded(deflection_words(result))
    print_notes(result.notes)
    for block in section.blocks:
        if isinstance(block, ReportTable):
            print_table(block.header, block.rows)
    if report is not None:
        from qsframework.report import write_report
        from qsframework.report.provenance import EQUILIBRIUM, LINEAR, STIFFNESS, provenance_section

        seen = Section("In 3D", (_view(robot, pose, load, point, stiffness_tables(result)[0]),))
        laws = (LINEAR, EQUILIBRIUM, STIFFNESS)
        own = provenance_section(arm.effects, [], None, laws, arm.parameters, [arm])
        sections = [seen, section, own]
        path = write_report(report, f"Stiffness: {arm.title}", sections, stiffness_verdict(result))
        print(f"report: {path}")


def _view(robot: str, pose: str, load: str, point: str, shares: ReportTable) -> SceneView:
    """The loaded arm and its ellipsoid, 100 times exaggerated."""
    from qsframework.cli.show import Shown, make_scene

    return SceneView(
        make_scene(Shown(subject=robot, pose=pose, load=load, point=point)).html(),
        "Transparent: the loaded arm, its deflection 100 times exaggerated. Orange: where the load point goes under "
        "this force in any direction; look for the long axis, in which the arm is soft. Drag to turn, scroll to zoom.",
        shares,
    )
