"""`qsf new` and `qsf check --conformance`: what they call and print."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from qsframework.cli.printing import print_folded, print_line
from qsframework.cli.progress import progress
from qsframework.errors import InputError, Problem

if TYPE_CHECKING:
    from qsframework.robot.new import Arm
    from qsframework.robot.statics import GravityCheck


def run_conformance(files: Sequence[Path]) -> None:
    """Try every robot with everything; InputError that lists what did not hold."""
    from qsframework.applications.conformance import check_robot

    failed: list[str] = []
    for file in files:
        with progress() as tell:
            checks = check_robot(file, progress=tell)
        failed += [f"{file}: {words}" for words in _print_checks(checks)]
    if failed:
        raise InputError([Problem(words) for words in failed])


def _print_checks(checks: Sequence[GravityCheck]) -> list[str]:
    """Print what was found of a robot; what did not hold."""
    for check in checks:
        print_folded(f"  {'ok' if check.good else 'NO'}  {check.name}: {check.words}")
    return [f"{check.name}: {check.words}" for check in checks if not check.good]


def run_new(name: str, urdf: Path | None, dh: Path | None, folder: Path | None, arm: Arm) -> None:
    """Write the folder of a new robot from a URDF or a table, try it, and print what is still to be looked up."""
    from qsframework.robot.new import new

    made = new(name, urdf, dh, folder, arm)
    print(f"{made.folder}: {', '.join(made.files)}")
    failed = _print_checks(made.checks)
    print("to look up, in README.md too:")
    for note in made.checklist:
        print_line("", note)
    if failed:
        raise InputError([Problem(words, file=str(made.folder)) for words in failed])
    print(
        f"next: qsf check {made.folder} --conformance tries it with a small campaign; qsf show {made.folder} draws it"
    )
