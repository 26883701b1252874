"""The page of the day: a whole day with mistakes in a browser, whatever is killed; nobody else is answered."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import re
import shutil
import signal
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import day_cell as cell
import numpy as np
import pytest
from headless import browser
from typer.testing import CliRunner

from qsf_day import Slot, begin, enter
from qsf_day.protocol import ProtocolOptions
from qsframework.cli.app import app
from qsframework.experiment import Experiment, load_experiment, write_plan
from qsframework.plugin import Array

OPTIONS = ["--cycles", "1", "--no-half", "--repeat-share", "0"]


class Server:
    """`qsf day` in a process of its own, to be asked and to be killed."""

    def __init__(self, folder: Path, port: int = 0) -> None:
        command = [sys.executable, "-m", "qsframework", "day", "experiment.yaml", "plan.csv", "-o", "day"]
        self.process = subprocess.Popen(
            [*command, "--port", str(port), *OPTIONS],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ,
        )
        assert self.process.stdout is not None
        self.port = 0
        for line in self.process.stdout:
            found = re.search(r"http://127\.0\.0\.1:(\d+)(/[0-9a-f]{16})/", line)
            if found:
                self.port, self.token = int(found[1]), found[2]
                break
        assert self.port, "the server did not start"
        end = time.monotonic() + 300.0
        while time.monotonic() < end:
            try:
                self.ask("GET", "/state")
                return
            except OSError:
                time.sleep(0.1)

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}{self.token}/"

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, Any]:
        return self.send(path, None if body is None else json.dumps(body), method, headers)

    def send(
        self, path: str, text: str | None, method: str = "POST", headers: Mapping[str, str] = {"X-QSF-Day": "1"}
    ) -> tuple[int, Any]:
        """A request with whatever body."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=300)
        connection.request(method, self.token + path, text, dict(headers))
        answer = connection.getresponse()
        content = answer.read().decode()
        connection.close()
        try:
            return answer.status, json.loads(content or "null")
        except json.JSONDecodeError:
            return answer.status, content

    def post(self, path: str, body: Any) -> tuple[int, Any]:
        return self.ask("POST", path, body, **{"X-QSF-Day": "1"})

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()
        if self.process.stderr is not None:
            self.process.stderr.close()


@pytest.fixture
def folder(tmp_path: Path, m900ib: Experiment) -> Path:
    path = cell.write_experiment(tmp_path)
    write_plan(tmp_path / "plan.csv", cell.make_day_plan(load_experiment(path)), load_experiment(path))
    return tmp_path


@pytest.fixture
def server(folder: Path) -> Iterator[Server]:
    made = Server(folder)
    yield made
    made.kill()


def lines(xyz: Array) -> str:
    return "\n".join(f"{m} " + " ".join(f"{1e3 * v:.4f}" for v in p) for m, p in zip(cell.MARKERS, xyz, strict=True))


def test_nobody_else_is_answered(server: Server, folder: Path) -> None:
    own = f"127.0.0.1:{server.port}"
    assert server.ask("GET", "/state")[0] == 200
    assert server.ask("GET", "/state", Host=f"localhost:{server.port}")[0] == 200
    assert server.ask("GET", "/", Host="evil.example")[0] == 403
    assert server.ask("GET", "/state", Host=f"evil.example:{server.port}")[0] == 403
    assert server.ask("GET", "/state", Origin="http://evil.example")[0] == 403
    known, server.token = server.token, ""  # of another user of the machine
    assert [server.ask("GET", path)[0] for path in ("/", "/state", "/scene")] == [404, 404, 404]
    server.token = known
    assert stat.S_IMODE((folder / "day" / ".page").stat().st_mode) == 0o600
    reading = {"visit": 0, "state": 0, "text": "m1 1 2 3"}
    assert server.ask("POST", "/readings", reading)[0] == 403  # as a form of another site would
    assert server.ask("POST", "/readings", reading, **{"X-QSF-Day": "1", "Origin": "http://127.0.0.1:1"})[0] == 403
    assert server.ask("POST", "/readings", reading, **{"X-QSF-Day": "1", "Origin": f"http://{own}"})[0] == 200
    assert server.ask("GET", "/../experiment.yaml")[0] == 404


