"""`qsf demo`: the main job on real readings and on a designed plan, in one report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.cli.commands import distinct_outputs, write_json
from qsframework.cli.printing import print_folded, print_line
from qsframework.cli.progress import Tell, progress
from qsframework.experiment import (
    Experiment,
    Plan,
    example,
    load_experiment,
    read_plan,
    read_readings,
    simulate,
    write_plan,
)
from qsframework.experiment.measured import keep_measured, write_simulated
from qsframework.fits import Fit, identify
from qsframework.plugin import build_effects
from qsframework.plugin.registry import with_role
from qsframework.report import (
    Mark,
    ReportTable,
    Section,
    Text,
    Verdict,
    fit_section,
    plan_section,
    sd_table,
    where_section,
    write_report,
)
from qsframework.report.provenance import AFTER, EQUILIBRIUM, INFORMATION, LEAST_SQUARES, computed

POSES = 12
CANDIDATES = 1000
WRITTEN = ("report.html", "plan.csv", "plan.json", "readings.csv", "readings.json", "fit.json", "truth.json")


def run_demo(output: Path, seed: int, json: Path | None = None) -> None:
    """Run both parts, print their numbers and the path of the report; everything as JSON where asked for."""
    distinct_outputs([*(output / name for name in WRITTEN), json], [])
    keep_measured([output / "readings.csv"], "-o")
    with progress() as tell:
        real, fits = real_readings(tell)
        planned, results = designed_plan(output, seed, tell)
        tell("report", 0, 1)
        title = "qsframework: elastostatic calibration, start to end"
        path = write_report(output / "report.html", title, [*real, *planned], _verdict(fits, results))
        tell("report", 1, 1)
    stages = _stages(fits, results)
    for number, (stage, found) in enumerate(stages.items(), 1):
        print_line(f"{number} of {len(stages)}, {stage}", found)
    print_folded(_real(fits))
    print(f"open: {path} (one file, no network needed)")
    if json is not None:
        write_json(json, {"report": str(path), "seed": seed, "real_readings": fits, "designed_plan": results})


def _stages(real: dict[str, Any], simulated: dict[str, Any]) -> dict[str, str]:
    """What each of the four stages found, by its name: from the fits as JSON."""
    joints, _, offaxis = (fit["errors_mm"]["displacement"] for fit in real.values())
    own, plan = simulated["fit"]["errors_mm"]["displacement"], simulated["certificate"]
    return {
        "real readings": f"FANUC R-2000iC, 43 cable pulls: {joints['nominal']:.3f} \u2192 {joints['held_out']:.3f} mm "
        "with six joint stiffnesses",
        "what the model missed": f"one off-axis spring at joint_3 more: \u2192 {offaxis['held_out']:.3f} mm",
        "a plan of poses": f"FANUC M-900iB/700, {POSES} poses, {_best(plan):.1f} % of the best of the candidates",
        "the plan's readings": f"simulated and identified: {own['nominal']:.3f} \u2192 {own['held_out']:.3f} mm",
    }


def _best(certificate: dict[str, Any]) -> float:
    """At least so many % of the best plan of the candidates; a refined one may be better than all of them."""
    return 100.0 * (certificate["polished_from"] or certificate["efficiency"])


def _real(fits: dict[str, Any]) -> str:
    """The one line to remember."""
    joints, _, offaxis = (fit["errors_mm"]["displacement"] for fit in fits.values())
    return (
        f"A real robot's error under load: {joints['nominal']:.3f} \u2192 {offaxis['held_out']:.3f} mm (3D RMS at "
        "held-out poses; before: nominal model)."
    )


def _verdict(real: dict[str, Any], simulated: dict[str, Any]) -> Verdict:
    """The first thing on the report: what the two parts found, with their numbers."""
    joints, _, offaxis = (fit["errors_mm"]["displacement"] for fit in real.values())
    own, plan = simulated["fit"]["errors_mm"]["displacement"], simulated["certificate"]
    return Verdict(
        Mark.GOOD,
        "Calibrated",
        _real(real),
        (
            (f"{joints['nominal']:.3f} mm", "R-2000iC, real readings, nominal model"),
            (f"{offaxis['held_out']:.3f} mm", "identified with an off-axis spring, held-out"),
            (f"{own['held_out']:.3f} mm", "M-900iB, simulated, held-out"),
            (f"{_best(plan):.1f} %", "of the best plan possible, at least"),
        ),
    )


def real_readings(tell: Tell) -> tuple[list[Section], dict[str, Any]]:
    """The R-2000iC's 43 cable-pull readings under three models: sections, and the fits as JSON."""
    label = "R-2000iC: 43 real readings"
    experiment = load_experiment(example("r2000ic") / "experiment.yaml")
    readings = read_readings(experiment.data, experiment)
    models = {
        "joint springs, J3 absolute": experiment,
        "joint springs, J3 read as relative": read_as_relative(experiment, "joint_3"),
        "joint springs and off-axis spring joint_3/x": with_offaxis(experiment, "joint_3", "x"),
    }
    fits: dict[str, Fit] = {}
    for i, (name, variant) in enumerate(models.items()):
        tell(label, i, len(models))
        fits[name] = identify(variant, readings)
    tell(label, len(models), len(models))
    name, last = next(reversed(models.items()))
    sections = [
        where_section(fits[name], last, readings, "R-2000iC: where the errors are, with the off-axis spring"),
        _compare_models(fits),
        fit_section(fits["joint springs, J3 absolute"], "R-2000iC: fit of the joint springs"),
        computed(last, [experiment.path, *experiment.data], None, (EQUILIBRIUM, LEAST_SQUARES)),
    ]
    return sections, {name: fit.as_json() for name, fit in fits.items()}


