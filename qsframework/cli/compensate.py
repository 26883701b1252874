"""`qsf compensate`: what it calls, prints and writes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from qsframework.applications.compensate import Compensation, compensate
from qsframework.applications.targets import flange_pose, read_targets
from qsframework.cli.commands import distinct_outputs, write_json
from qsframework.cli.progress import print_table, progress
from qsframework.experiment import Experiment, load_experiment
from qsframework.experiment.columns import write_table
from qsframework.identify.io import read_fit

_SHOWN = 20


@dataclass(frozen=True)
class CompensateFiles:
    """What the command reads and writes."""

    experiment: Path
    fit: Path
    targets: Path
    output: Path
    json: Path | None = None
    report: Path | None = None


def run_compensate(files: CompensateFiles, reference: str) -> None:
    """Correct the targets, print what is gained, write corrected.csv, the JSON and the report."""
    from qsframework.report import write_report
    from qsframework.report.compensation_section import compensation_section, target_table, target_view
    from qsframework.report.provenance import AFTER, EQUILIBRIUM, computed

    inputs = [files.experiment, files.fit, files.targets]
    distinct_outputs([files.output, files.json, files.report], inputs)
    experiment, fit = load_experiment(files.experiment), read_fit(files.fit)
    with progress() as tell:
        targets = read_targets(files.targets, experiment, tell)
        result = compensate(experiment, fit, targets, reference, tell)
    table = target_table(result)
    print_table(table.header, table.rows[:_SHOWN])
    if len(table.rows) > _SHOWN:
        print(f"... and {len(table.rows) - _SHOWN} more targets, in {files.output}")
    print(words(result))
    for note in result.notes:
        print(f"note: {note}")
    write_corrected(files.output, result, experiment)
    print(f"corrected targets: {files.output}")
    if files.json is not None:
        write_json(files.json, result.as_json())
    if files.report is not None:
        seen = target_view(experiment, result, fit.x(experiment.model()))
        sections = (compensation_section(result), seen, computed(experiment, inputs, None, (EQUILIBRIUM, AFTER)))
        print(f"report: {write_report(files.report, f'Compensation: {experiment.robot.title}', sections)}")


def words(result: Compensation) -> str:
    """What is gained, and the worst target."""
    i = result.worst
    rms = [float(np.sqrt(np.mean(v**2)) * 1e3) for v in (result.size, result.sd)]
    return (
        f"Uncorrected, the tool stands {rms[0]:.3f} mm (RMS) off its targets; corrected, {rms[1]:.4f} mm is to be "
        f"expected from the uncertainty of the fit. The largest expected error is {result.sd[i] * 1e3:.4f} mm, "
        f"at target {result.targets.name[i]}."
    )


def write_corrected(path: Path, result: Compensation, experiment: Experiment) -> None:
    """Corrected joint angles, and the pose that a controller with Cartesian targets is told instead."""
    place, turn = flange_pose(experiment, result.command)
    n = result.pendant.shape[1]
    header = ["target", *(f"q{k + 1}_deg" for k in range(n)), "x_mm", "y_mm", "z_mm", "rx_deg", "ry_deg", "rz_deg"]
    header += ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm", "uncorrected_mm", "expected_error_mm"]
    columns = [np.rad2deg(result.pendant), place * 1e3, np.rad2deg(turn), result.targets.wrench]
    numbers = np.column_stack([*columns, result.size * 1e3, result.sd * 1e3]).tolist()
    rows = [[name, *(f"{v:.6f}" for v in row)] for name, row in zip(result.targets.name, numbers, strict=True)]
    comments = [
        f"robot: {experiment.robot.name}",
        "corrected targets: give the controller either q1_deg ... or x_mm ... rz_deg of a row, not both",
    ]
    write_table(path, header, rows, comments)
