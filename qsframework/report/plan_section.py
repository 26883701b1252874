"""The plan in a report: certificate, predicted standard deviations, poses, 3D view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from qsframework.experiment import Experiment, Plan
from qsframework.information import PredictedUncertainty, predicted_beyond
from qsframework.plans.constraints import joint_range
from qsframework.plugin import Array, Parameter
from qsframework.report.blocks import ReportTable, SceneView, Section, Text
from qsframework.report.words.plan import certificate_text
from qsframework.report.words.sizes import shown_number, unit_shown
from qsframework.units import JointUnits
from qsframework.viz import show_scene


def margin_words(experiment: Experiment) -> str:
    """How far the poses keep from the joints' limits, and what sets it."""
    margins = joint_range(experiment)[0] - np.array(experiment.robot.controller.lower)
    units, driven = experiment.robot.controller.units, experiment.robot.facts.driven
    constraints = experiment.constraints
    own = {*constraints.joint_limits, *constraints.joint_values}
    kept = [(k, m) for k, m in enumerate(margins.tolist()) if driven[k] not in own]
    if not any(m > 0.0 for _, m in kept):
        return "The poses may go up to the joints' limits."
    said = ", ".join(f"J{k + 1} {units[k].text(m, 3)}" for k, m in kept)
    return f"Distance kept from the controller's limits: {said} (another: joint_margin_deg in the constraints)."


def sd_table(parameters: Sequence[Parameter], columns: Mapping[str, Array]) -> ReportTable:
    """Promised standard deviation of each parameter, one column per plan."""
    return ReportTable(
        ("parameter", "nominal", "unit", *columns),
        tuple(
            (
                p.name,
                shown_number(p.nominal, p.unit),
                unit_shown(p.unit),
                *(sd_words(sd, p) for sd in sds),
            )
            for p, *sds in zip(parameters, *columns.values(), strict=True)
        ),
        "Predicted standard deviation of each plan, from the sensitivities at the nominal values; in brackets its "
        "share of the nominal value.",
    )


def predicted_table(predicted: Sequence[PredictedUncertainty]) -> ReportTable:
    """What a plan tells of each fitted parameter, and what would tell more."""
    rows = tuple(
        (
            p.name,
            shown_number(p.nominal, p.unit),
            sd_words(p.sd, p),
            unit_shown(p.unit),
            p.help or "ok",
        )
        for p in predicted
    )
    return ReportTable(
        ("fitted parameter", "nominal", "predicted sd", "unit", "what would help"),
        rows,
        "Predicted standard deviation, from the sensitivities at the nominal values; in brackets its "
        "share of the nominal value.",
    )


def sd_words(sd: float, p: Parameter | PredictedUncertainty) -> str:
    """A predicted sd in the unit of its parameter, and its share of the nominal value; NaN: there is none."""
    if not np.isfinite(sd):
        return "-" if np.isnan(sd) else "not identifiable"
    share = f" ({100 * sd / abs(p.nominal):.1f} %)" if p.nominal else ""
    return shown_number(sd, p.unit, 3) + share


def beyond_table(experiment: Experiment, sds: Mapping[str, float]) -> ReportTable:
    """What the plan would tell about each parameter of the model that is not fitted, were it fitted too."""
    model = experiment.model()
    rows: list[tuple[str, ...]] = []
    for name, sd in sds.items():
        p = model.parameters[model.index([name])[0]]
        size, what = (abs(p.nominal), "nominal") if p.nominal else (p.typical, "typical")
        verdict = "not identifiable: no reading depends on it, or only together with others"
        if np.isfinite(sd):
            share = 100 * sd / size
            caveat = "" if share < 100 else ", not identifiable in practice"
            verdict = f"{shown_number(sd, p.unit, 3)} {unit_shown(p.unit)} ({share:.3g} % of its {what} value{caveat})"
        rows.append((name, verdict))
    return ReportTable(
        ("parameter", "sd if also estimated"),
        tuple(rows),
        "Parameters of the model that the fit holds at their nominal values: the predicted sd of each, one at a time.",
    )


def pose_table(plan: Plan, joints: JointUnits) -> ReportTable:
    """The plan's poses as the pendant shows them."""
    header = ("pose", *joints.labels(), "load", "force N", "repeats")
    rows = tuple(
        (
            plan.pose[i],
            *(f"{a:.2f}" for a in joints.shown(plan.pendant[i])),
            plan.load[i],
            ", ".join(f"{f:.0f}" for f in plan.wrench[i, :3]),
            str(plan.repeats[i]),
        )
        for i in range(len(plan.pose))
    )
    return ReportTable(header, rows, "Joints as the pendant shows them.")


def plan_sections(
    experiment: Experiment, plan: Plan, sds: ReportTable, notes: Sequence[str] = ()
) -> tuple[Section, ...]:
    """The 3D view, what the plan predicts, and how it is proved, folded."""
    beyond = predicted_beyond(experiment, plan)
    more = (beyond_table(experiment, beyond),) if beyond else ()
    return (
        Section("Poses", (plan_view(experiment, plan),)),
        Section("Predicted uncertainties", (sds, *more)),
        Section("Proof and notes", (Text(certificate_text(plan)), *map(Text, notes)), folded=True),
    )


def plan_section(experiment: Experiment, plan: Plan, sds: ReportTable, title: str) -> Section:
    """The same in one section, the proof first."""
    return Section(title, tuple(b for s in reversed(plan_sections(experiment, plan, sds)) for b in s.blocks))


def plan_view(experiment: Experiment, plan: Plan) -> SceneView:
    """The poses in 3D and as a table."""
    return SceneView(
        show_scene(experiment, plan).html(),
        "Drag to turn, scroll to zoom; the slider goes through the poses in their order, the others are ghosts. Red "
        "arrow: the load; blue: the markers; transparent arm: the deflection, 100 times exaggerated; orange: where the "
        "load point goes under the largest force in any direction. Look for poses that deflect in different ways.",
        pose_table(plan, experiment.robot.controller.units),
        plan.pose,
    )
