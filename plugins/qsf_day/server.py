"""The page of the measuring day, for this machine alone: one lock around one day, everything slow beside it.

Whatever the page shows is made from the day's files: it may be closed, opened twice or killed, and nothing is lost.
"""

from __future__ import annotations

import json
import re
import secrets
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.middleware.base import BaseHTTPMiddleware, RequestResponseEndpoint
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route

from qsf_day.entry import enter_file, enter_text, read_positions
from qsf_day.record import Slot
from qsf_day.session import Day, Judged, decide, enter_floor, reread
from qsf_day.so_far import SoFar, diagnosis_so_far, so_far
from qsf_day.words import (
    DONE,
    NOTHING_NEW,
    can_correct,
    floor_words,
    judged_words,
    load_words,
    mistake_words,
    slot_words,
    so_far_words,
    spoilt_words,
)
from qsframework.errors import QsfError
from qsframework.experiment import make_plan
from qsframework.files import write_text
from qsframework.files.plain import is_mapping
from qsframework.plugin import Poses
from qsframework.report.words.headline import headline
from qsframework.report.words.sizes import shown_number, unit_shown
from qsframework.viz import show_scene
from qsframework.viz.server import HOST

_LARGEST = 6_000_000
_LONGEST = 80
"""Characters of a file's name, which may be four bytes each."""
_SAID = 30
"""Lines of what was said that the page shows."""
_ONLY_OURS = "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'self'"
"""What the page may load: nothing from elsewhere."""
_TOKEN = re.compile("[0-9a-f]{16}")
_SECRET = "x-qsf-day"
"""A header that a form of another site cannot send."""


