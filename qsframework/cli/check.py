"""`qsf check`: what it calls, prints and writes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from qsframework.cli.commands import distinct_outputs, write_json
from qsframework.cli.kinds import kind
from qsframework.cli.printing import print_folded, print_table
from qsframework.cli.progress import progress, steps
from qsframework.errors import InputError, Problem, QsfError, all_of
from qsframework.experiment import Experiment, Readings, load_experiment, read_readings
from qsframework.robot import Robot, load_robot, robot_names
from qsframework.robot.findings import robot_findings
from qsframework.robot.search import shadows
from qsframework.robot.statics import WEIGHTLESS, GravityCheck

if TYPE_CHECKING:
    from qsframework.fits import Fit
    from qsframework.screening import Mistake

_READ_BY = {
    "plan": "qsf simulate EXPERIMENT PLAN reads it, with its constraints.",
    "targets": "qsf compensate EXPERIMENT FIT TARGETS reads them.",
    "fit": "qsf validate EXPERIMENT FIT READINGS reads it.",
}
"""The command that checks what is no experiment."""
Line = tuple[bool | None, str, str]
"""Whether it is as it should be (None: not measured, or of rows that harm no fit), its kind, and what was found."""


@dataclass(frozen=True, kw_only=True)
class Checked:
    """A file that could be read: what it is, and what its readings say of themselves."""

    file: Path
    words: str
    robot: Robot
    experiment: Experiment | None = None
    data: tuple[Path, ...] = ()
    readings: Readings | None = None
    lines: tuple[Line, ...] = ()

    @property
    def files(self) -> tuple[Path, ...]:
        """What the next command takes: the experiment, and the readings that it does not name."""
        named = self.experiment is None or self.data == self.experiment.data
        return (self.file,) if named else (self.file, *self.data)

    def said(self) -> str:
        """What the terminal shows."""
        if not self.lines:
            return f"{self.words}, ok"
        if all(good is False for good, _, _ in self.lines):
            return f"{self.words}, ok, but look at" + "".join(f"\n  {kind}: {said}" for _, kind, said in self.lines)
        bad = any(good is False for good, _, _ in self.lines)
        head = ", ok, but look at what is marked with !" if bad else ", ok"
        return self.words + head + "".join(f"\n  {_MARK[good]} {kind}: {said}" for good, kind, said in self.lines)


def check_files(files: Sequence[Path], json: Path | None, report: Path | None = None) -> bool:
    """Load each file, readings with their experiment; raise one InputError with the problems of all.

    Returns whether something is to be looked at.
    """
    distinct_outputs([json, report], [file for file in files if file.is_file()])
    by_kind = {file: kind(file) for file in files}
    data = tuple(file for file in files if by_kind[file] == "readings")
    if data and list(by_kind.values()).count("experiment") != 1:
        raise InputError(Problem("readings are checked with one experiment", hint="qsf check EXPERIMENT READINGS..."))
    with steps("check", *map(str, files)) as begins:

        def begun(file: Path) -> Checked:
            begins(str(file))
            return _check(file, data)

        checked = all_of(partial(begun, file) for file in files if file not in data)
    for one in checked:
        print_folded(f"{one.file}: {one.said()}")
        if one.experiment is not None:
            from qsframework.report.check_section import prior_table

            table = prior_table(one.experiment, one.readings)
            print()
            print_table(table.header, table.rows, caption=table.caption)
    if len(checked) == 1 and checked[0].experiment is not None:
        print("next: qsf", "identify" if checked[0].data else "design", *checked[0].files)
    if json is not None:
        write_json(json, {str(one.file): one.said() for one in checked}, names=True)
    if report is not None:
        _report(checked, report)
    return any(good is False for one in checked for good, _, _ in one.lines)


def _check(file: Path, data: tuple[Path, ...]) -> Checked:
    named = not file.suffix and not file.exists()  # a robot that nobody knows is told with the names that there are
    if named or str(file) in robot_names() or file.name == "robot.yaml" or file.is_dir():
        robot = load_robot(file)
        words = f"robot {robot.name}, {robot.facts.n} joints, {len(robot.parameters)} parameters"
        return Checked(file=file, words=words, robot=robot, lines=_of_robot(robot))
    if (found := kind(file)) in _READ_BY:
        raise InputError(Problem("is no experiment and no robot", str(file), found=found, hint=_READ_BY[found]))
    experiment = load_experiment(file)
    words = f"experiment with {experiment.robot.name}, {len(experiment.markers)} markers"
    own = _of_robot(experiment.robot)
    sources = data or experiment.data
    if not sources:
        return Checked(file=file, words=words, robot=experiment.robot, experiment=experiment, lines=own)
    readings = read_readings(sources, experiment, "positions")
    words += f", {len(readings)} readings at {len(set(readings.pose))} poses"
    return Checked(
        file=file,
        words=words,
        robot=experiment.robot,
        experiment=experiment,
        data=sources,
        readings=readings,
        lines=(*own, *experiment_lines(experiment, readings)),
    )


def _of_robot(robot: Robot) -> tuple[Line, ...]:
    """What deserves a look in the robot's own files."""
    weightless: tuple[Line, ...] = () if robot.facts.masses.any() else ((None, "masses", WEIGHTLESS),)
    own: tuple[Line, ...] = ((None, "robot", words),) if (words := shadows(robot.folder)) else ()
    return (*own, *weightless, *((False, found.name, found.words) for found in robot_findings(robot)))


