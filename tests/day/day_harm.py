"""What may befall a measuring day: kills, spoilt bytes, two writers. Each function says what became of it, as faults.

`benchmarks/kills.py --days` runs hundreds of each; a few run with the tests.
"""

from __future__ import annotations

import http.client
import json
import multiprocessing
import os
import random
import shutil
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import day_cell as cell
import numpy as np

from qsf_day import Day, Slot, begin, decide, enter
from qsf_day.entry import enter_file
from qsf_day.session import reread
from qsframework.errors import InputError, QsfError
from qsframework.experiment import Experiment, load_experiment, read_plan, write_plan
from qsframework.plugin import Array

sys.path.append(str(Path(__file__).resolve().parents[1] / "robustness"))
import killed

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "day"
OPTIONS = ("--cycles", "1", "--no-half", "--repeat-share", "0", "-o", "day")
Stood = dict[Slot, tuple[str, list[list[float]]]]
"""Of each state what is said of it, and its positions, mm, rounded as they were written."""


def stood(day: Day) -> Stood:
    """The states as they stand."""
    return {
        s: (e.said, [(1e3 * e.xyz[m]).round(4).tolist() for m in sorted(e.xyz)]) for s, e in day.record.states.items()
    }


def opened(experiment: Experiment, folder: Path) -> Day:
    return begin(experiment, read_plan(folder / "plan.csv", experiment), folder / "day", cell.SHORT)


@dataclass
class Watched:
    """The example's exports, files of several states, and what a run that nobody kills makes of them."""

    place: Path
    experiment: Experiment
    whole: Stood
    seconds: float
    words = b"keep\nkeep\n"

    def run(self, share: float | None = None) -> int:
        """One run, killed after a share of its time; two decisions come through its standard input."""
        reading, writing = os.pipe()
        os.write(writing, self.words)
        os.close(writing)
        old = os.dup(0)
        os.dup2(reading, 0)
        os.close(reading)
        try:
            line = ["day", "experiment.yaml", "plan.csv", "--watch", "exports", "--once", *OPTIONS]
            number = None if share is None else signal.SIGKILL
            return killed.run(killed.qsf(line), self.place.parent / "said", number, (share or 0.0) * self.seconds)
        finally:
            os.dup2(old, 0)
            os.close(old)


def watched(place: Path) -> Watched:
    """Prepared in an empty folder, which becomes the place to be."""
    shutil.copytree(EXAMPLE, place)
    os.chdir(place)
    out = Watched(place, load_experiment(place / "experiment.yaml"), {}, 0.0)
    for _ in range(2):
        shutil.rmtree(place / "day", ignore_errors=True)
        start = time.monotonic()
        code = out.run()
        out.seconds = time.monotonic() - start
        assert code == 0, (place.parent / "said").read_text()
    out.whole = stood(opened(out.experiment, place))
    return out


def kill_watched(one: Watched, share: float) -> tuple[str, list[str]]:
    """A day killed in watch mode, and gone on with: what was there when it was killed, and what is wrong at the end."""
    shutil.rmtree(one.place / "day", ignore_errors=True)
    code = one.run(share)
    before = stood(opened(one.experiment, one.place)) if (one.place / "day").exists() else {}
    faults = [] if code in (0, -signal.SIGKILL) else [f"it ended with {code}"]
    again = one.run()
    if again:
        return "", [*faults, f"the second run ended with {again}: {(one.place.parent / 'said').read_text()[-300:]}"]
    after = stood(opened(one.experiment, one.place))
    if {s: xyz for s, (_, xyz) in after.items()} != {s: xyz for s, (_, xyz) in one.whole.items()}:
        faults.append("readings are lost, doubled or in another state")
    for slot, (said, _) in after.items():
        kept = before.get(slot, ("",))[0]
        if said not in (one.whole[slot][0], "kept") or (kept == "kept" != said):
            faults.append(f"{slot}: {said}, where {one.whole[slot][0]} was said, and {kept or 'nothing'} before")
    return f"{len(before)} of {len(after)} states", faults


