"""Headless Chromium, for the tests that look at a page."""

from __future__ import annotations

import base64
import gzip
import shutil
import subprocess
from pathlib import Path

import pytest

browser = pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium on this machine")
NO_HOST = "--host-resolver-rules=MAP * ~NOTFOUND"
"""Every name resolves to nothing, so that a request to any host would be an error on the console."""
SMALL = "--window-size=800,600"
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)
"""Of a browser that draws without a screen and asks nobody."""
_LOOK = ("--virtual-time-budget=8000", "--enable-logging=stderr")


def open_page(page: Path | str, folder: Path, *more: str, timeout: float = 600) -> subprocess.CompletedProcess[str]:
    """Open a page, its profile in the folder; stderr holds what the browser logged."""
    address = page.as_uri() if isinstance(page, Path) else page
    command = ["chromium", *FLAGS, *_LOOK, f"--user-data-dir={folder / 'profile'}", *more, address]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout)


def unpacked(frame: str) -> str:
    """The page that a report holds, packed, for a frame."""
    return gzip.decompress(base64.b64decode(frame)).decode()


def console(log: str) -> list[str]:
    """What the page wrote to its console, of all that the browser logged."""
    return [line for line in log.splitlines() if "CONSOLE" in line and "GPU stall" not in line]
