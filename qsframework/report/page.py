"""One HTML file, offline and printable: the verdict, then pictures, then the evidence, folded."""

from __future__ import annotations

import base64
import gzip
import html
import re
from collections.abc import Iterator, Sequence
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.report.blocks import Block, Figure, Lines, Plot, ReportTable, SceneView, Section, Text, Verdict
from qsframework.report.numbers import figure_table
from qsframework.report.printed import rendered, write_page

_WORDS = 18
"""A column with a longer cell than this holds words, which are set from the left."""
_POINTS, _ROWS = 4_000, 2_000
"""Points of a series, and rows of a table, beyond which a page of all would be too large to open."""
_POWER = re.compile(r"\d(?:\.\d+)?e-\d+")


def write_report(path: str | Path, title: str, sections: Sequence[Section], verdict: Verdict | None = None) -> Path:
    """Write the report, all or nothing, and return its path."""
    drawn = [
        (s, list(_grouped([_block(b, f"figure-{i}-{j}") for j, b in enumerate(s.blocks)])))
        for i, s in enumerate(sections)
    ]
    blocks = [b for s in sections for b in s.blocks]
    folds = any(s.folded for s in sections) or any(not isinstance(b, Text | Lines | ReportTable) for b in blocks)
    plotly = _plotly() if any(isinstance(b, Figure) for b in blocks) else ""
    content = {"title": title, "sections": drawn, "verdict": verdict, "plotly": plotly, "folds": folds}
    return write_page(path, rendered("report.html.j2", {"whole": _whole}, content))


def _plotly() -> str:
    """Plotly's bundle of plots in a plane, a third of the whole; it comes with its licence and origin."""
    text = (files("qsframework.report") / "plotly" / "plotly-cartesian.min.js").read_text(encoding="utf-8")
    return text.replace("</script", "<\\/script")


def _whole(text: str) -> Any:
    """The text, escaped, in which no power of ten breaks at its hyphen."""
    from markupsafe import Markup

    return Markup(_POWER.sub(lambda m: f'<span class="whole">{m.group()}</span>', html.escape(text)))


def _grouped(blocks: Sequence[dict[str, Any]]) -> Iterator[list[dict[str, Any]]]:
    """Pictures that follow each other stand side by side; everything else stands alone."""
    for beside, group in groupby(blocks, key=lambda block: block["kind"] in ("figure", "view") and not block["wide"]):
        row = list(group)
        yield from [row] if beside else ([block] for block in row)


def _block(block: Block, name: str) -> dict[str, Any]:
    """What the template needs of a block; only figures hold markup that is not escaped."""
    if isinstance(block, Text):
        return {"kind": "text", "text": block.text}
    if isinstance(block, Lines):
        return {"kind": "lines", "rows": block.rows}
    if isinstance(block, ReportTable):
        return {"kind": "table", "table": _table(block)}
    if isinstance(block, SceneView):
        numbers, note = block.table, ""
        inside = {"kind": "view", "page": _packed(block.page), "poses": block.poses, "wide": False}
    else:
        numbers = figure_table(block.figure) if block.table is None else block.table
        figure, note = _thinned(block.figure)
        inside = {"kind": "figure", "name": name, "wide": block.wide, **_drawn(figure)}
    return {**inside, "rows": len(numbers.rows), "caption": block.caption + note, "table": _table(numbers)}


def _thinned(figure: Plot) -> tuple[Plot, str]:
    """A figure whose long series are drawn by the highest and the lowest point of each stretch, and a note on it."""
    long = [k for k, t in enumerate(figure.data) if t.type == "scatter" and len(t.y) > _POINTS]
    if not long:
        return figure, ""
    out = type(figure)(figure)
    for trace in (out.data[k] for k in long):
        count = len(trace.y)
        height = trace.y if isinstance(trace.marker.color, str | None) else trace.marker.color
        known = np.nan_to_num(np.asarray(height, dtype=np.float64))
        stretches = np.array_split(np.arange(count), _POINTS // 2)
        kept = np.unique([s[end(known[s])] for s in stretches for end in (np.argmin, np.argmax)])
        for place, names in ((trace, ("x", "y", "text", "customdata")), (trace.marker, ("size", "color"))):
            for name in names:
                values = getattr(place, name)
                if values is not None and not isinstance(values, str | float | int) and len(values) == count:
                    setattr(place, name, np.asarray(values)[kept])
    most = max(len(figure.data[k].y) for k in long)
    return out, f" Of {most} points the highest and lowest of each stretch are drawn, {_POINTS} at most."


def _drawn(figure: Plot) -> dict[str, str]:
    """A figure as JSON that may stand inside a script; its title, which the page sets, so that it breaks and is read
    aloud like others; and its height, so that nothing jumps when it is drawn."""
    return {
        "title": html.unescape(figure.layout.title.text),
        "json": figure.to_json(validate=False).replace("<", "\\u003c"),
        "height": str(figure.layout.height),
    }


def _packed(page: str) -> str:
    """A page that the report unpacks into a frame: compressed, because a scene and its viewer are large."""
    return base64.b64encode(gzip.compress(page.encode(), mtime=0)).decode()


def _table(table: ReportTable) -> dict[str, Any]:
    """A table, which of its columns hold words, and which holds names of poses."""
    rows, caption = table.rows[:_ROWS], table.caption
    if len(table.rows) > _ROWS:
        caption = f"The first {_ROWS} of {len(table.rows)} rows. {caption}".strip()
    words = [any(len(row[i]) > _WORDS for row in rows) for i in range(len(table.header))]
    pose = table.header.index("pose") if "pose" in table.header else None
    drawn = {"header": table.header, "rows": rows, "caption": caption, "words": words, "pose": pose}
    return {**drawn, "folded": table.folded}
