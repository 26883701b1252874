"""`tests/long.yaml` names tests and cases that are there, and leaves `make test` a case of each."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import yaml

LONG = yaml.safe_load((Path(__file__).parents[1] / "long.yaml").read_text())


def test_what_is_long_is_there_and_has_a_case_at_every_change(root: Path) -> None:
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", *(f"tests/{file}" for file in LONG)]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=600)
    every = [line.removeprefix("tests/") for line in done.stdout.splitlines() if "::" in line]
    for file, tests in LONG.items():
        names = {name.partition("[")[0].partition("::")[2] for name in every if name.startswith(f"{file}::")}
        assert names >= tests.keys(), (file, tests.keys() - names)
        assert names > tests.keys() or any(tests.values()), f"{file}: nothing is left at every change"
        cases = [f"{file}::{test}[{case}]" for test, kept in tests.items() for case in kept]
        assert not set(cases) - set(every), set(cases) - set(every)
