"""The notebook of examples/ runs as a notebook runs it, is short, and finds what it says."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from IPython.core.interactiveshell import InteractiveShell


@pytest.fixture(scope="module")
def notebook(root: Path) -> list[dict[str, Any]]:
    told = json.loads((root / "examples" / "notebook" / "calibration.ipynb").read_text())
    return [cell for cell in told["cells"] if cell["cell_type"] == "code"]


@pytest.fixture(scope="module")
def cells(notebook: list[dict[str, Any]]) -> list[str]:
    return ["".join(cell["source"]) for cell in notebook]


def words(html: str) -> str:
    """A page without its numbers, of which another machine may have other last digits."""
    return re.sub(r"[-+]?\d[\d.e+-]*", "#", html)


def test_it_has_less_than_sixty_lines_of_code(cells: list[str]) -> None:
    assert sum(bool(line.strip()) for cell in cells for line in cell.splitlines()) < 60


def test_every_cell_runs_and_shows_its_answer(
    notebook: list[dict[str, Any]], cells: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    shell = InteractiveShell()
    shown = []
    for cell in cells:
        done = shell.run_cell(cell)
        done.raise_error()
        shown.append(done.result)
    pages = [x._repr_html_() for x in shown if type(x).__module__.startswith("qsframework")]
    assert len(pages) == 5
    assert all("<table>" in page for page in pages)
    kept = [out.get("data", {}) for cell in notebook for out in cell["outputs"]]
    assert sum("image/png" in data for data in kept) == 2, "run: python docs/make_notebook.py"
    assert {words(page) for page in pages} <= {words("".join(data.get("text/html", ""))) for data in kept}
    off = next(x for x in shown if isinstance(x, dict))
    assert len(off) == 6
    assert max(abs(x) for x in off.values()) < 4.0
    found = shell.user_ns["found"]
    assert found.learned.name == "learned[j5/j4]"
    assert "learned[j5/j4]" in pages[-1]
    corrected = shell.user_ns["corrected"]
    assert (corrected.sd < 0.5 * corrected.uncorrected).all()
    assert "mm expected after it" in capsys.readouterr().out
