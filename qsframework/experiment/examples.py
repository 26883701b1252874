"""Where the examples are: beside the package in a clone, inside it in a wheel."""

from __future__ import annotations

from pathlib import Path

from qsframework.errors import InputError


def example(name: str) -> Path:
    """The folder of an example."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package.parent / "examples", package / "_examples"):
        if (folder / name / "experiment.yaml").is_file():
            return folder / name
    raise InputError(f"example {name!r} is not installed")
