"""The pages of docs/ are all in the menu, and lead nowhere that is not there."""

from __future__ import annotations

import re
from pathlib import Path

import draw_records


def test_every_page_is_in_the_menu(root: Path) -> None:
    menu = re.findall(r"^ +- .*: (\S+\.md)$", (root / "mkdocs.yml").read_text(), re.M)
    assert sorted(menu) == sorted(path.name for path in (root / "docs").glob("*.md"))


def test_links_lead_somewhere(root: Path) -> None:
    for page in (root / "docs").glob("*.md"):
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / target).is_file(), f"{page.name}: {target}"


def test_the_pictures_of_the_diagnosis_are_those_of_its_tables(root: Path) -> None:
    for name, drawn in draw_records.pictures().items():
        assert (root / "docs" / "images" / name).read_text() == drawn, "run: python benchmarks/draw_records.py"
        assert name in (root / "docs" / "diagnosis.md").read_text()