class DayPage:
    """A day behind a page. end: writes the results of the day to its folder and says which."""

    def __init__(self, day: Day, end: Callable[[Day], list[str]]) -> None:
        self._day, self._end = day, end
        self.path = f"/{_token(day.record.folder)}/"
        self._lock, self._wake = threading.Lock(), threading.Event()
        self._version, self._said = 1, list[dict[str, Any]]()
        self._found: SoFar | None = None
        self._diagnosis, self._ended, self._asked = "", list[str](), False
        self._scene: tuple[int, str] = (-1, "")
        self._worker = threading.Thread(target=self._work, daemon=True)
        self._worker.start()
        self._wake.set()

    def app(self) -> Starlette:
        """Below `path`: / the day, /state what it shows, /scene the next pose; the others take what is done."""
        return Starlette(
            routes=[
                Mount(
                    self.path.rstrip("/"),
                    routes=[
                        Route("/", self._page),
                        Route("/state", self._state),
                        Route("/scene", self._scene_page),
                        Route("/readings", self._post(self._readings), methods=["POST"]),
                        Route("/file", self._post(self._file), methods=["POST"]),
                        Route("/floor", self._post(self._floor), methods=["POST"]),
                        Route("/decide", self._post(self._decide), methods=["POST"]),
                        Route("/end", self._post(self._ask_end), methods=["POST"]),
                    ],
                )
            ],
            middleware=[Middleware(_OnlyHere)],
        )

    async def _page(self, request: Request) -> Response:
        page = files("qsf_day").joinpath("templates", "day.html").read_text(encoding="utf-8")
        return HTMLResponse(page)

    async def _state(self, request: Request) -> Response:
        if request.query_params.get("since") == str(self._version):
            return Response(status_code=204)
        return JSONResponse(await run_in_threadpool(self._told))

    async def _scene_page(self, request: Request) -> Response:
        return HTMLResponse(await run_in_threadpool(self._draw))

    def _post(self, do: Callable[[Mapping[str, Any]], None]) -> Callable[[Request], Any]:
        async def answer(request: Request) -> Response:
            try:
                content = await _body(request)
                if content is None:
                    return JSONResponse({"error": f"more than {_LARGEST} bytes"}, 413)
                await run_in_threadpool(self._locked, do, _request(content))
            except QsfError as error:
                with self._lock, suppress(QsfError):  # as it was where its files cannot be read
                    self._version += 1
                    self._day = reread(self._day)
                return JSONResponse({"error": str(error)}, 422)
            except ClientDisconnect:
                return Response(status_code=400)
            except (KeyError, OverflowError, RecursionError, TypeError, ValueError):
                return JSONResponse({"error": "no request of this page"}, 400)
            return JSONResponse(await run_in_threadpool(self._told))

        return answer

    def _locked(self, do: Callable[[Mapping[str, Any]], None], asked: Mapping[str, Any]) -> None:
        with self._lock:
            before = self._day.visits_done
            try:
                do(asked)
            finally:
                self._version += 1
            if self._day.visits_done != before or self._day.next is None:
                self._wake.set()

    def _readings(self, asked: Mapping[str, Any]) -> None:
        self._day, judged = enter_text(self._day, str(asked["text"]), self._slot(asked))
        self._say(judged)

    def _file(self, asked: Mapping[str, Any]) -> None:
        name = Path(str(asked["name"])).name or "dropped"
        if len(name) > _LONGEST:
            raise ValueError
        with TemporaryDirectory() as folder:
            path = Path(folder) / name
            write_text(path, str(asked["text"]))
            self._day, judged = enter_file(self._day, path, self._slot(asked))
        self._say(judged)
        if not judged:
            self._add(f"{name}: {NOTHING_NEW}", True)

    def _floor(self, asked: Mapping[str, Any]) -> None:
        count = max(self._day.record.protocol.options.reflectors, 1)
        names = tuple(f"floor_{k + 1}" for k in range(count))
        positions = read_positions(str(asked["text"]), names)
        self._day, judged = enter_floor(self._day, positions, self._slot(asked))
        self._add(floor_words(judged), judged.kind in ("first", "still"))

    def _decide(self, asked: Mapping[str, Any]) -> None:
        slot, what = self._slot(asked), str(asked["decision"])
        if slot is None:
            raise ValueError
        self._day = decide(self._day, slot, what, float(asked["time"]))
        self._add(f"{slot_words(self._day, slot)}: {DONE[what]}.", True)

    def _ask_end(self, asked: Mapping[str, Any]) -> None:
        self._asked = True
        self._wake.set()

    def _slot(self, asked: Mapping[str, Any]) -> Slot | None:
        """The state that the page speaks of; None where the day was done. ValueError where there is none such."""
        if "visit" not in asked and self._day.next is None:
            return None
        slot = Slot(int(asked["visit"]), int(asked["state"]))
        if slot not in self._day.record.slots:
            raise ValueError
        return slot

    def _say(self, judged: list[Judged]) -> None:
        for one in judged:
            self._add(judged_words(self._day, one), one.mistake is None)

    def _add(self, words: str, fine: bool) -> None:
        self._said = [*self._said, {"at": time.strftime("%H:%M"), "words": words, "fine": fine}][-_SAID:]

    def _told(self) -> dict[str, Any]:
        """What the page shows."""
        with self._lock:
            day, record = self._day, self._day.record
            slots, here = record.slots, day.next
            done = len(slots) if here is None else slots.index(here)
            each = 60.0 * record.protocol.hours / max(len(slots), 1)
            return {
                "version": self._version,
                "title": f"{record.protocol.title}: {record.folder.name}",
                "next": None if here is None else _next(day, here),
                "after": slot_words(day, slots[done + 1]) if here is not None and done + 1 < len(slots) else "",
                "done": done,
                "states": len(slots),
                "visits": [day.visits_done, len(record.protocol.visits)],
                "minutes": round(each * (len(slots) - done)),
                "waiting": [
                    {
                        "visit": s.visit,
                        "state": s.state,
                        "time": record.states[s].time,
                        "where": slot_words(day, s),
                        "words": mistake_words(day.mistakes[s]),
                        "correct": can_correct(day.mistakes[s]),
                    }
                    for s in record.doubtful
                ],
                "said": self._said[::-1],
                "spoilt": spoilt_words(day),
                "reflectors": record.protocol.options.reflectors,
                "so_far": None if self._found is None else _so_far(self._found),
                "diagnosis": self._diagnosis,
                "ended": self._ended,
                "ending": self._asked,
                "table": str(record.table.name),
            }

    def _draw(self) -> str:
        """The next pose in 3D, with its load."""
        with self._lock:
            day = self._day
            visit = min(day.visits_done, len(day.record.protocol.visits) - 1)
        if self._scene[0] != visit:
            there = day.record.protocol.visits[visit]
            pendant = there.pendant[None]
            poses = Poses(pendant, day.experiment.robot.controller.to_joints(pendant), there.wrench[None])
            plan = replace(make_plan(poses, [there.load]), pose=(there.pose,))
            scene = show_scene(day.experiment, plan)
            self._scene = (visit, scene.html())
        return self._scene[1]

    def _work(self) -> None:
        """What is too slow for an answer, whenever a visit is done."""
        causes: tuple[str, ...] = ()
        while True:
            self._wake.wait()
            self._wake.clear()
            with self._lock:
                day, asked = self._day, self._asked
            found = replace(so_far(day), causes=causes) if day.record.rows else None
            self._put(found=found)
            if asked:
                self._put(ended=_ended(self._end, day))
                continue
            diagnosis = diagnosis_so_far(day)
            if diagnosis is not None:
                causes = diagnosis.account.causes or ()
                said = f"The diagnosis after {day.visits_done} visits: {headline(diagnosis)}"
                self._put(found and replace(found, causes=causes), said)

    def _put(self, found: SoFar | None = None, diagnosis: str | None = None, ended: list[str] | None = None) -> None:
        with self._lock:
            self._found = found or self._found
            self._diagnosis = self._diagnosis if diagnosis is None else diagnosis
            if ended is not None:
                self._ended, self._asked = ended, False
            self._version += 1


