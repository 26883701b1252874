"""How a result shows itself: as the terminal's text, as one line, in a notebook, as a table of pandas, as a plot.

A result knows no words: what makes its view is handed down by the front door (`qsframework`), which knows everything.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol


class View(Protocol):
    """A result as people see it."""

    def text(self) -> str: ...
    def line(self) -> str: ...
    def html(self) -> str: ...
    def frame(self) -> Any: ...
    def plot(self) -> Any: ...


MAKERS: list[Callable[[Any], View]] = []
"""What makes the view of a result: one, which the front door sets."""


class Viewed:
    """A result with a view: `str`, `repr`, HTML in a notebook, `to_frame()` and `plot()`."""

    def __str__(self) -> str:
        """The verdict and the table of the terminal."""
        return MAKERS[0](self).text()

    def __repr__(self) -> str:
        """One line: what it is, and its verdict."""
        return f"<{type(self).__name__}: {MAKERS[0](self).line()}>"

    def _repr_html_(self) -> str:
        """The verdict and the table, for a notebook."""
        return MAKERS[0](self).html()

    def to_frame(self) -> Any:
        """A `pandas.DataFrame`, SI: of a fit its parameters, of a plan its poses, of readings their rows, of a
        diagnosis all causes, of a validation the errors. InputError where pandas is not installed."""
        return MAKERS[0](self).frame()

    def plot(self) -> Any:
        """A `plotly.graph_objects.Figure`: the one that the result's report shows first."""
        return MAKERS[0](self).plot()
