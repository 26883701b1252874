"""A Chromium that a test drives by the DevTools protocol: open, evaluate, kill."""

from __future__ import annotations

import base64
import json
import os
import signal
import subprocess
import time
import urllib.request
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

from headless import FLAGS
from websockets.sync.client import ClientConnection, connect

_DRIVEN = ("--disable-quic", "--remote-debugging-port=0", "--window-size=1000,1400")
_ONLY_HERE = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
"""Every name but this machine's address resolves to nothing."""


class Browser:
    """One page of one browser; what it logged, of this the errors, and what it asked of other hosts."""

    def __init__(self, folder: Path, address: str, own: str = "") -> None:
        """own: how addresses begin that may be asked for; the page's own where nothing is said."""
        command = ["chromium", *FLAGS, *_DRIVEN, _ONLY_HERE, f"--user-data-dir={folder}", "about:blank"]
        quiet = subprocess.DEVNULL
        self._process = subprocess.Popen(command, stdout=quiet, stderr=quiet, start_new_session=True)
        told, end = folder / "DevToolsActivePort", time.monotonic() + 300.0
        while not (told.is_file() and told.read_text().strip()):
            assert time.monotonic() < end, "the browser did not start"
            time.sleep(0.1)
        port = told.read_text().splitlines()[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=120) as answer:
            pages = [p for p in json.load(answer) if p["type"] == "page"]
        self._open = ExitStack()
        address_of_page = pages[0]["webSocketDebuggerUrl"]
        self._socket: ClientConnection = self._open.enter_context(connect(address_of_page, max_size=None))
        self._number, self.errors, self.foreign, self.logged = 0, list[str](), list[str](), list[str]()
        self._own = own or address
        for domain in ("Runtime", "Log", "Network", "Page"):
            self._ask(f"{domain}.enable")
        self._ask("Page.navigate", url=address)
        self.until("document.readyState === 'complete'")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def kill(self) -> None:
        """End it as a power cut would."""
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._open.close()

    def run(self, script: str) -> Any:
        """The value of an expression in the page; promises are waited for."""
        found = self._ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def until(self, condition: str, seconds: float = 300.0) -> None:
        """Wait for an expression to be true."""
        end = time.monotonic() + seconds
        while not self.run(condition):
            assert time.monotonic() < end, f"never came true: {condition}"
            time.sleep(0.05)

    def go(self, address: str, ready: str) -> None:
        """Open another page and wait for a condition in it."""
        self._ask("Page.navigate", url=address)
        self.until(f"location.href.split('#')[0] === {json.dumps(address.partition('#')[0])} && ({ready})")

    def size(self, width: int, height: int) -> None:
        """Give the page the size of another screen."""
        self._ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def key(self, name: str) -> None:
        """Press a key."""
        codes = {"ArrowRight": 39}
        for kind in ("rawKeyDown", "keyUp"):
            self._ask("Input.dispatchKeyEvent", type=kind, key=name, code=name, windowsVirtualKeyCode=codes[name])

    def pdf(self) -> bytes:
        """The page as it is printed on A4."""
        return base64.b64decode(self._ask("Page.printToPDF", printBackground=True, preferCSSPageSize=True)["data"])

    def picture(self, box: list[float]) -> bytes:
        """A PNG of a part of the page that is in view: left, top, width, height in pixels of the whole page."""
        part = {**dict(zip(("x", "y", "width", "height"), box, strict=True)), "scale": 1}
        return base64.b64decode(self._ask("Page.captureScreenshot", optimizeForSpeed=True, clip=part)["data"])

    def media(self, kind: str = "", scheme: str = "light") -> None:
        """Show the page as on paper (print), or in a light or dark scheme."""
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self._ask("Emulation.setEmulatedMedia", media=kind, features=features)

    def _ask(self, method: str, **params: Any) -> dict[str, Any]:
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": params}))
        while True:
            said = json.loads(self._socket.recv(timeout=300))
            self._hear(said)
            if said.get("id") == self._number:
                assert "error" not in said, said["error"]
                return dict(said["result"])

    def forget(self) -> None:
        """What was logged and asked so far, for it was another test's."""
        for told in (self.errors, self.foreign, self.logged):
            told.clear()

    def _hear(self, said: dict[str, Any]) -> None:
        params = said.get("params", {})
        if said.get("method") in ("Runtime.consoleAPICalled", "Log.entryAdded") and "GPU stall" not in str(params):
            self.logged.append(str(params))
        if said.get("method") == "Runtime.exceptionThrown":
            self.errors.append(str(params["exceptionDetails"]))
        if said.get("method") == "Runtime.consoleAPICalled" and params["type"] == "error":
            self.errors.append(str(params["args"]))
        if said.get("method") == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.errors.append(str(params["entry"]))
        if said.get("method") == "Network.requestWillBeSent":
            url = params["request"]["url"]
            if not url.startswith((self._own, "data:", "blob:", "about:")):
                self.foreign.append(url)
