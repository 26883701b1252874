"""mapping.yaml: what the columns and the words of an instrument's files mean, kept for the next time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pydantic

from qsf_trackers.tables import StatedProblem, stated_units
from qsframework.errors import InputError, Problem
from qsframework.files import Document, FileModel, read_yaml, validate


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


@dataclass(frozen=True)
class Mapping:
    """What is stated, and the file that states it."""

    spec: MappingSpec
    document: Document

    def placed(self, error: InputError) -> InputError:
        """The same problems, those of what is stated here with the file and line."""
        return InputError(self._placed(p) if isinstance(p, StatedProblem) else p for p in error.problems)

    def _placed(self, problem: StatedProblem) -> Problem:
        part, key, value = problem.stated
        if getattr(self.spec, part).get(key) != value:
            return problem  # stated elsewhere
        message = f"{problem.message} ({problem.file})" if problem.file else problem.message
        return replace(problem, message=message, file=str(self.document.path), line=self.document.line(part, key))


def read_mapping(path: str | Path) -> Mapping:
    """Read a mapping. InputError with all its problems, each with file and line."""
    mapping = Mapping(validate(document := read_yaml(path), MappingSpec), document)
    try:
        stated_units(mapping.spec.units)
    except InputError as error:
        line = document.line("units")
        raise InputError([replace(p, file=str(path), line=line) for p in error.problems]) from error
    return mapping
