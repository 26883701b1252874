"""`qsf new` and `qsf check --conformance`: what they call and print."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qsframework.cli.progress import progress
from qsframework.errors import InputError, Problem


def run_conformance(files: Sequence[Path]) -> None:
    """Try every robot with everything; InputError that lists what did not hold."""
    failed = [f"{file}: {words}" for file in files for words in try_robot(file)]
    if failed:
        raise InputError([Problem(words) for words in failed])


def try_robot(robot: Path) -> list[str]:
    """Print what was found of a robot; what did not hold."""
    from qsframework.applications.conformance import check_robot

    with progress() as tell:
        checks = check_robot(robot, progress=tell)
    for check in checks:
        print(f"  {'ok' if check.good else 'NO'}  {check.name}: {check.words}")
    return [f"{check.name}: {check.words}" for check in checks if not check.good]
