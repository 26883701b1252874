"""The files of each command: what it reads, and what it writes where it is asked to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from qsframework.cli.options import Anyway, ExperimentFile, Json, Report
from qsframework.experiment.options import ReadAs
from qsframework.option import Option

PlanFile = Annotated[Path, typer.Argument(help="plan.csv", show_default=False)]
Readings = Annotated[
    tuple[Path, ...],
    typer.Argument(metavar="[READINGS]...", help="Files of readings (default: the experiment's own)."),
]


@dataclass(frozen=True, kw_only=True)
class DesignFiles:
    """candidates: a number, grid:LEVELS or a file of poses; accuracy, m."""

    experiment: ExperimentFile
    task: Annotated[
        Path | None,
        Option("task.yaml: the smallest plan for the points of its path.", name="for", group="Plan"),
    ] = None
    accuracy: Annotated[
        float | None,
        Option("With --for: required accuracy of the tool there, k = 2.", name="accuracy-mm", least=0.0, unit="mm"),
    ] = None
    taken: Annotated[tuple[Path, ...], Option("Readings or a plan already taken; a pose of both counts once.")] = ()
    test_poses: Annotated[
        Path | None, Option("For I and G: plan file with the poses and loads of the work.", group="Criterion")
    ] = None
    candidates: Annotated[
        str, Option("How many poses to draw, 'grid:5' for 5 angles of each joint, or a file of poses.", group="Search")
    ] = "1000"
    output: Annotated[Path, Option("The plan.", short="o", group="Output")] = Path("plan.csv")
    verbose: Annotated[bool, Option("Print how many poses each constraint excludes.")] = False
    json: Json = None
    report: Report = None

    def inputs(self) -> list[Path]:
        named = [Path(self.candidates)] if Path(self.candidates).is_file() else []
        asked = [path for path in (self.test_poses, self.task) if path is not None]
        return [self.experiment, *self.taken, *named, *asked]


@dataclass(frozen=True, kw_only=True)
class FitFiles:
    """states: how files of states are read."""

    experiment: ExperimentFile
    data: Readings = ()
    states: ReadAs = None
    nominal: Annotated[Path | None, Option("Write a nominal.yaml with the identified values.", group="Output")] = None
    compare: Annotated[Path | None, Option("fit.json of an earlier campaign: lists the changes since.")] = None
    verbose: Annotated[bool, Option("Print all rows and columns of the tables.")] = False
    json: Json = None
    report: Report = None
    anyway: Anyway = False

    @property
    def outputs(self) -> tuple[Path | None, ...]:
        return (self.json, self.report, self.nominal)


@dataclass(frozen=True, kw_only=True)
class DiagnoseFiles:
    """extend: a folder, doubtful: with the doubtful names too; plan: one to judge before measuring; output: the plan of
    --follow-up."""

    experiment: Path
    data: tuple[Path, ...] = ()
    plan: Path | None = None
    verbose: Annotated[bool, Option("List all causes, also excluded and unobservable ones.", group="Diagnosis")] = False
    extend: Annotated[
        Path | None, Option("Folder for the extended robot and an experiment on it.", group="Extended model")
    ] = None
    doubtful: Annotated[
        bool,
        Option(
            "Extend by doubtful causes too, which do not clearly reduce the held-out error.", name="extend-doubtful"
        ),
    ] = False
    output: Annotated[
        Path | None,
        Option("The plan of --follow-up (follow-up.csv).", short="o", group="Further poses"),
    ] = None
    json: Json = None
    report: Report = None


CORRECTED = Path("corrected.csv")


@dataclass(frozen=True, kw_only=True)
class CompensateFiles:
    """The fit, the targets or the programme, and what is written."""

    experiment: Path
    fit: Path
    targets: Path
    output: Annotated[Path, Option("The corrected targets.", short="o")] = CORRECTED
    json: Json = None
    report: Report = None