def _token(folder: Path) -> str:
    """The word in the page's address, which other users of the machine do not know; kept for the next start."""
    file, word = folder / ".page", secrets.token_hex(8)
    with suppress(OSError, QsfError):
        kept = file.read_text(encoding="ascii", errors="replace") if file.exists() else ""
        if _TOKEN.fullmatch(kept):
            return kept
        write_text(file, word, 0o600)
    return word


async def _body(request: Request) -> bytes | None:
    """The body of a request; None, without reading on, where it is too large."""
    content = b""
    async for part in request.stream():
        if len(content) + len(part) > _LARGEST:
            return None
        content += part
    return content


def _request(content: bytes) -> Mapping[str, Any]:
    """What is asked. ValueError, TypeError, RecursionError where it is no object of finite numbers and sound texts."""
    asked = json.loads(content or b"{}")
    if not is_mapping(asked):
        raise TypeError
    json.dumps(asked, allow_nan=False, ensure_ascii=False).encode()
    return asked


def _ended(end: Callable[[Day], list[str]], day: Day) -> list[str]:
    try:
        return end(day)
    except QsfError as error:
        return [str(error)]


def _next(day: Day, slot: Slot) -> dict[str, Any]:
    visit, read = day.record.visit(slot), day.record.at(slot)
    units = day.record.protocol.units
    values = units.shown(visit.pendant).tolist()
    return {
        "visit": slot.visit,
        "state": slot.state,
        "pose": visit.pose,
        "words": slot_words(day, slot),
        "load": load_words(day, slot),
        "angles": [[f"J{k + 1}", f"{v:.2f}", units[k].shown] for k, v in enumerate(values)],
        "markers": [[m, m in read] for m in visit.markers],
    }


def _so_far(found: SoFar) -> dict[str, Any]:
    rows: list[list[Any]] = []
    for t in found.told:
        sds = [shown_number(sd, t.unit, 2) for sd in (t.sd, t.predicted)]
        rows.append([t.name, shown_number(t.value, t.unit), *sds, unit_shown(t.unit), t.enough])
    predicted = [t.predicted for t in found.told]
    curves = [
        [visits, [sd / p if 0.0 < sd / p < float("inf") else None for sd, p in zip(sds, predicted, strict=True)]]
        for visits, sds in found.history
    ]
    return {"words": so_far_words(found), "rows": rows, "enough": found.enough, "curves": curves}


class _OnlyHere(BaseHTTPMiddleware):
    """Refuses what another host's name, another origin or a form of another site asks."""

    async def dispatch(self, request: Request, call_next: RequestResponseEndpoint) -> Response:
        host = request.headers.get("host", "")
        name = host.rpartition(":")[0] or host
        origin = request.headers.get("origin")
        foreign = origin is not None and origin != f"http://{host}"
        if name not in (HOST, "localhost") or foreign or (request.method == "POST" and _SECRET not in request.headers):
            return PlainTextResponse("only for this machine\n", 403)
        response = await call_next(request)
        response.headers["Cache-Control"] = "no-store"
        response.headers["Content-Security-Policy"] = _ONLY_OURS
        response.headers["X-Content-Type-Options"] = "nosniff"
        return response
