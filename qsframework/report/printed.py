"""A page as a file: HTML, or printed on paper's pages by a Chromium where the file's name ends in .pdf."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from qsframework.errors import InputError, Problem
from qsframework.files import write_bytes, write_text

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
"""Names under which a browser may be installed that prints without a screen; the first that is there prints."""
_HEADLESS = (
    "headless",
    "disable-gpu",
    "use-gl=angle",
    "use-angle=swiftshader",
    "enable-unsafe-swiftshader",
    "disable-background-networking",
    "disable-component-update",
    "disable-sync",
    "no-first-run",
    "host-resolver-rules=MAP * ~NOTFOUND",
    "virtual-time-budget=15000",
    "no-pdf-header-footer",
)
_PATIENCE = 180.0
_OWN = "qsframework.report"


def rendered(
    template: str, filters: Mapping[str, Callable[[str], Any]], content: Mapping[str, Any], package: str = _OWN
) -> str:
    """A page by its template; package: that holds it, beside the templates of reports."""
    import jinja2

    loader = jinja2.ChoiceLoader([jinja2.PackageLoader(name) for name in (package, _OWN)])
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    environment.filters.update(filters)
    return environment.get_template(template).render(**content)


def write_page(path: str | Path, page: str) -> Path:
    """Write a page, all or nothing: HTML, or a PDF where the path ends so.

    InputError where no browser is installed that prints, or where it prints nothing.
    """
    if Path(path).suffix.lower() != ".pdf":
        return write_text(path, page)
    return write_bytes(path, printed(page, Path(path)))


def printed(page: str, path: Path) -> bytes:
    """The page as it is printed, its plots and 3D views drawn; path: what errors name."""
    folders = os.pathsep.join(filter(os.path.isabs, os.get_exec_path()))  # not the current one
    browser = next((found for name in BROWSERS if (found := shutil.which(name, path=folders))), None)
    if browser is None:
        hint = "Write .html instead, and print it from any browser."
        raise InputError(Problem("a PDF is printed by Chromium, and none is installed", str(path), hint=hint))
    with tempfile.TemporaryDirectory() as name:
        html, out = Path(name) / "page.html", Path(name) / "page.pdf"
        write_text(html, page)
        root = ["no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []  # Chromium has none for root
        flags = [*_HEADLESS, *root, f"user-data-dir={name}/profile", f"print-to-pdf={out}"]
        command = [browser, *(f"--{flag}" for flag in flags)]
        try:
            done = subprocess.run([*command, html.as_uri()], capture_output=True, timeout=_PATIENCE, cwd=name)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise InputError(Problem(f"{browser} did not print: {error}", str(path))) from error
        if not out.is_file() or not out.read_bytes().startswith(b"%PDF"):
            lines = done.stderr.decode(errors="replace").strip().splitlines()
            raise InputError(Problem(f"{browser} printed nothing{f': {lines[-1]}' if lines else ''}", str(path)))
        return out.read_bytes()
