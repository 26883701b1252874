"""Effects that robot.yaml and experiment.yaml name by `file:`, which must lie in their folder and be trusted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from qsframework.errors import InputError, Problem
from qsframework.plugin import Effect, RobotFacts, build_effects
from qsframework.plugin.trusted import effect_of_file, refusal
from qsframework.robot.packages import inside


def entry_effects(
    entry: Mapping[str, Any], folder: Path, facts: RobotFacts, markers: Sequence[str] = (), *, trust: bool = False
) -> tuple[Effect, ...]:
    """The effects of one entry of a list `effects:` in a file of the folder. InputError with every problem found."""
    if "file" not in entry:
        return build_effects(entry, facts, markers)
    path = named_file(entry, folder)
    if not trust:
        raise InputError(replace(refusal(str(entry["file"])), message=f"file: {refusal(str(entry['file'])).message}"))
    name = entry.get("effect")
    if name is not None and not isinstance(name, str):
        raise InputError(Problem("effect must be the name of an effect in the file", found=repr(name)[:80]))
    kind = effect_of_file(path, name)
    others = {key: value for key, value in entry.items() if key not in ("file", "effect")}
    return build_effects({"effect": kind.effect_name(), **others}, facts, markers, kind)


def named_file(entry: Mapping[str, Any], folder: Path) -> Path:
    """The file of an entry. InputError where it is not a Python file in the folder."""
    name, problem = entry["file"], None
    if not isinstance(name, str) or not name.endswith(".py") or len(name) > 200 or "\0" in name:
        problem = "must name a Python file, such as my_effect.py"
    elif not inside(folder / name, folder):
        problem = "is outside the folder of the file that names it"
    elif not (folder / name).is_file():
        problem = f"does not exist in {folder}"
    if problem:
        raise InputError(Problem(f"file: {problem}", found=repr(name)[:80]))
    return folder / str(name)
