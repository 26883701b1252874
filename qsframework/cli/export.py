"""`qsf export`: what it calls and prints."""

from __future__ import annotations

import json as json_module
from dataclasses import replace
from pathlib import Path

import numpy as np

from qsframework.applications.export import ENDINGS, export, written
from qsframework.applications.options import ExportOptions
from qsframework.applications.ordering import with_repeats
from qsframework.applications.programme import Programme, draft, make_programme
from qsframework.cli.commands import beside, distinct_outputs, load_campaign, load_plan, write_json
from qsframework.cli.printing import print_folded, print_notes
from qsframework.cli.progress import progress
from qsframework.errors import InputError, Problem
from qsframework.experiment import Experiment, Plan
from qsframework.files import read_text
from qsframework.plugin import Array


def run_export(plan_file: Path, file: Path, output: Path, options: ExportOptions, json: Path | None) -> None:
    """Order and check the plan, write it for the controller."""
    pause = None if options.hold else options.pause
    endings = ENDINGS.get(options.to, ())
    outputs = [beside(output, s) for s in endings] if len(endings) > 1 else [output]
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


def plan_of(file: Path, experiment: Experiment) -> Plan:
    """A plan for the real robot: InputError where it, or the proof beside it, names another robot."""
    plan, beside, name = load_plan(file, experiment), file.with_suffix(".json"), experiment.robot.name
    if beside.is_file():
        named = json_module.loads(read_text(beside)).get("robot", name)
        if named != name:
            hint = "Name the experiment of the robot that the plan was made for."
            raise InputError(
                Problem("the plan is of another robot", str(beside), found=str(named), allowed=name, hint=hint)
            )
    return plan


def home_pose(experiment: Experiment, text: str, option: str = "--home") -> Array:
    """Pendant angles (n,) rad of an option."""
    from qsframework.cli.numbers import numbers

    robot = experiment.robot
    units = robot.controller.units
    pendant = units.si(numbers(option, text, (robot.controller.axes,)))
    outside = np.flatnonzero(robot.controller.outside(pendant[None])[0])
    if len(outside):
        k = int(outside[0])
        allowed = units[k].between(*robot.controller.range_of(k))
        message = f"{option}: {robot.facts.driven[k]} is outside its limits"
        raise InputError(Problem(message, found=units[k].text(pendant[k]), allowed=allowed))
    return pendant


def words(programme: Programme) -> str:
    """How long the way is, and what lies in between."""
    measured = sum(m.measured for m in programme.moves)
    way, before = np.rad2deg([programme.length, programme.length_as_planned])
    text = f"{measured} stops to measure, {programme.vias} more to drive by. The way turns the busiest joint by "
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
