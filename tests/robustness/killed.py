"""Commands that are killed: imported once, forked for each run, so that a run costs no start-up.

Run as a script with the path of a JSON file of jobs; prints what became of each as JSON.
"""

from __future__ import annotations

import io
import json
import os
import random
import signal
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

WAIT = 600.0
Files = dict[str, bytes]


def in_child(work: Callable[[], int], said: Path) -> int:
    """Start a child process; what it says on standard error goes to a file."""
    from qsframework.cli.stop import Stopped, listening

    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # one that comes before the child listens waits for it
    child = os.fork()
    if child:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        return child
    code = 70
    try:
        with said.open("w", buffering=1) as err, redirect_stderr(err), redirect_stdout(io.StringIO()):
            os.dup2(err.fileno(), 2)
            try:
                with listening():
                    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
                    code = work()
            except Stopped as stopped:
                print(_STOPPED, file=err)
                code = stopped.code
            except SystemExit as end:
                code = end.code if isinstance(end.code, int) else 0
            except BaseException as error:
                import traceback

                traceback.print_exception(error)
    finally:
        os._exit(code)


def qsf(arguments: list[str]) -> Callable[[], int]:
    """The command line, as `qsf` runs it."""

    def work() -> int:
        from qsframework.cli import main

        sys.argv = ["qsf", *arguments]
        main()
        return 0

    return work


def ended(child: int, limit: float = WAIT) -> int:
    """Exit code, negative for a signal."""
    end = time.monotonic() + limit
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > end:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return -99
        time.sleep(0.001)


def run(
    work: Callable[[], int],
    said: Path,
    number: int | None = None,
    delay: float = 0.0,
    ready: Callable[[], bool] = lambda: True,
) -> int:
    """Run, and send a signal so long after all is ready."""
    child = in_child(work, said)
    if number is not None:
        while not ready():
            if os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None:
                break
            time.sleep(0.001)
        time.sleep(delay)
        os.kill(child, number)
    return ended(child)


def files_in(folder: Path) -> Files:
    """All files by their names in the folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def lay(folder: Path, files: Files) -> None:
    """Put files into a folder."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def all_whole(left: Files, new: Files) -> bool:
    """The new files, and no others."""
    return set(left) == set(new) and all(whole(n, left[n], new[n]) for n in new)


def clear(folder: Path) -> None:
    """Remove all in a folder."""
    import shutil

    shutil.rmtree(folder)
    folder.mkdir()


def old_of(new: Files, folders: list[str]) -> Files:
    """What stood there before: anything; in a folder that the command made as a whole, such a folder."""
    return {n: c + b"\n# old\n" if n.split("/")[0] in folders else b"old " + n.encode() for n, c in new.items()}


def command_job(job: dict[str, Any], place: Path, chance: random.Random) -> dict[str, Any]:
    """One command: a full run, runs that are killed over old files, and a full run over what is left."""
    out, said = place / "out", place / "said.txt"
    out.mkdir()
    os.chdir(place)
    work = qsf(job["arguments"])
    start, before = time.monotonic(), sum(os.times()[2:4])
    code = run(work, said)
    seconds = time.monotonic() - start
    new = files_in(out)
    result: dict[str, Any] = {"code": code, "seconds": seconds, "files": sorted(new), "said": said.read_text()[-2000:]}
    if code:
        return result
    folders = job.get("folders", [])
    old = {} if job.get("fresh") else old_of(new, folders)
    trials: list[dict[str, Any]] = []
    for k in range(job["kills"]):
        clear(out)
        lay(out, old)
        number = (signal.SIGKILL, signal.SIGINT)[k % 2]
        share = chance.uniform(0.0, 1.0) if k % 4 < 2 else chance.uniform(0.85, 1.0)
        code = run(work, said, number, share * seconds)
        left = files_in(out)
        trials.append(
            {
                "signal": int(number),
                "code": code,
                "share": share,
                "said": said.read_text()[-2000:],
                "half": half(left, old, new, folders),
                "stale": [n for n in left if n not in new],
            }
        )
    if job.get("again"):
        result |= {"again": run(work, said), "same": all_whole(files_in(out), new)}
    return result | {"trials": trials, "cpu": sum(os.times()[2:4]) - before}


def whole(name: str, left: bytes, new: bytes) -> bool:
    """Whether a file is the new one. The scenes of pages have new ids in every run."""
    if not name.endswith(".html"):
        return left == new
    return left[:200] == new[:200] and left[-200:] == new[-200:] and abs(len(left) - len(new)) < 0.01 * len(new)


def half(left: Files, old: Files, new: Files, folders: list[str]) -> list[str]:
    """Files that are neither the old nor the new ones; folders that are a mixture."""
    bad = [n for n in set(old) | set(new) if n in left and left[n] != old.get(n) and not whole(n, left[n], new[n])]
    bad += [n for n in old if n not in left]
    for folder in folders:
        mine = {n: c for n, c in left.items() if n.split("/")[0] == folder}
        if mine not in [{n: c for n, c in kind.items() if n.split("/")[0] == folder} for kind in (old, new)]:
            bad.append(folder)
    return bad


