"""How results look outside reports: the text, line, HTML, frame and plot of each (`qsframework.viewed`)."""

from __future__ import annotations

import html as escaping
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import singledispatch
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from qsframework.diagnose import Diagnosis
from qsframework.errors import InputError, Problem
from qsframework.experiment import Plan, Readings
from qsframework.identify import Fit
from qsframework.identify.columns import values_of
from qsframework.identify.validate import Validation
from qsframework.plugin import Array
from qsframework.report.blocks import ReportTable, Verdict
from qsframework.report.diagnosis_plots import budget_figure
from qsframework.report.diagnosis_tables import cause_table, doubtful_table, error_rows, verdict_groups
from qsframework.report.fit_plots import distribution_figure
from qsframework.report.fit_section import error_tables, fit_table
from qsframework.report.parameter_plots import parameter_figure
from qsframework.report.plan_section import pose_table
from qsframework.report.plots import COLOURS, SYMBOLS, blank, plotted
from qsframework.report.validation_section import validation_tables
from qsframework.report.words.fit import fit_verdict
from qsframework.report.words.headline import headline
from qsframework.report.words.plan import certificate_text
from qsframework.report.words.validation import validation_verdict
from qsframework.terminal import paragraphs, table_lines, width
from qsframework.units import JointUnits

if TYPE_CHECKING:
    from plotly.graph_objects import Figure as Plot

_ROWS = 10
"""Of readings that text shows."""


