"""What the benchmarks share: clocks, tables, and the page docs/results.md.

Each script writes its own section of the page, between two marks, with its command, the date and the machine, and its
tables as files in docs/records; a script that stops half-way leaves the page as it was.
"""

from __future__ import annotations

import csv
import io
import os
import platform
import re
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from importlib.metadata import version
from pathlib import Path

from qsframework.files import write_text

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
PAGE = ROOT / "docs" / "results.md"
RECORDS = ROOT / "docs" / "records"
MADE = ("section", "command", "date", "runs", "machine")
RUNS = 5
THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def cpu(job: Callable[[], object], runs: int = RUNS) -> float:
    """Median CPU seconds of a job."""
    return turns({"job": job}, runs)["job"]


def turns(jobs: Mapping[str, Callable[[], object]], runs: int = RUNS) -> dict[str, float]:
    """Median CPU seconds of each job. They take turns, so that whatever slows the machine slows all of them."""
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(runs):
        for name, job in jobs.items():
            start = time.process_time()
            job()
            times[name].append(time.process_time() - start)
    return {name: statistics.median(each) for name, each in times.items()}


def memory() -> float:
    """Peak resident memory of this process, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


@dataclass(frozen=True)
class Ran:
    """A finished process: CPU and clock seconds, peak resident memory in MB."""

    cpu: float
    wall: float
    memory: float


class Failed(SystemExit):
    """A command that failed, with what it said: it stops the benchmark unless somebody catches it."""


def ran(command: Sequence[str], folder: Path | str = ".", more: Mapping[str, str] | None = None) -> Ran:
    """Run a command to its end, its output thrown away; an error is Failed. more: of its environment."""
    start = time.perf_counter()
    process = subprocess.Popen(
        list(command),
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env={**os.environ, **THREADS, **(more or {})},
    )
    assert process.stderr is not None
    with process.stderr as stream:
        told = stream.read()
    _, status, used = os.wait4(process.pid, 0)  # what this process alone has used
    wall = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise Failed(f"{' '.join(command)} failed:\n{told.decode(errors='replace')[-2000:]}")
    return Ran(used.ru_utime + used.ru_stime, wall, used.ru_maxrss / 1024.0)


def medians(commands: Mapping[str, Sequence[str]], folder: Path | str, runs: int = RUNS) -> dict[str, Ran]:
    """Medians of several runs of each command, which take turns."""
    found: dict[str, list[Ran]] = {name: [] for name in commands}
    for _ in range(runs):
        for name, command in commands.items():
            found[name].append(ran(command, folder))
    return {name: middle(each) for name, each in found.items()}


def middle(each: Sequence[Ran]) -> Ran:
    """Medians of several runs."""
    return Ran(*(statistics.median(getattr(r, key) for r in each) for key in ("cpu", "wall", "memory")))


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join([*lines, *("| " + " | ".join(str(c) for c in row) + " |" for row in rows)])


def vectors() -> str:
    """The widest vectors that numpy uses: those of the processor, less what NPY_DISABLE_CPU_FEATURES names."""
    from numpy._core._multiarray_umath import __cpu_features__ as features

    return next((name for name, key in (("AVX-512", "X86_V4"), ("AVX2", "X86_V3")) if features.get(key)), "no AVX2")


def cores() -> str:
    """Cores, processor family with its vectors, and Python."""
    return f"{os.cpu_count()} cores, {platform.machine()} with {vectors()}, Python {platform.python_version()}"


def machine() -> str:
    """The same with the libraries that do the work."""
    names = ("numpy", "scipy", "pin", "cvxpy")
    return f"{cores()}, {', '.join(f'{name} {version(name)}' for name in names)}"


def replace_between(page: Path, start: str, end: str, text: str) -> None:
    """Put a text between two marks of a page; the page is written whole or not at all."""
    old = page.read_text()
    if old.count(start) != 1 or old.count(end) != 1:
        raise SystemExit(f"{page} must hold {start} and {end} once each")
    before, after = old.partition(start)[0], old.partition(end)[2]
    write_text(page, f"{before}{start}\n{text}\n{end}{after}")


def shelved(text: str, name: str, goals: bool = True, aside: str | None = None) -> str:
    """A record with its tables as files docs/records/NAME*.csv beside the page: here stay the words, unless goals is
    False the goals that are missed, and links to the files. Of the table under the heading `aside` the link alone."""
    title, links, kept = "", list[tuple[str, str, str]](), list[str]()
    for block in text.split("\n\n"):
        lines = block.splitlines()
        if lines and lines[0].startswith("#"):
            title = lines[0].lstrip("# ")
        elif lines and lines[0].startswith("|"):
            rows = [line[2:-2].split(" | ") for line in lines if not line.startswith("|---")]
            if goals and "goal" in rows[0] and title != aside:
                kept.append(_of_goals(rows))
            links.append((title or name.split()[-1], rows[0][0], _shelf(rows, name, title)))
        else:
            kept.append(block)
    titles = [title for title, _, _ in links]
    named = [f"[{t if titles.count(t) == 1 else f'{t}, by {by}'}]({file})" for t, by, file in links]
    return "\n\n".join([*kept, *([f"Raw tables: {'; '.join(named)}."] if named else [])])


MET = "goal met"


def _of_goals(rows: Sequence[Sequence[str]]) -> str:
    """The rows that have a goal, without how many cases they count; of a whole and its parts the whole. Where a column
    says whether goals are met: how many are, and the rows of the others."""
    shown = [k for k, name in enumerate(rows[0]) if name != "cases"]
    goal = rows[0].index("goal")
    names = {row[0] for row in rows}
    kept = [
        row for row in rows[1:] if row[goal].strip("- ") and (_whole(row[0]) == row[0] or _whole(row[0]) not in names)
    ]
    missed = [row for row in kept if MET not in rows[0] or row[rows[0].index(MET)] != "yes"]
    said = [] if MET not in rows[0] else [f"{len(kept) - len(missed)} of {len(kept)} goals are met."]
    found = table([rows[0][k] for k in shown], ([row[k] for k in shown] for row in missed))
    return "\n\n".join([*said, *([found] if missed else [])])


def _whole(name: str) -> str:
    """What a row counts a part of: `nothing hidden, 12 poses: said something` of `nothing hidden: said something`."""
    return re.sub(r", [^:]*(?=:)", "", name, count=1)


def _shelf(rows: Sequence[Sequence[str]], name: str, title: str) -> str:
    """Write one table; its address, as docs/*.md link to it."""
    words = re.findall(r"[a-z0-9]+", f"{name} {title.partition(':')[0]} by {rows[0][0]}".lower())
    file = RECORDS / f"{'-'.join(words)}.csv"
    _write_rows(file, rows)
    return f"{RECORDS.name}/{file.name}"


def _write_rows(file: Path, rows: Iterable[Sequence[str]]) -> None:
    file.parent.mkdir(exist_ok=True)
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    write_text(file, out.getvalue())


def write_section(name: str, text: str, command: str, runs: int | None = RUNS) -> None:
    """Put a section between its marks on the page, and into docs/records/made.csv its command, the date, the runs whose
    medians it holds (None: counts) and the machine.

    The page is of processors with AVX-512; of others the tables are written, under names that say so.
    """
    narrow = "" if vectors() == "AVX-512" else f", {vectors()}"
    shown = shelved(text, f"performance {name}{narrow}", False)
    if not narrow:
        replace_between(PAGE, f"<!-- {name} -->", f"<!-- end of {name} -->", shown)
    file, name = RECORDS / "made.csv", f"{name}{narrow}"
    rows = list(csv.reader(file.read_text().splitlines())) if file.is_file() else [list(MADE)]
    rows = [row for row in rows if row[0] != name]
    rows.append([name, command, date.today().isoformat(), "" if runs is None else str(runs), machine()])
    _write_rows(file, [rows[0], *sorted(rows[1:])])


def show(name: str, text: str, write: bool, quick: bool, runs: int | None = RUNS) -> None:
    """Print a section; write it if asked to, but never a quick run, whose sizes are not those of the page."""
    print(text, flush=True)
    if write and quick:
        print("a quick run is not written to the page", file=sys.stderr)
    elif write:
        write_section(name, text, f"python benchmarks/{Path(sys.argv[0]).name} --write", runs)
