"""A page for this machine only: the scene is made anew whenever one of its files changes."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Lock
from typing import Any

from qsframework.errors import InputError, QsfError
from qsframework.viz.scene import Scene

HOST = "127.0.0.1"
"""The only address that is listened on: nobody else's machine can ask."""
_WATCH = "/changed"


class SceneSite:
    """The page of a scene and the files that it is made from.

    make(watch) gives the page as HTML; it is called again once a file is another than it was
    """

    def __init__(self, make: Callable[[str], str], files: Sequence[Path]) -> None:
        self._make, self._files, self._lock = make, tuple(files), Lock()
        self._page, self._state = "", ""

    @property
    def state(self) -> str:
        """A text that changes with the files."""
        return " ".join(str(path.stat().st_mtime_ns) if path.exists() else "gone" for path in self._files) or "-"

    def page(self) -> str:
        """The page now; where the files are wrong, a page that says so and waits for better ones."""
        with self._lock:
            state = self.state
            if not self._page or state != self._state:
                try:
                    self._page = self._make(_WATCH)
                except QsfError as error:
                    self._page = Scene(title="error", notes=str(error).splitlines()).html(_WATCH)
                self._state = state
            return self._page


def serve(site: SceneSite, port: int) -> ThreadingHTTPServer:
    """A server on 127.0.0.1, ready to `serve_forever`. InputError where the port is taken; port 0 takes a free one."""
    with taking(port):
        return _Server((HOST, port), _handler(site))


@contextmanager
def taking(port: int) -> Generator[None]:
    """Within, a port is listened on; InputError where it is no port, or taken."""
    if not 0 <= port <= 65535:
        raise InputError(f"port {port}: allowed: 0 (any free one) to 65535")
    try:
        yield
    except OSError as error:
        hint = "Stop what listens there, or give another one; 0 takes any free one"
        raise InputError(f"port {port} cannot be listened on: {error.strerror}. {hint}") from None


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a client that has left."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


def _handler(site: SceneSite) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        """GET / is the page, GET /changed its state; no icon; anything else, or another host's name, is refused."""

        def do_GET(self) -> None:
            host = (self.headers.get("Host") or "").rpartition(":")[0]
            if host not in (HOST, "localhost"):  # a page from elsewhere that points its own name at this machine
                self._answer(403, "text/plain", "only for this machine\n")
            elif self.path == "/":
                self._answer(200, "text/html", site.page())
            elif self.path == _WATCH:
                self._answer(200, "text/plain", site.state)
            elif self.path == "/favicon.ico":  # browsers ask by themselves, and would complain
                self._answer(200, "image/x-icon", "")
            else:
                self._answer(404, "text/plain", "not found\n")

        def _answer(self, status: int, kind: str, text: str) -> None:
            body = text.encode()
            self.send_response(status)
            self.send_header("Content-Type", f"{kind}; charset=utf-8")
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing: the terminal belongs to the command."""

    return Handler
