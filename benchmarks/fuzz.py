"""The long runs of spoiled files, 100,000 of them, and of whole commands, 30,000: records in docs/results.md.

    python benchmarks/fuzz.py                 # go on where the last run stopped, then write the records
    python benchmarks/fuzz.py commands        # only the commands, or only the files
    python benchmarks/fuzz.py --share 0.01    # a hundredth of it, to see that it works; no record
    python benchmarks/fuzz.py --again URDF    # forget what was found of a format or a command, and try it anew
    python benchmarks/fuzz.py commands --renew 0.4   # try the first 40 % again where another commit was tried

Inputs are tried in chunks, each in a process of its own with 4 GB of memory at most; what a chunk found is kept in
build/fuzz.jsonl, so that a run that is stopped goes on. A chunk with a fault is tried again at another commit. What is
tried, and what counts as a fault, is in tests/robustness/fuzzing.py and command_lines.py.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "robustness"))
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"
import command_lines  # noqa: E402
import fuzzing  # noqa: E402
from common import replace_between, shelved  # noqa: E402

FILES = {
    "robot.yaml": 6000,
    "nominal.yaml": 5000,
    "URDF": 9000,
    "xacro": 3000,
    "a stranger's URDF": 1000,
    "a stranger's table": 1000,
    "experiment.yaml": 14000,
    "plan.csv": 16000,
    "readings.csv": 12000,
    "states.csv": 6000,
    "controller programmes": 6000,
    "fit.json": 8000,
    "task.yaml": 6000,
    "plan.json": 9000,
    "targets.csv": 4000,
}
COMMANDS = {
    "qsf demo": 100,
    "qsf robots": 300,
    "qsf check": 2500,
    "qsf stiffness": 2600,
    "qsf show": 2500,
    "qsf design": 2400,
    "qsf simulate": 2600,
    "qsf identify": 2500,
    "qsf validate": 2200,
    "qsf diagnose": 1000,
    "qsf compensate": 2500,
    "qsf kinematics": 1800,
    "qsf certificate": 1700,
    "qsf export": 1700,
    "qsf protocol": 1200,
    "qsf day": 600,
    "qsf import": 1700,
    "qsf compare": 900,
    "qsf new": 1300,
}
COUNTS = FILES | COMMANDS
FIRST_SEED = 1_000_000
"""Away from the seeds of the tests."""
CHUNK = 100
MEMORY = 4 * 1024**3
STATE, PAGE = ROOT / "build" / "fuzz.jsonl", ROOT / "docs" / "results.md"
START, STOP = "<!-- record of benchmarks/fuzz.py -->", "<!-- end of the record -->"
START_COMMANDS, STOP_COMMANDS = "<!-- record of commands -->", "<!-- end of the record of commands -->"
Goods = list[fuzzing.Good] | command_lines.Commands


@dataclass
class Tally:
    """What is known of one format."""

    outcomes: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    slowest: float = 0.0
    slowest_seed: int = 0
    memory: float = 0.0
    commits: Counter[str] = field(default_factory=Counter)
    faults: list[dict[str, Any]] = field(default_factory=list)

    def add(self, chunk: dict[str, Any]) -> None:
        self.outcomes.update(chunk["outcomes"])
        self.seconds += chunk["seconds"]
        self.memory = max(self.memory, chunk["memory_mb"])
        self.faults += chunk["faults"]
        self.commits[chunk["commit"]] += sum(chunk["outcomes"].values())
        if chunk["slowest"] > self.slowest:
            self.slowest, self.slowest_seed = chunk["slowest"], chunk["slowest_seed"]


def try_chunk(goods: Goods, seeds: range) -> dict[str, Any]:
    """All inputs of a chunk, in this process."""
    outcomes: Counter[str] = Counter()
    faults, slowest, slowest_seed = [], 0.0, 0
    for seed in seeds:
        found = fuzzing.try_seed(goods, seed) if isinstance(goods, list) else goods.try_seed(seed)
        outcomes[found.outcome.value] += 1
        if found.seconds > slowest:
            slowest, slowest_seed = found.seconds, seed
        if found.outcome is fuzzing.Outcome.FAULT:
            faults.append({"seed": seed, "words": found.words})
    return {"outcomes": outcomes, "faults": faults, "slowest": slowest, "slowest_seed": slowest_seed}


def in_own_process(goods: Goods, seeds: range) -> dict[str, Any]:
    """What a chunk found; a process that dies is a fault of its chunk."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "found.json"
        child = os.fork()
        if child == 0:
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            try:
                out.write_text(json.dumps(try_chunk(goods, seeds)))
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(0)
        _, status, usage = os.wait4(child, 0)
        if out.exists():
            found = json.loads(out.read_text())
        else:
            words = f"the process of seeds {seeds.start} to {seeds.stop - 1} died with status {status}"
            found = {"outcomes": {"fault": len(seeds)}, "faults": [{"seed": seeds.start, "words": words}]}
            found |= {"slowest": 0.0, "slowest_seed": seeds.start}
    return found | {"seconds": time.perf_counter() - started, "memory_mb": usage.ru_maxrss / 1024}


