"""A validation in a report: errors at held-out readings."""

from __future__ import annotations

import html

import numpy as np

from qsframework.fits.columns import SUITED
from qsframework.fits.validate import Validation, ValidationErrors
from qsframework.report.blocks import Figure, Plot, ReportTable, Section, Text
from qsframework.report.error_maps import placed_maps
from qsframework.report.fit_plots import distribution_figure
from qsframework.report.plots import AFTER, blank
from qsframework.report.words.sizes import mm
from qsframework.report.words.validation import validation_words


def validation_tables(found: Validation) -> tuple[ReportTable, ...]:
    """The 3D error before and after, and RMS by axis, for all readings and for each series."""
    parts = (found.whole, *(found.parts if len(found.parts) > 1 else ()))
    tables = [
        ReportTable(
            ("3D error", "count", "RMS, mm", "mean, mm", "95 %, mm", "max, mm", "nominal RMS", "nominal max"),
            tuple((p.name, str(p.count), *_in_mm(*p.summary(), *p.summary(before=True)[::3])) for p in parts),
            f"Distance of the measured from the predicted point. Nominal: the arm before the readings, {SUITED}.",
        ),
        ReportTable(
            ("RMS by axis", "x, mm", "y, mm", "z, mm"),
            tuple((p.name, *_in_mm(*p.axes())) for p in parts),
            "Gauges: along the gauge axis, in the first column.",
        ),
    ]
    if found.halves:
        sizes = _in_mm(*np.quantile(found.spread, [0.0, 0.5, 1.0]))
        tables.append(
            ReportTable(
                ("RMS of the 3D error by half", "mm"),
                tuple(zip(("smallest", "median", "largest"), sizes, strict=True)),
                "Each half of the poses fitted, the errors those of the other.",
            )
        )
    return tuple(tables)


def _in_mm(*values: float) -> list[str]:
    return [mm(v, 4) for v in values]


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
            *placed_maps(found.places, found.poses, {"nominal": found.whole.before, "identified": found.whole.errors}),
        ),
    )


def _distribution(errors: ValidationErrors) -> tuple[Figure, ...]:
    sizes = {"nominal": errors.distances(before=True), "identified": errors.distances()}
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
