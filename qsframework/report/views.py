"""How results look outside reports: the text, line, HTML, frame and plot of each (`qsframework.viewed`)."""

from __future__ import annotations

import html as escaping
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import singledispatch
from importlib import import_module
from typing import Any

import numpy as np

from qsframework.diagnoses import Diagnosis
from qsframework.errors import InputError, Problem, QsfError
from qsframework.experiment import Experiment, Plan, Readings, Simulation
from qsframework.experiment.columns import WRENCH_NAMES
from qsframework.fits import Fit
from qsframework.fits.columns import values_of
from qsframework.fits.validate import Validation
from qsframework.plugin import Array
from qsframework.report.blocks import Plot, ReportTable, Verdict
from qsframework.report.compare_section import path_figure, sd_tables, summary_table
from qsframework.report.compensation_section import target_table
from qsframework.report.diagnosis_plots import budget_figure
from qsframework.report.diagnosis_tables import cause_table, doubtful_table, error_rows, verdict_groups
from qsframework.report.fit_plots import distribution_figure, parameter_figure
from qsframework.report.fit_section import error_tables, fit_table
from qsframework.report.plan_section import pose_table
from qsframework.report.plots import COLOURS, SYMBOLS, blank, plotted
from qsframework.report.robot_section import joint_table
from qsframework.report.stiffness_section import deflection_words, stiffness_tables
from qsframework.report.validation_section import validation_tables
from qsframework.report.words.comparison import comparison_verdict
from qsframework.report.words.compensation import compensation_verdict
from qsframework.report.words.fit import fit_verdict
from qsframework.report.words.headline import headline
from qsframework.report.words.plan import certificate_text
from qsframework.report.words.sizes import mm, shown_number, unit_shown
from qsframework.report.words.validation import validation_verdict
from qsframework.robot import Robot
from qsframework.terminal import paragraphs, table_lines, width
from qsframework.units import JointUnits
from qsframework.uses import Compensation, Stiffness, Targets
from qsframework.uses.compare import Comparison

_AXES = ("x_m", "y_m", "z_m")
_ROWS = 10
"""Of readings, targets and parameters that text shows."""


@dataclass(frozen=True)
class ResultView:
    """said: the verdict, or what a value is; columns: by name, each as long as the frame; draw: makes the plot;
    beside: attributes of the frame"""

    said: str
    tables: tuple[ReportTable, ...]
    columns: Mapping[str, Any]
    draw: Callable[[], Plot] | None = None
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
        if self.draw is None:
            raise InputError(
                Problem(f"no plot shows this: {self.line()}", hint="qsf.show draws robots and experiments")
            )
        figure = self.draw()  # a report sets the title itself; alone the plot needs room for it above the legend
        return figure.update_layout(title={"x": 0.01, "y": 0.98, "yanchor": "top"}, margin={"t": 84})


@singledispatch
def view_of(result: Any) -> ResultView:
    """How a result looks."""
    raise TypeError(f"a {type(result).__name__} has no view")


@view_of.register
def _fit(fit: Fit) -> ResultView:
    tables = (fit_table(fit, brief=True), *error_tables(fit))
    errors = {"errors_mm": fit.errors_mm}
    return ResultView(_said(fit_verdict(fit)), tables, values_of(fit), lambda: parameter_figure(fit).figure, errors)


@view_of.register
def _plan(plan: Plan) -> ResultView:
    units = plan.units or JointUnits((False,) * plan.pendant.shape[1])
    columns = {
        "pose": plan.pose,
        **_joint_columns(plan.pendant, units),
        **_columns(WRENCH_NAMES, plan.wrench),
        "load": plan.load,
        "repeats": plan.repeats,
    }
    said = f"{len(plan.pose)} poses, {sum(plan.repeats)} with their repeats. {certificate_text(plan)}"

    def figure() -> Plot:
        out = blank("Joints of the plan", "pose", f"value, {units.one}")
        for k, values in enumerate(units.shown(plan.pendant).T):
            mark = {"color": COLOURS[k % len(COLOURS)], "symbol": SYMBOLS[k % len(SYMBOLS)]}
            out.add_scatter(x=list(plan.pose), y=plotted(values), mode="markers", marker=mark, name=units.labels()[k])
        return out

    return ResultView(said, (pose_table(plan, units),), columns, figure)


