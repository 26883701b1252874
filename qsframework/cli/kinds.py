"""What a file is, known by what stands in it: every verb is `qsf VERB EXPERIMENT [FILES...]`, in any order of files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from qsframework.errors import InputError, Problem

_HEADS = {"marker": "readings", "target": "targets"}
"""Columns that only one kind of table has; other tables of poses are plans."""
_HEAD = 1_000_000
"""Bytes of a file in which it says what it is: tables may be long."""


def kind(path: Path) -> str:
    """experiment, fit, readings, targets or plan; "" for what cannot be read, or is none of these."""
    if path.suffix == ".json" or not path.is_file():
        return "fit" if path.suffix == ".json" else ""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD).decode("utf-8-sig", errors="ignore")
    except OSError:  # told by who reads it
        return ""
    lines = [line for line in head.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        return ""
    if lines[0].lstrip().startswith("{"):
        return "fit"
    if any(line.startswith("robot:") for line in lines):
        return "experiment"
    header = {cell.strip() for cell in lines[0].split(",")}
    return next((k for column, k in _HEADS.items() if column in header), "plan" if "pose" in header else "")


def sorted_out(files: Sequence[Path], one: Sequence[str], rest: str) -> Mapping[str, list[Path]]:
    """Files by kind: at most one each of some kinds, and all others as `rest`, whose reader says what is wrong."""
    out: dict[str, list[Path]] = {name: [] for name in (*one, rest)}
    for file in files:
        found = kind(file)
        out[found if found in one and not out[found] else rest].append(file)
    return out


def the_fit(files: Mapping[str, list[Path]], command: str) -> Path:
    """The one fit among the files of a command. InputError where there is none."""
    if not files["fit"]:
        raise InputError(Problem(f"none of the files is a fit; qsf {command}", hint="qsf identify --json makes one."))
    return files["fit"][0]
