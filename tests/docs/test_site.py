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

import make_drawings
import pytest
from headless import NO_HOST, browser, open_page

import qsframework as qsf

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
        assert "<h1" in (site / f"{name}.html").read_text()


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
            assert to.is_file(), f"{path.relative_to(site)}: {link}"
            if parts.fragment and to in pages and not parts.fragment.startswith("__"):
                assert unquote(parts.fragment) in pages[to].ids, f"{path.relative_to(site)}: {link}"
            followed += 1
    assert followed > 500


def test_no_page_asks_another_host(site: Path, pages: dict[Path, Page]) -> None:
    for path, page in pages.items():
        assert page.loads or path.name == "scene.html"
        for link in page.loads:
            assert not urlparse(link).netloc, f"{path.relative_to(site)}: {link}"
        assert "@import" not in path.read_text()
    for sheet in site.rglob("*.css"):
        assert not re.search(r"(?:url\(|@import)\s*['\"]?(?:https?:)?//", sheet.read_text()), sheet


def test_equations_are_drawn_without_a_script(root: Path, site: Path) -> None:
    page, source = (site / "model.html").read_text(), (root / "docs" / "model.md").read_text()
    assert page.count("<math") == source.count("```math") > 10
    assert "\\tag" not in page
    assert '<span class="number">(18)</span>' in page


def test_home_shows_a_plan_in_3d(site: Path) -> None:
    assert 'src="scene.html"' in (site / "index.html").read_text()
    assert "three" in (site / "scene.html").read_text().lower()


@browser
def test_search_finds_pages_that_are_opened_from_disk(site: Path, tmp_path: Path) -> None:
    found = open_page(f"{(site / 'glossary.html').as_uri()}?q=balancer", tmp_path, NO_HOST, "--dump-dom").stdout
    assert "matching documents" in found
    assert "model.html" in found.split("matching documents", 1)[1]


def test_the_drawings_are_current(root: Path) -> None:
    for name in make_drawings.DRAWINGS:
        told = (root / "docs" / "images" / f"drawing-{name}.svg").read_text()
        assert told == make_drawings.svg(name), "run: python docs/make_drawings.py"


def test_every_robot_has_its_picture(root: Path) -> None:
    page = (root / "docs" / "robots.md").read_text()
    for robot in (root / "robots").glob("*/robot.yaml"):
        name = robot.parent.name
        assert f"images/{name}.png" in page
        assert (root / "docs" / "images" / f"{name}.png").stat().st_size > 5_000


def test_the_api_shows_the_verbs_with_their_docstrings(site: Path, pages: dict[Path, Page]) -> None:
    page = site / "api.html"
    for name in ("plans.design", "fits.identify", "diagnoses.diagnose", "uses.compensate", "plugin.Spring"):
        assert f"qsframework.{name}" in pages[page].ids
    assert "certified against the best relaxed design" in page.read_text()
    names = [n for n in dir(qsf) if n != "__version__"]
    own = {n: getattr(qsf, n).__name__.rpartition(".")[2] for n in names}
    assert [n for n in names if not any(i.endswith(f".{own[n]}") for i in pages[page].ids)] == []
