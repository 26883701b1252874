"""CONTRIBUTING.md shows the layers that the tree has."""

from __future__ import annotations

import sys
from pathlib import Path


def test_the_layers_are_current(root: Path) -> None:
    sys.path.insert(0, str(root / "docs"))
    import make_layers

    text = (root / "CONTRIBUTING.md").read_text()
    assert make_layers.page(text) == text, "run: python docs/make_layers.py"
