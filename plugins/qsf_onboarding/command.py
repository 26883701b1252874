"""`qsf new`: what it is asked."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from qsf_onboarding.options import Arm
from qsframework.option import Option


def new(
    name: Annotated[str, typer.Argument(help="The robot's name.", show_default=False)],
    urdf: Annotated[Path | None, Option("Its URDF or xacro.")] = None,
    dh: Annotated[Path | None, Option("Instead of a URDF, a table: a_mm, alpha_deg, d_mm, theta_deg.")] = None,
    output: Annotated[Path | None, Option("Folder to make (default: the name).", short="o")] = None,
    *,
    arm: Arm,
) -> None:
    """Make and test a robot's folder from a URDF or a table."""
    from qsf_onboarding.run import run_new

    run_new(name, urdf, dh, output, arm)