def test_requests_that_no_page_makes_change_nothing(server: Server) -> None:
    for path, body in (
        ("/readings", {}),
        ("/readings", []),
        ("/readings", {"visit": 0, "state": 0, "text": "x" * 6_100_000}),
        ("/readings", {"visit": 0, "state": 0, "text": "m1 1 2"}),
        ("/readings", {"visit": 3, "state": 0, "text": "m1 1 2 3"}),
        ("/decide", {"visit": 99, "state": 0, "time": 0, "decision": "keep"}),
        ("/decide", {"visit": 0, "state": 0, "time": 0, "decision": "burn"}),
        ("/decide", {"visit": 0, "state": 0, "time": 0, "decision": "again"}),
        ("/decide", {"visit": 0, "state": 0, "decision": "again"}),
        ("/readings", {"text": "m1 1 2 3"}),
        ("/file", {"name": "f.txt", "text": "m1 1 2 3"}),
        ("/file", {"visit": 0, "state": 0, "name": "../../x", "text": ""}),
        ("/floor", {"visit": 0, "state": 0, "text": "floor_1 a b c"}),
    ):
        status, said = server.post(path, body)
        assert 400 <= status < 500, path
        assert said["error"], path
    assert server.ask("GET", "/state")[1]["done"] == 0


def test_what_is_malformed_is_told_so(server: Server) -> None:
    for text in (
        "[" * 100_000,
        '{"a":' * 50_000,
        "{",
        "null",
        "[]",
        '{"visit": Infinity, "state": 0, "text": "m1 1 2 3"}',
        '{"visit": 1e999, "state": 0, "text": "m1 1 2 3"}',
        '{"visit": 0, "state": 0, "text": "\\ud800 1 2"}',
        '{"visit": %s, "state": 0, "text": ""}' % ("9" * 5000),
        json.dumps({"visit": 0, "state": 0, "name": "x" * 5000, "text": "m1 1 2 3"}),
        json.dumps({"visit": 0, "state": 0, "name": "\0", "text": "m1 1 2 3"}),
    ):
        for path in ("/file",) if "name" in text else ("/readings", "/file", "/floor", "/decide"):
            status, said = server.send(path, text)
            assert status == 400, (path, text[:60])
            assert said["error"]
    assert server.ask("GET", "/state")[1]["done"] == 0


def memory(server: Server) -> float:
    """The most MB that the server has held."""
    status = Path(f"/proc/{server.process.pid}/status").read_text()
    return float(re.search(r"VmHWM:\s+(\d+) kB", status)[1]) / 1e3  # pyright: ignore[reportOptionalSubscript]


@pytest.mark.parametrize("length", ["Content-Length: 600000000", "Transfer-Encoding: chunked"])
def test_a_large_body_is_not_held_and_a_client_may_leave(server: Server, length: str) -> None:
    before, part = memory(server), b"x" * 1_000_000
    part = part if "Length" in length else b"f4240\r\n" + part + b"\r\n"
    head = f"POST /readings HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nX-QSF-Day: 1\r\n{length}\r\n\r\n"
    with socket.create_connection(("127.0.0.1", server.port), timeout=600) as client:
        client.sendall(head.encode())
        try:
            for _ in range(600):
                client.sendall(part)
        except (ConnectionError, TimeoutError):
            pass  # the server has closed it
    with socket.create_connection(("127.0.0.1", server.port), timeout=600) as client:
        client.sendall(head.encode() + part[:100])  # and leaves
    time.sleep(0.5)
    assert server.ask("GET", "/state")[0] == 200
    assert memory(server) - before < 30.0
    server.process.terminate()
    assert server.process.stderr is not None
    assert "Traceback" not in server.process.stderr.read()


def test_a_page_that_is_behind_fills_no_other_state(server: Server) -> None:
    """A page opened twice: the second one enters what the first one has entered already."""
    text = "m1 100 200 300\nm2 400 200 300\nm3 400 600 300"
    assert server.post("/readings", {"visit": 0, "state": 0, "text": text})[0] == 200
    status, said = server.post("/readings", {"visit": 0, "state": 0, "text": text})
    assert status == 422
    assert "the day has moved on: next is pose" in said["error"]


