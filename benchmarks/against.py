"""The same jobs by an older revision and by this tree: CPU seconds and memory of whole commands, in turns.

    python benchmarks/against.py [REV] [--runs 9] [--jobs start-up,check] [--json FILE] [--quick] [--write]

The older tree is a git worktree in build/against. It runs with this interpreter and its own code in front, or in an
environment of its own where what it needs has changed since (or with --environment). Seconds and megabytes are medians;
the ratio is the median of the ratios of runs that follow each other, which a busy machine slows alike. Nothing is
subtracted: the row `start-up` says what any command takes. A command that a tree refuses has a row that says so.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from common import ROOT, Failed, Ran, middle, ran, show, table

REV = "bedeb7f"
"""The last revision with a model for plans and another for fits."""
RUNS = 9
FOLDER = ROOT / "build" / "against"
POSES = 1000
ALIKE, LESS = 1.1, 0.8
"""Goals: CPU of the new tree over that of the old one."""


@dataclass(frozen=True)
class Job:
    """A command in words that both trees know; {examples} and {made} (benchmarks/campaign.py) are the tree's own.

    ratio: the goal, CPU of the new tree over that of the old one
    """

    name: str
    what: str
    words: str
    ratio: float | None = None

    def command(self, examples: Path, made: Path) -> list[str]:
        """The arguments of `qsf`."""
        return [word.format(examples=examples, made=made) for word in self.words.split()]


M900IB = "{examples}/m900ib/experiment.yaml"
R2000IC = "identify {examples}/r2000ic/experiment.yaml"
UR10 = "identify {examples}/ur10/experiment.yaml {examples}/ur10"
DESIGN = f"design {M900IB} --poses 12 --output plan.csv"
JOBS = (
    Job("start-up", "`qsf --help`", "--help"),
    Job("r2000ic", "identify 43 displacements", R2000IC, ALIKE),
    Job("ur10-b", "identify the UR10's geometry, series B", f"{UR10}/series_b.csv", ALIKE),
    Job("ur10-d", "identify the UR10's geometry, series D", f"{UR10}/series_d.csv", ALIKE),
    Job("diagnose", "diagnose 60 poses x 3 markers", "diagnose {examples}/hidden_effect/experiment.yaml", ALIKE),
    Job("design", "design 12 poses of 1,000", DESIGN, ALIKE),
    Job("million", "design 12 poses of 1,000,000 candidates", f"{DESIGN} --candidates 500000", ALIKE),
    Job("simulate", "simulate 12 poses", f"simulate {M900IB} {{examples}}/m900ib/table5.csv --output made.csv"),
    Job("check", "check the M-900iB", "check fanuc_m900ib"),
    Job("stiffness", "stiffness of the M-900iB", "stiffness fanuc_m900ib --pose 0,20,-10,0,40,0 --load 0,0,-4000"),
    Job("campaign", "identify 61 parameters of {poses} poses x 3 markers", "identify {made}/experiment.yaml", LESS),
)


@dataclass(frozen=True)
class Side:
    """A tree and the interpreter that runs it."""

    name: str
    tree: Path
    python: str
    words: str

    @property
    def environment(self) -> dict[str, str]:
        """The tree's code before whatever the interpreter has installed."""
        return {"PYTHONPATH": os.pathsep.join([str(self.tree), str(self.tree / "plugins")])}

    def ready(self) -> Side:
        """Itself, compiled; SystemExit where its interpreter would run other code."""
        parts = ["-m", "compileall", "-q", "qsframework", "plugins"]  # or the first run would pay for it
        ran([self.python, *parts], self.tree, self.environment)
        said = subprocess.run(
            [self.python, "-c", "import qsframework, qsf_plugins; print(qsframework.__file__, qsf_plugins.__file__)"],
            env={**os.environ, **self.environment},
            cwd=FOLDER,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        if said.count(str(self.tree)) != 2:
            raise SystemExit(f"the {self.name} tree is {self.tree}, but its interpreter imports {said}")
        return self


# ---------------------------------------------------------------- the two trees


def git(*arguments: str) -> str:
    """What git says in this repository; SystemExit with its words where it fails."""
    done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"git {' '.join(arguments)}: {done.stderr.strip()}")
    return done.stdout.strip()


