"""docs/diagnose.md: what four commands say of one table with one wrong angle, side by side."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app

VERBS = {
    "check": "check spoiled.yaml",
    "identify": "identify spoiled.yaml --json fit.json",
    "diagnose": "diagnose spoiled.yaml",
    "certificate": "certificate spoiled.yaml fit.json --halves 3 -o certificate.html",
}


def run(line: str) -> str:
    done = CliRunner().invoke(app, line.split(), env={"COLUMNS": "1000", "TERMINAL_WIDTH": "1000"})
    return done.output + str(done.exception or "")


def spoil(folder: Path, root: Path) -> None:
    """A simulated campaign whose q3 of pose 5 is typed 20 deg off."""
    example = root / "examples" / "m900ib"
    run(f"simulate {example}/experiment.yaml {example}/table5.csv --truth drawn --seed 1 -o readings.csv")
    text = (folder / "readings.csv").read_text().splitlines()
    rows = list(csv.reader(text))
    q3 = next(row for row in rows if row[0] == "pose").index("q3_deg")
    fifth = list(dict.fromkeys(row[0] for row in rows[3:]))[4]
    for row in rows:
        if row[0] == fifth:
            row[q3] = f"{float(row[q3]) - 20:.4f}"
    (folder / "spoiled.csv").write_text("".join(",".join(row) + "\n" for row in rows))
    (folder / "spoiled.yaml").write_text((example / "experiment.yaml").read_text() + "\ndata: spoiled.csv\n")


def test_four_commands_say_the_same_of_one_spoiled_table(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    spoil(tmp_path, root)
    page = (root / "docs" / "diagnose.md").read_text()
    shown = dict(re.findall(r"^\| `qsf (\w+)` \| (.*) \|$", page, re.M))
    assert list(shown) == list(VERBS)
    printed = {verb: re.sub(r"\s+", " ", run(line)) for verb, line in VERBS.items()}
    assert shown.items() <= {v: next((p for p in [shown[v]] if p in printed[v]), printed[v]) for v in VERBS}.items()
