"""One HTML file, offline and printable, from sections of text, tables, figures and scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from qsframework.files import write_text

_WORDS = 40
"""A column with a longer cell than this holds words, which are set from the left."""


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str


@dataclass(frozen=True)
class Table:
    """Rows of cells under a header; `caption` says what to look for."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""


@dataclass(frozen=True)
class Figure:
    """A plotly figure; `caption` says what to look for."""

    figure: Any
    caption: str


@dataclass(frozen=True)
class View:
    """A 3D scene as a page of its own inside the report."""

    page: str
    caption: str


@dataclass(frozen=True)
class Section:
    """A titled part of a report."""

    title: str
    blocks: tuple[Text | Table | Figure | View, ...]


def write_report(path: str | Path, title: str, sections: Sequence[Section]) -> Path:
    """Write the report, all or nothing, and return its path."""
    import jinja2
    from plotly.offline import get_plotlyjs

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("qsframework.report"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    drawn = [(s.title, [_block(b, f"figure-{i}-{j}") for j, b in enumerate(s.blocks)]) for i, s in enumerate(sections)]
    plots = any(isinstance(b, Figure) for s in sections for b in s.blocks)
    page = environment.get_template("report.html.j2").render(
        title=title, sections=drawn, plotly=get_plotlyjs().replace("</script", "<\\/script") if plots else ""
    )
    return write_text(path, page)


def _block(block: Text | Table | Figure | View, name: str) -> dict[str, Any]:
    """What the template needs of a block; only figures hold markup that is not escaped."""
    if isinstance(block, Text):
        return {"kind": "text", "text": block.text}
    if isinstance(block, Table):
        words = [any(len(row[i]) > _WORDS for row in block.rows) for i in range(len(block.header))]
        return {"kind": "table", "header": block.header, "rows": block.rows, "caption": block.caption, "words": words}
    if isinstance(block, View):
        return {"kind": "view", "page": block.page, "caption": block.caption}
    drawn = block.figure.to_html(
        full_html=False, include_plotlyjs=False, div_id=name, config={"displaylogo": False, "responsive": True}
    )
    return {"kind": "figure", "html": drawn, "caption": block.caption}
