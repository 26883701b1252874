"""Corrected targets in a report: what was off, what is left to be expected, and where it is worst."""

from __future__ import annotations

import html

import numpy as np

from qsframework.experiment import Experiment, make_plan
from qsframework.plugin import Array, Poses
from qsframework.report.blocks import Figure, ReportTable, SceneView, Section, Text
from qsframework.report.plots import AFTER, BEFORE, COLOURS, blank, log_axis, plotted
from qsframework.report.words.compensation import own_cause
from qsframework.uses.compensate import Compensation
from qsframework.uses.inverse import rigid_tip
from qsframework.uses.stiffness import spring_shares

_MOST = 24
"""Targets in the scene."""
_SMALL = 0.01
"""Share of the deflection below which a spring is not drawn."""


def target_table(result: Compensation) -> ReportTable:
    """One row per target: its error uncorrected, the error to be expected after it, the correction."""
    correction = result.units.shown(result.pendant - result.targets.pendant)
    rows = tuple(
        (
            name,
            f"{result.uncorrected[i] * 1e3:.3f}",
            f"{result.of_load[i] * 1e3:.3f}",
            f"{result.of_own[i] * 1e3:.3f}",
            f"{result.sd[i] * 1e3:.4f}",
            f"{result.turn_sd[i] * 1e3:.4f}",
            *(f"{c:+.4f}" for c in correction[i]),
        )
        for i, name in enumerate(result.targets.name)
    )
    header = ("target", "uncorrected mm", "by load mm", "without load mm", "expected after mm", "expected after mrad")
    return ReportTable(
        (*header, *result.units.labels("dJ")),
        rows,
        f"Position error of the load point without the correction{result.at_level}; how far the load alone moves it, "
        f"and how far off {own_cause(result)} put it without; the root mean square of the distance "
        "that is to be expected with it, from the covariance of the fit and the stated uncertainties of the load and "
        "of what was held at nominal; and what was added to each joint.",
    )


def _of_noise(result: Compensation) -> str:
    """What part is the noise's, where other uncertainties were stated."""
    whole, noise = (float((sd**2).sum()) for sd in (result.sd, result.noise_sd))
    if not whole > noise:
        return ""
    return (
        f"The readings' noise makes {100.0 * noise / whole:.0f} % of its mean square; the rest, which more readings do "
        "not lessen, is what the model lacks and the stated uncertainties of the campaign's load and of what was held. "
    )


def compensation_section(result: Compensation) -> Section:
    """Words, notes, the figure and the table."""
    names = [html.escape(name) for name in result.targets.name]
    figure = blank("Distance from the target", "target", "mm")
    for values, name, look in (
        (result.uncorrected, "uncorrected", BEFORE),
        (result.sd, "expected after the correction", AFTER),
    ):
        dots = {**look, "size": 9}
        figure.add_scatter(x=names, y=plotted(1e3 * values), mode="markers", name=name, marker=dots, customdata=names)
    figure.update_layout(
        yaxis=log_axis(1e3 * np.concatenate([result.uncorrected, result.sd])), xaxis={"type": "category"}
    )
    caption = (
        f"Diamonds: the distance from the target without a correction{result.at_level}; circles: expected after it, on "
        "a logarithmic scale. Look for targets whose circle is not much lower than the diamond: there the fit is "
        "too uncertain, and more readings near that pose would help."
    )
    worst = result.worst
    text = (
        "Each target was corrected so that the loaded arm, by the full equilibrium of the identified model, reaches "
        "it. What then remains is the error of the identified parameters, S cov S' with S the derivative of "
        "the tip at the corrected angles, and what held-out poses are off beyond the noise. It is largest at target "
        f"{names[worst]}: {result.sd[worst] * 1e3:.4f} mm. {_of_noise(result)}The robot's repeatability comes on top."
    )
    notes = tuple(Text(f"Note: {note}.") for note in result.notes)
    return Section("Corrected targets", (*notes, Figure(figure, caption, target_table(result)), Text(text)))


def target_view(experiment: Experiment, result: Compensation, x: Array) -> Section:
    """The targets that are farthest off without a correction, before and after it in 3D, and which springs give there,
    at the fitted parameters x."""
    from qsframework.viz import show_scene
    from qsframework.viz.scenes import draw_targets

    targets, arm = result.targets, experiment.robot.controller
    worst = np.sort(np.argsort(-result.uncorrected, kind="stable")[:_MOST])
    names = [targets.name[int(i)] for i in worst]
    poses = Poses(targets.pendant, arm.to_joints(targets.pendant), targets.wrench)
    plan = make_plan(poses.take(worst), [""] * len(worst), names=names)
    scene = show_scene(experiment, plan, x, commanded=result.reference == "commanded")
    stood = rigid_tip(experiment.robot, experiment.load_site, plan.q).position
    moved = result.command.position[worst] - stood
    enlarged = draw_targets(scene, stood, result.deflection[worst, :3], moved, result.covariance[worst, :3, :3])
    rows = tuple(
        (n, *(f"{1e3 * v:+.4f}" for v in (*result.deflection[i, :3], *move)))
        for n, i, move in zip(names, worst, moved, strict=True)
    )
    view = SceneView(
        scene.html(),
        f"The targets{'' if len(worst) == len(targets.name) else f' that are farthest off, {_MOST} of them'}. Red "
        "arrows: where the tool stands without a correction; green: how far the command is moved; transparent: the arm "
        "under its load; all 100 times enlarged. Blue ellipsoids: the error to be expected after the correction "
        f"(k = 2), {enlarged:.0f} times enlarged. Look for a long one: in its direction more readings would help.",
        ReportTable(
            ("pose", *(f"{what} {axis} mm" for what in ("off", "moved") for axis in "xyz")),
            rows,
            "Where the uncorrected tool stands, and how far the command is moved; base frame.",
        ),
        tuple(names),
    )
    return Section("In 3D", (view, *_by_joint(experiment, result, poses, x)))


def _by_joint(experiment: Experiment, result: Compensation, poses: Poses, x: Array) -> tuple[Figure, ...]:
    """What each spring adds to the deflection under load along the targets, in their order."""
    from qsframework.viz.glow import shares

    if not poses.wrench.any():
        return ()
    found = shares(experiment.model(), poses, x)
    size = 1e3 * np.linalg.norm(spring_shares(experiment.model(), poses, x).sum(axis=1), axis=1)
    parts = found.share * size[:, None]
    order = np.argsort(-np.abs(parts).max(axis=0), kind="stable")
    most, rest = order[: len(COLOURS) - 1], order[len(COLOURS) - 1 :]
    drawn = [(found.names[int(k)], parts[:, k]) for k in most if np.abs(found.share[:, k]).max() > _SMALL]
    if len(rest):
        drawn.append((f"{len(rest)} others", parts[:, rest].sum(axis=1)))
    names = [html.escape(name) for name in result.targets.name]
    figure = blank("Deflection under load by spring", "target", "mm, along the deflection")
    for k, (name, values) in enumerate(drawn):
        look = {"color": COLOURS[k]}
        figure.add_bar(x=names, y=plotted(values), name=html.escape(name), marker=look, customdata=names)
    figure.update_layout(barmode="relative", xaxis={"type": "category"})
    caption = (
        "What each spring adds to the deflection of the load point, by the linear model, in the order of the targets. "
        "Look which spring makes most of it: stiffness is gained there, or a pose that loads it less."
    )
    return (Figure(figure, caption),)
