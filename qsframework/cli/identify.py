"""`qsf identify`: what it calls and prints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from qsframework.cli.commands import distinct_outputs, readings_file, write_json
from qsframework.cli.displacements import read_displacements
from qsframework.cli.positions import print_findings
from qsframework.cli.progress import print_table
from qsframework.experiment import Experiment, Readings, is_states, load_experiment

if TYPE_CHECKING:
    from qsframework.identify import Choices, Fit, Masked


_OF_STATES = (
    "The displacements are differences of two positions, and so is their noise: sqrt(2) times that of one position, "
    "which is what sigma_mm says in a file of states."
)


@dataclass(frozen=True)
class FitFiles:
    """What the command reads, and what it writes where it is asked to; positions join the displacements of data."""

    experiment: Path
    data: Path | None = None
    json: Path | None = None
    report: Path | None = None
    nominal: Path | None = None
    urdf: Path | None = None
    positions: Path | None = None

    @property
    def outputs(self) -> tuple[Path | None, ...]:
        return (self.json, self.report, self.nominal, self.urdf)


@dataclass(frozen=True)
class How:
    """How to fit; method "" is linear for displacements; tied: groups of names."""

    fit: list[str] | None = None
    method: str = ""
    priors: bool = False
    loss: str = "linear"
    fixed: tuple[str, ...] = ()
    tied: tuple[tuple[str, ...], ...] = ()
    clean: bool = False
    shared_error: bool = False
    differences: bool = False
    exact: bool = False
    profile: tuple[str, ...] = ()


def _choices(how: How) -> Choices | None:
    """How to fit positions, None for the plain fit. InputError for what is for displacements only."""
    from qsframework.errors import InputError
    from qsframework.identify import Choices

    if how.method not in ("", "one-step"):
        raise InputError(
            f"method {how.method} is for displacements alone; absolute positions are always fitted in one step "
            "together with their tracker's frame. Leave --method out"
        )
    if how.shared_error:
        raise InputError(
            "shared-error is for displacement readings alone; these are positions. Positions with loaded states count "
            "as displacements with --differences"
        )
    if how.exact or how.profile:
        name = "--exact" if how.exact else "--profile"
        raise InputError(f"{name} is for displacement readings alone; absolute positions have no such fit yet")
    chosen = Choices(how.priors, how.loss, how.fixed, how.tied)
    return None if chosen == Choices() and not how.method else chosen


def _check_kinds(files: FitFiles, source: Path) -> None:
    """InputError where --positions names no positions, or is given beside positions."""
    from qsframework.errors import InputError

    if files.positions is None:
        return
    if not is_states(files.positions):
        raise InputError(f"{files.positions}: --positions needs absolute positions x_mm, y_mm, z_mm")
    if is_states(source):
        raise InputError(f"{source} holds positions too; with --positions, --data is a file of displacements")


def _cleaned(
    experiment: Experiment, readings: Readings, fit: list[str] | None
) -> tuple[Readings, tuple[Masked, ...]]:  # fmt: skip
    """The readings without those that cannot be right, which are named."""
    from qsframework.identify import check_readings, masked, said_of

    found = check_readings(experiment if fit is None else experiment.with_(fit=tuple(fit)), readings)
    print_findings(found, "displacements")
    return masked(readings, found), said_of(found, readings)


def run_identify(files: FitFiles, how: How) -> None:
    """Identify, print the fit, write the files and the report."""
    from qsframework.cli.positions import identify_states
    from qsframework.identify import identify
    from qsframework.identify.fit_files import result_files

    experiment = load_experiment(files.experiment)
    source = readings_file(experiment, files.data)
    distinct_outputs(files.outputs, [files.experiment, source, *([files.positions] if files.positions else [])])
    _check_kinds(files, source)
    outputs = files.json, files.report, files.nominal, files.urdf
    if is_states(source) and not how.differences:
        identify_states(experiment, source, how.fit, *outputs, _choices(how), clean=how.clean)
        return
    readings = read_displacements(experiment, source)
    cleaned = None
    if how.clean:
        readings, cleaned = _cleaned(experiment, readings, how.fit)
    if files.positions is not None:
        identify_states(experiment, files.positions, how.fit, *outputs, _choices(how), readings, how.clean, cleaned)
        return
    shared = "pose" if how.shared_error else ""
    result = identify(
        experiment, readings, how.fit, how.method or "linear", how.priors, how.loss, how.fixed, how.tied, shared,
        how.exact, how.profile,
    )  # fmt: skip
    if is_states(source):
        result = replace(result, notes=(*result.notes, _OF_STATES))
    result = replace(result, cleaned=cleaned)
    _tell(result)
    for said in result_files(result, experiment.robot, files.nominal, files.urdf):
        print(said)
    if files.json is not None:
        write_json(files.json, result.as_json())
        print(f"fit: {files.json}")
    if files.report is not None:
        _report(files.report, experiment, readings, result, [files.experiment, source], how.exact)


def _tell(result: Fit) -> None:
    """The verdict, the tables and the notes."""
    from qsframework.report import error_table, fit_table, interval_tables

    print(result.verdict())
    for table in (fit_table(result), *interval_tables(result), error_table(result)):
        print_table(table.header, table.rows)
        print(table.caption)
    for note in result.notes:
        print(note)


def _report(
    report: Path, experiment: Experiment, readings: Readings, fit: Fit, inputs: list[Path], exact: bool
) -> None:  # fmt: skip
    from qsframework.report import fit_section, write_report
    from qsframework.report.fit_section import residual_view
    from qsframework.report.provenance import EQUILIBRIUM, LEAST_SQUARES, LINEAR, computed

    own = computed(experiment, inputs, None, (EQUILIBRIUM if exact else LINEAR, LEAST_SQUARES))
    sections = (fit_section(fit, "Fit"), residual_view(fit, experiment, readings), own)
    print(f"report: {write_report(report, f'Identification: {experiment.robot.title}', sections)}")
