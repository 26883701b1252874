"""The pages of docs/ are all in the menu, and lead nowhere that is not there."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import draw_records

from qsframework.cli.app import every_command


def test_every_page_is_in_the_menu(root: Path) -> None:
    menu = re.findall(r"^ +- .*: (\S+\.md)$", (root / "mkdocs.yml").read_text(), re.M)
    assert sorted(menu) == sorted(path.name for path in (root / "docs").glob("*.md"))


def test_all_pages_have_no_more_words_than_a_short_book(root: Path) -> None:
    assert sum(len(page.read_text().split()) for page in (root / "docs").glob("*.md")) <= 30_000


def test_links_lead_somewhere(root: Path) -> None:
    for page in (root / "docs").glob("*.md"):
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / target).is_file(), f"{page.name}: {target}"


def test_every_command_shown_exists_with_its_options(root: Path) -> None:
    """What runs by a test of its own is held there to more; here are those with files of the reader's too."""
    commands = every_command()
    seen = 0
    for page in [*(root / "docs").glob("*.md"), root / "README.md", *(root / "examples").glob("*/*.md")]:
        text = page.read_text().replace("\\\n", " ")
        for line in re.findall(r"^(?:\d\. )?qsf (\w.*)$", "\n".join(re.findall(r"```\w*\n(.*?)```", text, re.S)), re.M):
            name, *rest = shlex.split(line, comments=True)
            known = {
                option for parameter in commands[name].params for option in (*parameter.opts, *parameter.secondary_opts)
            }
            asked = {word.partition("=")[0] for word in rest if re.match(r"--?[a-z]", word)}
            assert asked <= known | {"--help"}, f"{page.name}: qsf {line}"
            seen += 1
    assert seen > 100


def test_the_pictures_of_the_diagnosis_are_those_of_its_tables(root: Path) -> None:
    for name, drawn in draw_records.pictures().items():
        assert (root / "docs" / "images" / name).read_text() == drawn, "run: python benchmarks/draw_records.py"
        assert name in (root / "docs" / "results.md").read_text()


def test_the_messages_of_their_page_are_those_of_the_code(root: Path) -> None:
    told = "".join(p.read_text() for d in ("qsframework", "plugins") for p in (root / d).rglob("*.py"))
    said = re.findall(r"^\| (?!it says|---)(.+?) \|", (root / "docs" / "messages.md").read_text(), re.M)
    assert len(said) >= 15
    assert not [message for message in said if message not in told]
