"""`qsf day`: what it calls and prints."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from qsframework.applications.day.day import Day, begin
from qsframework.applications.day.entry import enter_file
from qsframework.applications.protocol import ProtocolWish
from qsframework.cli.export import plan_of
from qsframework.cli.printing import print_folded
from qsframework.errors import InputError, QsfError
from qsframework.experiment import load_experiment
from qsframework.files import sha256

_POLL = 0.5
"""Seconds between two looks into the watched folder; a file that has not changed meanwhile is whole."""

_TOGETHER = 2_000_000_000
"""Nanoseconds: files nearer in time than that were copied together, and time does not order them."""

_DIGITS = re.compile(r"(\d+)")


_State = tuple[int, int, str]


@dataclass(frozen=True, kw_only=True)
class DayFiles:
    """What the command reads, and the folder that it writes; watch: a folder of the tracker's files."""

    experiment: Path
    plan: Path
    folder: Path
    watch: Path | None = None


def run_day(files: DayFiles, wish: ProtocolWish, port: int, once: bool = False) -> None:
    """Serve the page until Ctrl-C, or take what comes into a folder; once: what lies there now, and end."""
    from qsframework.report.words.day import slot_words

    experiment = load_experiment(files.experiment)
    day = begin(experiment, plan_of(files.plan, experiment), files.folder, wish)
    done = len(day.record.rows)
    begun = f"continued, {done} readings are there" if done else "begun"
    print(f"the day is {begun}: {day.record.table}")
    if day.next is not None:
        print(f"next: {slot_words(day, day.next)}")
    if files.watch is None:
        _serve(day, files, port)
    else:
        _watch(day, files, files.watch, once)


def _serve(day: Day, files: DayFiles, port: int) -> None:
    try:
        import uvicorn

        from qsframework.report.day_server import DayPage
    except ImportError as error:
        raise InputError(f"the page of the day needs {error.name}: pip install 'qsframework[day]'") from error
    import socket

    from qsframework.viz.server import HOST, taking

    listening = socket.socket()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    with taking(port):
        listening.bind((HOST, port))
    page = DayPage(day, lambda now: finish(now, files))
    print(
        f"http://{HOST}:{listening.getsockname()[1]}/  (Ctrl-C ends it; the day goes on with the same command)",
        flush=True,
    )
    server = uvicorn.Server(uvicorn.Config(page.app(), log_level="error", lifespan="off"))
    server.run(sockets=[listening])


def _watch(day: Day, files: DayFiles, folder: Path, once: bool) -> None:
    """A line for every reading that comes in."""
    from qsframework.report.words.day import judged_words

    if not folder.is_dir():
        raise InputError(f"--watch: no folder {folder}")
    print(f"watching {folder}: Ctrl-C ends it; the day goes on with the same command", flush=True)
    looked: set[_State] = set()
    refused: set[str] = set()
    while day.next is not None:
        for path, state in _whole(folder):
            if state in looked:
                continue
            looked.add(state)
            hash = sha256(path)
            if hash in refused or hash in day.record.files:
                continue
            try:
                day, said = enter_file(day, path)
            except QsfError as error:
                refused.add(hash)
                print_folded(f"{path.name}: not taken: {error}")
                continue
            for judged in said:
                print_folded(f"{path.name}: {judged_words(day, judged)}")
        if once:
            return
    print("every state of every pose was read")
    for line in finish(day, files):
        print_folded(line)


def _whole(folder: Path) -> Iterator[tuple[Path, _State]]:
    """Files that nobody is writing, the oldest first, with a state that a change would change.

    Files written within two seconds of each other, as a copied folder's are, come in the order of their names.
    """

    def states() -> dict[Path, _State]:
        found = (p for p in folder.iterdir() if p.is_file() and not p.name.startswith("."))
        return {p: (p.stat().st_mtime_ns, p.stat().st_size, p.name) for p in found}

    before = states()
    time.sleep(_POLL)
    after = states()
    settled = sorted(((p, state) for p, state in after.items() if before.get(p) == state), key=lambda f: f[1])
    together: list[list[tuple[Path, _State]]] = []
    for one in settled:
        if together and one[1][0] - together[-1][-1][1][0] <= _TOGETHER:
            together[-1].append(one)
        else:
            together.append([one])
    for group in together:
        yield from sorted(group, key=lambda f: _by_number(f[0].name))


def _by_number(name: str) -> list[tuple[int, str]]:
    """visit_9 before visit_10."""
    return [(int(part) + 1 if part.isdecimal() else 0, part) for part in _DIGITS.split(name)]


def finish(day: Day, files: DayFiles) -> list[str]:
    """Fit, validation, diagnosis, reports and certificate of the day, in its folder; what became of each."""
    from qsframework.applications.certificate import certify, read_meta
    from qsframework.applications.day.so_far import accepted
    from qsframework.cli.commands import write_json
    from qsframework.diagnose import diagnose
    from qsframework.identify import identify, read_fit
    from qsframework.report import fit_sections, write_report
    from qsframework.report.certificate_page import write_certificate
    from qsframework.report.diagnosis_section import diagnosis_sections
    from qsframework.report.words.certificate import conformity_words
    from qsframework.report.words.fit import fit_verdict, verdict_words
    from qsframework.report.words.headline import diagnosis_verdict, headline

    out, folder = list[str](), files.folder
    experiment = day.experiment
    readings = accepted(day)
    fit = identify(experiment, readings)
    write_json(folder / "fit.json", fit.as_json())
    title, verdict = f"Identification: {experiment.robot.title}", fit_verdict(fit, readings.poses)
    write_report(folder / "fit.html", title, fit_sections(fit, experiment, readings), verdict)
    out.append(f"fit.json, fit.html: {verdict_words(fit)}")
    if day.record.doubtful:
        out.append(f"{len(day.record.doubtful)} states wait for a decision and are left out")
    try:
        found = diagnose(experiment, readings)
        write_report(
            folder / "diagnosis.html",
            f"Diagnosis: {experiment.robot.title}",
            diagnosis_sections(found, [files.experiment, day.record.table]),
            diagnosis_verdict(found),
        )
        out.append(f"diagnosis.html: {headline(found)}")
    except QsfError as error:
        out.append(f"no diagnosis: {error}")
    try:
        certified = certify(experiment, read_fit(folder / "fit.json"), readings, read_meta(None), halves=10, seed=0)
        write_certificate(folder / "certificate.html", certified)
        out.append(f"certificate.html: {conformity_words(certified.conformity)}")
    except QsfError as error:
        out.append(f"no certificate: {error}")
    return out
