"""A validation in a report: errors at held-out readings."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

import numpy as np

from qsframework.identify.validate import Validation, ValidationErrors
from qsframework.report.blocks import Figure, ReportTable, Section, Text
from qsframework.report.fit_plots import distribution_figure
from qsframework.report.plots import AFTER, blank
from qsframework.report.words.validation import validation_words

if TYPE_CHECKING:
    from plotly.graph_objects import Figure as Plot


def validation_tables(found: Validation) -> tuple[ReportTable, ...]:
    """The 3D error before and after, and RMS by axis, for all readings and for each series."""
    parts = (found.whole, *(found.parts if len(found.parts) > 1 else ()))
    header = ("3D error", "count", "RMS, mm", "mean, mm", "95 %, mm", "max, mm", "nominal RMS", "nominal max")
    rows: list[tuple[str, ...]] = []
    for part in parts:
        before = part.summary(before=True)
        rows.append((part.name, str(part.count), *map(_mm, (*part.summary(), before[0], before[-1]))))
    axes = tuple((part.name, *map(_mm, part.axes())) for part in parts)
    tables = [
        ReportTable(
            header,
            tuple(rows),
            "Distance of the measured from the predicted point. Nominal: nominal model, best-fit alignment.",
        ),
        ReportTable(
            ("RMS by axis", "x, mm", "y, mm", "z, mm"), axes, "Gauges: along the gauge axis, in the first column."
        ),
    ]
    if found.halves:
        low, middle, high = np.quantile(found.spread, [0.0, 0.5, 1.0])
        tables.append(
            ReportTable(
                ("RMS of the 3D error by half", "mm"),
                (("smallest", _mm(low)), ("median", _mm(middle)), ("largest", _mm(high))),
                "Each half of the poses fitted, the errors those of the other.",
            )
        )
    return tuple(tables)


def _mm(value: float) -> str:
    return f"{1e3 * value:.4f}" if np.isfinite(value) else "-"


def validation_section(found: Validation) -> Section:
    """The verdict, the tables, and the errors by row and as a distribution."""
    return Section(
        "Errors at readings",
        (
            Text(validation_words(found)),
            *(Text(f"Note: {note}.") for note in found.notes),
            *validation_tables(found),
            *_distribution(found.whole),
            Figure(_by_row(found), "3D error by row of the file. Look for rows that belong together."),
        ),
    )


def _distribution(part: ValidationErrors) -> tuple[Figure, ...]:
    sizes = {"nominal": part.distances(before=True), "identified": part.distances()}
    return (distribution_figure(sizes),) if len(sizes["identified"]) else ()


def _by_row(found: Validation) -> Plot:
    figure = blank("3D error by row", "row of the readings file", "3D error, mm")
    whole = np.flatnonzero(np.isfinite(found.whole.errors).all(axis=1))
    size = np.linalg.norm(found.whole.errors[whole], axis=1) * 1e3
    poses = [html.escape(found.poses[int(i)]) for i in whole]
    figure.add_scatter(
        x=found.lines[whole].tolist(),
        y=size.tolist(),
        mode="markers",
        marker={**AFTER, "size": 5},
        text=[f"pose {pose}" for pose in poses],
        customdata=poses,
        name="identified",
    )
    return figure
