"""Run the notebook of examples/ and keep what its cells show, so that it can be read without running it.

Run: python docs/make_notebook.py
"""

from __future__ import annotations

import base64
import json
import os
import tempfile
from pathlib import Path
from typing import Any

from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import capture_output
from make_pictures import screenshot

NOTEBOOK = Path(__file__).resolve().parents[1] / "examples" / "notebook" / "calibration.ipynb"


def main() -> None:
    """Write the notebook anew, with its outputs."""
    notebook = json.loads(NOTEBOOK.read_text())
    shell = InteractiveShell()
    os.chdir(NOTEBOOK.parent)
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, cell in enumerate(code, 1):
        with capture_output() as said:
            done = shell.run_cell("".join(cell["source"]), store_history=True)
        done.raise_error()
        cell["execution_count"] = number
        cell["outputs"] = [*_printed(said.stdout.partition(f"Out[{number}]")[0]), *_shown(shell, done.result, number)]
    NOTEBOOK.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n")


def _printed(said: str) -> list[dict[str, Any]]:
    return [{"output_type": "stream", "name": "stdout", "text": said.splitlines(keepends=True)}] if said else []


def _shown(shell: InteractiveShell, result: object, number: int) -> list[dict[str, Any]]:
    """What a notebook shows of the value of a cell: its page or its text; of a figure its picture."""
    if result is None:
        return []
    if hasattr(result, "to_plotly_json"):
        data = {"image/png": _picture(result)}
    else:
        data = {k: v for k, v in shell.display_formatter.format(result)[0].items() if k.startswith("text/")}
    return [{"output_type": "execute_result", "execution_count": number, "metadata": {}, "data": data}]


def _picture(figure: Any) -> str:
    with tempfile.TemporaryDirectory() as folder:
        page, picture = Path(folder) / "figure.html", Path(folder) / "figure.png"
        figure.update_layout(paper_bgcolor="white", width=900)
        page.write_text(figure.to_html(include_plotlyjs=True))
        screenshot(page, picture, f"920,{int(figure.layout.height or 450) + 20}")
        return base64.b64encode(picture.read_bytes()).decode()


if __name__ == "__main__":
    main()
