"""The pages of docs/ are all in the menu, and lead nowhere that is not there."""

from __future__ import annotations

import re
from pathlib import Path


def test_every_page_is_in_the_menu(root: Path) -> None:
    menu = re.findall(r"^ +- .*: (\S+\.md)$", (root / "mkdocs.yml").read_text(), re.M)
    assert sorted(menu) == sorted(path.name for path in (root / "docs").glob("*.md"))


def test_links_lead_somewhere(root: Path) -> None:
    for page in (root / "docs").glob("*.md"):
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / target).is_file(), f"{page.name}: {target}"
