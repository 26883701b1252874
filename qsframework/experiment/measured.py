"""Does a table hold what somebody measured? Commands that write tables do not replace such a one."""

from __future__ import annotations

import csv
import hashlib
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qsframework.errors import InputError, Problem, refuse
from qsframework.experiment.columns import LARGEST, table_lines, table_text, write_table
from qsframework.experiment.readings import Made, Readings
from qsframework.experiment.readings_table import readings_table
from qsframework.experiment.setup import Experiment
from qsframework.files import read_text, sha256, write_text
from qsframework.files.formats import FORMAT

_MARK, _IMPORTED = "simulated: ", "imported: "
_TYPED = re.compile(r"(d?[xyz]|time|time_unloaded|temperature|temperature_unloaded)_.*")
"""Columns that are filled in on the measuring day."""


def write_simulated(path: str | Path, readings: Readings, experiment: Experiment) -> dict[str, Any]:
    """Write simulated readings, and beside them a .json with the model and the seed that made them; its content.

    A comment in the table says so with its hash: what is changed later no longer fits it.
    """
    header, rows = readings_table(readings, experiment)
    mark = f"{_MARK}{_hash(table_text(header, rows))}"
    path = Path(path)
    write_table(path, header, rows, [f"robot: {experiment.robot.name}", mark])
    made = readings.made or Made("equilibrium", None)
    beside = {"format": FORMAT, "model": made.model, "seed": made.seed, "readings_sha256": sha256(path)}
    write_text(path.with_suffix(".json"), json.dumps(beside, indent=2, sort_keys=True) + "\n")
    return beside


def write_imported(path: str | Path, header: Sequence[str], rows: Sequence[Sequence[str]], robot: str) -> None:
    """Write a table that was made of other files; a comment says so with its hash, as long as nobody changes it."""
    write_table(path, header, rows, [f"robot: {robot}", f"{_IMPORTED}{_hash(table_text(header, rows))}"])


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def measured_rows(path: Path) -> int:
    """Rows of a table in which a position, a displacement, a time or a temperature stands, whatever separates them.

    0 where there is no file, or an untouched one of `qsf simulate` or `qsf import`.
    InputError where the file is no text.
    """
    if not path.is_file():
        return 0
    marked = re.search(rf"^# (?:{_MARK}|{_IMPORTED})(\w+)\n", text := read_text(path, LARGEST), re.MULTILINE)
    if marked and marked[1] == _hash(text[marked.end() :]):
        return 0
    lines = [line for line in table_lines(path) if line.strip() and not line.startswith("#")]
    if not lines:
        return 0
    sign = max(",;\t", key=lines[0].count)
    header, *rows = csv.reader(lines, delimiter=sign)
    typed = [i for i, name in enumerate(header) if _TYPED.fullmatch(name.strip())]
    return sum(any(i < len(row) and row[i].strip() for i in typed) for row in rows)


def keep_measured(paths: list[Path], option: str) -> None:
    """InputError where a file to be written holds what somebody measured; option: what names another file."""
    problems: list[Problem] = []
    hint = f"Move it away, or name another file with {option}."
    for path in paths:
        try:
            rows = measured_rows(path)
        except (InputError, csv.Error):
            problems.append(Problem("would be replaced, and cannot be read as a table", str(path), hint=hint))
            continue
        if rows:
            found = f"{rows} row{'s' if rows > 1 else ''} with a position or a time filled in"
            problems.append(Problem("would be replaced, but holds readings", str(path), found=found, hint=hint))
    refuse(problems)
