"""The example of a day says what its README says, and is what its maker writes."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

DAY = ["--cycles", "1", "--no-half", "--repeat-share", "0", "--once"]


def test_the_fifth_visit_is_to_be_looked_at(root: Path, tmp_path: Path) -> None:
    example = root / "examples" / "day"
    files = [str(example / "experiment.yaml"), str(example / "plan.csv")]
    command = [sys.executable, "-m", "qsframework", "day", *files, "-o", str(tmp_path), *DAY]
    exports = shutil.copytree(example / "exports", tmp_path / "exports")
    for k, path in enumerate(sorted(exports.iterdir(), reverse=True)):  # a copy's times say nothing
        os.utime(path, ns=(0, 1_700_000_000_900_000_000 + 100_000_000 * k))
    done = subprocess.run([*command, "--watch", str(exports)], capture_output=True, text=True, timeout=600, check=True)
    lines = [line for line in done.stdout.splitlines() if line.startswith("visit_")]
    assert lines == sorted(lines, key=lambda line: line[:7])
    assert done.stdout.count("as expected.") == 12
    assert done.stdout.count("q3 is +2.0") == 3
    assert len((tmp_path / "readings.csv").read_text().splitlines()) == 3 + 15 * 3


def test_the_example_is_what_its_maker_writes(root: Path, tmp_path: Path) -> None:
    maker = root / "benchmarks" / "make_day_example.py"
    subprocess.run([sys.executable, str(maker), "--folder", str(tmp_path)], check=True, timeout=600)
    for path in sorted((root / "examples" / "day").rglob("*.*")):
        made = tmp_path / path.relative_to(root / "examples" / "day")
        if path.name != "plan.json":  # it holds versions and hashes
            assert made.read_text() == path.read_text(), path.name


def test_an_empty_folder_is_looked_at_once(root: Path, tmp_path: Path) -> None:
    example = root / "examples" / "day"
    files = [str(example / "experiment.yaml"), str(example / "plan.csv")]
    command = [sys.executable, "-m", "qsframework", "day", *files, "-o", str(tmp_path / "day"), *DAY]
    (tmp_path / "exports").mkdir()
    done = subprocess.run(
        [*command, "--watch", "exports"], cwd=tmp_path, capture_output=True, text=True, timeout=600, check=True
    )
    assert "exports: the folder is empty" in done.stdout
