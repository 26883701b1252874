"""mapping.yaml: what the columns and the words of an instrument's files mean, kept for the next time."""

from __future__ import annotations

from pathlib import Path

import pydantic

from qsframework.files import FileModel, read_yaml, validate


class MappingSpec(FileModel):
    """What is stated of the files of one instrument or program."""

    columns: dict[str, str] = pydantic.Field(
        default_factory=dict, description="a column's name, or its number, by what it is: x, y, z, name, q1, time, ..."
    )
    units: list[str] = pydantic.Field(
        default_factory=list, description="units of what the files do not say: one of length, of angle, of time"
    )
    names: dict[str, str] = pydantic.Field(
        default_factory=dict, description="what a word of a name means: a pose, a marker, loaded or unloaded"
    )


def read_mapping(path: str | Path) -> MappingSpec:
    """Read a mapping. InputError with all its problems, each with file and line."""
    return validate(read_yaml(path), MappingSpec)