def needs(tree: Path) -> dict[str, Any]:
    """What an environment of the tree depends on: its pins, what it asks for, and what it registers."""
    project = tomllib.loads((tree / "pyproject.toml").read_text())["project"]
    kept = ("dependencies", "requires-python", "scripts", "entry-points")
    return {"lock": (tree / "requirements.lock").read_text()} | {key: project.get(key) for key in kept}


def old_side(revision: str, environment: bool) -> Side:
    """The older tree, made where it is missing, and its interpreter."""
    commit = git("rev-parse", "--short", f"{revision}^{{commit}}")
    tree = FOLDER / commit
    if not tree.exists():
        git("worktree", "add", "--force", "--detach", str(tree), commit)  # --force: `make clean` only took the folder
    if not environment and needs(tree) == needs(ROOT):
        return Side("old", tree, sys.executable, f"{commit}, in this interpreter").ready()
    return Side("old", tree, environment_of(tree), f"{commit}, in an environment of its own").ready()


def environment_of(tree: Path) -> str:
    """The interpreter of the tree's own environment, made from its own pins where it is missing."""
    python, stamp = tree / ".venv" / "bin" / "python", tree / ".venv" / "installed"
    if not stamp.exists():
        print(f"Installing into {tree}/.venv: one to three minutes and 1.5 GB, once", file=sys.stderr)
        subprocess.run([sys.executable, "-m", "venv", "--clear", str(tree / ".venv")], check=True)
        clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        subprocess.run(
            [str(python), "-m", "pip", "install", "--quiet", "-c", "requirements.lock", "-e", "."],
            cwd=tree,
            env={**clean, "PIP_CONSTRAINT": "requirements.lock"},
            check=True,
        )
        stamp.touch()
    return str(python)


def new_side() -> Side:
    """This tree."""
    return Side("new", ROOT, sys.executable, f"{git('describe', '--always', '--dirty')}, this tree").ready()


# ---------------------------------------------------------------- measuring


@dataclass(frozen=True)
class Row:
    """A job with all its runs in both trees, or what a tree said when it failed."""

    job: Job
    runs: Mapping[str, Sequence[Ran]]
    failed: Mapping[str, str]

    def cells(self, poses: int) -> list[str]:
        """A line of the table."""
        both = {name: middle(each) for name, each in self.runs.items() if name not in self.failed}
        cpu = [f"{both[n].cpu:.2f}" if n in both else f"failed: {self.failed[n]}" for n in ("old", "new")]
        size = [f"{both[n].memory:.0f}" if n in both else "-" for n in ("old", "new")]
        ratio = "-" if self.ratio is None else f"{self.ratio:.2f}"
        return [self.job.name, self.job.what.format(poses=f"{poses:,}"), *cpu, ratio, *size, self.goal()]

    @property
    def ratio(self) -> float | None:
        """CPU of the new tree over that of the old one, median of the pairs of runs; None where one failed."""
        if self.failed:
            return None
        return statistics.median(n.cpu / o.cpu for o, n in zip(self.runs["old"], self.runs["new"], strict=True))

    def goal(self) -> str:
        """What was promised, and whether it is kept."""
        if self.job.ratio is None:
            return ""
        wanted = f"at most {self.job.ratio:g}"
        if self.ratio is None:
            return f"{wanted}: not measured"
        return f"{wanted}: {'met' if self.ratio <= self.job.ratio else 'NOT met'}"

    def as_json(self) -> dict[str, Any]:
        """All that was measured."""
        runs = {name: [asdict(r) for r in each] for name, each in self.runs.items()}
        return {"job": self.job.name, "what": self.job.what, "runs": runs, "failed": dict(self.failed)}


