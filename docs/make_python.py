"""Write docs/python.md from the scripts in examples/scripts: python docs/make_python.py"""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "python.md"
HEAD = """# From Python

Every command calls a function of `qsframework`, which scripts and notebooks call too. A fit, a plan, readings, a
diagnosis and a validation print their verdict and table, show them in a notebook, and have `.to_frame()` (pandas) and
`.plot()` (plotly). Quantities are SI, angles radians; `qsf.units.to_si(90.0, "deg")` and
`qsf.units.from_si(x, "mm")` go to and from other units. The [API page](api.md) lists the functions. The notebook
`examples/notebook/calibration.ipynb` goes from the plan to corrected targets. The scripts in
`examples/scripts` write into a folder of their own; the tests run them all.
"""
SCRIPTS = {
    "design_simulate_identify": "A plan, its simulation, and the fit",
    "find_a_hidden_effect": "A hidden effect",
    "compensate_targets": "Corrected targets",
}


def page() -> str:
    """The page: one script, and where the others are."""
    first, *others = SCRIPTS.items()
    listed = "".join(f"- {title}: `examples/scripts/{name}.py`\n" for name, title in others)
    shown = f"`examples/scripts/{first[0]}.py`\n\n```python\n{_text(first[0])}```\n"
    return f"{HEAD}\n## {first[1]}\n\n{shown}\n## More\n\n{listed}"


def _text(name: str) -> str:
    return (ROOT / "examples" / "scripts" / f"{name}.py").read_text()


if __name__ == "__main__":
    PAGE.write_text(page())