def test_a_port_that_is_taken_is_said(folder: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        command = [sys.executable, "-m", "qsframework", "day", "experiment.yaml", "plan.csv", "--port", port]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600)
    assert done.returncode == 2
    assert f"port {port} cannot be listened on" in done.stderr
    assert "0 takes any free one" in done.stderr


def test_a_plan_of_another_robot_is_refused(folder: Path) -> None:
    plan = folder / "plan.csv"
    plan.write_text(plan.read_text().replace("# robot: fanuc_m900ib", "# robot: fanuc_r2000ic"))
    command = [sys.executable, "-m", "qsframework", "day", "experiment.yaml", "plan.csv", "--watch", ".", "--once"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600)
    assert done.returncode == 2
    assert "fanuc_r2000ic" in done.stderr
    assert not (folder / "day").exists()


def watched(folder: Path, typed: str = "") -> str:
    """What is said, in this process, of what lies in the folder of exports now; typed: on standard input."""
    reads, writes = os.pipe()
    os.write(writes, typed.encode())
    os.close(writes)
    kept = os.dup(0)
    os.dup2(reads, 0)
    try:
        with contextlib.chdir(folder):
            whole = ["day", "experiment.yaml", "plan.csv", "-o", "day", *OPTIONS, "--watch", "exports", "--once"]
            done = CliRunner().invoke(app, whole, catch_exceptions=False)
    finally:
        os.dup2(kept, 0)
        os.close(kept)
        os.close(reads)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_a_watched_folder_says_a_line_for_every_state(folder: Path) -> None:
    experiment = load_experiment(folder / "experiment.yaml")
    options = ProtocolOptions(cycles=1, half=False, repeat_share=0.0)
    day = begin(experiment, cell.make_day_plan(experiment), folder / "other", options)
    arm, rng = cell.draw_arm(experiment, 4)
    exports = folder / "exports"
    exports.mkdir()
    said = ""
    for k in range(3):
        (exports / f"p{k}.txt").write_text(lines(arm.read(day, Slot(0, k), rng)) + "\n")
        said += watched(folder, "yes\n")
    (exports / "letter.txt").write_text("Dear operator\n")
    shutil.copy(exports / "p0.txt", exports / "copy.txt")
    last = watched(folder)
    assert [f"p{k}.txt: pose" in said for k in range(3)] == [True] * 3
    assert said.count("as expected.") == 3
    assert "letter.txt: not taken" in last
    assert "copy.txt: taken in before, nothing in it is new" in last
    assert "p0.txt" not in last
    assert "continued, 9 readings are there" in last


def test_a_file_is_taken_when_it_has_an_end_and_has_stopped_changing(folder: Path) -> None:
    """A slow export, and one that grows: what is whole is taken, and later what is new in it; nothing twice."""
    experiment = load_experiment(folder / "experiment.yaml")
    day = begin(experiment, cell.make_day_plan(experiment), folder / "other", cell.SHORT)
    arm, rng = cell.draw_arm(experiment, 4)
    for k in range(3):
        day, _ = enter(day, dict(zip(cell.MARKERS, arm.read(day, Slot(0, k), rng), strict=True)))
    whole = day.record.table.read_text().splitlines(keepends=True)
    export, path = folder / "exports" / "slow\x1b[2J.csv", folder / "day" / "readings.csv"
    export.parent.mkdir()
    for text, count, said in (
        ("".join(whole[2:6]) + whole[6][:-9], 0, "not taken: its last line has no end"),
        ("".join(whole[2:5]), 2, "m3 to come"),
        ("".join(whole[2:9]), 6, "as expected."),
        ("".join(whole[2:]), 9, "as expected."),
        ("# again\n" + "".join(whole[2:]), 9, "taken in before, nothing in it is new"),
    ):
        export.write_text(text)
        printed = watched(folder)
        assert said in " ".join(printed.split())
        assert "\x1b" not in printed
        assert len(path.read_text().splitlines()) == 3 + count
    assert [line.split(",")[:18] for line in path.read_text().splitlines()[2:]] == [
        line.split(",")[:18] for line in "".join(whole[2:]).splitlines()
    ]