def read_state() -> dict[str, dict[int, dict[str, Any]]]:
    """Chunks that were tried, by format and first seed."""
    done: dict[str, dict[int, dict[str, Any]]] = {name: {} for name in COUNTS}
    for line in STATE.read_text().splitlines() if STATE.exists() else []:
        chunk = json.loads(line)
        done[chunk["format"]][chunk["first"]] = chunk
    return done


def run(counts: dict[str, int], share: float, renew: float) -> dict[str, Tally]:
    """Try what has not been tried yet; of a share of it, what has not been tried at this commit."""
    done, commit = read_state(), head()
    STATE.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, STATE.open("a") as state:
        corpus: dict[str, Goods] = {}
        if FILES.keys() & counts.keys():
            corpus |= fuzzing.corpus(Path(folder) / "files")
        if COMMANDS.keys() & counts.keys():
            corpus |= command_lines.benches(Path(folder) / "commands")
        for name, count in counts.items():
            last = FIRST_SEED + max(1, round(count * share))
            for first in range(FIRST_SEED, last, CHUNK):
                seeds = range(first, min(first + CHUNK, last))
                before = done[name].get(first, {"outcomes": {}, "commit": "", "faults": []})
                other = before["commit"] != commit and (before["faults"] or first < FIRST_SEED + count * renew)
                if not other and sum(before["outcomes"].values()) == len(seeds):
                    continue
                chunk = in_own_process(corpus[name], seeds)
                done[name][first] = chunk | {"format": name, "first": first, "commit": commit}
                state.write(json.dumps(done[name][first]) + "\n")
                state.flush()
                for fault in chunk["faults"]:
                    print(f"{name}, seed {fault['seed']}: {fault['words']}", flush=True)
            print(name, sum(sum(c["outcomes"].values()) for c in done[name].values()), flush=True)
    tallies = {name: Tally() for name in counts}
    for name, tally in tallies.items():
        for chunk in done[name].values():
            tally.add(chunk)
    return tallies


def head() -> str:
    """The commit of the repository."""
    command = ["git", "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True).stdout.strip()


def processor() -> str:
    """The processor's name."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def record(tallies: dict[str, Tally]) -> str:
    """The record as Markdown."""
    total = Counter[str]()
    for tally in tallies.values():
        total.update(tally.outcomes)
    inputs, seconds = sum(total.values()), sum(t.seconds for t in tallies.values())
    commits = sum((t.commits for t in tallies.values()), Counter[str]())
    at = ", ".join(f"{name} ({count:,} inputs)" for name, count in commits.items())
    files = bool(FILES.keys() & tallies.keys())
    kind = "spoiled files" if files else "command lines"
    faults = "non-finite values, second reads that differ" if files else "wrong outputs, refusals without a place"
    lines = [
        f"`python benchmarks/fuzz.py {'files' if files else 'commands'}`, {date.today()}: **{inputs:,} {kind}, "
        f"{total['fault']} faults** (tracebacks, warnings, hangs, {faults}). "
        f"{seconds / 60:.0f} minutes of one process on a shared {processor()}, Python {platform.python_version()}. "
        f"Commits: {at}.",
        "",
        f"| {'format' if files else 'command'} | inputs | taken | refused | faults | seeds | ms for one "
        "| slowest, ms (seed) | memory, MB |",
        "|---|---:|---:|---:|---:|---|---:|---|---:|",
    ]
    for name, t in tallies.items():
        count = sum(t.outcomes.values())
        if count:
            lines.append(
                f"| {name} | {count:,} | {t.outcomes['value']:,} | {t.outcomes['refused']:,} | {t.outcomes['fault']} "
                f"| {FIRST_SEED} to {FIRST_SEED + count - 1} | {1e3 * t.seconds / count:.1f} "
                f"| {1e3 * t.slowest:.0f} ({t.slowest_seed}) | {t.memory:.0f} |"
            )
    return "\n".join(lines)


def forget(name: str) -> None:
    """Drop the chunks of a format."""
    lines = STATE.read_text().splitlines() if STATE.exists() else []
    STATE.write_text("".join(line + "\n" for line in lines if json.loads(line)["format"] != name))


def main() -> int:
    """Run, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", nargs="?", choices=("files", "commands"), help="only these")
    parser.add_argument("--renew", type=float, default=0.0, help="share to be tried at this commit")
    parser.add_argument("--share", type=float, default=1.0, help="of the inputs; the record is written for all only")
    parser.add_argument("--again", action="append", default=[], choices=list(COUNTS), help="a format to try anew")
    options = parser.parse_args()
    for name in options.again:
        forget(name)
    faults = 0
    for kind, counts, marks in (
        ("files", FILES, (START, STOP)),
        ("commands", COMMANDS, (START_COMMANDS, STOP_COMMANDS)),
    ):
        if options.kind in (None, kind):
            tallies = run(counts, options.share, options.renew)
            text = record(tallies)
            print(text)
            if options.share == 1.0:
                replace_between(PAGE, *marks, f"\n{shelved(text, f'robustness {kind}')}\n")
            faults += sum(len(t.faults) for t in tallies.values())
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
