"""`qsf new` and `qsf check --conformance`: what they call and print."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from qsframework.cli.pairs import pairs
from qsframework.cli.printing import print_folded, print_line
from qsframework.cli.progress import progress
from qsframework.errors import InputError, Problem

if TYPE_CHECKING:
    from qsframework.robot.statics import Check


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


def _print_checks(checks: Sequence[Check]) -> list[str]:
    """Print what was found of a robot; what did not hold."""
    for check in checks:
        print_folded(f"  {'ok' if check.good else 'NO'}  {check.name}: {check.words}")
    return [f"{check.name}: {check.words}" for check in checks if not check.good]


@dataclass(frozen=True)
class NewWish:
    """Where the folder goes, which links the arm ends at, what its xacro asks for: NAME=FOLDER and NAME=VALUE, and
    whether a table of Denavit and Hartenberg is the modified one."""

    output: Path | None = None
    _: KW_ONLY
    base: str | None = None
    flange: str | None = None
    payload: float | None = None
    packages: Sequence[str] = ()
    arguments: Sequence[str] = ()
    modified: bool = False


def run_new(name: str, urdf: Path | None, wish: NewWish, table: Path | None = None) -> None:
    """Write the folder of a new robot from a URDF or a table, try it, and print what is still to be looked up."""
    from qsframework.files import write_folder
    from qsframework.robot.denavit_file import read_denavit
    from qsframework.robot.loader import load_robot
    from qsframework.robot.packages import Sources
    from qsframework.robot.scaffold import propose
    from qsframework.robot.statics import check_statics

    if not _NAME.fullmatch(name):
        raise InputError(Problem(f"name: use letters, digits, _ . and - only, found {name!r}"))
    if wish.payload is not None and not 0.0 < wish.payload < 1e5:
        raise InputError(
            Problem("--payload: no payload of a robot", found=f"{wish.payload:g} kg", allowed="above 0 kg")
        )
    file = urdf or table
    if file is None or (urdf and table):
        raise InputError(Problem("give --urdf FILE, or --dh TABLE of Denavit and Hartenberg"))
    if wish.modified and table is None:
        raise InputError(Problem("--modified: belongs to a table of Denavit and Hartenberg, --dh"))
    if not file.is_file():
        hint = "Give a URDF or xacro with --urdf, or a table with --dh."
        raise InputError(Problem("no such file", file=str(file), hint=hint))
    folder = wish.output or Path(name)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(Problem("exists already, and nothing is overwritten", file=str(folder), hint="Choose -o."))
    packages = {key: Path(value) for key, value in pairs("--package", wish.packages, "NAME=FOLDER").items()}
    missing = [
        Problem(f"--package {key}: no such folder", str(value)) for key, value in packages.items() if not value.is_dir()
    ]
    if missing:
        raise InputError(missing)
    sources = Sources(packages, pairs("--arg", wish.arguments, "NAME=VALUE"), nearby=True)
    description = file if table is None else read_denavit(table, wish.modified)
    flange = wish.flange or (None if table is None else "flange")
    proposal = propose(name, description, wish.base, flange, sources, wish.payload)
    write_folder(folder, proposal.files)
    print(f"{folder}: {', '.join(proposal.files)}")
    failed = _print_checks(check_statics(load_robot(folder)))
    print("to look up, in README.md too:")
    for note in proposal.checklist:
        print_line("", note)
    if failed:
        raise InputError([Problem(words, file=str(folder)) for words in failed])
    print(f"next: qsf check {folder} --conformance tries it with a small campaign; qsf show {folder} draws it")


_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