def read_as_relative(experiment: Experiment, joint: str) -> Experiment:
    """The experiment under the wrong convention: the joint's pendant angle taken as relative to the joint before."""
    (coupling,) = build_effects({"joint": joint}, experiment.robot.facts, effect=with_role("shown angle")[0])
    wide = experiment.with_effects([coupling])
    *others, factor = wide.parameters
    return wide.with_(parameters=(*others, replace(factor, nominal=-1.0)))


def with_offaxis(experiment: Experiment, joint: str, axis: str) -> Experiment:
    """The experiment with one more spring, about an axis that no motor turns."""
    place = {"joint": joint, "axis": axis}
    return experiment.with_effects(build_effects(place, experiment.robot.facts, effect=with_role("bearing")[0]))


def _compare_models(fits: dict[str, Fit]) -> Section:
    rows: list[tuple[str, ...]] = []
    for name, fit in fits.items():
        broken = [e.name for e in fit.estimates if e.value < e.lower]
        rows.append(
            (
                name,
                *(f"{fit.errors['displacement'][key] * 1e3:.3f}" for key in ("readings", "identified", "held_out")),
                ", ".join(broken) or "none",
            )
        )
    table = ReportTable(
        ("3D RMS", "readings, mm", "identified, mm", "held-out, mm", "negative compliances"),
        tuple(rows),
        "A wrong convention shows itself: a larger error and a compliance below zero. One off-axis spring removes a "
        "fifth of the held-out error.",
    )
    text = Text(
        "FANUC R-2000iC with a drilling spindle, 43 cable pulls of 115 to 1166 N (Liu, Feng, Jin, Shanghai Jiao Tong "
        "University, MIT licence; see examples/r2000ic/README.md). The source states no noise and has no repeats, so "
        "the noise is estimated from the residuals."
    )
    return Section("R-2000iC: which model explains the readings", (text, table))


def designed_plan(output: Path, seed: int, tell: Tell) -> tuple[list[Section], dict[str, Any]]:
    """Design 12 poses for the M-900iB, simulate them, identify, compare with the truth and with Table 5."""
    from qsframework.plans import design

    experiment = load_experiment(example("m900ib") / "experiment.yaml")
    plan = design(experiment, POSES, "D", CANDIDATES, seed, progress=tell)
    output.mkdir(parents=True, exist_ok=True)
    write_plan(output / "plan.csv", plan, experiment)
    tell("simulate and identify", 0, 1)
    simulation = simulate(experiment, plan, truth="drawn", seed=seed)
    write_simulated(output / "readings.csv", simulation.readings, experiment)
    readings = read_readings(output / "readings.csv", experiment)
    fit = identify(experiment, readings)
    write_json(output / "fit.json", fit.as_json())
    write_json(output / "truth.json", simulation.truth_by_name(), names=True)
    tell("simulate and identify", 1, 1)
    files: Sequence[Path] = [experiment.path, output / "plan.csv", output / "readings.csv"]
    sections = [
        plan_section(experiment, plan, _against_table5(experiment, plan), f"M-900iB/700: {POSES} designed poses"),
        fit_section(fit, "M-900iB/700: identified from simulated readings", simulation.truth_by_name()),
        computed(experiment, files, seed, (EQUILIBRIUM, LEAST_SQUARES, INFORMATION, AFTER)),
    ]
    certificate = plan.certificate.as_json() if plan.certificate else None
    return sections, {"certificate": certificate, "fit": fit.as_json(), "truth": simulation.truth_by_name()}


def _against_table5(experiment: Experiment, plan: Plan) -> ReportTable:
    """Promised sds beside those of the paper's Table 5 under the weight alone."""
    from qsframework.information import predicted_sd
    from qsframework.plans import broken_constraints

    paper = read_plan(example("m900ib") / "table5.csv", experiment)
    weight = replace(plan, wrench=np.tile(paper.wrench[:1], (len(plan.pose), 1)))
    table = sd_table(
        experiment.fit_parameters(),
        {
            "this plan": predicted_sd(experiment, plan),
            "these poses, weight only": predicted_sd(experiment, weight),
            "the paper's Table 5": predicted_sd(experiment, paper),
        },
    )
    broken = broken_constraints(experiment, paper)
    notes = "; ".join(f"{', '.join(poses)} break {constraint}" for constraint, poses in broken.items())
    caption = f"{table.caption} Under the weight alone nothing loads joint 1. Of Table 5, {notes}."
    return replace(table, caption=caption)