@view_of.register
def _readings(readings: Readings) -> ResultView:
    kinds = [k for k in ("displacement", "position", "gauge") if (readings.kind == k).any()]
    counts = ", ".join(f"{int((readings.kind == k).sum())} {k}s" for k in kinds)
    masked = int((~readings.use).sum())
    said = f"{len(readings)} readings ({counts or 'none'}) of {len(set(readings.pose))} poses, from {readings.where}"
    said += f"; {masked} masked." if masked else "."
    loads = readings.poses.wrench[readings.plus, :3]
    columns = {
        "pose": readings.pose,
        "kind": readings.kind,
        "marker": readings.marker,
        **_columns(_AXES, readings.value),
        **_columns(("sigma_x_m", "sigma_y_m", "sigma_z_m"), readings.sigma),
        **_columns(WRENCH_NAMES[:3], loads),
        "use": readings.use,
        "line": readings.line,
    }
    rows = tuple(
        (
            readings.pose[i],
            str(readings.kind[i]),
            *map(mm, readings.value[i]),
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

    return ResultView(said, (title,), columns, figure)


@view_of.register
def _diagnosis(found: Diagnosis) -> ResultView:
    columns = {
        "cause": [x.name for x in found.table],
        "status": [x.status.value for x in found.table],
        "s": [x.s for x in found.table],
        "p": [x.p_value for x in found.table],
        "nearest": [x.nearest for x in found.table],
        "angle_rad": [x.angle for x in found.table],
    }
    groups = [ReportTable((title, ""), lines.rows) for title, lines in verdict_groups(found)]
    tables = (
        *groups,
        *(table for table in (cause_table(found), doubtful_table(found)) if table.rows),
        error_rows(found),
    )
    return ResultView(headline(found), tables, columns, lambda: budget_figure(found).figure)


@view_of.register
def _validation(found: Validation) -> ResultView:
    columns = {
        "pose": found.poses,
        "line": found.lines,
        **_columns(("error_x_m", "error_y_m", "error_z_m"), found.whole.errors),
        **_columns(("nominal_error_x_m", "nominal_error_y_m", "nominal_error_z_m"), found.whole.before),
    }
    sizes = {"nominal": found.whole.distances(before=True), "identified": found.whole.distances()}
    return ResultView(
        _said(validation_verdict(found)), validation_tables(found), columns, lambda: distribution_figure(sizes).figure
    )


@view_of.register
def _robot(robot: Robot) -> ResultView:
    c = robot.controller
    units = ["m" if sliding else "rad" for sliding in c.units.sliding]
    columns = {"joint": robot.facts.driven, "lower": c.lower, "upper": c.upper, "unit": units}
    carried = "" if robot.payload is None else f", payload {robot.payload:g} kg"
    said = f"{robot.name}, {robot.title}: {robot.facts.n} joints, {len(robot.parameters)} parameters{carried}"
    return ResultView(said, (joint_table(robot),), columns)


@view_of.register
def _experiment(experiment: Experiment) -> ResultView:
    try:
        parameters = experiment.fit_parameters()
    except QsfError:  # a campaign that cannot be fitted can still be looked at
        parameters = ()
    columns = {
        "parameter": [p.name for p in parameters],
        "nominal": [p.nominal for p in parameters],
        "sd": [np.nan if p.sd is None else p.sd for p in parameters],
        "unit": [p.unit for p in parameters],
    }
    counts = (
        f"{len(parameters)} parameters to estimate, {len(experiment.markers)} markers, {len(experiment.loads)} loads"
    )
    said = f"{experiment.path}: {experiment.robot.title}, {counts}"
    rows = tuple((p.name, shown_number(p.nominal, p.unit), unit_shown(p.unit)) for p in parameters)
    return ResultView(said, (_first(("parameter", "nominal", "unit"), rows),), columns)


@view_of.register
def _simulation(made: Simulation) -> ResultView:
    of = view_of(made.readings)
    return replace(of, said=f"Simulated: {of.said}")


@view_of.register
def _stiffness(found: Stiffness) -> ResultView:
    columns = {"spring": found.names, **_columns(_AXES, found.shares)}

    def figure() -> Plot:
        out = blank("Deflection by spring", "", "mm")
        for k, axis in enumerate("xyz"):
            out.add_bar(x=list(found.names), y=plotted(1e3 * found.shares[:, k]), name=axis)
        return out

    return ResultView(deflection_words(found), tuple(stiffness_tables(found)), columns, figure)


@view_of.register
def _targets(targets: Targets) -> ResultView:
    columns = {
        "target": targets.name,
        **_columns(_AXES, targets.wanted.position),
        **_columns(WRENCH_NAMES, targets.wrench),
    }
    rows = tuple(
        (name, *map(mm, at), ", ".join(f"{f:.0f}" for f in wrench[:3]))
        for name, at, wrench in zip(targets.name, targets.wanted.position, targets.wrench, strict=True)
    )
    said = f"{len(targets)} {'Cartesian' if targets.cartesian else 'joint'} targets, from {targets.path or 'Python'}"
    return ResultView(said, (_first(("target", "x, mm", "y, mm", "z, mm", "force N"), rows),), columns)


@view_of.register
def _compensation(found: Compensation) -> ResultView:
    columns = {
        "target": found.targets.name,
        "uncorrected_m": found.uncorrected,
        "expected_error_m": found.sd,
        **_joint_columns(found.pendant, found.units),
    }

    def figure() -> Plot:
        out = blank("Position error", "target", "mm")
        for name, size in (("uncorrected", found.uncorrected), ("predicted after correction", found.sd)):
            out.add_bar(x=list(found.targets.name), y=plotted(1e3 * size), name=name)
        return out

    table = target_table(found)
    tables = (_first(table.header, table.rows, table.caption),)
    return ResultView(_said(compensation_verdict(found)), tables, columns, figure)


@view_of.register
def _comparison(found: Comparison) -> ResultView:
    columns = {
        "robot": [r.robot.name for r in found.robots for _ in r.task],
        "point": [k + 1 for r in found.robots for k in range(len(r.task))],
        "deflection_m": [v for r in found.robots for v in r.task.tolist()],
        "after_m": [v for r in found.robots for v in r.after.tolist()],
    }
    tables = (summary_table(found), *sd_tables(found))
    return ResultView(_said(comparison_verdict(found)), tables, columns, lambda: path_figure(found))


def _columns(names: Sequence[str], values: Array) -> dict[str, Any]:
    """Columns (N, k) by their names."""
    return dict(zip(names, values.T, strict=True))


def _joint_columns(pendant: Array, units: JointUnits) -> dict[str, Any]:
    """Joint values (N, n), SI, by the names of their columns."""
    return _columns([f"q{k + 1}_{'m' if s else 'rad'}" for k, s in enumerate(units.sliding)], pendant)


def _first(header: tuple[str, ...], rows: tuple[tuple[str, ...], ...], caption: str = "") -> ReportTable:
    """The first rows of a table, and how many there are."""
    more = f"The first {_ROWS} of {len(rows)}." if len(rows) > _ROWS else ""
    return ReportTable(header, rows[:_ROWS], " ".join(filter(None, (more, caption))))


def _said(verdict: Verdict) -> str:
    return f"{verdict.word}: {verdict.said}"