@dataclass(frozen=True)
class Face:
    """said: the verdict, or what a value is; columns: by name, each as long as the frame; draw: makes the plot;
    beside: attributes of the frame"""

    said: str
    tables: tuple[ReportTable, ...]
    columns: Mapping[str, Any]
    draw: Callable[[], Plot]
    beside: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def text(self) -> str:
        """The verdict and the tables, as wide as the terminal."""
        room = width()
        lines = paragraphs(self.said, room)
        for table in self.tables:
            lines += ["", *table_lines(table.header, table.rows, room)]
        return "\n".join(lines)

    def line(self) -> str:
        """The verdict's first line."""
        return self.said.splitlines()[0]

    def html(self) -> str:
        """The verdict and the tables, with nothing of theirs taken for markup."""
        out = [f"<p><b>{escaping.escape(self.said)}</b></p>"]
        for table in self.tables:
            head = "".join(f"<th>{escaping.escape(cell)}</th>" for cell in table.header)
            rows = "".join(
                "<tr>" + "".join(f"<td>{escaping.escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows
            )
            out.append(f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>")
        return "\n".join(out)

    def frame(self) -> Any:
        """The columns as a `pandas.DataFrame`."""
        try:
            pandas = import_module("pandas")
        except ImportError as error:
            hint = "pip install pandas"
            raise InputError(Problem("a frame needs pandas, which is not installed", hint=hint)) from error
        frame = pandas.DataFrame(dict(self.columns))
        frame.attrs.update(self.beside)
        return frame

    def plot(self) -> Any:
        """The plot, a `plotly.graph_objects.Figure`."""
        return self.draw()


@singledispatch
def face(result: Any) -> Face:
    """How a result looks."""
    raise TypeError(f"a {type(result).__name__} has no face")


@face.register
def _fit(fit: Fit) -> Face:
    tables = (fit_table(fit, brief=True), *error_tables(fit))
    errors = {"errors_mm": fit.errors_mm}
    return Face(_said(fit_verdict(fit)), tables, values_of(fit), lambda: parameter_figure(fit).figure, errors)


@face.register
def _plan(plan: Plan) -> Face:
    units = plan.units or JointUnits((False,) * plan.pendant.shape[1])
    columns: dict[str, Any] = {"pose": plan.pose}
    columns |= {f"q{k + 1}": plan.pendant[:, k] for k in range(len(units))}
    columns |= {name: plan.wrench[:, k] for k, name in enumerate(("fx", "fy", "fz", "mx", "my", "mz"))}
    columns |= {"load": plan.load, "repeats": plan.repeats}
    said = f"{len(plan.pose)} poses, {sum(plan.repeats)} with their repeats. {certificate_text(plan)}"

    def figure() -> Plot:
        out = blank("Joints of the plan", "pose", f"value, {units.one}")
        for k, shown in enumerate(units.shown(plan.pendant).T):
            mark = {"color": COLOURS[k % len(COLOURS)], "symbol": SYMBOLS[k % len(SYMBOLS)]}
            out.add_scatter(x=list(plan.pose), y=plotted(shown), mode="markers", marker=mark, name=units.labels()[k])
        return out

    return Face(said, (pose_table(plan, units),), columns, figure)


@face.register
def _readings(readings: Readings) -> Face:
    kinds = [k for k in ("displacement", "position", "gauge") if (readings.kind == k).any()]
    counts = ", ".join(f"{int((readings.kind == k).sum())} {k}s" for k in kinds)
    masked = int((~readings.use).sum())
    said = f"{len(readings)} readings ({counts or 'none'}) of {len(set(readings.pose))} poses, from {readings.where}"
    said += f"; {masked} masked." if masked else "."
    loads = readings.poses.wrench[readings.plus, :3]
    columns: dict[str, Any] = {"pose": readings.pose, "kind": readings.kind, "marker": readings.marker}
    columns |= {axis: readings.value[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"sigma_{axis}": readings.sigma[:, k] for k, axis in enumerate("xyz")}
    columns |= {name: loads[:, k] for k, name in enumerate(("fx", "fy", "fz"))}
    columns |= {"use": readings.use, "line": readings.line}
    rows = tuple(
        (
            readings.pose[i],
            str(readings.kind[i]),
            *(_mm(v) for v in readings.value[i]),
            ", ".join(f"{f:.0f}" for f in loads[i]),
            "" if readings.use[i] else "masked",
        )
        for i in range(min(len(readings), _ROWS))
    )
    header = ("pose", "kind", "x, mm", "y, mm", "z, mm", "force N", "")
    title = ReportTable(header, rows, f"The first {len(rows)}." if len(readings) > _ROWS else "")

    def figure() -> Plot:
        out = blank("Readings", "pose", "size, mm")
        for k, kind in enumerate(kinds):
            at = np.flatnonzero((readings.kind == kind) & readings.use)
            size = 1e3 * np.sqrt(np.nansum(readings.value[at] ** 2, axis=1))
            mark = {"color": COLOURS[k], "symbol": SYMBOLS[k]}
            names = [readings.pose[int(i)] for i in at]
            out.add_scatter(x=names, y=plotted(size), mode="markers", marker=mark, name=f"{kind}s")
        return out

    return Face(said, (title,), columns, figure)


@face.register
def _diagnosis(found: Diagnosis) -> Face:
    columns: dict[str, Any] = {
        "cause": [x.name for x in found.table],
        "status": [x.status.value for x in found.table],
        "s": [x.s for x in found.table],
        "p": [x.p_value for x in found.table],
        "nearest": [x.nearest for x in found.table],
        "angle": [x.angle for x in found.table],
    }
    groups = [ReportTable((title, ""), lines.rows) for title, lines in verdict_groups(found)]
    tables = (
        *groups,
        *(table for table in (cause_table(found), doubtful_table(found)) if table.rows),
        error_rows(found),
    )
    return Face(headline(found), tables, columns, lambda: budget_figure(found).figure)


@face.register
def _validation(found: Validation) -> Face:
    e, before = found.whole.errors, found.whole.before
    columns: dict[str, Any] = {"pose": found.poses, "line": found.lines}
    columns |= {f"error_{axis}": e[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"nominal_error_{axis}": before[:, k] for k, axis in enumerate("xyz")}
    sizes = {"nominal": found.whole.distances(before=True), "identified": found.whole.distances()}
    return Face(
        _said(validation_verdict(found)), validation_tables(found), columns, lambda: distribution_figure(sizes).figure
    )


def _said(verdict: Verdict) -> str:
    return f"{verdict.word}: {verdict.said}"


def _mm(value: Array | float) -> str:
    return f"{1e3 * float(value):.3f}" if np.isfinite(value) else "-"