def test_what_is_typed_decides_as_the_page_does(folder: Path) -> None:
    experiment = load_experiment(folder / "experiment.yaml")
    plan = cell.make_day_plan(experiment)
    day = begin(experiment, plan, folder / "day", cell.SHORT)
    arm, rng = cell.draw_arm(experiment, 4)
    while day.next != Slot(5, 0):
        slot = day.next or Slot(0, 0)
        xyz = arm.read(day, slot, rng)
        xyz = cell.exchanged(xyz, arm, day, slot) if slot.visit == 4 else xyz
        day, _ = enter(day, dict(zip(cell.MARKERS, xyz, strict=True)))
    assert len(day.record.doubtful) == 3
    (folder / "exports").mkdir()
    (folder / "exports" / "letter.txt").write_text("Dear operator\n")  # in an empty folder a file is waited for
    said = " ".join(watched(folder, "correct\nnonsense\nkeep\nagain\n").split())
    assert "waits: Markers m1 and m2 are exchanged." in said
    assert "corrected as proposed." in said
    assert "kept as it is." in said
    assert "to be read again." in said
    assert "'nonsense' is not an answer to the question" in said
    after = begin(experiment, plan, folder / "day", cell.SHORT)
    assert [after.record.states[Slot(4, k)].said for k in range(2)] == ["corrected", "kept"]
    assert after.next == Slot(4, 2)


PLANTED: dict[Slot, tuple[cell.Explanation, str, str]] = {
    Slot(4, 0): (cell.exchanged, "Markers m1 and m2 are exchanged.", "correct"),
    Slot(4, 2): (cell.sign, "The sign of x is flipped.", "correct"),
    Slot(5, 0): (cell.angle, "q3 is +2.0", "again"),
    Slot(5, 1): (cell.ten_times, "The deflection matches ten times the load", "again"),
    Slot(6, 0): (cell.inches, "The numbers are in inch, not in mm.", "correct"),
    Slot(7, 1): (cell.no_load, "The load was not put on", "again"),
    Slot(8, 0): (cell.other_pose, "These are readings of pose", "again"),
}
MOVED = Slot(9, 0)
"""Where the tracker is moved."""
KILLED, CLOSED = (Slot(3, 1), Slot(6, 1), Slot(8, 2)), (Slot(4, 1), Slot(7, 0))


@browser
def test_on_a_telephone_one_thing_at_a_time(folder: Path, server: Server) -> None:
    """390 px: the next pose alone, or the pose to look at again alone; what is tapped is 44 px high."""
    from chromium import Browser

    page = Browser(folder / "profile", server.address)
    seen = """({next: !!document.getElementById("next").getClientRects().length,
      asked: document.querySelectorAll(".box").length,
      shown: [...document.querySelectorAll(".box")].filter(b => b.getClientRects().length).length,
      wide: document.documentElement.scrollWidth, open: document.querySelectorAll("details[open]").length,
      low: [...document.querySelectorAll("button, input, summary")].filter(b => b.getClientRects().length)
      .map(b => b.getBoundingClientRect().height).filter(h => h < 44)})"""
    try:
        page.size(390, 844)
        page.go(server.address, "typeof known !== 'undefined' && known && known.next")
        first = page.run(seen)
        assert first == {"next": True, "asked": 0, "shown": 0, "wide": first["wide"], "open": 0, "low": []}
        state = server.ask("GET", "/state")[1]["next"]
        wrong = "\n".join(f"{name} {1000 + 50 * i} 20 3000" for i, (name, _) in enumerate(state["markers"]))
        server.post("/readings", {"visit": state["visit"], "state": state["state"], "text": wrong})
        page.until("known.waiting.length > 0")
        asked = page.run(seen)
        assert (asked["next"], asked["shown"], asked["low"]) == (False, 1, [])
        assert max(first["wide"], asked["wide"]) <= 390
    finally:
        page.kill()


