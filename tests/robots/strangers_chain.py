"""A stranger's file through the commands that a user types, one after the other, in this process."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import typer
from strangers import STRANGERS, Stranger
from strangers_more import MORE

from qsframework.cli.app import app
from qsframework.errors import QsfError
from qsframework.robot import load_robot
from qsframework.uses.conformance import small_campaign

EVERY = (*STRANGERS, *MORE)
COMMANDS = {
    "check": "check arm --conformance",
    "design": "design experiment.yaml --poses 10 --candidates 200 --output plan.csv",
    "simulate": "simulate experiment.yaml plan.csv --output readings.csv",
    "identify": "identify experiment.yaml readings.csv --json fit.json",
    "diagnose": "diagnose experiment.yaml readings.csv",
    "export": "export experiment.yaml plan.csv --to csv --output path.csv",
}
FILES = ("arm", "experiment.yaml", "plan.csv", "readings.csv", "fit.json", "path.csv")


@dataclass(frozen=True)
class Step:
    """A command, its CPU seconds, and its refusal ("" where it did what it should)."""

    name: str
    seconds: float
    refusal: str
    output: str


def new(stranger: Stranger, folder: Path) -> Step:
    """`qsf new` on the files of a stranger, written to `folder`/given; the robot is `folder`/arm."""
    file = stranger.write(folder / "given")
    words = ["new", stranger.name, "--dh" if file.suffix == ".csv" else "--urdf", str(file), "-o", str(folder / "arm")]
    return run([*words, *stranger.options])


def chain(stranger: Stranger, folder: Path) -> Iterator[Step]:
    """All commands in turn, up to the first that refuses."""
    step = new(stranger, folder)
    yield step
    if step.refusal:
        return
    robot = load_robot(folder / "arm")
    small_campaign(robot, folder)
    for line in COMMANDS.values():
        step = run([str(folder / word) if word in FILES else word for word in line.split()])
        yield step
        if step.refusal:
            return


def run(words: list[str]) -> Step:
    """A command line of `qsf`."""
    start, out = process_time(), io.StringIO()
    refusal = ""
    with redirect_stdout(out), redirect_stderr(io.StringIO()):
        try:
            typer.main.get_command(app)(words, standalone_mode=False)
        except QsfError as error:
            refusal = str(error)
    return Step(words[0], process_time() - start, refusal, out.getvalue())