def measured(
    name: str, commands: Mapping[str, Callable[[], Ran]], runs: int
) -> tuple[dict[str, list[Ran]], dict[str, str]]:
    """Runs of each tree's command, which take turns and take turns in being first; a tree that fails is let be."""
    found: dict[str, list[Ran]] = {side: [] for side in commands}
    failed: dict[str, str] = {}
    for k in range(runs):
        for side in list(commands)[:: 1 if k % 2 == 0 else -1]:
            if side in failed:
                continue
            try:
                found[side].append(commands[side]())
            except Failed as error:
                failed[side] = last_words(str(error))
                print(f"{name}, {side} tree: {error}", file=sys.stderr)
    return found, failed


def last_words(said: str) -> str:
    """The last line of an error that has words, out of the box that it may be drawn in."""
    lines = [line.strip(" │|") for line in said.splitlines()]
    return next((line for line in reversed(lines) if any(c.isalpha() for c in line)), "")[:100].replace("|", "/")


def run_job(job: Job, sides: Sequence[Side], made: Path, folder: Path, runs: int) -> Row:
    """Measure a job in both trees; each tree writes into a folder of its own."""
    commands: dict[str, Callable[[], Ran]] = {}
    for side in sides:
        line = [side.python, "-m", "qsframework", *job.command(side.tree / "examples", made / side.name)]
        own = folder / side.name
        own.mkdir(exist_ok=True)
        commands[side.name] = lambda line=line, own=own, side=side: ran(line, own, side.environment)
    return Row(job, *measured(job.name, commands, runs))


def picked(names: str) -> list[Job]:
    """The jobs of these names, all where none is said."""
    wanted = [name for name in names.split(",") if name]
    unknown = [name for name in wanted if name not in {job.name for job in JOBS}]
    if unknown:
        raise SystemExit(f"no job {', '.join(unknown)}; there are {', '.join(job.name for job in JOBS)}")
    return [job for job in JOBS if not wanted or job.name in wanted]


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", nargs="?", default=REV, metavar="REV")
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--jobs", default="", help="some of them, by comma")
    parser.add_argument("--environment", action="store_true", help="an environment of its own for the older tree")
    parser.add_argument("--json", type=Path, help="write all runs to this file")
    parser.add_argument("--quick", action="store_true", help="one run, a tenth of the poses")
    parser.add_argument("--write", action="store_true", help="write the table to docs/results.md")
    given = parser.parse_args()
    jobs, runs, poses = picked(given.jobs), 1 if given.quick else given.runs, POSES // 10 if given.quick else POSES
    FOLDER.mkdir(parents=True, exist_ok=True)
    sides = [old_side(given.revision, given.environment), new_side()]
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = folder / "made"
        # in processes of their own: this one stays small, for a command's peak memory counts from its parent's
        for side in sides:
            script = side.tree / "benchmarks" / "campaign.py"
            ran([side.python, str(script), str(made / side.name), "--poses", str(poses)], more=side.environment)
        for job in jobs:
            rows.append(run_job(job, sides, made, folder, runs))
            print(" | ".join(rows[-1].cells(poses)), file=sys.stderr, flush=True)
    head = ["job", "what", "old, CPU s", "new, CPU s", "ratio", "old, MB", "new, MB", "goal"]
    text = table(head, [row.cells(poses) for row in rows]) + f"\n\nOld: {sides[0].words}. New: {sides[1].words}."
    if given.json:
        told = {"old": sides[0].words, "new": sides[1].words, "poses": poses, "rows": [row.as_json() for row in rows]}
        given.json.write_text(json.dumps(told, indent=1) + "\n")
    some = bool(given.quick or given.jobs)
    show("against", text, given.write, some, runs)


if __name__ == "__main__":
    main()
