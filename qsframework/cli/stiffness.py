"""`qsf stiffness`: what an arm does at one pose under one load."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from qsframework.applications import Stiffness, stiffness_at
from qsframework.cli.commands import distinct_outputs, write_json
from qsframework.cli.numbers import numbers, point_of, wrench_of
from qsframework.cli.printing import print_folded, print_table
from qsframework.report.blocks import ReportTable, SceneView, Section, Text
from qsframework.robot import load_robot

_AXES = ("x", "y", "z", "rx", "ry", "rz")


def run_stiffness(robot: str, pose: str, load: str, point: str, json: Path | None, report: Path | None) -> None:
    """Compute, print, write."""
    distinct_outputs([json, report], [])
    arm = load_robot(robot)
    result = stiffness_at(
        arm,
        arm.controller.units.si(numbers("--pose", pose, (arm.controller.axes,))),
        wrench_of("--load", load, arm),
        point_of("--point", point),
    )
    notes = [Text(f"Note: {note}.") for note in result.notes]
    section = Section(
        f"{arm.title} at {pose} {arm.controller.units.one} under {load} N",
        (Text(_words(result)), *notes, *_tables(result)),
    )
    if json is not None:
        write_json(json, result.as_json())
    print_folded(_words(result))
    for note in result.notes:
        print_folded(f"note: {note}")
    for block in section.blocks:
        if isinstance(block, ReportTable):
            print_table(block.header, block.rows)
    if report is not None:
        from qsframework.report import write_report
        from qsframework.report.provenance import EQUILIBRIUM, LINEAR, STIFFNESS, provenance_section

        seen = Section("In 3D", (_view(robot, pose, load, point, _tables(result)[0]),))
        laws = (LINEAR, EQUILIBRIUM, STIFFNESS)
        own = provenance_section(arm.effects, [], None, laws, arm.parameters, [arm])
        path = write_report(report, f"Stiffness: {arm.title}", [section, seen, own])
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


def _tables(result: Stiffness) -> list[ReportTable]:
    square = float(result.linear @ result.linear)
    shares = [
        (name, *(f"{v * 1e3:.4f}" for v in share), f"{100 * share @ result.linear / square:.1f} %" if square else "-")
        for name, share in zip(result.names, result.shares, strict=True)
    ]
    sums = [
        (name, *(f"{v * 1e3:.4f}" for v in vector), "")
        for name, vector in (("linear model", result.linear), ("full equilibrium", result.full))
    ]
    tables = [ReportTable(("spring", "dx mm", "dy mm", "dz mm", "share"), tuple([*shares, *sums]))]
    for words, with_load in (("K_C", True), ("K_C without load and gravity in H", False)):
        K = result.stiffness(with_load)
        if K is not None:
            rows = tuple((axis, *(f"{v:.4g}" for v in row)) for axis, row in zip(_AXES, K, strict=True))
            tables.append(ReportTable((words, *_AXES), rows, "N/m, N/rad, N m/m and N m/rad, base frame."))
    return tables


def _words(result: Stiffness) -> str:
    text = (
        f"The load point moves by {np.linalg.norm(result.full) * 1e3:.4f} mm and turns by "
        f"{np.linalg.norm(result.rotation) * 1e3:.4f} mrad. The linear model errs by "
        f"{100 * result.linear_error:.3f} % of that."
    )
    if result.stiffness() is None:
        text += " A direction at the tip does not give at all, so there is no finite K_C."
    return text
