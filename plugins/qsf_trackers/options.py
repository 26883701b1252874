"""What the files of others do not state, and where they lie."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from qsframework.cli import ExperimentFile, Json
from qsframework.option import Option, Options


@dataclass(frozen=True, kw_only=True)
class ImportOptions(Options):
    """What the files of others do not state.

    clock: s, the log's minus the tracker's; align: "", "unloaded" or a file of known points; within: m
    """

    columns: Annotated[
        Mapping[str, str],
        Option("Such as x=Xcoord, or x=3 where columns have no names.", name="map", form="ROLE=COLUMN"),
    ] = field(default_factory=dict[str, str])
    units: Annotated[tuple[str, ...], Option("Unit of columns that state none: mm, in, deg, ms.", name="unit")] = ()
    names: Annotated[
        Mapping[str, str],
        Option("In names, such as WITH=loaded or ball1=m1.", name="word", form="FOUND=MEANT"),
    ] = field(default_factory=dict[str, str])
    sheet: Annotated[str, Option("Which sheet of a workbook.")] = ""
    separator: Annotated[
        str,
        Option(
            "Column separator: ',', ';', '|', tab or space (default: detected).",
            choices=("", ",", ";", "|", "tab", "space"),
        ),
    ] = ""
    decimal: Annotated[str, Option("Decimal sign: '.' or ',' (default: detected).", choices=("", ".", ","))] = ""
    match: Annotated[
        str,
        Option(
            "Match points by names, by order (of the plan) or nearest.",
            group="Points",
            choices=("names", "order", "nearest"),
        ),
    ] = "names"
    join: Annotated[
        str, Option("Match the joint log by names, by order or by time.", choices=("", "names", "order", "time"))
    ] = ""
    state: Annotated[
        str, Option("State of points that carry none: unloaded or loaded.", choices=("", "unloaded", "loaded"))
    ] = ""
    series: Annotated[str, Option("Name of the tracker's station.")] = ""
    ignore: Annotated[tuple[str, ...], Option("Ignore these points, such as 'B*', or a column.")] = ()
    clock: Annotated[float, Option("Seconds by which the log's clock is ahead of the tracker's.")] = 0.0
    align: Annotated[
        str, Option("Tracker to base: from the 'unloaded' readings, or a file of known points, base frame.")
    ] = ""
    within: Annotated[
        float,
        Option("Largest distance of a point from its predicted place, mm.", least=1e-3, most=1e5, unit="mm"),
    ] = 0.05


@dataclass(frozen=True, kw_only=True)
class ImportFiles:
    """look: show what would be taken for what, and write nothing."""

    experiment: ExperimentFile
    files: Annotated[
        tuple[Path, ...],
        typer.Argument(
            help="Point lists, and a joint log: CSV, text or Excel, as they were exported.", show_default=False
        ),
    ]
    plan: Annotated[
        Path | None, Option("plan.csv, or the table to fill in of qsf protocol.", short="p", group="Files")
    ] = None
    mapping: Annotated[Path | None, Option("YAML with columns, units and names.")] = None
    output: Annotated[Path, Option("The readings.", short="o", group="Output")] = Path("readings.csv")
    look: Annotated[bool, Option("Show the column mapping, and write nothing.")] = False
    json: Json = None
