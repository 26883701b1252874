"""Write the layers and the picture of CONTRIBUTING.md from the tree itself: python docs/make_layers.py"""

from __future__ import annotations

import ast
import re
import sys
import textwrap
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "house"))

from sources import PACKAGES, tree  # noqa: E402
from test_imports import LAYERS, imported  # noqa: E402

PAGE = ROOT / "CONTRIBUTING.md"
BEGIN, END = "<!-- made by docs/make_layers.py -->\n", "<!-- end of what docs/make_layers.py makes -->\n"
WIDTH = 24


def made() -> str:
    """The layers as a list, each with the first sentence of its docstring, and the picture of who imports whom."""
    lines = [_line(name, ROOT / "qsframework") for names in LAYERS for name in names]
    beside = [_line(path.name, path.parent) for path in PACKAGES]
    picture = "".join(f"  {upper} --> {lower}\n" for upper, lower in _arrows())
    return (
        f"{BEGIN}\n```\n{''.join(lines)}```\n\nBeside the core, under `plugins/`, found by entry points:\n\n"
        f"```\n{''.join(beside)}```\n\n```mermaid\nflowchart LR\n{picture}```\n{END}"
    )


def page(text: str) -> str:
    """CONTRIBUTING.md with what is made between its marks."""
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    return before + made() + after


def _line(name: str, folder: Path) -> str:
    package = folder / name / "__init__.py"
    shown, path = (f"{name}/", package) if package.is_file() else (name, folder / f"{name}.py")
    words = " ".join((ast.get_docstring(tree(path)) or "").split())
    sentence = re.split(r"(?<=\.)\s", words)[0].rstrip(".")
    return textwrap.fill(f"{shown:{WIDTH}} {sentence}", 120, subsequent_indent=" " * (WIDTH + 1)) + "\n"


def _arrows() -> list[tuple[str, str]]:
    """Who is imported by whom, among packages; what follows from other arrows is left out."""
    used = {name: {other for other in _imports(ROOT / "qsframework" / name)} for name in _packages()}
    used |= {path.name: _imports(path) - {path.name} for path in PACKAGES}
    reached = {name: _reached(name, used) for name in used}
    arrows = [
        (lower, upper)
        for upper, lowers in used.items()
        for lower in lowers
        if not any(lower in reached[other] for other in lowers - {lower})
    ]
    order = [*_packages(), *(path.name for path in PACKAGES)]
    return sorted(arrows, key=lambda arrow: (order.index(arrow[0]), order.index(arrow[1])))


def _packages() -> list[str]:
    return [name for names in LAYERS for name in names if (ROOT / "qsframework" / name).is_dir()]


def _imports(folder: Path) -> set[str]:
    found = {name for path in folder.rglob("*.py") for name in imported(tree(path))}
    core = {name.split(".")[1] for name in found if name.startswith("qsframework.")}
    return (core & {*_packages()}) - {folder.name}


def _reached(name: str, used: Mapping[str, set[str]]) -> set[str]:
    out, waiting = set[str](), [name]
    while waiting:
        for lower in used[waiting.pop()] - out:
            out.add(lower)
            waiting.append(lower)
    return out


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text()))
