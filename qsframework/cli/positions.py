"""`qsf identify` on absolute positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from qsframework.cli.progress import print_table
from qsframework.experiment import Experiment, Readings, StateReadings, read_states

if TYPE_CHECKING:
    from qsframework.identify import Choices, Finding, Masked
    from qsframework.identify.absolute import PositionFit


def print_findings(found: Sequence[Finding], what: str) -> None:
    """What was masked of the positions or displacements, a line each."""
    if not found:
        print(f"the {what} were looked through: no row is masked")
    for one in found:
        print(f"masked, {one.kind}: {one.words}")


def identify_states(
    experiment: Experiment, source: Path, fit: list[str] | None, json: Path | None, report: Path | None,
    nominal: Path | None = None, urdf: Path | None = None, how: Choices | None = None,
    displacements: Readings | None = None, clean: bool = False, cleaned: tuple[Masked, ...] | None = None,
) -> None:  # fmt: skip
    """Identify from a file of state readings, and from displacements where given; print the fit, write the files.

    clean: mask the positions that cannot be right, and name them; cleaned: what was masked of the displacements
    """
    from qsframework.cli.commands import write_json
    from qsframework.identify import check_positions, identify_jointly, identify_positions, masked, said_of
    from qsframework.identify.fit_files import result_files
    from qsframework.report.fit_section import fit_table
    from qsframework.report.position_section import left_aside_table, position_error_table

    states = read_states(source, experiment)
    if clean:
        found = check_positions(experiment, states, fit)
        print_findings(found, "positions")
        cleaned = (*(cleaned or ()), *said_of(found, states))
        states = masked(states, found)
    if how is None and displacements is None:
        result = identify_positions(experiment, states, fit)
    else:
        result = identify_jointly(experiment, states, fit, displacements, how)
    result = replace(result, cleaned=cleaned)
    print(result.verdict())
    for table in (fit_table(result), left_aside_table(result), position_error_table(result)):
        print_table(table.header, table.rows)
        print(table.caption)
    for note in result.notes:
        print(note)
    if result.masked:
        print(f"gross errors, masked by the fit: rows {', '.join(map(str, result.masked))}; look at them")
    for said in result_files(result, experiment.robot, nominal, urdf):
        print(said)
    if json is not None:
        write_json(json, result.as_json())
        print(f"fit: {json}")
    if report is not None:
        files = [experiment.path, source]
        if displacements is not None and displacements.source is not None:
            files.append(displacements.source)
        _report(report, experiment, states, result, files)


def _report(report: Path, experiment: Experiment, states: StateReadings, fit: PositionFit, files: list[Path]) -> None:
    from qsframework.report import write_report
    from qsframework.report.position_section import position_section, position_view
    from qsframework.report.provenance import EQUILIBRIUM, LEAST_SQUARES, computed

    own = computed(experiment, files, None, (EQUILIBRIUM, LEAST_SQUARES))
    sections = (position_section(fit, "Fit"), position_view(fit, experiment, states), own)
    print(f"report: {write_report(report, f'Identification: {experiment.robot.title}', sections)}")
