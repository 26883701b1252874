"""Command lines of the net whose every number, name and word is recorded: what changed without being meant to, shows.

lines.yaml holds the command lines, expected/ what they left; `make golden` runs all of them, this module the quick
ones. What is meant to change is recorded anew by `python tests/golden/golden.py --write CHAIN/LINE`, a number in a
commit of its own.
"""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
import yaml
from golden import EXPECTED, HERE, chains, hold

CHAINS, TOLERANCES = chains()
QUICK = [chain.part(chain.quick) for chain in CHAINS if chain.quick]


@pytest.mark.parametrize("chain", QUICK, ids=lambda chain: chain.name)
def test_what_the_command_lines_leave_is_what_is_recorded(chain, tmp_path: Path) -> None:
    told = [said for _, said in hold(chain, tmp_path.resolve(), TOLERANCES) if said]
    assert not told, "\n" + "\n".join(told)


def test_the_net_is_wide(root: Path) -> None:
    """All examples, all shipped robots, all commands; none is built upon what goes soon."""
    lines = [line for chain in CHAINS for line in chain.lines.values()]
    assert len(lines) >= 180
    assert sum(chain.quick for chain in CHAINS) >= 40
    said = "\n".join(lines)
    for place in ("examples", "robots"):
        for path in (p for p in (root / place).iterdir() if p.is_dir()):
            named = yaml.safe_load(path.joinpath("robot.yaml").read_text())["name"] if place == "robots" else path.name
            assert named in said or path.name == "notebook", path  # the notebook has a test of its own
    commands = {shlex.split(line)[0] for line in lines}
    from qsframework.cli.app import app

    known = {c.name or c.callback.__name__ for c in app.registered_commands if c.callback is not None}
    assert known - commands <= {"version", "help"}


def test_every_command_line_is_recorded_and_nothing_else() -> None:
    lines = {f"{chain.name}/{name}" for chain in CHAINS for name in chain.lines}
    kept = [p.relative_to(EXPECTED) for p in EXPECTED.rglob("*.*")]
    assert {p.with_suffix("").as_posix() for p in kept} == lines
    assert {p.suffix for p in kept} == {".numbers", ".words"}
    assert len(kept) == 2 * len(lines)
    assert sum((EXPECTED / p).stat().st_size for p in kept) < 3_000_000
    assert all(t.reason for t in TOLERANCES)
    assert (HERE / "inputs").is_dir()
