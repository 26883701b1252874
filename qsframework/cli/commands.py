"""What each command calls and prints."""

from __future__ import annotations

import json as jsonlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from qsframework.errors import InputError
from qsframework.experiment import (
    Experiment,
    load_experiment,
    read_plan,
)
from qsframework.files import write_text
from qsframework.files.formats import FORMAT


def run_simulate(
    file: Path, plan_file: Path, output: Path, truth: str, seed: int, json: Path | None, exact: bool = False,
    report: Path | None = None,
) -> None:  # fmt: skip
    """Simulate a plan and write its readings."""
    from qsframework.design import broken_constraints
    from qsframework.experiment import simulate
    from qsframework.experiment.measured import keep_measured, write_simulated

    distinct_outputs([output, json, report], [file, plan_file, plan_file.with_suffix(".json")])
    keep_measured([output], "-o")
    experiment = load_experiment(file)
    plan = read_plan(plan_file, experiment)
    for constraint, poses in broken_constraints(experiment, plan).items():
        print(f"note: {', '.join(poses)} break the constraint {constraint!r}")
    result = simulate(experiment, plan, truth=truth, seed=seed, exact=exact)
    write_simulated(output, result.readings, experiment)
    if json is not None:
        write_json(json, {"readings": str(output), "seed": seed, "truth": result.truth_by_name()})
    if report is not None:
        from qsframework.report import write_report
        from qsframework.report.provenance import EQUILIBRIUM, LINEAR, computed
        from qsframework.report.simulation_section import simulation_sections

        own = computed(experiment, [file, plan_file], seed, (EQUILIBRIUM,) if exact else (LINEAR, EQUILIBRIUM))
        sections = (*simulation_sections(experiment, plan, result, exact), own)
        print(f"report: {write_report(report, f'Simulation: {experiment.robot.title}', sections)}")
    print(f"{len(result.readings.use)} readings at {len(result.readings.poses)} poses: {output}")
    print(f"next: qsf identify {file} --data {output}")


def readings_file(experiment: Experiment, data: Path | None, option: str = "--data FILE") -> Path:
    """The readings that a command works on; option: how the command is given them."""
    path = data or experiment.data
    if path is None:
        raise InputError(f"{experiment.path}: no readings; add `data: readings.csv` or give {option}")
    return path


def distinct_outputs(outputs: Sequence[Path | None], inputs: Sequence[Path]) -> None:
    """InputError, before anything is computed, where two outputs or an output and an input are one file."""
    seen = {path.resolve(): "an input" for path in inputs}
    for path in (p for p in outputs if p is not None):
        if path.resolve() in seen:
            raise InputError(f"{path} would overwrite {seen[path.resolve()]} of this command; choose another name")
        seen[path.resolve()] = "another output"


def write_json(path: Path, content: Mapping[str, Any], names: bool = False) -> None:
    """Write JSON with its format, all or nothing; names: the keys are names of robots or files, and nothing else."""
    told = dict(content) if names else {"format": FORMAT, **content}
    write_text(path, jsonlib.dumps(told, indent=2, sort_keys=True, allow_nan=False) + "\n")
