"""`qsf protocol` and `qsf day`: what they are asked."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from qsf_day.options import DayFiles, ProtocolOptions, VisitOptions
from qsframework.cli import ExperimentFile, PlanFile, Trust
from qsframework.option import Option


def protocol(
    experiment: ExperimentFile,
    plan: PlanFile,
    output: Annotated[Path, Option("The sheet to print: .html, or .pdf by Chromium.", short="o")] = Path("sheet.html"),
    readings: Annotated[Path, Option("The table to fill in.")] = Path("readings.csv"),
    *,
    options: ProtocolOptions,
    trust: Trust = False,
) -> None:
    """Write the measuring protocol: a sheet, and a table to fill in."""
    from qsf_day.run_protocol import run_protocol

    run_protocol(experiment, plan, output, readings, options)


def day(
    files: DayFiles,
    port: Annotated[int, Option("Port of the page; 0 takes any free one.", least=0)] = 8765,
    once: Annotated[bool, Option("With --watch: read what is there, then exit.")] = False,
    *,
    options: VisitOptions,
    trust: Trust = False,
) -> None:
    """Run the measuring session; reports mistakes at once."""
    from qsf_day.run import run_day

    run_day(files, ProtocolOptions(**vars(options)), port, once)
