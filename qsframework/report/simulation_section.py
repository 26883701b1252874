"""A simulated campaign in a report: what each pose shows, against the noise, and what made it."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from qsframework.experiment import Experiment, Plan, Simulation
from qsframework.plugin import Array
from qsframework.report.blocks import Figure, Plot, ReportTable, SceneView, Section, Text
from qsframework.report.plots import GREY, blank
from qsframework.report.words.sizes import mm, shown_number, unit_shown
from qsframework.viz import show_scene
from qsframework.viz.deflection import deflection

_LOOK = (
    "Bars: how far each marker moves under the load, without noise; the dotted line is the noise of one coordinate. "
    "Look for poses whose bars are hardly above it: they carry no information; and for markers that always move alike."
)
_SCENE = (
    "The arm at every pose of the plan; transparent: deflected, 100 times exaggerated, by the full equilibrium at the "
    "simulation's parameters. Look for poses in which another part of the arm deflects than in most."
)


def simulation_sections(
    experiment: Experiment, plan: Plan, result: Simulation, linear: bool, notes: Sequence[str] = ()
) -> tuple[Section, ...]:
    """Deflections as figure and table, the scene, and the parameters that made the readings; notes: said first."""
    model = result.model
    moved = model.predict(plan.poses, result.x, linear)
    how = "the linear model" if linear else "the full equilibrium"
    sigma = 1e3 * (experiment.noise.sigma or 0.0)
    rows, poses = len(result.readings), len(np.unique(result.readings.plus))
    said = (
        f"{rows} readings of {poses} visits to {len(plan.pose)} poses by {how}, with independent Gaussian noise of "
        f"{sigma:.4g} mm on every coordinate. The readings differ from the numbers below by this noise alone."
    )
    numbers = deflection_table(experiment, plan, moved)
    figure = Figure(_bars(experiment, plan, moved, sigma), _LOOK, numbers)
    view = SceneView(show_scene(experiment, plan, result.x).html(), _SCENE, tip_table(plan, result))
    return (
        Section("What the poses show", (Text(said), *(Text(f"Note: {note}.") for note in notes), figure)),
        Section("In 3D", (view,)),
        Section("What made the readings", (truth_table(result),)),
    )


def deflection_table(experiment: Experiment, plan: Plan, moved: Array) -> ReportTable:
    """Displacement (N, K, 3) m of each marker at each pose, without noise."""
    rows = tuple(
        (
            plan.pose[i],
            plan.load[i] or "-",
            m.name,
            *(mm(v, 4) for v in (*moved[i, k], float(np.linalg.norm(moved[i, k])))),
        )
        for i in range(len(plan.pose))
        for k, m in enumerate(experiment.markers)
    )
    return ReportTable(
        ("pose", "load", "marker", "dx mm", "dy mm", "dz mm", "length mm"), rows, "Base frame, without noise."
    )


def tip_table(plan: Plan, result: Simulation) -> ReportTable:
    """The load point's way from unloaded to loaded by the full equilibrium."""
    tip = 1e3 * deflection(result.model, plan.poses, result.x).tip
    rows = tuple((p, *(f"{v:.4f}" for v in t), f"{np.linalg.norm(t):.4f}") for p, t in zip(plan.pose, tip, strict=True))
    return ReportTable(("pose", "dx mm", "dy mm", "dz mm", "length mm"), rows, "Of the load point.")


def truth_table(result: Simulation) -> ReportTable:
    """The parameters of the simulation beside the nominal ones."""
    rows: list[tuple[str, ...]] = []
    for p, x in zip(result.model.parameters, result.x, strict=True):
        change = f"{100 * (x / p.nominal - 1):+.1f} %" if p.nominal else "-"
        numbers = (shown_number(v, p.unit, 5) for v in (x, p.nominal))
        rows.append((p.name, *numbers, unit_shown(p.unit), change))
    header = ("parameter", "in the simulation", "nominal", "unit", "change")
    return ReportTable(header, tuple(rows), "A fit of the readings should find the second column within its sds.")


def _bars(experiment: Experiment, plan: Plan, moved: Array, sigma: float) -> Plot:
    figure = blank("Displacement of the markers", "pose", "length, mm")
    figure.update_layout(barmode="group", xaxis={"type": "category"})
    sizes = 1e3 * np.linalg.norm(moved, axis=2)
    poses = [html.escape(p) for p in plan.pose]
    for k, marker in enumerate(experiment.markers):
        figure.add_bar(x=poses, y=sizes[:, k].tolist(), name=html.escape(marker.name))
    figure.add_hline(sigma, line={"color": GREY, "dash": "dot"}, annotation_text="noise")
    return figure
