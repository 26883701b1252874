"""Corrected targets in a report: what was off, what is left to be expected, and where it is worst."""

from __future__ import annotations

import html

import numpy as np

from qsframework.applications.compensate import Compensation
from qsframework.experiment import Experiment, make_plan
from qsframework.plugin import Array, Poses
from qsframework.report.blocks import Figure, ReportTable, SceneView, Section, Text
from qsframework.report.plots import AFTER, BEFORE, blank, log_axis, plotted

_MOST = 24
"""Targets in the scene."""


def target_table(result: Compensation) -> ReportTable:
    """One row per target: its error uncorrected, the error to be expected after it, the correction."""
    correction = result.units.shown(result.pendant - result.targets.pendant)
    rows = tuple(
        (
            name,
            f"{result.size[i] * 1e3:.3f}",
            f"{result.sd[i] * 1e3:.4f}",
            f"{result.turn_sd[i] * 1e3:.4f}",
            *(f"{c:+.4f}" for c in correction[i]),
        )
        for i, name in enumerate(result.targets.name)
    )
    header = ("target", "uncorrected mm", "expected after mm", "expected after mrad")
    return ReportTable(
        (*header, *result.units.labels("dJ")),
        rows,
        "Distance of the load point from its wanted place without the correction; the root mean square of the distance "
        "that is to be expected with it, from the covariance of the fit and the stated uncertainties of the load and "
        "of what was held at nominal; and what was added to each joint.",
    )


def _of_noise(result: Compensation) -> str:
    """What part is the noise's, where other uncertainties were stated."""
    whole, noise = (float((sd**2).sum()) for sd in (result.sd, result.noise_sd))
    if not whole > noise:
        return ""
    return (
        f"The readings' noise makes {100.0 * noise / whole:.0f} % of its mean square, the stated uncertainties of the "
        "measuring campaign's load and of what was held at nominal the rest, which more readings do not lessen. "
    )


def compensation_section(result: Compensation) -> Section:
    """Words, notes, the figure and the table."""
    names = [html.escape(name) for name in result.targets.name]
    figure = blank("Distance from the target", "target", "mm")
    for values, name, look in (
        (result.size, "uncorrected", BEFORE),
        (result.sd, "expected after the correction", AFTER),
    ):
        dots = {**look, "size": 9}
        figure.add_scatter(x=names, y=plotted(1e3 * values), mode="markers", name=name, marker=dots, customdata=names)
    figure.update_layout(yaxis=log_axis(1e3 * np.concatenate([result.size, result.sd])), xaxis={"type": "category"})
    caption = (
        "Diamonds: the distance from the target without a correction; circles: expected after it, on a logarithmic "
        "scale. Look for targets whose circle is not much lower than the diamond: there the fit knows too little, and "
        "more readings near that pose would help."
    )
    worst = result.worst
    text = (
        "Each target was moved so that the loaded arm, by the full equilibrium of the identified model, stands where "
        "it is wanted. What then remains is the error of the identified parameters, S cov S' with S the derivative of "
        f"the tip at the corrected angles. It is largest at target {names[worst]}: {result.sd[worst] * 1e3:.4f} mm. "
        f"{_of_noise(result)}Effects that the model does not hold, and the robot's repeatability, come on top."
    )
    notes = tuple(Text(f"Note: {note}.") for note in result.notes)
    return Section("Corrected targets", (*notes, Figure(figure, caption, target_table(result)), Text(text)))


def target_view(experiment: Experiment, result: Compensation, x: Array) -> Section:
    """The targets that are farthest off without a correction, with their load, at the fitted parameters x."""
    from qsframework.viz import show_scene

    targets = result.targets
    worst = np.sort(np.argsort(-result.size, kind="stable")[:_MOST])
    names = [targets.name[int(i)] for i in worst]
    pendant = targets.pendant[worst]
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), targets.wrench[worst])
    plan = make_plan(poses, [""] * len(worst), names=names)
    rows = tuple((n, *(f"{1e3 * v:+.4f}" for v in result.deflection[i, :3])) for n, i in zip(names, worst, strict=True))
    view = SceneView(
        show_scene(experiment, plan, x, commanded=result.reference == "commanded").html(),
        f"The targets{'' if len(worst) == len(targets.name) else f' that are farthest off, {_MOST} of them'}; transparent: the "
        "arm under its load, 100 times exaggerated, at the identified parameters. Look whether the correction acts "
        "against what you see: the arm is told to stand as far on the other side.",
        ReportTable(
            ("pose", "off x mm", "off y mm", "off z mm"), rows, "Where the uncorrected tool stands, base frame."
        ),
        tuple(names),
    )
    return Section("In 3D", (view,))
