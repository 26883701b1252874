"""Which arm of a description becomes a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from qsframework.option import Option, Options


@dataclass(frozen=True, kw_only=True)
class Arm(Options):
    """Which arm of a description; base and flange are found where they are left out."""

    modified: Annotated[bool, Option("The table is the modified one (Craig).")] = False
    base: Annotated[str | None, Option("Fixed link (default: the root).")] = None
    flange: Annotated[str | None, Option("Link that carries the tool.")] = None
    payload: Annotated[float | None, Option("Its payload, kg, from the manual.")] = None
    bearing: Annotated[float | None, Option("Height, m, of the first bearing, from the manual.")] = None
    packages: Annotated[Mapping[str, Path], Option("A package that it names.", name="package", form="NAME=FOLDER")] = (
        field(default_factory=dict[str, Path])
    )
    arguments: Annotated[Mapping[str, str], Option("For a xacro's $(arg NAME).", name="arg", form="NAME=VALUE")] = (
        field(default_factory=dict[str, str])
    )
