"""`qsf compensate`: what it calls, prints and writes."""

from __future__ import annotations

import difflib
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from qsframework.cli.commands import certificate_of_positions, distinct_outputs, load_campaign, write_json
from qsframework.cli.declared import Values
from qsframework.cli.files import CORRECTED, CompensateFiles
from qsframework.cli.printing import print_folded, print_notes, print_table, print_verdict
from qsframework.cli.progress import progress
from qsframework.errors import InputError, Problem
from qsframework.experiment import Experiment
from qsframework.experiment.columns import WRENCH_NAMES, write_table
from qsframework.files.output import write_bytes
from qsframework.fits import FitRecord, read_fit
from qsframework.fits.soundness import check_fit
from qsframework.plugin import Array
from qsframework.plugin.language import endings, is_programme, programme_files
from qsframework.uses.compensate import Compensation, compensate
from qsframework.uses.programme_targets import (
    ProgrammeOptions,
    ProgrammeTargets,
    corrected_texts,
    read_programme,
)
from qsframework.uses.targets import flange_pose, read_targets

_SHOWN = 20
_DIFF = 120
"""Lines of the difference that are shown."""


def run_compensate(
    files: CompensateFiles, reference: str, options: Values = MappingProxyType({}), anyway: bool = False
) -> None:
    """Correct the targets, print what is gained, write corrected targets or the programme, the JSON and the report.

    options: what was typed for those of a programme
    """
    programme = is_programme(files.targets)
    if any(options.values()) and not programme:
        hint = "A table of targets has columns for the forces; the other options are for programmes."
        raise InputError(Problem("is no programme", str(files.targets), allowed=", ".join(endings()), hint=hint))
    inputs = [files.experiment, files.fit, files.targets]
    outputs = [files.output]
    if programme:
        inputs, outputs = [*inputs[:2], *programme_files(files.targets)], programme_outputs(files)
    distinct_outputs([*outputs, files.json, files.report], inputs)
    experiment, fit = load_campaign(files.experiment), read_fit(files.fit)
    check_fit(fit, experiment.robot, anyway=anyway)
    made: ProgrammeTargets | None = None
    with progress() as tell:
        if programme:
            made = read_programme(files.targets, experiment, programme_options(options, experiment), tell)
        targets = read_targets(files.targets, experiment, tell) if made is None else made.targets
        result = compensate(experiment, fit, targets, reference, tell, path=programme, anyway=anyway)
    if made is not None:
        result = replace(result, notes=(*result.notes, *made.notes))
    texts = {} if made is None else corrected_texts(made, result, experiment)
    _print(result, files.output)
    if made is None:
        write_corrected(files.output, result, experiment)
        print(f"corrected targets: {files.output}")
    else:
        _programme(made, texts, outputs)
    _more(files, experiment, fit, result, inputs, {} if made is None else {"motions": made.counts})
    if result.account.positions:
        certificate = certificate_of_positions(experiment, files.fit, result.account)
        print(f"next: qsf kinematics {files.experiment} {files.fit} --urdf corrected.urdf, or {certificate}")


def _print(result: Compensation, output: Path) -> None:
    from qsframework.report.compensation_section import target_table
    from qsframework.report.words.compensation import compensation_verdict

    print_verdict(compensation_verdict(result))
    table = target_table(result)
    print_table(table.header, table.rows[:_SHOWN])
    if len(table.rows) > _SHOWN:
        print(f"... and {len(table.rows) - _SHOWN} more targets, in {output}")
    print_folded(words(result))
    print_notes(result.notes)


def _more(
    files: CompensateFiles,
    experiment: Experiment,
    fit: FitRecord,
    result: Compensation,
    inputs: list[Path],
    counts: dict[str, dict[str, int]],
) -> None:
    from qsframework.report import write_report
    from qsframework.report.compensation_section import compensation_section, target_view
    from qsframework.report.provenance import AFTER, EQUILIBRIUM, computed
    from qsframework.report.words.compensation import compensation_verdict

    if files.json is not None:
        write_json(files.json, result.as_json() | counts)
    if files.report is not None:
        seen = target_view(experiment, result, fit.x_of(experiment.model()))
        sections = (compensation_section(result), seen, computed(experiment, inputs, None, (EQUILIBRIUM, AFTER)))
        title = f"Compensation: {experiment.robot.title}"
        print(f"report: {write_report(files.report, title, sections, compensation_verdict(result))}")


