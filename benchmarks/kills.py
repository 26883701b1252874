"""Kill -9 at 200 random moments and Ctrl-C at 100, over all commands that write: the record in docs/results.md.

    python benchmarks/kills.py                # go on where the last run stopped, then write the record
    python benchmarks/kills.py --renew        # try again what another commit was tried with
    python benchmarks/kills.py --kills 1      # one kill of each command, to see that it works; no record
    python benchmarks/kills.py --days         # the measuring day: kills, spoilt files, two writers; its own record

Each command runs on a small arm over files of an earlier run, is killed at a random moment, and runs again. What became
of it is kept in build/kills.jsonl. What may be left, and what a second run has to do, is in tests/robustness/killed.py.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / name) for name in ("robustness", "day")]
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"
import command_lines  # noqa: E402
import killed  # noqa: E402
from common import replace_between, shelved  # noqa: E402
from fuzz import PAGE, head, processor  # noqa: E402

STATE = ROOT / "build" / "kills.jsonl"
START, STOP = "<!-- record of benchmarks/kills.py -->", "<!-- end of the record of kills -->"
START_DAYS, STOP_DAYS = "<!-- record of benchmarks/kills.py --days -->", "<!-- end of the record of days -->"
KILLS, STOPS = 10, 5
"""Moments for each command: of a kill, and of a Ctrl-C."""


def read_state() -> dict[tuple[str, int], dict[str, Any]]:
    """What was tried, by command and number of the moment."""
    lines = STATE.read_text().splitlines() if STATE.exists() else []
    return {(r["line"], r["kill"]): r for r in map(json.loads, lines)}


def run(kills: int, stops: int, renew: bool) -> list[dict[str, Any]]:
    """Try what has not been tried: moments of each command, numbered, those of Ctrl-C after KILLS."""
    done, commit, moments = read_state(), head(), [*range(kills), *range(KILLS, KILLS + stops)]
    STATE.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, STATE.open("a") as state:
        bench = command_lines.prepared(Path(folder))
        for line in killed.WRITING:
            first: killed.First | None = None
            for kill in moments:
                old = done.get((line, kill))
                if old is not None and (not renew or old["commit"] == commit) and not old["faults"]:
                    continue
                first = first or killed.first_run(bench, Path(folder) / "place", line)
                share = random.Random(f"{line} {kill}").random()
                number = signal.SIGKILL if kill < KILLS else signal.SIGINT
                found = killed.killed_once(bench, Path(folder) / "place", line, first, share, number)
                done[line, kill] = found | {"line": line, "kill": kill, "commit": commit}
                state.write(json.dumps(done[line, kill]) + "\n")
                state.flush()
                for fault in found["faults"]:
                    print(f"{line}, at {share:.2f} of its time: {fault}", flush=True)
            print(line, flush=True)
    return [done[line, kill] for line in killed.WRITING for kill in moments]


def record(found: list[dict[str, Any]]) -> Iterator[str]:
    """The record as Markdown."""
    commits = ", ".join(f"{name} ({count})" for name, count in Counter(r["commit"] for r in found).items())
    faults, stops = sum(len(r["faults"]) for r in found), sum(r["kill"] >= KILLS for r in found)
    counted = f"{len(found) - stops} kills, {stops} stops by Ctrl-C, {faults} faults"
    yield f"`python benchmarks/kills.py`, {date.today()}: **{counted}**; {processor()}. Commits: {commits}."
    yield ""
    yield "| command | kills, Ctrl-C | old files | new files | some of each | done before | hidden part left | faults |"
    yield "|---|---:|---:|---:|---:|---:|---:|---:|"
    for line in killed.WRITING:
        own = [r for r in found if r["line"] == line]
        counts = Counter(r["left"] for r in own)
        verb, *words = line.split()
        shown = " ".join([verb, *(w for w in words if w in ("--extend", "plan.csv") and verb == "diagnose")])
        yield (
            f"| `qsf {shown}` | {len(own)} | {counts['old']} | {counts['new']} | {counts['mixed']} | {counts['done']} "
            f"| {sum(r['part'] for r in own)} | {sum(len(r['faults']) for r in own)} |"
        )


def days() -> Iterator[tuple[str, int, list[str]]]:
    """What befell measuring days: what was done, how often, and what was wrong."""
    import day_harm as harm

    with tempfile.TemporaryDirectory() as folder:
        chance = random.Random(0)
        watched = harm.watched(Path(folder) / "watched")
        shares = [chance.uniform(0.3, 1.0) for _ in range(100)]
        yield (
            "kills in watch mode, files of three states",
            100,
            [f for s in shares for f in harm.kill_watched(watched, s)[1]],
        )
        kills, faults = 0, list[str]()
        for seed in range(20):
            count, found = harm.kill_paged(Path(folder) / f"paged{seed}", seed, 5)
            kills, faults = kills + count, faults + found
        yield "kills by the page, while a reading or a decision is stored", kills, faults
        spoilt = harm.spoilt(Path(folder) / "spoilt")
        yield "spoilt journals", 600, [f for seed in range(600) for f in harm.spoil_journal(spoilt, seed)]
        yield "spoilt tables and exports", 400, [f for seed in range(400) for f in harm.spoil_table(spoilt, seed)]
        rounds, faults = 0, list[str]()
        for seed in range(9):
            count, found = harm.two_writers(spoilt.experiment, Path(folder) / f"two{seed}", seed)
            rounds, faults = rounds + count, faults + found
        yield "rounds of two writers of one state", rounds, faults


def record_of_days(found: list[tuple[str, int, list[str]]]) -> Iterator[str]:
    """The record as Markdown."""
    yield f"`python benchmarks/kills.py --days`, {date.today()}, commit {head()}; {processor()}."
    yield ""
    yield "| what | how often | faults |"
    yield "|---|---|---|"
    yield from (f"| {what} | {count:,} | {len(faults)} |" for what, count, faults in found)


def main() -> int:
    """Run, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=KILLS, help="kills of each command")
    parser.add_argument("--renew", action="store_true", help="try again what another commit was tried with")
    parser.add_argument("--days", action="store_true", help="the measuring day instead")
    options = parser.parse_args()
    if options.days:
        befallen = [one for one in days() if print(*one, flush=True) is None]
        text = shelved("\n".join(record_of_days(befallen)), "robustness days")
        replace_between(PAGE, START_DAYS, STOP_DAYS, f"\n{text}\n")
        return 1 if any(faults for _, _, faults in befallen) else 0
    found = run(options.kills, STOPS if options.kills == KILLS else 0, options.renew)
    text = "\n".join(record(found))
    print(text)
    if options.kills == KILLS:
        replace_between(PAGE, START, STOP, f"\n{shelved(text, 'robustness kills')}\n")
    return 1 if any(r["faults"] for r in found) else 0


if __name__ == "__main__":
    sys.exit(main())
