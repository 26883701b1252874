"""The command lines of lines.yaml, run and held to what is recorded of them in expected/.

`python tests/golden/golden.py` runs all chains and says what differs; with names of chains or of command lines
(CHAIN/LINE) these only. `--write NAME...` records the named ones anew (`--write all`: all of them); `--words NAME...`
the words alone, of those where nothing else has changed. What is recorded is never written otherwise. A number that is
meant to change is recorded in a commit of its own, with old, new and reason.
"""

from __future__ import annotations

import argparse
import io
import os
import runpy
import shlex
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from unittest.mock import patch

import yaml
from golden_record import Record, Tolerance, differences, read_record, record, stored_numbers, stored_words

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
EXPECTED = HERE / "expected"
LINKED = {"examples": ROOT / "examples", "robots": ROOT / "robots", "inputs": HERE / "inputs"}
"""Folders that every chain finds beside it."""
COLUMNS = "1000"
"""A sentence and a row of a table stand on one line."""


@dataclass(frozen=True)
class Chain:
    """Command lines that run one after the other in one folder, by their names; quick: as many run in `make test`."""

    name: str
    lines: dict[str, str]
    quick: int

    def part(self, count: int) -> Chain:
        """The first ones."""
        return Chain(self.name, dict(list(self.lines.items())[:count]), min(self.quick, count))

    def __len__(self) -> int:
        return len(self.lines)


def chains(path: Path = HERE / "lines.yaml") -> tuple[list[Chain], list[Tolerance]]:
    """All chains, and where their numbers may differ more."""
    document = yaml.safe_load(path.read_text())
    out = []
    for name, chain in document["chains"].items():
        lines = {n: str(line) for n, line in chain.items() if n != "quick"}
        out.append(Chain(name, lines, chain.get("quick", 0)))
    return out, [Tolerance(**t) for t in document["tolerances"]]


def expected(name: str) -> Record | None:
    """What is recorded of a command line, CHAIN/LINE."""
    files = [EXPECTED / f"{name}.{kind}" for kind in ("numbers", "words")]
    if not all(f.is_file() for f in files):
        return None
    return read_record(*(f.read_text() for f in files))


def write(name: str, line: str, found: Record, words_only: bool = False) -> None:
    """Record a command line."""
    (EXPECTED / name).parent.mkdir(parents=True, exist_ok=True)
    if not words_only:
        (EXPECTED / f"{name}.numbers").write_text(stored_numbers(found, line))
    (EXPECTED / f"{name}.words").write_text(stored_words(found, line))


def _run(arguments: list[str]) -> int:
    """The exit code of `qsf ...`, or of `script FILE ...`, run in this process."""
    from qsframework.cli.app import main

    try:
        if arguments[0] == "script":
            with patch.object(sys, "argv", arguments[1:]):
                runpy.run_path(arguments[1], run_name="__main__")
        else:
            with patch.object(sys, "argv", ["qsf", *arguments]):
                main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def _written(folder: Path) -> dict[str, tuple[Path, int, bytes]]:
    """All files in a folder, but those of linked ones."""
    out = {}
    for place, folders, names in os.walk(folder):
        folders[:] = [f for f in folders if not (Path(place) / f).is_symlink()]
        for name in names:
            path = Path(place) / name
            out[path.relative_to(folder).as_posix()] = path
    return {name: (path, path.stat().st_mtime_ns, path.read_bytes()) for name, path in sorted(out.items())}


@cache
def _own() -> dict[bytes, str]:
    """The shipped files by what they hold: a command may write a copy of one."""
    files = (p for name in ("examples", "robots") for p in sorted((ROOT / name).rglob("*.*")) if p.is_file())
    return {p.read_bytes(): p.relative_to(ROOT).as_posix() for p in files}


def run_line(line: str, folder: Path) -> Record:
    """Run a command line in a folder."""
    before = _written(folder)
    out, err = io.StringIO(), io.StringIO()
    with chdir(folder), patch.dict(os.environ, COLUMNS=COLUMNS), redirect_stdout(out), redirect_stderr(err):
        code = _run(shlex.split(line))
    new = {name: found[0] for name, found in _written(folder).items() if found != before.get(name)}
    texts = {"stdout": out.getvalue(), "stderr": err.getvalue()}
    there = folder.resolve()  # as experiments in the repository call it, which a clone elsewhere calls otherwise
    places = {os.path.relpath(there, start): "<folder>" for start in (HERE / "inputs", ROOT / "examples" / "one")}
    places |= {str(folder): "<folder>", str(ROOT): "<repository>"}
    return record(code, {n: t for n, t in texts.items() if t}, new, places, _own())


def run_chain(chain: Chain, folder: Path) -> Iterator[tuple[str, str, Record]]:
    """Name (CHAIN/LINE), line and record of each command line of a chain."""
    for name, target in LINKED.items():
        (folder / name).symlink_to(target)
    for name, line in chain.lines.items():
        yield f"{chain.name}/{name}", line, run_line(line, folder)


@contextmanager
def somewhere() -> Iterator[Path]:
    """A folder of its own, by its real path."""
    with tempfile.TemporaryDirectory(prefix="golden-") as folder:
        yield Path(folder).resolve()