WRITING = (
    "design experiment.yaml -n 4 --candidates 40 -o out/plan.csv --json out/d.json --report out/d.html",
    "simulate experiment.yaml plan.csv -o out/r.csv --json out/t.json --report out/t.html",
    "identify experiment.yaml readings.csv --json out/fit.json --nominal out/n.yaml",
    "validate experiment.yaml fit.json other.csv --json out/v.json --report out/v.html",
    "diagnose experiment.yaml readings.csv --json out/d.json --report out/d.html --extend out/new",
    "diagnose experiment.yaml plan.csv --json out/p.json --report out/p.html",
    "stiffness small --pose 10,-20 --load 0,0,-100 --json out/s.json --report out/s.html",
    "compensate experiment.yaml fit.json targets.csv -o out/c.csv --json out/c.json --report out/c.html --anyway",
    "kinematics experiment.yaml fit.json --urdf out/k.urdf --dh out/dh.yaml --offsets out/o.csv --anyway",
    "certificate experiment.yaml fit.json --halves 2 -o out/certificate.html",
    "export ur10.yaml ur10_plan.csv --to urscript -o out/arm.script --json out/e.json",
    "protocol experiment.yaml plan.csv -o out/sheet.html --readings out/r.csv",
    "day experiment.yaml plan.csv --watch exports --once --cycles 1 --no-half --repeat-share 0 -o out/day",
    "import experiment.yaml points.csv --plan plan.csv --unit mm -o out/i.csv --json out/i.json",
    "compare small small2 --task task.yaml --json out/c.json --report out/c.html",
    "new arm --urdf small/small.urdf -o out/arm",
    "show small --html out/scene.html",
    "check experiment.yaml --json out/check.json --report out/check.html",
    "robots --json out/robots.json --report out/robots.html",
    "demo -o out/demo --json out/demo.json",
)
"""Every command that writes, on the files of command_lines.prepared."""
_STOPPED = "Interrupted. No partial files were left."
_NOT_TWICE, _GROWS = ("new",), ("day",)
"""`new` overwrites no folder; a day's folder grows reading by reading, and goes on."""


@dataclass(frozen=True)
class First:
    """What a run that nobody disturbs writes, and the seconds that it takes."""

    files: Files
    seconds: float


def first_run(bench: Path, place: Path, line: str) -> First:
    """The run against which killed ones are held; the one before it loads what later runs have loaded."""
    seconds = 0.0
    for _ in range(2):
        laid(bench, place, {})
        start = time.monotonic()
        code = run(qsf(line.split()), place.parent / "said")
        seconds = time.monotonic() - start
        if code:
            raise RuntimeError(f"qsf {line}: {(place.parent / 'said').read_text()}")
    return First(files_in(place / "out"), seconds)


def killed_once(
    bench: Path, place: Path, line: str, first: First, share: float, number: signal.Signals = signal.SIGKILL
) -> dict[str, Any]:
    """A run over an earlier run's files, killed or stopped by Ctrl-C (SIGINT) after a share of its time, and a second
    one over what is left."""
    verb, said = line.split()[0], place.parent / "said"
    folders = sorted({n.split("/")[0] for n in first.files if "/" in n} - {"demo", "day"})
    old = {} if verb in (*_NOT_TWICE, *_GROWS) else old_of(first.files, folders)
    laid(bench, place, old)
    code = run(qsf(line.split()), said, number, share * first.seconds)
    left = files_in(place / "out")
    parts = [n for n in left if ".qsf-part" in n]
    whole_files = {n: c for n, c in left.items() if n not in parts}
    faults: list[str] = []
    stopped, words = number == signal.SIGINT, said.read_text()
    if code not in (0, 130 if stopped else -signal.SIGKILL):
        faults.append(f"it ended with {code}: {words[-500:]}")
    if stopped and (parts or (code and words.splitlines()[-1:] != [_STOPPED])):
        faults.append(f"stopped, it left {parts} and said: {words[-500:]}")
    if verb not in _GROWS:
        faults += [f"{n} is neither the old one nor the new one" for n in half(whole_files, old, first.files, folders)]
    new = len(_news(whole_files, first)) == len(first.files)
    told = "done" if code == 0 else "old" if whole_files == old else "new" if new else "mixed"
    if verb in _NOT_TWICE and whole_files:
        clear(place / "out")
    again = run(qsf(line.split()), said)
    after = files_in(place / "out")
    if again:
        faults.append(f"the second run ended with {again}: {said.read_text()[-500:]}")
    elif len(_news(after, first)) != len(first.files) or after.keys() != first.files.keys():
        faults.append(f"the second run left other files: {sorted(after)}")
    return {"left": told, "part": bool(parts), "faults": faults}


def _news(left: Files, first: First) -> list[str]:
    """Files that are the new ones; a day says when each reading came, which the first run cannot say."""
    return [n for n, c in left.items() if n in first.files and (n.startswith("day/") or whole(n, c, first.files[n]))]


def laid(bench: Path, place: Path, old: Files) -> None:
    """The bench, anew, with an earlier run's files; it is the place to be."""
    import shutil

    os.chdir(bench)
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(bench, place)
    (place / "out").mkdir()
    lay(place / "out", old)
    os.chdir(place)


def main() -> None:
    """Do the jobs of the file."""
    import typer.main

    given = json.loads(Path(sys.argv[1]).read_text())
    for name in given["imports"]:
        __import__(name)
    typer.main.get_command = cache(typer.main.get_command)
    for arguments in given["before"]:  # loads the effects and what reads a robot, which else each run would do again
        with redirect_stdout(io.StringIO()), suppress(SystemExit):
            qsf(arguments)()
    results = []
    for k, job in enumerate(given["jobs"]):
        print(time.ctime(), job["arguments"], file=sys.stderr, flush=True)
        place = Path(given["folder"]) / f"job{k}"
        place.mkdir()
        results.append(command_job(job, place, random.Random(given["seed"] * 1000 + k)))
    print(json.dumps(results))


if __name__ == "__main__":
    main()
