"""How a result shows itself: as the terminal's text, as one line, in a notebook, as a table of pandas, as a plot.

The faces are made in `qsframework.report.faces`, which is loaded when one is asked for: a result knows no words.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


class Displayed:
    """A result with a face: `str`, `repr`, HTML in a notebook, `to_frame()` and `plot()`."""

    def __str__(self) -> str:
        """The verdict and the table of the terminal."""
        return str(_faces().text(self))

    def __repr__(self) -> str:
        """One line."""
        return str(_faces().line(self))

    def _repr_html_(self) -> str:
        """The verdict and the table, for a notebook."""
        return str(_faces().html(self))

    def to_frame(self) -> Any:
        """A `pandas.DataFrame`, SI: of a fit its parameters, of a plan its poses, of readings their rows, of a
        diagnosis all causes, of a validation the errors. InputError where pandas is not installed."""
        return _faces().frame(self)

    def plot(self) -> Any:
        """A `plotly.graph_objects.Figure`: the one that the result's report shows first."""
        return _faces().plot(self)


def _faces() -> Any:
    return import_module("qsframework.report.faces")
