"""What reports are made of."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plotly.graph_objects import Figure as Plot
else:
    Plot = object


class Mark(Enum):
    """Whether the reader may go on; each has a shape of its own on the page, and the verdict its word."""

    GOOD = "good"
    LOOK = "look"
    BAD = "bad"


@dataclass(frozen=True)
class Verdict:
    """The answer to the reader's first question: a word with its mark, one sentence, and three or four numbers, each
    with what it is."""

    mark: Mark
    word: str
    said: str
    numbers: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str


@dataclass(frozen=True)
class Lines:
    """A list of short statements, each with what it is about in front ("" for nothing)."""

    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class ReportTable:
    """Rows of cells under a header; `caption` says what to look for; folded: what stands in its place until it is
    opened, "" for a table that is always open. A column `pose` ties its rows to the poses of a view."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    folded: str = ""


@dataclass(frozen=True)
class Figure:
    """A plot; `caption` says what to look for, `table` its numbers, read off its traces unless given.

    wide: takes the whole width of the page. Points whose `customdata` are names of poses lead to the pose in a view.
    """

    figure: Plot
    caption: str
    table: ReportTable | None = None
    wide: bool = False


@dataclass(frozen=True)
class SceneView:
    """A 3D scene as a page of its own inside the report; `caption` says what to look for, `table` its numbers; poses:
    the name of the pose that each step of the scene's slider shows, where it shows poses."""

    page: str
    caption: str
    table: ReportTable
    poses: tuple[str, ...] = ()


Block = Text | Lines | ReportTable | Figure | SceneView


@dataclass(frozen=True)
class Section:
    """A titled part of a report; folded: evidence that stands closed until somebody wants it, or prints; new_page:
    begins one on paper."""

    title: str
    blocks: tuple[Block, ...]
    folded: bool = False
    new_page: bool = False
