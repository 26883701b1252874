"""`qsf export`: what it calls and prints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from qsf_controllers.export import endings, export, written
from qsf_controllers.options import ExportOptions
from qsframework.cli import (
    beside,
    distinct_outputs,
    home_pose,
    load_campaign,
    plan_of,
    print_folded,
    print_notes,
    progress,
    write_json,
)
from qsframework.plans import draft, make_programme, with_repeats
from qsframework.plugin import Programme


def run_export(plan_file: Path, file: Path, output: Path, options: ExportOptions, json: Path | None) -> None:
    """Order and check the plan, write it for the controller."""
    pause = None if options.hold else options.pause
    outputs = [beside(output, s) for s in endings(options.to)] if len(endings(options.to)) > 1 else [output]
    distinct_outputs([*outputs, json], [file, plan_file, beside(plan_file, ".json")])
    experiment = load_campaign(file)
    plan = with_repeats(plan_of(plan_file, experiment), options.repeat_share, options.seed)
    home = None if options.home is None else home_pose(experiment, options.home)
    named = {"tool": options.tool, "frame": options.frame}
    written(
        replace(draft(experiment, plan, options.speed, pause), **named), options.to, output
    )  # refused before the work
    with progress() as tell:
        programme = make_programme(
            experiment, plan, options.order, options.seed, options.speed, pause, home, tell, str(plan_file)
        )
    files = export(replace(programme, **named), options.to, output)
    print_folded(words(programme))
    print_notes(programme.notes)
    print("written: " + ", ".join(map(str, files)))
    days = " or ".join(f"qsf {day} {file} {plan_file}" for day in ("protocol", "day"))
    print(f"next: the measuring day, on paper or on a screen: {days}")
    if json is not None:
        write_json(json, as_json(programme, options, files))


def words(programme: Programme) -> str:
    """How long the way is, and what lies in between."""
    measured = sum(m.measured for m in programme.moves)
    way, before = np.rad2deg([programme.length, programme.length_as_planned])
    text = f"{measured} stops to measure, {programme.vias} via points. The way turns the busiest joint by "
    text += f"{way:.0f} deg in all{', from home and back' if programme.home else ''}"
    return text + f"; the plan's own order asks {before:.0f} deg before any detour."


def as_json(programme: Programme, options: ExportOptions, files: tuple[Path, ...]) -> dict[str, object]:
    """The sequence as the file holds it."""
    return {
        "robot": programme.robot,
        "files": [str(f) for f in files],
        "order": options.order,
        "seed": options.seed,
        "speed_percent": programme.speed,
        "pause_s": programme.pause,
        "way_deg": float(np.rad2deg(programme.length)),
        "way_as_planned_deg": float(np.rad2deg(programme.length_as_planned)),
        "stops": [
            {
                "pose": m.pose,
                "visit": m.repeat,
                **programme.units.fields("q", m.pendant),
                "load": m.load,
            }
            for m in programme.moves
        ],
        "notes": list(programme.notes),
    }
