"""`qsf new`: what it calls and prints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from qsframework.cli import print_checks, print_folded, print_line, print_table
from qsframework.errors import InputError, Problem

if TYPE_CHECKING:
    from qsf_onboarding.joints import ChainJoint
    from qsf_onboarding.options import Arm


def _print_chain(chain: Sequence[ChainJoint]) -> None:
    """Every joint between base and flange, and beside them: what it became, its limits as stated and as used."""

    def between(joint: ChainJoint, ends: tuple[float, float] | None) -> str:
        if ends is None:
            return ""
        low, high = (round(end * joint.unit.per, 1) + 0.0 for end in ends)
        return f"{low:g}..{high:g} {joint.unit.shown}"

    rows = [
        (j.name, j.child, str(j.fate), between(j, j.stated), between(j, j.used if j.used != j.stated else None), j.why)
        for j in chain
    ]
    print_table(("joint", "moves", "it is", "limits stated", "used, where others", "why"), rows)


def run_new(name: str, urdf: Path | None, dh: Path | None, folder: Path | None, arm: Arm) -> None:
    """Write the folder of a new robot from a URDF or a table, try it, and print what is still to be looked up."""
    from qsf_onboarding.folder import new
    from qsframework.robot.search import shadows
    from qsframework.uses.first_campaign import first_campaign

    made = new(name, urdf, dh, folder, arm, lambda robot: first_campaign(robot, "."))
    print(f"{made.folder}: {', '.join(made.files)}")
    if words := shadows(made.folder):
        print_folded(f"note: {words}, wherever an experiment stands beside it")
    _print_chain(made.chain)
    failed = print_checks(made.checks)
    print("to look up, in README.md too:")
    for note in made.checklist:
        print_line("", note)
    if failed:
        raise InputError([Problem(words, file=str(made.folder)) for words in failed])
    experiment = made.folder / "experiment.yaml"
    print(f"a first campaign, to be made yours: {experiment}")
    print(f"next: qsf design {experiment} -n 12")
    print_folded(f"qsf show {made.folder} draws it; qsf check {made.folder} --conformance tries it throughout.")
