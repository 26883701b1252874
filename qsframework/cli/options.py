"""Arguments and options that commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

ExperimentFile = Annotated[Path, typer.Argument(help="experiment.yaml", show_default=False)]
Json = Annotated[Path | None, typer.Option("--json", help="Write the result as JSON.")]
Report = Annotated[Path | None, typer.Option("--report", help="Write a report: .html, or .pdf by Chromium.")]
Jobs = Annotated[int, typer.Option("--jobs", help="Processes of this machine; 0: one per core.", min=0)]
DaskAddress = Annotated[
    str | None, typer.Option("--dask", help="Work on a Dask cluster: its address, as tcp://10.0.0.5:8786.")
]
