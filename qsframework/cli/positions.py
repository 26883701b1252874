"""`qsf identify` on absolute positions."""

from __future__ import annotations

from pathlib import Path

from qsframework.cli.progress import print_table
from qsframework.experiment import Experiment, read_states


def identify_states(
    experiment: Experiment, source: Path, fit: list[str] | None, json: Path | None, report: Path | None,
    nominal: Path | None = None, urdf: Path | None = None,
) -> None:  # fmt: skip
    """Identify from a file of state readings, print the fit, write fit.json and the report."""
    from qsframework.cli.commands import write_json
    from qsframework.identify import identify_positions
    from qsframework.identify.fit_files import result_files
    from qsframework.report import provenance_section, write_report
    from qsframework.report.fit_section import fit_table
    from qsframework.report.position_section import left_aside_table, position_error_table, position_section

    result = identify_positions(experiment, read_states(source, experiment), fit)
    print(result.verdict())
    for table in (fit_table(result), left_aside_table(result), position_error_table(result)):
        print_table(table.header, table.rows)
        print(table.caption)
    if result.masked:
        print(f"gross errors, masked: rows {', '.join(map(str, result.masked))}; look at them")
    for said in result_files(result, experiment.robot, nominal, urdf):
        print(said)
    if json is not None:
        write_json(json, result.as_json())
        print(f"fit: {json}")
    if report is not None:
        files = [experiment.path, source]
        sections = (position_section(result, "Fit"), provenance_section(result.model.effects, files, None))
        print(f"report: {write_report(report, f'Identification: {experiment.robot.title}', sections)}")
