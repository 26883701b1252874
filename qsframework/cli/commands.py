"""What commands share: readings that they work on, outputs that are nobody else's, JSON."""

from __future__ import annotations

import json as jsonlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qsframework.cli.printing import print_folded
from qsframework.errors import InputError, Problem
from qsframework.files import read_text, write_text
from qsframework.files.formats import FORMAT

if TYPE_CHECKING:
    from qsframework.experiment import Experiment, Plan
    from qsframework.experiment.account import Account
    from qsframework.robot import Robot


def load_campaign(path: Path) -> Experiment:
    """The experiment of a command, with a line on its robot where that is not the shipped one of its name."""
    from qsframework.experiment import load_experiment

    experiment = load_experiment(path)
    note_folders(experiment.robot)
    return experiment


def note_folders(*robots: Robot) -> None:
    """A line on each robot whose folder is read in place of the shipped one of its name."""
    from qsframework.robot.search import shadows

    print_folded(*(f"note: {words}" for robot in robots if (words := shadows(robot.folder))))


def load_plan(path: Path, experiment: Experiment) -> Plan:
    """The plan of a command, with a line on what changed since it was made."""
    from qsframework.experiment.plan import changed_since, read_plan

    plan = read_plan(path, experiment)
    if parts := changed_since(path, experiment):
        words = f"the {' and the '.join(parts)} changed since {path} was made"
        print_folded(f"note: {words}: its proof is of another campaign; qsf design makes it anew")
    return plan


def plan_of(file: Path, experiment: Experiment) -> Plan:
    """A plan for the real robot: InputError where it, or the proof beside it, names another robot."""
    plan, proof, name = load_plan(file, experiment), file.with_suffix(".json"), experiment.robot.name
    if proof.is_file():
        named = jsonlib.loads(read_text(proof)).get("robot", name)
        if named != name:
            hint = "Name the experiment of the robot that the plan was made for."
            raise InputError(
                Problem("the plan is of another robot", str(proof), found=str(named), allowed=name, hint=hint)
            )
    return plan


def readings_files(experiment: Experiment, data: Sequence[Path], option: str = "FILE...") -> tuple[Path, ...]:
    """The readings that a command works on; option: how the command is given them."""
    paths = tuple(data) or experiment.data
    if not paths:
        raise InputError(f"{experiment.path}: no readings; add `data: readings.csv` or give {option}")
    hint = f"`data:` of {experiment.path} names it: change it there if the folder was moved, or give {option}."
    gone = [Problem("no such file", str(p), hint=hint) for p in experiment.data if not data and not p.is_file()]
    if gone:
        raise InputError(gone)
    return paths


def certificate_of_positions(experiment: Experiment, fit: Path, account: Account) -> str:
    """The command that certifies a fit of positions with the readings that it is from."""
    own = {path.resolve() for path in experiment.data}
    used = [(experiment.path.parent.resolve() / file.path).resolve() for file in account.files]
    files = [] if set(used) <= own else [os.path.relpath(path, Path.cwd().resolve()) for path in used]
    return " ".join(["qsf certificate", str(experiment.path), str(fit), *files, "-o certificate.html"])


_DESCRIBES = {".yaml", ".yml", ".urdf", ".xacro", ".stl", ".dae", ".obj"}
_DEEP = 3
"""Folders above a file of a robot in which its robot.yaml may lie: meshes have folders of their own."""


def distinct_outputs(outputs: Sequence[Path | None], inputs: Sequence[Path], folder: Path | None = None) -> None:
    """InputError, before anything is computed, for an output that cannot be written or is another or an input, too.

    folder: one more output, which may be a folder that exists
    """
    named = [path for path in (*outputs, folder) if path is not None]
    problems = [p for path in named for p in _unwritable(path) if path is not folder or not path.is_dir()]
    if problems:
        raise InputError(problems)
    seen = {path.resolve(): "an input of this command" for path in inputs}
    for path in named:
        other = seen.get(path.resolve()) or _linked(path, inputs)
        if other:
            raise InputError(f"{path} would overwrite {other}; choose another name")
        if robot := _robot_of(path):
            raise InputError(f"{path} would overwrite a file of the robot in {robot}; choose another name")
        owner = path.with_suffix(".csv")
        own = path.suffix == ".json" and owner.resolve() in seen
        seen[path.resolve()] = f"what is written beside {owner}" if own else "another output of this command"


def _linked(path: Path, inputs: Sequence[Path]) -> str:
    """Which input a file is by another name, a hard link; "" where it is none."""
    same = [other for other in inputs if path.exists() and other.exists() and path.samefile(other)]
    return f"{same[0]}, an input of this command" if same else ""


def _robot_of(path: Path) -> Path | None:
    """The folder of the robot that an existing file describes; None of others."""
    if not path.is_file() or path.suffix.lower() not in _DESCRIBES:
        return None
    own = path.suffix.lower() not in (".yaml", ".yml") or path.name in ("robot.yaml", "nominal.yaml")
    return next((p for p in path.absolute().parents[:_DEEP] if own and (p / "robot.yaml").is_file()), None)


def beside(path: Path, ending: str) -> Path:
    """The file of this ending beside an output; itself where it has no name, for that is a folder."""
    return path.with_suffix(ending) if path.name else path


def _unwritable(path: Path) -> list[Problem]:
    """Why a file could not be written there: it is a folder, it lies in a file, or nobody may write there."""
    if path.is_dir():
        hint = f"Name a file, such as {path / 'name'} with its ending."
        return [Problem("cannot be written: this is a folder", str(path), hint=hint)]
    if path.exists() and not path.is_file():
        return [Problem("cannot be written: this is no ordinary file", str(path))]
    above = next(p for p in path.absolute().parents if p.exists())
    if not above.is_dir():
        return [Problem(f"cannot be written: {above} is a file, not a folder", str(path))]
    if not os.access(above, os.W_OK | os.X_OK):
        return [Problem(f"cannot be written: nothing may be written in {above}", str(path))]
    return []


def write_json(path: Path, content: Mapping[str, Any], names: bool = False) -> None:
    """Write JSON with its format, all or nothing; names: the keys are names of robots or files, and nothing else."""
    whole = dict(content) if names else {"format": FORMAT, **content}
    write_text(path, jsonlib.dumps(whole, indent=2, sort_keys=True, allow_nan=False) + "\n")
