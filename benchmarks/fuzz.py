"""The long run of spoiled files: at least 100,000 of them, from stated seeds, with a record in docs/robustness.md.

    python benchmarks/fuzz.py                 # go on where the last run stopped, then write the record
    python benchmarks/fuzz.py --share 0.01    # a hundredth of it, to see that it works
    python benchmarks/fuzz.py --again URDF    # forget what was found of a format and try it anew

Inputs are tried in chunks, each in a process of its own with 4 GB of memory at most; what a chunk found is kept in
build/fuzz.jsonl. What is tried, and what counts as a fault, is in tests/robustness/fuzzing.py.
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
from collections import Counter
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "robustness"))
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"
import fuzzing  # noqa: E402
from common import replace_between  # noqa: E402

COUNTS = {
    "robot.yaml": 6000,
    "nominal.yaml": 5000,
    "URDF": 9000,
    "xacro": 3000,
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
FIRST_SEED = 1_000_000
"""Away from the seeds of the tests."""
CHUNK = 250
MEMORY = 4 * 1024**3
STATE, PAGE = ROOT / "build" / "fuzz.jsonl", ROOT / "docs" / "robustness.md"
START, STOP = "<!-- record of benchmarks/fuzz.py -->", "<!-- end of the record -->"


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


def try_chunk(goods: list[fuzzing.Good], seeds: range) -> dict[str, Any]:
    """All inputs of a chunk, in this process."""
    outcomes: Counter[str] = Counter()
    faults, slowest, slowest_seed = [], 0.0, 0
    for seed in seeds:
        found = fuzzing.try_seed(goods, seed)
        outcomes[found.outcome.value] += 1
        if found.seconds > slowest:
            slowest, slowest_seed = found.seconds, seed
        if found.outcome is fuzzing.Outcome.FAULT:
            faults.append({"seed": seed, "words": found.words})
    return {"outcomes": outcomes, "faults": faults, "slowest": slowest, "slowest_seed": slowest_seed}


def in_own_process(goods: list[fuzzing.Good], seeds: range) -> dict[str, Any]:
    """What a chunk found; a process that dies is a fault of its chunk."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "found.json"
        child = os.fork()
        if child == 0:
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            try:
                out.write_text(json.dumps(try_chunk(goods, seeds)))
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


def run(share: float) -> dict[str, Tally]:
    """Try what has not been tried yet."""
    done, commit = read_state(), head()
    STATE.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, STATE.open("a") as state:
        corpus = fuzzing.corpus(Path(folder))
        for name, count in COUNTS.items():
            last = FIRST_SEED + max(1, round(count * share))
            for first in range(FIRST_SEED, last, CHUNK):
                seeds = range(first, min(first + CHUNK, last))
                if first in done[name] and sum(done[name][first]["outcomes"].values()) == len(seeds):
                    continue
                chunk = in_own_process(corpus[name], seeds)
                done[name][first] = chunk | {"format": name, "first": first, "commit": commit}
                state.write(json.dumps(done[name][first]) + "\n")
                state.flush()
                for fault in chunk["faults"]:
                    print(f"{name}, seed {fault['seed']}: {fault['words']}", flush=True)
            print(name, sum(sum(c["outcomes"].values()) for c in done[name].values()), flush=True)
    tallies = {name: Tally() for name in COUNTS}
    for name, chunks in done.items():
        for chunk in chunks.values():
            tallies[name].add(chunk)
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
    lines = [
        f"`python benchmarks/fuzz.py`, {date.today()}: **{inputs:,} spoiled files, "
        f"{total['fault']} faults** (tracebacks, warnings, hangs, non-finite values, second reads that differ). "
        f"{seconds / 60:.0f} minutes of one process on a shared {processor()}, Python {platform.python_version()}. "
        f"Commits: {at}.",
        "",
        "| format | inputs | taken | refused | faults | seeds | ms for one | slowest, ms (seed) | memory, MB |",
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
    parser.add_argument("--share", type=float, default=1.0, help="of the inputs; the record is written for all only")
    parser.add_argument("--again", action="append", default=[], choices=list(COUNTS), help="a format to try anew")
    options = parser.parse_args()
    for name in options.again:
        forget(name)
    tallies = run(options.share)
    text = record(tallies)
    print(text)
    if options.share == 1.0:
        replace_between(PAGE, START, STOP, f"\n{text}\n")
    return 1 if any(t.faults for t in tallies.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