def programme_outputs(files: CompensateFiles) -> list[Path]:
    """Where the corrected files go, in the order of `programme_files`. InputError for another ending."""
    endings = [p.suffix for p in programme_files(files.targets)]
    output = files.output.with_suffix(endings[0]) if files.output == CORRECTED else files.output
    if output.suffix.lower() not in [e.lower() for e in endings]:
        allowed = f"a name with {' or '.join(endings)}"
        raise InputError(Problem("a programme is written as what it is", str(files.output), allowed=allowed))
    return [output.with_suffix(e) for e in endings]


def programme_options(options: Values, experiment: Experiment) -> ProgrammeOptions:
    """What was typed, as numbers. InputError where it is none."""
    from qsframework.cli.numbers import home_pose, numbers, wrench_of

    loads: dict[str, Array] = {}
    for text in options["loads"]:
        name, _, values = text.rpartition("=")
        loads[name] = wrench_of("--load", values, experiment.robot)
    tools, frames = dict[str, Array](), dict[str, Array]()
    for option, texts, into in (("--tool", options["tools"], tools), ("--frame", options["frames"], frames)):
        for text in texts:
            name, _, values = text.partition("=")
            into[name.strip()] = numbers(option, values, (6,))
    start = options["start"] and home_pose(experiment, options["start"], "--start")
    return ProgrammeOptions(loads=loads, keep=options["keep"], tools=tools, frames=frames, start=start)


def _programme(made: ProgrammeTargets, texts: dict[Path, str], outputs: list[Path]) -> None:
    """Write the corrected files, and show what differs."""
    searched = [p for p in made.points if p.cartesian]
    if searched:
        print_folded(
            f"note: the joint angles of {len(searched)} poses, from {searched[0].name} in line {searched[0].line} on, "
            "were searched from the point before; the configuration that the programme states was not read"
        )
    counts = ", ".join(f"{count} {what}" for what, count in made.counts.items())
    print(f"{len(made.source.motions)} motions: {counts}")
    for (path, text), output in zip(texts.items(), outputs, strict=True):
        old, new = (t.replace("\r\n", "\n").split("\n") for t in (made.source.texts[path], text))
        diff = list(difflib.unified_diff(old, new, path.name, output.name, lineterm="", n=0))
        print("\n".join(diff[:_DIFF]))
        if len(diff) > _DIFF:
            print(f"... and {len(diff) - _DIFF} more lines that differ")
        write_bytes(output, text.encode(made.source.encodings[path]))
    print(f"corrected programme, read back: {', '.join(map(str, outputs))}")


def words(result: Compensation) -> str:
    """What is gained, and the worst target."""
    i = result.worst
    rms = [float(np.sqrt(np.mean(v**2)) * 1e3) for v in (result.uncorrected, result.sd)]
    return (
        f"Uncorrected, the tool stands {rms[0]:.3f} mm (RMS{result.at_level}) off its targets; corrected, "
        f"{rms[1]:.4f} mm is to be expected from the uncertainty of the fit. The largest expected error is "
        f"{result.sd[i] * 1e3:.4f} mm, at target {result.targets.name[i]}."
    )


def write_corrected(path: Path, result: Compensation, experiment: Experiment) -> None:
    """Corrected joint angles, and the pose that a controller with Cartesian targets is given instead."""
    place, turn = flange_pose(result.command)
    joints = experiment.robot.controller.units
    header = ["target", *joints.names(), "x_mm", "y_mm", "z_mm", "rx_deg", "ry_deg", "rz_deg"]
    header += [*WRENCH_NAMES, "uncorrected_mm", "by_load_mm", "without_load_mm", "expected_error_mm"]
    columns = [joints.shown(result.pendant), place * 1e3, np.rad2deg(turn), result.targets.wrench]
    sizes = (result.uncorrected, result.of_load, result.of_own, result.sd)
    numbers = np.column_stack([*columns, *(1e3 * size for size in sizes)]).tolist()
    rows = [[name, *(f"{v:.6f}" for v in row)] for name, row in zip(result.targets.name, numbers, strict=True)]
    comments = [
        f"robot: {experiment.robot.name}",
        "corrected targets: give the controller either q1, q2, ... or x_mm ... rz_deg of a row, not both",
        *([f"uncorrected_mm, without_load_mm, expected_error_mm{result.at_level}"] if result.at_level else []),
    ]
    write_table(path, header, rows, comments)
