"""docs/new-effect.md shows the stranger's package as it is, and the kinds as they are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from qsframework import plugin
from qsframework.plugin import Effect


def blocks(root: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", (root / "docs" / "new-effect.md").read_text(), re.M | re.S)


@pytest.mark.parametrize(
    ("language", "name"),
    [("python", "qsf_bolted_base.py"), ("toml", "pyproject.toml"), ("yaml", "experiment.yaml")],
)
def test_the_page_shows_the_files_of_the_package(root: Path, language: str, name: str) -> None:
    (block,) = blocks(root, language)
    assert block == (root / "tests" / "third_party_package" / name).read_text()


def test_the_effect_is_as_short_as_promised(root: Path) -> None:
    """The class is no longer than the example of the blueprint: 12 lines."""
    (block,) = blocks(root, "python")
    assert len(block[block.index("@dataclass") :].splitlines()) <= 12


def test_the_table_lists_every_kind_with_what_it_asks_for(root: Path) -> None:
    kinds = {kind.__name__: kind for kind in Effect.__subclasses__() if kind.__module__ == "qsframework.plugin.kinds"}
    page = (root / "docs" / "new-effect.md").read_text()
    rows = re.findall(r"^\| (\d) \| `(\w+)` \| [^|]* \| ([^|]*) \| ([^|]*) \|$", page, re.M)
    assert {name: int(stage) for stage, name, _, _ in rows} == {n: k.stage for n, k in kinds.items()}
    for _, name, write, give in rows:
        for method in kinds[name].__abstractmethods__:
            assert re.search(rf"`{method}\b", write), f"{name} needs {method}"
        for term in re.findall(r"`(\w+)`", give):
            assert hasattr(plugin, term)
