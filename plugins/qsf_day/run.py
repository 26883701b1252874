"""`qsf day`: what it calls and prints."""

from __future__ import annotations

import os
import re
import select
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from qsf_day.entry import Unconfirmed, enter_file
from qsf_day.options import DayFiles, ProtocolOptions
from qsf_day.record import Slot
from qsf_day.session import DECISIONS, Day, begin, decide, reread
from qsframework.cli import load_campaign, plan_of, print_folded
from qsframework.errors import InputError, QsfError, missing_extra
from qsframework.experiment import Experiment, Readings, load_experiment, read_readings
from qsframework.files import sha256

if TYPE_CHECKING:
    from qsframework.diagnoses import Diagnosis, FollowUp

SECOND_DAY = "follow-up.csv"
"""The plan of the visits that settle what a day's diagnosis leaves open."""

_POLL = 0.5
"""Seconds between two looks into the watched folder; a file has stopped changing that has not changed meanwhile."""

_LONG = 60.0
"""Seconds after which a file counts as whole though its last line has no end."""

_TOGETHER = 2_000_000_000
"""Nanoseconds: files nearer in time than that were copied together, and time does not order them."""

_DIGITS = re.compile(r"(\d+)")


_State = tuple[int, int, str]


def run_day(files: DayFiles, options: ProtocolOptions, port: int, once: bool = False) -> None:
    """Serve the page until Ctrl-C, or take what comes into a folder; once: what lies there now, and end."""
    from qsf_day.words import mistake_words, slot_words, spoilt_words

    if once and files.watch is None:
        raise InputError("--once goes with --watch: the page serves until Ctrl-C")
    if files.watch is not None and not files.watch.is_dir():
        raise InputError(f"--watch: no folder {files.watch}")
    experiment = load_campaign(files.experiment)
    day = begin(experiment, plan_of(files.plan, experiment), files.folder, options)
    done = len(day.record.rows)
    begun = f"continued, {done} readings are there" if done else "begun"
    print(f"the day is {begun}: {day.record.table}")
    if day.record.spoilt:
        print_folded(spoilt_words(day))
    for slot, mistake in day.mistakes.items():
        print_folded(f"{slot_words(day, slot)} waits: {mistake_words(mistake)}")
    if day.next is not None:
        print(f"next: {slot_words(day, day.next)}")
    if files.watch is None:
        _serve(day, files, port)
    else:
        _watch(day, files, files.watch, once)


def _serve(day: Day, files: DayFiles, port: int) -> None:
    try:
        import uvicorn

        from qsf_day.server import DayPage
    except ImportError as error:
        raise missing_extra(f"the page of the day needs {error.name}", "day") from error
    import socket

    from qsframework.viz.server import HOST, taking

    listening = socket.socket()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    with taking(port):
        listening.bind((HOST, port))
    page = DayPage(day, lambda now: finish(now, files))
    print(
        f"http://{HOST}:{listening.getsockname()[1]}{page.path}  (Ctrl-C ends it; the same command resumes it)",
        flush=True,
    )
    server = uvicorn.Server(uvicorn.Config(page.app(), log_level="error", lifespan="off"))
    server.run(sockets=[listening])


def _watch(day: Day, files: DayFiles, folder: Path, once: bool) -> None:
    """A line for every state that comes in; what is typed decides on those that wait."""
    from qsf_day.words import can_correct, slot_words

    print(f"watching {folder}: Ctrl-C ends it; the same command resumes the session", flush=True)
    looked, typed, asked, plain = _Looked(once), _Typed(), "", list[Path]()
    while not typed.end and (day.next is not None or (day.record.doubtful and typed.open)):
        for path in looked.whole(folder):
            day = _take(day, path, None, plain)
        for word in typed.words():
            day = _do(day, word, plain)
        question = ""
        if waiting := day.record.doubtful[:1]:
            correct = ", correct" if can_correct(day.mistakes[waiting[0]]) else ""
            question = f"{slot_words(day, waiting[0])} needs a decision: keep{correct} / again"
        elif plain and day.next is not None:
            question = f"{plain[0].name}: points without a pose. Is it {slot_words(day, day.next)}? Type yes or no."
        if question and question != asked:
            print_folded(question)
        asked = question
        if once:
            if looked.empty:
                print_folded(f"{folder}: the folder is empty: let the instrument's software write its exports into it")
            for path in looked.unfinished:
                print_folded(f"{path.name}: not taken: its last line has no end, so it may still be written")
            return
    print("every state of every pose was read" if day.next is None else "the day is ended")
    print_folded(*finish(day, files))


