"""The site: built without a warning, complete, every link inside it resolves, and no page asks another host."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlparse

import pytest

MISSING = [m for m in ("mkdocs", "material", "mkdocstrings_handlers") if importlib.util.find_spec(m) is None]
pytestmark = pytest.mark.skipif(bool(MISSING), reason=f"the docs extra is not installed: no {', '.join(MISSING)}")

LOADED = {("script", "src"), ("img", "src"), ("iframe", "src"), ("source", "src"), ("link", "href")}
"""What a browser fetches by itself; <a> is followed by the reader only."""


class Page(HTMLParser):
    """The ids of a page, what it links to, and what it loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(path.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {k: v or "" for k, v in attrs}
        self.ids |= {given[k] for k in ("id", "name") if k in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if given.get("rel") in ("canonical", "next", "prev", "edit"):
            return
        self.loads += [given[key] for name, key in LOADED if name == tag and key in given]


@pytest.fixture(scope="module")
def site(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site; its log is beside it."""
    folder = tmp_path_factory.mktemp("docs")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(folder / "site")]
    quiet = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "NO_COLOR": "1"}
    done = subprocess.run(command, cwd=root, env=quiet, capture_output=True, text=True)
    (folder / "log").write_text(done.stdout + done.stderr)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "site"


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    return {path: Page(path) for path in site.rglob("*.html")}


def test_no_warning(site: Path) -> None:
    log = (site.parent / "log").read_text()
    assert "WARNING" not in log
    assert "Documentation built" in log


def test_every_entry_of_the_menu_is_a_page(root: Path, site: Path) -> None:
    menu = re.findall(r"^ +- .*: (\S+)\.md$", (root / "mkdocs.yml").read_text(), re.M)
    assert len(menu) > 15
    for name in menu:
        page = site / "index.html" if name == "index" else site / name / "index.html"
        assert "<h1" in page.read_text()


def test_links_and_anchors_resolve(site: Path, pages: dict[Path, Page]) -> None:
    followed = 0
    for path, page in pages.items():
        if path.name == "404.html":
            continue
        for link in page.links:
            parts = urlparse(link)
            if parts.scheme or parts.netloc:
                continue
            to = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            to = to / "index.html" if to.is_dir() else to
            assert to.is_file(), f"{path.relative_to(site)}: {link}"
            if parts.fragment and to in pages and not parts.fragment.startswith("__"):
                assert unquote(parts.fragment) in pages[to].ids, f"{path.relative_to(site)}: {link}"
            followed += 1
    assert followed > 500


def test_no_page_asks_another_host(site: Path, pages: dict[Path, Page]) -> None:
    for path, page in pages.items():
        assert page.loads
        for link in page.loads:
            assert not urlparse(link).netloc, f"{path.relative_to(site)}: {link}"
        assert "@import" not in path.read_text()
    for sheet in site.rglob("*.css"):
        assert not re.search(r"(?:url\(|@import)\s*['\"]?(?:https?:)?//", sheet.read_text()), sheet


def test_the_api_shows_the_verbs_with_their_docstrings(site: Path, pages: dict[Path, Page]) -> None:
    page = site / "api" / "index.html"
    for name in ("design.design", "identify.identify", "diagnose.diagnose", "applications.compensate", "plugin.Spring"):
        assert f"qsframework.{name}" in pages[page].ids
    assert "certified against the best relaxed design" in page.read_text()
