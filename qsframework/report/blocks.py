"""What reports are made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str


@dataclass(frozen=True)
class Lines:
    """A list of short statements, each with what it is about in front ("" for nothing)."""

    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Table:
    """Rows of cells under a header; `caption` says what to look for; folded: what stands in its place until it is
    opened, "" for a table that is always open."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    folded: str = ""


@dataclass(frozen=True)
class Figure:
    """A plotly figure; `caption` says what to look for, `table` its numbers, read off its traces unless given."""

    figure: Any
    caption: str
    table: Table | None = None


@dataclass(frozen=True)
class View:
    """A 3D scene as a page of its own inside the report; `caption` says what to look for, `table` its numbers."""

    page: str
    caption: str
    table: Table


Block = Text | Lines | Table | Figure | View


@dataclass(frozen=True)
class Section:
    """A titled part of a report."""

    title: str
    blocks: tuple[Block, ...]
