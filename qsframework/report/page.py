"""One HTML file, offline and printable, from sections of text, tables, figures and scenes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qsframework.files import write_text
from qsframework.report.blocks import Block, Figure, Lines, Section, Table, Text, View
from qsframework.report.numbers import figure_table

__all__ = ["Block", "Figure", "Lines", "Section", "Table", "Text", "View", "write_report"]
_WORDS = 18
"""A column with a longer cell than this holds words, which are set from the left."""
_OPEN = 14
"""Numbers of a figure with no more rows than this stand open below it."""
_PRINTED = 60
"""Numbers with no more rows than this are printed, also if they are folded on the screen."""


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


def _block(block: Block, name: str) -> dict[str, Any]:
    """What the template needs of a block; only figures hold markup that is not escaped."""
    if isinstance(block, Text):
        return {"kind": "text", "text": block.text}
    if isinstance(block, Lines):
        return {"kind": "lines", "rows": block.rows}
    if isinstance(block, Table):
        return {"kind": "table", "table": _table(block)}
    if isinstance(block, View):
        numbers, inside = block.table, {"kind": "view", "page": block.page}
    else:
        numbers = figure_table(block.figure) if block.table is None else block.table
        drawn = block.figure.to_html(
            full_html=False, include_plotlyjs=False, div_id=name, config={"displaylogo": False, "responsive": True}
        )
        inside = {"kind": "figure", "html": drawn}
    rows = len(numbers.rows)
    folded = {"rows": rows, "open": rows <= _OPEN, "printed": rows <= _PRINTED}
    return {**inside, **folded, "caption": block.caption, "table": _table(numbers)}


def _table(table: Table) -> dict[str, Any]:
    """A table, and which of its columns hold words."""
    words = [any(len(row[i]) > _WORDS for row in table.rows) for i in range(len(table.header))]
    drawn = {"header": table.header, "rows": table.rows, "caption": table.caption, "words": words}
    return {**drawn, "folded": table.folded}