def _take(day: Day, path: Path, slot: Slot | None, plain: list[Path]) -> Day:
    """The day with a file; one of plain points is put aside until a state is confirmed for it."""
    from qsf_day.words import NOTHING_NEW, judged_words

    try:
        day, said = enter_file(day, path, slot)
    except Unconfirmed:
        plain.append(path)
        return day
    except (QsfError, OSError) as error:
        print_folded(f"{path.name}: not taken: {error}")
        return day
    for judged in said:
        print_folded(f"{path.name}: {judged_words(day, judged)}")
    if not said and day.record.files.get(sha256(path)) != path.name:  # a restart says nothing of what it finds again
        print_folded(f"{path.name}: {NOTHING_NEW}")
    return day


def _do(day: Day, word: str, plain: list[Path]) -> Day:
    """The day after a word that was typed: on the first state that waits, else on the first file of plain points."""
    from qsf_day.words import DONE, slot_words

    if word in DECISIONS and day.record.doubtful:
        slot = day.record.doubtful[0]
        try:
            day = decide(day, slot, word, day.record.states[slot].time)
            print_folded(f"{slot_words(day, slot)}: {DONE[word]}.")
        except QsfError as error:
            print_folded(str(error))
            day = reread(day)
    elif word in ("yes", "no") and plain and not day.record.doubtful:
        path = plain.pop(0)
        day = _take(day, path, day.next, plain) if word == "yes" else day
    elif word:
        print_folded(f"{word[:20]!r} is not an answer to the question")
    return day


class _Typed:
    """Lines that are typed, or come through a pipe, without waiting for them. open: more may come; end: the last one
    was `end`."""

    def __init__(self) -> None:
        self.open, self.end, self._left = True, False, b""

    def words(self) -> Iterator[str]:
        """Those that have come."""
        while self.open and not self.end and _readable():
            more = os.read(0, 4096)
            self.open = bool(more)
            *lines, self._left = (self._left + more).split(b"\n")
            for line in lines:
                word = line.decode("utf-8", "replace").strip().lower()
                self.end = self.end or word == "end"
                if word != "end":
                    yield word


def _readable() -> bool:
    """Whether standard input holds something; not where a terminal is another job's."""
    try:
        return (not os.isatty(0) or os.tcgetpgrp(0) == os.getpgrp()) and bool(select.select([0], [], [], 0)[0])
    except (OSError, ValueError):
        return False


class _Looked:
    """What was seen in a watched folder. once: what lies there is waited for while it changes, a minute at most;
    unfinished: files that have stopped changing without an end."""

    def __init__(self, once: bool) -> None:
        self._looks = int(_LONG / _POLL) if once else 1
        self._seen, self._taken, self.unfinished = dict[Path, _State](), set[_State](), list[Path]()

    @property
    def empty(self) -> bool:
        """Whether no file lay there at the last look."""
        return not self._seen

    def whole(self, folder: Path) -> Iterator[Path]:
        """Files that have an end and have stopped changing, and were not given as they are now; the oldest first.

        Files written within two seconds of each other, as a copied folder's are, come in the order of their names.
        """
        still: list[tuple[Path, _State]] = []
        for look in range(self._looks):
            before, self._seen = self._seen, dict(_states(folder))
            still = [(path, state) for path, state in self._seen.items() if before.get(path) == state]
            if (self._seen or look) and len(still) == len(self._seen):
                break
            time.sleep(_POLL)
        self.unfinished = [path for path, state in still if not _has_end(path, state)]
        new = [f for f in still if f[1] not in self._taken and f[0] not in self.unfinished]
        self._taken |= {state for _, state in new}
        yield from _in_order(sorted(new, key=lambda f: f[1]))


def _states(folder: Path) -> Iterator[tuple[Path, _State]]:
    """The files of a folder, with a state that a change would change."""
    for path in folder.iterdir():
        with suppress(OSError):  # gone meanwhile
            if path.is_file() and not path.name.startswith("."):
                status = path.stat()
                yield path, (status.st_mtime_ns, status.st_size, path.name)


def _has_end(path: Path, state: _State) -> bool:
    """Whether a file's last line has an end, or nobody has written for long; what is no text ends as it likes."""
    try:
        with path.open("rb") as file:
            file.seek(-min(64, state[1]), os.SEEK_END)
            last = file.read()
    except OSError:
        return False
    ends = b"\0" in last or last.rstrip(b" \t\x1a").endswith((b"\n", b"\r", b"}", b"]", b">"))
    return ends or time.time() - state[0] / 1e9 > _LONG


