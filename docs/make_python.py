"""Write docs/python.md: one fit by all its printers, and where the scripts are: python docs/make_python.py"""

from __future__ import annotations

import io
import os
import re
import tempfile
from contextlib import chdir, redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "python.md"
HEAD = """# From Python

Every command calls a function of `qsframework`, which scripts and notebooks call too. A fit, a plan, readings, a
diagnosis and a validation print their verdict and table, show them in a notebook, and have `.to_frame()` (pandas) and
`.plot()` (plotly). Quantities are SI, angles radians; `qsf.units.to_si(90.0, "deg")` and
`qsf.units.from_si(x, "mm")` go to and from other units. The [API page](api.md) has an example of every function, from
the plan to corrected targets; so has the notebook `examples/notebook/calibration.ipynb`.
"""
SCRIPTS_HEAD = """Whole programmes of less than 40 lines; each writes into a folder of its own.
"""
FIT = """import json

import qsframework as qsf
from qsframework.experiment import example

experiment = qsf.load_experiment(example("r2000ic") / "experiment.yaml")
readings = qsf.read_readings(experiment.data, experiment)
fit = qsf.identify(experiment, readings)
print(repr(fit))
"""
PRINTERS = {
    "Terminal": ("What `qsf identify` prints.", "print(fit)\n"),
    "Notebook": ("What a cell shows that ends with `fit`.", "print(fit._repr_html_())\n"),
    "Data frame": (
        "SI, with a row for each parameter; the errors are attributes of the frame.",
        'frame = fit.to_frame()[["parameter", "value", "sd", "unit", "state"]]\n'
        'print(frame.to_string(index=False, float_format="{:.3e}".format))\n'
        "print(f\"held-out: {fit.to_frame().attrs['errors_mm']['displacement']['held_out']:.3f} mm\")\n",
    ),
    "JSON": (
        "What `--json fit.json` writes, SI; [all its keys](file-formats.md).",
        "content = json.loads(json.dumps(fit.as_json()))\n"
        'first = content["estimates"]["joint_compliance[joint_1]"]\n'
        'print({name: first[name] for name in ("unit", "state")}, f"{first[\'value\']:.3e} ± {first[\'sd\']:.3e}")\n'
        "print(f\"held-out: {content['held_out_error_m']:.3e} m\")\n",
    ),
    "HTML": (
        "What `--report fit.html` writes: one page with verdict, tables, figures and the robot in 3D.",
        'print("report:", qsf.report(fit, "fit.html", experiment, readings))\n',
    ),
    "PDF": (
        "The same page on sheets of A4, by a Chromium that is installed.",
        'print("report:", qsf.report(fit, "fit.pdf", experiment, readings))\n',
    ),
}
"""What is said of each printer of a fit, and the code that calls it."""
SCRIPTS = {
    "design_simulate_identify": "A plan, its simulation, and the fit",
    "find_a_hidden_effect": "A hidden effect",
    "compensate_targets": "Corrected targets",
}


def page() -> str:
    """The page: one fit by all its printers, and where the scripts are."""
    listed = "".join(f"- {title}: `examples/scripts/{name}.py`\n" for name, title in SCRIPTS.items())
    return f"{HEAD}\n{_printed()}\n## Scripts\n\n{SCRIPTS_HEAD}\n{listed}"


def printed(folder: Path, pdf: bool = True) -> dict[str, str]:
    """What each printer prints, run in a folder that keeps its files; pdf: with the one that needs a browser."""
    names: dict[str, Any] = {}
    with chdir(folder), patch.dict(os.environ, {"COLUMNS": "100"}):
        out = {"": _run(FIT, names)}
        for title, (_, code) in PRINTERS.items():
            out[title] = _run(code, names) if pdf or title != "PDF" else "report: fit.pdf\n"
    return out


def _run(code: str, names: dict[str, Any]) -> str:
    with redirect_stdout(io.StringIO()) as said:
        exec(code, names)
    return said.getvalue()


def _printed() -> str:
    """The section of the printers, each with its code and what it printed."""
    with tempfile.TemporaryDirectory() as folder:
        out = printed(Path(folder), pdf=False)
    parts = [f"## One fit, six printers\n\n```python\n{FIT}```\n\n```\n{out['']}```\n"]
    for title, (words, code) in PRINTERS.items():
        shown = re.sub(r"\n+", "\n", out[title]) if title == "Notebook" else f"```\n{out[title]}```\n"
        parts.append(f"### {title}\n\n{words}\n\n```python\n{code}```\n\n{shown}")
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page())
