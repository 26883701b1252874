"""The modules of the tree, each read and parsed once for all that is asked of it."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIBRARY = sorted((ROOT / "qsframework").rglob("*.py"))
EFFECTS = sorted((ROOT / "plugins" / "qsf_plugins").rglob("*.py"))
PACKAGES = sorted(p.parent for p in (ROOT / "plugins").glob("*/__init__.py"))
FIELD = sorted(p for p in (ROOT / "plugins").rglob("*.py") if p not in EFFECTS)
"""Modules of the packages beside the core: trackers, controllers, the day, new robots."""
MODULES = [*LIBRARY, *EFFECTS, *FIELD]


@cache
def text(path: Path) -> str:
    return path.read_text()


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(text(path))


def complaints(paths: Iterable[Path], check: Callable[[Path], Iterable[str]]) -> list[str]:
    """What the check says of every path, not only of the first that it complains of."""
    return [f"{path.relative_to(ROOT)}: {said}" for path in paths for said in check(path)]