def experiment_lines(experiment: Experiment, readings: Readings) -> list[Line]:
    """What the readings say of themselves, and what is wrong with them."""
    from qsframework.fits.identify import fit_readings
    from qsframework.screening import FILES, STAND_OUT, find_mistakes
    from qsframework.screening.closure import check_states

    lines: list[Line] = [(c.good, c.kind, c.said) for c in check_states(experiment, readings)]
    lines += [(None, "reads", said) for said in readings.about_reads]
    lines += [(None, "still", said) for said in readings.about_still(experiment.robot.facts.driven)]
    mistakes = find_mistakes(experiment, readings)
    told = [c for c in mistakes if c.told and c.file != FILES]
    lines += [(None if c.name in STAND_OUT or not c.stops else False, c.title, c.words) for c in told]
    try:  # states may be fitted as differences
        used = read_readings(readings.sources, experiment) if readings.is_position.any() else readings
        fit = fit_readings(experiment, used)
    except QsfError as error:
        return [*lines, (False, "fit", str(error))]
    return [*lines, *_of_fit(fit, mistakes, experiment, used)]


def _of_fit(fit: Fit, mistakes: Sequence[Mistake], experiment: Experiment, readings: Readings) -> list[Line]:
    """What the residuals say of the noise, and what is wrong beside mistakes in the table."""
    from qsframework.fits.findings import TOO_LARGE, findings_of
    from qsframework.report.words.fit import verdict_words

    table, lines = {c.name for c in mistakes}, [(None, "noise", said) for said in fit.about_noise]
    found = [f for f in findings_of(fit, mistakes, experiment, readings) if f.name not in table]
    wrong = [(False if f.stops else None, f.title, f.words) for f in found]
    if fit.widening > TOO_LARGE**2 and not wrong:
        lines.append((None, "residuals", verdict_words(fit)))
    return [*lines, *wrong]


_MARK = {True: " ", False: "!", None: "?"}
"""Before each line: as it should be; look at it; not measured, or of rows that harm no fit."""


def _report(checked: Sequence[Checked], report: Path) -> None:
    from qsframework.report import write_report
    from qsframework.report.blocks import Section
    from qsframework.report.check_section import found_section, prior_table, readings_section
    from qsframework.report.provenance import robots_computed
    from qsframework.report.robot_section import robot_section

    sections = [found_section([(str(c.file), c.words, c.lines) for c in checked])]
    for c in checked:
        if c.experiment is not None and c.readings is not None:
            sections.append(Section("Known before the readings", (prior_table(c.experiment, c.readings),)))
            sections.append(readings_section(c.experiment, c.readings, "/".join(c.file.parts[-2:])))
    sections += [robot_section(robot) for robot in {c.robot.folder: c.robot for c in checked}.values()]
    files = [path for c in checked if c.experiment is not None for path in (c.experiment.path, *c.data)]
    own = robots_computed([c.robot for c in checked], files)
    print(f"report: {write_report(report, 'Check', [*sections, own])}")


def run_conformance(files: Sequence[Path]) -> None:
    """Try every robot with everything; InputError that lists what did not hold."""
    from qsframework.uses.conformance import check_robot

    failed: list[str] = []
    for file in files:
        with progress() as tell:
            checks = check_robot(file, progress=tell)
        failed += [f"{file}: {words}" for words in print_checks(checks)]
    if failed:
        raise InputError([Problem(words) for words in failed])


def print_checks(checks: Sequence[GravityCheck]) -> list[str]:
    """Print what was found of a robot; what did not hold."""
    for check in checks:
        print_folded(f"  {'ok' if check.good else 'NO'}  {check.name}: {check.words}")
    return [f"{check.name}: {check.words}" for check in checks if not check.good]