@dataclass
class Paged:
    """A day by the page: an operator who types, makes mistakes and decides, while the server is killed.

    sent: every text of a state, mm; word: the last decision on it that was answered
    """

    place: Path
    experiment: Experiment
    chance: random.Random
    port: int = 0
    child: int = 0
    faults: list[str] = field(default_factory=list[str])
    sent: dict[Slot, list[list[list[float]]]] = field(default_factory=dict[Slot, list[list[list[float]]]])
    word: dict[Slot, str] = field(default_factory=dict[Slot, str])

    def start(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        line = ["day", "experiment.yaml", "plan.csv", "--port", str(self.port), *OPTIONS]
        self.child = killed.in_child(killed.qsf(line), self.place.parent / "said")
        end = time.monotonic() + 600.0
        while time.monotonic() < end:
            try:
                self.ask("GET", "/state")
                return
            except OSError:
                time.sleep(0.02)
        raise TimeoutError((self.place.parent / "said").read_text())

    def stop(self) -> None:
        os.kill(self.child, signal.SIGKILL)
        os.waitpid(self.child, 0)

    def ask(self, method: str, path: str, what: Any = None) -> tuple[int, Any]:
        """OSError where the server is gone."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=600)
        try:
            token = (self.place / "day" / ".page").read_text()
            connection.request(
                method, f"/{token}{path}", None if what is None else json.dumps(what), {"X-QSF-Day": "1"}
            )
            answer = connection.getresponse()
            return answer.status, json.loads(answer.read() or b"null")
        except http.client.HTTPException as error:
            raise ConnectionError from error
        finally:
            connection.close()

    def killed_soon(self, what: Callable[[], tuple[int, Any]]) -> tuple[int, Any] | None:
        """An answer, while a kill is on its way; None where none came."""
        if os.fork() == 0:
            time.sleep(self.chance.uniform(0.0, 0.08))
            os.kill(self.child, signal.SIGKILL)
            os._exit(0)
        try:
            found = what()
        except OSError:
            found = None
        os.waitpid(self.child, 0)
        os.wait()
        self.start()
        return found


def kill_paged(place: Path, seed: int, kills: int) -> tuple[int, list[str]]:
    """A day by the page with some kills, each while something is being stored; how many came, and the faults."""
    place.mkdir()
    os.chdir(place)
    experiment = load_experiment(cell.write_experiment(place))
    plan = cell.make_day_plan(experiment, 8)
    write_plan(place / "plan.csv", plan, experiment)
    arm, rng = cell.draw_arm(experiment, seed)
    one = Paged(place, experiment, random.Random(seed))
    same = begin(experiment, plan, place / "same", cell.SHORT)
    at = sorted(one.chance.sample(range(1, 24), kills))
    one.start()
    step = 0
    while True:
        _, state = one.ask("GET", "/state")
        if state["next"] is None and not state["waiting"]:
            break
        do, told = _next_act(one, same, state, arm, rng)
        step += 1
        found = one.killed_soon(do) if step in at else do()
        if found is not None and found[0] != 200:
            one.faults.append(f"step {step}: {found}")
            break
        if found is not None and told is not None:
            one.word[told[0]] = told[1]
    one.stop()
    one.faults += list(_of_the_end(one, opened(experiment, place)))
    return sum(k <= step for k in at), one.faults


def _next_act(
    one: Paged, same: Day, state: Mapping[str, Any], arm: cell.Arm, rng: np.random.Generator
) -> tuple[Callable[[], tuple[int, Any]], tuple[Slot, str] | None]:
    """What the operator does next: a decision on what waits, or the next reading, now and then with two markers
    exchanged."""
    if state["waiting"]:
        waits = state["waiting"][0]
        word = one.chance.choice(["keep", "again", *(["correct"] if waits["correct"] else [])])
        what = {k: waits[k] for k in ("visit", "state", "time")} | {"decision": word}
        return lambda: one.ask("POST", "/decide", what), (Slot(waits["visit"], waits["state"]), word)
    slot = Slot(state["next"]["visit"], state["next"]["state"])
    xyz: Array = arm.read(same, slot, rng)
    xyz = cell.exchanged(xyz, arm, same, slot) if one.chance.random() < 0.2 and slot.visit > 3 else xyz
    mm = (1e3 * xyz).round(4).tolist()
    one.sent.setdefault(slot, []).append(mm)
    text = "\n".join(" ".join([m, *map(repr, p)]) for m, p in zip(cell.MARKERS, mm, strict=True))
    reading = {"visit": slot.visit, "state": slot.state, "text": text}
    return lambda: one.ask("POST", "/readings", reading), None


def _of_the_end(one: Paged, day: Day) -> Iterator[str]:
    """What is wrong with a day that is done."""
    done = {"keep": "kept", "correct": "corrected"}
    for slot in day.record.slots:
        said, xyz = stood(day).get(slot, ("lost", []))
        allowed = one.sent.get(slot, [])
        if said == "corrected":
            allowed = [[mm[1], mm[0], mm[2]] for mm in allowed]
        if xyz not in allowed:
            yield f"{slot}: {said}, {xyz} was never sent for it"
        word = one.word.get(slot, "")
        if word in done and said != done[word]:
            yield f"{slot}: {said}, but {word} was answered"


def two_writers(experiment: Experiment, folder: Path, seed: int) -> tuple[int, list[str]]:
    """Two processes that enter the same states at the same time, one of them with a view that is behind; how many
    rounds, and what stands in a state that was not named for it."""
    plan = cell.make_day_plan(experiment, 8)
    day = begin(experiment, plan, folder, cell.SHORT)
    arm, rng = cell.draw_arm(experiment, seed)
    texts = [{s: arm.read(day, s, rng).round(7) for s in day.record.slots} for _ in range(2)]
    context, slots = multiprocessing.get_context("fork"), day.record.slots
    gate, said = context.Barrier(2), context.Queue()

    def write(k: int) -> None:
        now, faults = day, list[str]()
        try:
            for slot in slots:
                gate.wait(60.0)
                try:
                    now, _ = enter(now, dict(zip(cell.MARKERS, texts[k][slot], strict=True)), slot)
                except InputError:
                    now = reread(now)
        except BaseException as error:
            faults.append(f"writer {k}: {error!r}")
        said.put(faults)

    both = [context.Process(target=write, args=(k,)) for k in range(2)]
    for process in both:
        process.start()
    faults = [fault for _ in both for fault in said.get(timeout=600)]
    for process in both:
        process.join()
    end = begin(experiment, plan, folder, cell.SHORT)
    for slot in slots:
        there = np.array([end.record.at(slot).get(m, np.zeros(3)) for m in cell.MARKERS])
        if not any(np.array_equal(there, text[slot]) for text in texts):
            faults.append(f"{slot}: not what one writer named it for")
    return len(slots), faults


@dataclass
class Spoilt:
    """A day with its files, to be spoilt again and again."""

    place: Path
    experiment: Experiment
    log: bytes
    table: bytes
    lines: list[bytes]


def spoilt(place: Path) -> Spoilt:
    """A day after five visits of the example, three states decided upon."""
    shutil.copytree(EXAMPLE, place)
    experiment = load_experiment(place / "experiment.yaml")
    day = opened(experiment, place)
    for path in sorted((place / "exports").iterdir()):
        day, _ = enter_file(day, path)
    for slot, word in zip(day.record.doubtful, ("keep", "again"), strict=False):
        day = decide(day, slot, word)
    log = (place / "day" / "day.jsonl").read_bytes()
    return Spoilt(place, experiment, log, (place / "day" / "readings.csv").read_bytes(), log.split(b"\n")[1:-1])


def spoil(content: bytes, chance: random.Random) -> bytes:
    """Bytes flipped, lost, put in, exchanged; an end cut off; lines lost or doubled; other ends of lines."""
    out, place = bytearray(content), chance.randrange(len(content))
    match chance.randrange(7):
        case 0:
            for _ in range(chance.randint(1, 5)):
                out[chance.randrange(len(out))] = chance.randrange(256)
        case 1:
            del out[place : place + chance.randint(1, 400)]
        case 2:
            out[place:place] = chance.randbytes(chance.randint(1, 400))
        case 3:
            del out[place:]
        case 4:
            lines = content.split(b"\n")
            k = chance.randrange(len(lines))
            lines[k : k + 1] = [lines[k]] * chance.choice((0, 2))
            return b"\n".join(lines)
        case 5:
            out[place : place + 50] = bytes(50)
        case _:
            return content.replace(b"\n", b"\r\n")
    return bytes(out)


def spoil_journal(one: Spoilt, seed: int) -> list[str]:
    """A day is opened whose journal was spoilt: every whole record is there, and nothing ends in a traceback."""
    content, folder = spoil(one.log, random.Random(seed)), one.place / "day"
    (folder / "day.jsonl").write_bytes(content)
    (folder / "readings.csv").write_bytes(one.table)
    whole = [json.loads(line[9:]) for line in one.lines if line in content]
    try:
        day = opened(one.experiment, one.place)
    except QsfError as error:
        return [] if not whole else [f"refused, with {len(whole)} whole records: {error}"]
    except Exception as error:
        return [f"a traceback: {error!r}"]
    lost = [record for record in whole if record not in day.record.log]
    faults = [f"{len(lost)} whole records are not used"] if lost else []
    missing = len(one.lines) - len(whole)
    hidden = (
        missing
        and not day.record.spoilt
        and content[-1:] == b"\n"
        and b"\n" + content != content
        and _named(one, content)
    )
    return [*faults, *(["spoilt lines are not named"] if hidden else [])]


def _named(one: Spoilt, content: bytes) -> bool:
    """Whether something stands there that is neither the header nor a record."""
    known = {*one.lines, one.log.split(b"\n")[0], b""}
    return any(line.rstrip() not in known for line in content.split(b"\n")[:-1])


def spoil_table(one: Spoilt, seed: int) -> list[str]:
    """A day is opened whose table was spoilt, and a spoilt export comes in."""
    chance, folder = random.Random(seed), one.place / "day"
    (folder / "day.jsonl").write_bytes(one.log)
    (folder / "readings.csv").write_bytes(spoil(one.table, chance))
    export = one.place / "spoilt.csv"
    export.write_bytes(spoil(chance.choice(sorted((one.place / "exports").iterdir())).read_bytes(), chance))
    try:
        day = opened(one.experiment, one.place)
        if (folder / "readings.csv").read_bytes() != one.table or len(day.record.log) != len(one.lines):
            return ["the table is not made anew"]
        enter_file(day, export)
    except QsfError:
        return []
    except Exception as error:
        return [f"a traceback: {error!r}"]
    return []