def said(name: str, line: str, found: dict[str, list[str]], most: int = 12) -> str:
    """What a difference is told as; most: places of one kind."""
    out = [f"{name}: {', '.join(found)} changed: qsf {line}"]
    for kind, places in found.items():
        out += [f"  {kind}: {place}" for place in places[:most]]
        out += [f"  {kind}: ... and {len(places) - most} more"] * (len(places) > most)
    return "\n".join(out)


def compared(name: str, line: str, found: Record, tolerances: list[Tolerance]) -> dict[str, list[str]]:
    """What differs of a command line from what is recorded, by kind."""
    wanted = expected(name)
    if wanted is None:
        return {"record": [f"nothing is recorded; golden.py --write {name}"]}
    return differences(name, wanted, found, tolerances)


def hold(chain: Chain, folder: Path, tolerances: list[Tolerance]) -> Iterator[tuple[str, str]]:
    """Of each command line of a chain its name, and what differs; no words where nothing does."""
    for name, line, found in run_chain(chain, folder):
        different = compared(name, line, found, tolerances)
        yield name, said(name, line, different) if different else ""


@dataclass(frozen=True)
class Job:
    """A chain to run; wanted: the command lines to record, with their words alone or whole, or none, to compare."""

    chain: Chain
    tolerances: list[Tolerance]
    wanted: frozenset[str] | None = None
    words_only: bool = False

    def told(self, name: str, line: str, found: Record) -> str:
        """What is to be said of a command line, once it is compared or recorded."""
        if self.wanted is not None and name not in self.wanted:
            return ""
        different = (
            {} if self.wanted is not None and not self.words_only else compared(name, line, found, self.tolerances)
        )
        if self.wanted is None or set(different) - {"words"}:
            return said(name, line, different) if different else ""
        write(name, line, found, self.words_only)
        return ""


def _work(job: Job) -> list[tuple[str, str, float]]:
    """Run a chain: of each command line its name, what is said of it, and its CPU seconds."""
    out: list[tuple[str, str, float]] = []
    with somewhere() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        start = time.process_time()
        try:
            for name, line, found in run_chain(job.chain, folder):
                out.append((name, job.told(name, line, found), time.process_time() - start))
                start = time.process_time()
        except Exception:
            name = f"{job.chain.name}/{list(job.chain.lines)[len(out)]}"
            out.append((name, f"{name}:\n{traceback.format_exc()}", 0.0))
    return out


def _asked(names: list[str], known: list[Chain]) -> list[Chain]:
    """The chains of the names, each as far as its last name."""
    out = []
    for chain in known:
        wanted = [k for k, n in enumerate(chain.lines, 1) if {chain.name, f"{chain.name}/{n}", "all"} & set(names)]
        if wanted:
            out.append(chain.part(wanted[-1]))
    lines = {f"{c.name}/{n}" for c in known for n in c.lines}
    if unknown := set(names) - lines - {c.name for c in known} - {"all"}:
        sys.exit(f"no such chain or command line: {', '.join(sorted(unknown))}")
    return out


def _left_over(known: list[Chain], remove: bool) -> list[str]:
    """Records of command lines that are no longer in the list."""
    lines = {f"{c.name}/{n}" for c in known for n in c.lines}
    found = [
        p for p in sorted(EXPECTED.rglob("*.*")) if p.relative_to(EXPECTED).with_suffix("").as_posix() not in lines
    ]
    for path in found if remove else ():
        path.unlink()
    return [] if remove else [f"{p.relative_to(HERE)}: its command line is not in lines.yaml" for p in found]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="chains, or CHAIN/LINE; all if left out")
    parser.add_argument("--write", nargs="+", metavar="NAME", help="record these anew: chains, CHAIN/LINE, or all")
    parser.add_argument("--words", nargs="+", metavar="NAME", help="record the words alone of these")
    parser.add_argument("--quick", action="store_true", help="only what `make test` runs")
    parser.add_argument("--jobs", type=int, default=2, help="processes; chains are dealt out to them")
    parser.add_argument("--times", action="store_true", help="print the CPU seconds of each line")
    given = parser.parse_args()
    known, tolerances = chains()
    names = given.write or given.words or given.names or ["all"]
    asked = _asked(names, known)
    if given.quick:
        asked = [c.part(c.quick) for c in asked if c.quick]
    wanted = None
    if given.write or given.words:
        wanted = frozenset(
            f"{c.name}/{n}" for c in known for n in c.lines if {"all", c.name, f"{c.name}/{n}"} & set(names)
        )
    failed = _left_over(known, "all" in (given.write or ()))
    jobs = [Job(chain, tolerances, wanted, not given.write) for chain in asked]
    count = 0
    with ProcessPoolExecutor(given.jobs) as pool:
        for name, told, seconds in (line for done in pool.map(_work, jobs) for line in done):
            count += 1
            failed += [told] if told else []
            if told or given.times:
                print(told or f"{name}: {seconds:.2f} s", flush=True)
    print(f"{count} command lines, {len(failed)} differ" if wanted is None else f"recorded {len(wanted) - len(failed)}")
    return 1 if failed else 0


if __name__ == "__main__":
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    sys.path.insert(0, str(ROOT / "docs"))
    sys.exit(main())
