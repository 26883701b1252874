"""`qsf simulate`: what it calls, prints and writes."""

from __future__ import annotations

from pathlib import Path

from qsframework.cli.commands import beside, distinct_outputs, load_campaign, load_plan, write_json
from qsframework.cli.printing import print_folded, print_notes
from qsframework.errors import some_of
from qsframework.experiment import Experiment
from qsframework.experiment.readings_table import holds_readings


def run_simulate(
    file: Path,
    plan_file: Path,
    output: Path,
    truth: str,
    seed: int,
    json: Path | None,
    linear: bool = False,
    report: Path | None = None,
) -> None:
    """Simulate a plan and write its readings."""
    from qsframework.elastostatics import range_notes
    from qsframework.experiment import simulate
    from qsframework.experiment.measured import keep_measured, write_simulated
    from qsframework.plans import broken_constraints
    from qsframework.plans.constraints import touching

    sidecar = beside(output, ".json")
    others = [path for path in (json, report) if path != sidecar]
    distinct_outputs([output, sidecar, *others], [file, plan_file, beside(plan_file, ".json")])
    keep_measured([output], "-o")
    experiment = load_campaign(file)
    if holds_readings(plan_file):
        _run_rows(experiment, plan_file, output, truth, seed, linear)
        return
    plan = load_plan(plan_file, experiment)
    solid = touching(experiment, plan.pendant)
    for constraint, poses in broken_constraints(experiment, plan).items():
        pairs = ", ".join(dict.fromkeys(filter(None, solid.get(constraint, ()))))
        print_folded(f"note: {some_of(poses)} break the constraint {constraint!r}{f' ({pairs})' if pairs else ''}")
    result = simulate(experiment, plan, truth=truth, seed=seed, linear=linear)
    notes = range_notes(result.model, plan.poses, plan.pose, result.x)
    print_notes(notes)
    made = write_simulated(output, result.readings, experiment)
    if json is not None:
        written = {"readings": str(output), "seed": seed, "truth": result.truth_by_name()}
        written |= {"notes": list(notes)} if notes else {}
        write_json(json, {**(made if json == sidecar else {}), **written})
    if report is not None:
        from qsframework.report import write_report
        from qsframework.report.provenance import EQUILIBRIUM, LINEAR, computed
        from qsframework.report.simulation_section import simulation_sections

        own = computed(experiment, [file, plan_file], seed, (LINEAR, EQUILIBRIUM) if linear else (EQUILIBRIUM,))
        sections = (*simulation_sections(experiment, plan, result, linear, notes), own)
        print(f"report: {write_report(report, f'Simulation: {experiment.robot.title}', sections)}")
    print(f"{len(result.readings)} readings at {len(set(result.readings.pose))} poses: {output}")
    print(f"next: qsf identify {file} {output}")


def _run_rows(experiment: Experiment, table: Path, output: Path, truth: str, seed: int, linear: bool) -> None:
    """Simulate the rows of a table of readings."""
    from qsframework.experiment import read_readings, simulate_rows
    from qsframework.experiment.measured import write_simulated

    result = simulate_rows(experiment, read_readings(table, experiment), None, truth, seed, linear)
    write_simulated(output, result.readings, experiment)
    print(f"{len(result.readings)} readings at {len(set(result.readings.pose))} poses: {output}")
    print(f"next: qsf identify {experiment.path} {output}")
