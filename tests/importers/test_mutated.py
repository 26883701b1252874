"""Exports that were changed at random end in readings or in an error of the user's file, never in anything else."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest
import samples
from layouts import LAYOUTS
from samples import FORMATS, Campaign

from qsf_trackers import ImportOptions, import_readings
from qsframework.cli.pairs import pairs
from qsframework.errors import InputError

PIECES = (
    "",
    "0",
    "-1e400",
    "nan",
    "1,5",
    "1.5.5",
    "p01",
    "m2_loaded",
    "\t",
    ";",
    '"',
    "\x00",
    "\u0661",
    "mm",
    "[in]",
    "\n",
    "::",
)


def mutated(content: bytes, rng: random.Random) -> bytes:
    """A few bytes, cells or lines taken out, doubled, or put in."""
    text = content.decode("latin-1")
    for _ in range(rng.randint(1, 4)):
        lines = text.splitlines(keepends=True) or [""]
        k = rng.randrange(len(lines))
        kind = rng.randrange(5)
        if kind == 0:
            del lines[k]
        elif kind == 1:
            lines.insert(k, lines[rng.randrange(len(lines))] if lines else "x")
        elif kind == 2:
            cut = rng.randrange(len(lines[k]) + 1)
            lines[k] = lines[k][:cut] + rng.choice(PIECES) + lines[k][cut + rng.randint(0, 5) :]
        elif kind == 3:
            lines = lines[:k]
        else:
            a, b = rng.choice(",;\t .:"), rng.choice(",;\t .:")
            lines = [line.replace(a, b) for line in lines]
        text = "".join(lines)
    return text.encode("latin-1", errors="replace")


@pytest.mark.parametrize("name", [*FORMATS, "fanuc", "kuka", "ros"])
def test_mutated_exports(name: str, tmp_path: Path) -> None:
    c = samples.make_campaign(tmp_path)
    logs: dict[str, Callable[[Campaign], Path]] = {
        "fanuc": samples.fanuc_log,
        "kuka": samples.kuka_log,
        "ros": samples.ros_log,
    }
    make, stated = (FORMATS[name][0], FORMATS[name][1]) if name in FORMATS else (logs[name], ())
    others = [] if name in FORMATS else [samples.tracker_pilot(c)]
    path = make(c)
    content = path.read_bytes()
    rng = random.Random(name)
    columns = pairs("--map", stated[1:2], "ROLE=COLUMN")
    options = ImportOptions(columns=columns, names={}, join="time" if name in ("kuka", "ros") else "", align="unloaded")
    taken, nameless = 0, list[object]()
    for _ in range(40):
        path.unlink()  # what is written into an old file waits for the disk
        path.write_bytes(mutated(content, rng))
        try:
            taken += len(import_readings(c.experiment, [*others, path], tmp_path / "plan.csv", options).readings) > 0
        except InputError as error:
            nameless += [p for p in error.problems if not (p.file or p.found)]
    assert taken < 40
    assert nameless == []


@pytest.mark.parametrize("what", LAYOUTS)
def test_mutated_layouts(what: str, tmp_path: Path) -> None:
    """The same of every layout, taken in the order of the plan."""
    c = samples.make_campaign(tmp_path)
    paths = [a for a in LAYOUTS[what](c) if isinstance(a, Path)]
    content, rng = paths[-1].read_bytes(), random.Random(what)
    options = ImportOptions(columns={}, names={}, units=("mm", "rad"), match="order", join="order")
    nameless: list[object] = []
    for _ in range(12):
        paths[-1].unlink()
        paths[-1].write_bytes(mutated(content, rng))
        try:
            import_readings(c.experiment, paths, tmp_path / "plan.csv", options)
        except InputError as error:
            nameless += [p for p in error.problems if not (p.file or p.found)]
    assert nameless == []
