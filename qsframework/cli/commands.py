"""What each command calls and prints."""

from __future__ import annotations

import json as jsonlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qsframework.cli.progress import print_table
from qsframework.errors import InputError, Problem
from qsframework.experiment import (
    Experiment,
    Readings,
    StateReadings,
    is_states,
    load_experiment,
    read_plan,
    read_readings,
    read_states,
    write_readings,
)
from qsframework.files import write_text


def list_robots(json: Path | None) -> None:
    """Name and title of every robot on the search path."""
    from qsframework.robot import load_robot, robot_names

    rows = tuple((name, load_robot(name).title) for name in robot_names())
    print_table(("robot", "title"), rows)
    if json is not None:
        write_json(json, dict(rows))


def check_files(files: Sequence[Path], json: Path | None) -> None:
    """Load each file; raise one InputError with the problems of all."""
    problems: list[Problem] = []
    words: dict[str, str] = {}
    for file in files:
        try:
            words[str(file)] = _check(file)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    for name, said in words.items():
        print(f"{name}: {said}")
    if json is not None:
        write_json(json, words)


def _check(file: Path) -> str:
    from qsframework.robot import load_robot, robot_names

    if str(file) in robot_names() or file.name == "robot.yaml" or file.is_dir():
        robot = load_robot(file)
        return f"robot {robot.name}, {robot.facts.n} joints, {len(robot.parameters)} parameters, ok"
    experiment = load_experiment(file)
    words = f"experiment with {experiment.robot.name}, {len(experiment.markers)} markers"
    if experiment.data is not None:
        read = read_states if is_states(experiment.data) else read_readings
        readings = read(experiment.data, experiment)
        words += f", {len(readings.use)} readings at {len(readings.poses)} poses"
        if isinstance(readings, Readings):
            from qsframework.identify import check_readings

            found = check_readings(experiment, readings)
            if found:
                return words + ", ok, but look at" + "".join(f"\n  {f.kind}: {f.words}" for f in found)
        else:
            lines = _state_lines(experiment, readings)
            if lines:
                bad = any(line.startswith(_MARK[False]) for line in lines)
                head = ", ok, but look at what is marked with !" if bad else ", ok"
                return words + head + "".join(f"\n  {line}" for line in lines)
    return words + ", ok"


def _state_lines(experiment: Experiment, states: StateReadings) -> list[str]:
    """What the states of a measuring day say, and the positions that cannot be right."""
    from qsframework.applications.closure import check_states
    from qsframework.identify import check_positions

    checks = [f"{_MARK[c.good]} {c.kind}: {c.words}" for c in check_states(experiment, states)]
    return checks + [f"{_MARK[False]} {f.kind}: {f.words}" for f in check_positions(experiment, states)]


_MARK = {True: " ", False: "!", None: "?"}
"""Before what `qsf check` says of states: as it should be, look at it, not measured."""


def run_simulate(
    file: Path, plan_file: Path, output: Path, truth: str, seed: int, json: Path | None, exact: bool = False
) -> None:
    """Simulate a plan and write its readings."""
    from qsframework.design import broken_constraints
    from qsframework.experiment import simulate

    experiment = load_experiment(file)
    distinct_outputs([output, json], [file, plan_file, plan_file.with_suffix(".json")])
    plan = read_plan(plan_file, experiment)
    for constraint, poses in broken_constraints(experiment, plan).items():
        print(f"note: {', '.join(poses)} break the constraint {constraint!r}")
    result = simulate(experiment, plan, truth=truth, seed=seed, exact=exact)
    write_readings(output, result.readings, experiment)
    if json is not None:
        write_json(json, {"readings": str(output), "seed": seed, "truth": result.truth_by_name()})
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


def write_json(path: Path, content: Any) -> None:
    """Write JSON, all or nothing."""
    write_text(path, jsonlib.dumps(content, indent=2, sort_keys=True, allow_nan=False) + "\n")