@browser
def test_a_whole_day_in_a_browser_with_eight_mistakes(tmp_path: Path) -> None:
    """5 poses under 2 loads, 3 markers; the server is killed three times and the browser twice. All eight mistakes are
    named when they are entered, nothing else is to be looked at, and no reading is lost."""
    from chromium import Browser

    path = cell.write_experiment(tmp_path)
    experiment = load_experiment(path)
    plan = cell.make_day_plan(experiment, 5, loads=2)
    write_plan(tmp_path / "plan.csv", plan, experiment)
    options = ProtocolOptions(cycles=1, half=False, repeat_share=0.0)
    day = begin(experiment, plan, tmp_path / "same", options)  # the protocol of the day, to be measured
    arm, rng = cell.draw_arm(experiment, 11)
    server = Server(tmp_path)
    page = Browser(tmp_path / "profile", server.address)
    planted, killed, closed = dict(PLANTED), list(KILLED), list(CLOSED)
    told: dict[Slot, str] = {}
    errors, foreign = list[str](), list[str]()
    try:
        while True:
            state = server.ask("GET", "/state")[1]
            if state["next"] is None:
                break
            slot = Slot(state["next"]["visit"], state["next"]["state"])
            if slot in killed:
                killed.remove(slot)
                server.kill()
                server = Server(tmp_path, server.port)
            if slot in closed:
                closed.remove(slot)
                errors, foreign = errors + page.errors, foreign + page.foreign
                page.kill()
                shutil.rmtree(tmp_path / "profile", ignore_errors=True)
                page = Browser(tmp_path / "profile", server.address)
            if slot == MOVED and MOVED not in told:
                arm = arm.moved(np.array([0.05, -0.03, 0.04]))
            xyz = arm.read(day, slot, rng)
            wrong = planted.pop(slot, None)
            xyz = wrong[0](xyz, arm, day, slot) if wrong else xyz
            numbers = json.dumps([f"{1e3 * v:.4f}" for v in xyz.ravel()])
            page.until(f"known && known.next && known.next.visit === {slot.visit} && known.next.state === {slot.state}")
            page.run(f"[...document.querySelectorAll('#markers input')].forEach((f, i) => f.value = {numbers}[i])")
            page.run("document.querySelector('#typed button').click()")
            page.until(f"known.done > {state['done']} || known.waiting.length > 0")
            waiting = page.run("known.waiting")
            if waiting:
                told[slot] = waiting[0]["words"]
                what = PLANTED[slot][2] if slot in PLANTED else "correct"
                button = {"correct": "Correct it so", "again": "Read it again"}[what]
                page.run(
                    f"[...document.querySelectorAll('#waiting button')].find(b => b.textContent === '{button}').click()"
                )
                page.until("known.waiting.length === 0")
        errors, foreign = errors + page.errors, foreign + page.foreign
        assert page.run("getComputedStyle(document.querySelector('#angles')).display") == "flex"
        assert page.run("document.documentElement.scrollWidth <= window.innerWidth")
        page.until("document.querySelectorAll('#curves path').length > 6", 240.0)
        page.size(400, 900)
        assert page.run("document.documentElement.scrollWidth <= 400")
        page.run("document.getElementById('end').click()")
        page.until("known.ended.length > 0", 240.0)
        ended = page.run("known.ended")
    finally:
        page.kill()
        server.kill()
    assert set(told) == {*PLANTED, MOVED}
    for slot, (_, words, _) in PLANTED.items():
        assert words in told[slot]
    assert "the tracker was moved" in told[MOVED]
    assert not killed
    assert not closed
    assert not foreign
    lost = [e for e in errors if "ERR_CONNECTION" not in e and "Failed to load" not in e]  # while the server was dead
    assert not lost
    done = begin(experiment, plan, tmp_path / "day", options)
    assert done.next is None
    assert len(done.record.rows) == 10 * 3 * 3
    assert not done.mistakes
    assert any(line.startswith("fit.json") for line in ended)
    assert any(line.startswith("diagnosis.html") for line in ended)
    for name in ("fit.json", "fit.html", "diagnosis.html"):
        assert (tmp_path / "day" / name).is_file()