def _in_order(files: Sequence[tuple[Path, _State]]) -> Iterator[Path]:
    """Files by their times, those of one moment by their names."""
    together: list[list[tuple[Path, _State]]] = []
    for one in files:
        if together and one[1][0] - together[-1][-1][1][0] <= _TOGETHER:
            together[-1].append(one)
        else:
            together.append([one])
    for group in together:
        yield from (path for path, _ in sorted(group, key=lambda f: _by_number(f[0].name)))


def _by_number(name: str) -> list[tuple[int, str]]:
    """visit_9 before visit_10."""
    return [(int(part) + 1 if part.isdecimal() else 0, part) for part in _DIGITS.split(name)]


def finish(day: Day, files: DayFiles) -> list[str]:
    """Fit, validation, diagnosis, reports and certificate of the day, in its folder; what became of each."""
    from qsf_day.so_far import accepted
    from qsframework.cli import write_json
    from qsframework.diagnoses import diagnose
    from qsframework.fits import identify
    from qsframework.report.results import report
    from qsframework.report.words.fit import verdict_words
    from qsframework.report.words.headline import headline

    out, folder = list[str](), files.folder
    experiment = day.experiment
    day = reread(day)
    readings = accepted(day)
    if day.record.doubtful:
        out.append(f"{len(day.record.doubtful)} states wait for a decision and are not used")
    try:
        fit = identify(experiment, readings)
        write_json(folder / "fit.json", fit.as_json())
        report(fit, folder / "fit.html", experiment, readings, files=[files.experiment, day.record.table])
        out.append(f"fit.json, fit.html: {verdict_words(fit)}")
        out += [f"look at {finding.sentence}" for finding in fit.account.findings]
    except QsfError as error:
        return [*out, f"no fit, no diagnosis and no certificate: {error}"]
    found: Diagnosis | None = None
    try:
        found = diagnose(experiment, readings)
        after, said = second_day(found, folder)
        report(found, folder / "diagnosis.html", files=[files.experiment, day.record.table], day=after)
        out += [f"diagnosis.html: {headline(found)}", *said]
    except QsfError as error:
        out.append(f"no diagnosis: {error}")
    try:
        out += certificate_of(experiment, readings, found, folder)
    except QsfError as error:
        out.append(f"no certificate: {error}")
    return out


def second_day(found: Diagnosis, folder: Path) -> tuple[FollowUp | None, list[str]]:
    """The visits that would settle what a diagnosis leaves open, as a plan in the day's folder, and what is said of
    them; none where nothing is open."""
    from qsframework.diagnoses import follow_up
    from qsframework.experiment import write_plan
    from qsframework.report.words.follow_up import follow_up_words

    if found.verdict == "none":
        return None, []
    try:
        after = follow_up(found)
    except QsfError as error:
        return None, [f"no plan of a second day: {error}"]
    write_plan(folder / SECOND_DAY, after.plan, found.experiment)
    return after, [f"{SECOND_DAY}: {' '.join(follow_up_words(after))}"]


def certificate_of(experiment: Experiment, readings: Readings, found: Diagnosis | None, folder: Path) -> list[str]:
    """The certificate of the day's fit; of the extended one, in a folder of its own, where a diagnosis asks for it."""
    from qsframework.cli import write_json
    from qsframework.experiment.account import added_effects
    from qsframework.fits import identify, read_fit
    from qsframework.report.certificate_page import write_certificate
    from qsframework.report.extended import extended_words, write_extended
    from qsframework.report.words.certificate import conformity_words
    from qsframework.uses.certificate import certify, read_meta

    out, made = list[str](), folder
    if found is not None and (found.account.causes or (found.learned is not None and found.learned.holds)):
        made, found, diagnosis = folder / "extended", None, found
        write_extended(diagnosis, made)
        experiment = load_experiment(made / "experiment.yaml")
        out.append(f"extended/: {extended_words(diagnosis, added_effects(experiment.model()))}")
        readings = read_readings(experiment.data, experiment)
        write_json(made / "fit.json", identify(experiment, readings).as_json())
    certified = certify(experiment, read_fit(made / "fit.json"), readings, read_meta(None), diagnosis=found)
    write_certificate(folder / "certificate.html", certified)
    return [*out, f"certificate.html: {conformity_words(certified.conformity)}"]
