"""`qsf identify`: what it calls and prints."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from qsframework.cli.commands import distinct_outputs, readings_file, write_json
from qsframework.cli.progress import print_table
from qsframework.experiment import Experiment, Readings, is_states, load_experiment, read_readings, read_states


@dataclass(frozen=True)
class FitFiles:
    """What the command reads, and what it writes where it is asked to."""

    experiment: Path
    data: Path | None = None
    json: Path | None = None
    report: Path | None = None
    nominal: Path | None = None
    urdf: Path | None = None

    @property
    def outputs(self) -> tuple[Path | None, ...]:
        return (self.json, self.report, self.nominal, self.urdf)


@dataclass(frozen=True)
class How:
    """How to fit; tied: groups of names."""

    fit: list[str] | None = None
    method: str = "linear"
    priors: bool = False
    loss: str = "linear"
    fixed: tuple[str, ...] = ()
    tied: tuple[tuple[str, ...], ...] = ()
    clean: bool = False
    shared_error: bool = False
    differences: bool = False


def _displacements(experiment: Experiment, source: Path) -> Readings:
    """Readings of a file of displacements, or loaded minus unloaded positions of a file of states."""
    from qsframework.identify.differences import differences

    if is_states(source):
        return differences(read_states(source, experiment), experiment)[0]
    return read_readings(source, experiment)


def run_identify(files: FitFiles, how: How) -> None:
    """Identify, print the fit, write the files and the report."""
    from qsframework.cli.positions import identify_states
    from qsframework.errors import InputError
    from qsframework.identify import check_readings, identify, masked
    from qsframework.identify.fit_files import result_files
    from qsframework.report import error_table, fit_section, fit_table, provenance_section, write_report

    experiment = load_experiment(files.experiment)
    source = readings_file(experiment, files.data)
    distinct_outputs(files.outputs, [files.experiment, source])
    if is_states(source) and not how.differences:
        if how != How(how.fit):
            raise InputError(
                "method, priors, loss, fixed, tied, clean and shared-error are for displacement readings; these are "
                "positions. Positions with loaded states count as displacements with --differences"
            )
        identify_states(experiment, source, how.fit, files.json, files.report, files.nominal, files.urdf)
        return
    readings = _displacements(experiment, source)
    if how.clean:
        found = check_readings(experiment if how.fit is None else experiment.with_(fit=tuple(how.fit)), readings)
        for finding in found:
            print(f"masked, {finding.kind}: {finding.words}")
        readings = masked(readings, found)
    shared = "pose" if how.shared_error else ""
    result = identify(experiment, readings, how.fit, how.method, how.priors, how.loss, how.fixed, how.tied, shared)
    print(result.verdict())
    for table in (fit_table(result), error_table(result)):
        print_table(table.header, table.rows)
        print(table.caption)
    for note in result.notes:
        print(note)
    for said in result_files(result, experiment.robot, files.nominal, files.urdf):
        print(said)
    if files.json is not None:
        write_json(files.json, result.as_json())
        print(f"fit: {files.json}")
    if files.report is not None:
        inputs = [files.experiment, source]
        sections = (fit_section(result, "Fit"), provenance_section(result.model.effects, inputs, None))
        print(f"report: {write_report(files.report, f'Identification: {experiment.robot.title}', sections)}")
