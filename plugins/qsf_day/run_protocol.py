"""`qsf protocol`: what it calls and prints."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from qsf_day.options import ProtocolOptions
from qsf_day.protocol import (
    Protocol,
    make_protocol,
    write_floor_file,
    write_reading_file,
)
from qsframework.cli import beside, distinct_outputs, load_campaign, plan_of, print_folded, print_notes
from qsframework.experiment import floor_file, keep_measured


def _states(protocol: Protocol) -> str:
    """How the states of a protocol are read: in differences, unless positions are planned."""
    return " --states differences" if all(v.load for v in protocol.visits) else ""


def run_protocol(file: Path, plan_file: Path, sheet: Path, readings: Path, options: ProtocolOptions) -> None:
    """Write the sheet and the files to fill in."""
    from qsf_day.sheet import Commands, SheetFiles, turning_words, write_sheet
    from qsf_day.sketch import sketches

    floor = floor_file(readings) if readings.name else readings
    distinct_outputs([sheet, readings, floor], [file, plan_file, beside(plan_file, ".json")])
    keep_measured([readings, floor], "--readings")
    experiment = load_campaign(file)
    plan = plan_of(plan_file, experiment)
    protocol = make_protocol(experiment, plan, options, str(plan_file))
    commands = Commands(
        programme=f"exported with --order {options.order} --seed {options.seed} --repeat-share "
        f"{options.repeat_share:g} --hold",
        warm_up="exported without --hold it drives on by itself",
        identify=f"qsf identify EXPERIMENT{_states(protocol)}",
    )
    pendant = np.stack([v.pendant for v in protocol.visits])
    force = np.stack([v.wrench[:3] for v in protocol.visits])
    pictures = sketches(experiment.robot, experiment.load_site, pendant, force)
    files = SheetFiles(readings.name, floor.name, (file, plan_file))
    write_sheet(sheet, protocol, pictures, files, commands)
    write_reading_file(readings, protocol)
    print(f"{len(protocol.visits)} visits, {protocol.readings} readings, about {protocol.hours:.1f} hours: {sheet}")
    print_folded(turning_words(protocol))
    print_notes(protocol.notes)
    print(f"to fill in: {readings}")
    if options.reflectors:
        write_floor_file(floor, protocol)
        print(f"to fill in: {floor}")
    filled = f"`data: {readings.name}` in {file.name}, then qsf check {file}"
    print(f"next: {filled}; try it before: qsf simulate {file} {plan_file}")
