"""What a class declares of its file: keys, units, nested records.

Models are of files that people write. Records are of files that qsframework writes: one declaration of a field serves
the value, its writing and its reading.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Any, get_args, get_type_hints

import numpy as np
import pydantic
from pydantic_core import core_schema

from qsframework.files.plain import FileRecord, is_list, is_tuple


@dataclass(frozen=True)
class Unit:
    """Mark of a field in SI whose key in the file ends in a unit: `lever: Annotated[float, Unit("m")]`.

    stem: the key's name where it is not the field's: `limits_deg` and `limits_mm` are two fields
    """

    si: str
    stem: str = ""


@dataclass(frozen=True)
class Named:
    """Mark of a tuple of records that the file holds as a mapping: from this field of each to its others."""

    field: str

    def __get_pydantic_core_schema__(self, source: Any, handler: pydantic.GetCoreSchemaHandler) -> Any:
        inner = handler.generate_schema(dict[str, get_args(source)[0]])
        return core_schema.no_info_after_validator_function(lambda found: tuple(found.values()), inner)


@dataclass(frozen=True)
class Lists:
    """Mark of an array that the file holds as lists of numbers, one in another `depth` times."""

    depth: int

    def __get_pydantic_core_schema__(self, source: Any, handler: pydantic.GetCoreSchemaHandler) -> Any:
        inner = handler.generate_schema(list[float] if self.depth == 1 else list[list[float]])
        return core_schema.no_info_after_validator_function(_array, inner)


def _array(lists: list[Any]) -> Any:
    if len({len(row) if is_list(row) else 0 for row in lists}) > 1:
        raise ValueError("rows of different lengths")
    return np.array(lists, dtype=float)


def null(value: float) -> Any:
    """Mark of a number that stands as null in the file where it is `value`, which is not finite."""
    return pydantic.WrapValidator(lambda found, number: value if found is None else number(found))


class FileModel(pydantic.BaseModel):
    """A frozen model of a file's mapping; unknown keys are errors, measured keys end in their unit."""

    model_config = pydantic.ConfigDict(
        extra="forbid",
        frozen=True,
        strict=True,
        allow_inf_nan=False,
        defer_build=True,  # a command reads few of the kinds of files that there are
    )


@cache
def fields(model: type[Any]) -> Mapping[str, pydantic.fields.FieldInfo]:
    """The fields of a FileModel or FileRecord that stand in its file."""
    if issubclass(model, FileModel):
        return model.model_fields
    hints = get_type_hints(model, include_extras=True)
    found = {
        f.name: pydantic.fields.FieldInfo.from_annotated_attribute(hints[f.name], f) for f in dataclasses.fields(model)
    }
    return {name: info for name, info in found.items() if not info.exclude}


@cache
def measured(model: type[Any]) -> Mapping[str, Unit]:
    """The unit, with the key's stem, of each field whose key in the file ends in a unit."""
    out: dict[str, Unit] = {}
    for name, info in fields(model).items():
        for mark in (
            *info.metadata,
            *(m for a in get_args(info.annotation) for m in getattr(a, "__metadata__", ())),
        ):
            if isinstance(mark, Unit):
                out[name] = Unit(mark.si, mark.stem or name)
    return out


def as_file(record: FileRecord, model: type[Any] | None = None) -> dict[str, Any]:
    """What the file of a record holds; model: the class whose fields it has, where the record is of a class below it.

    All is SI, so that what is read back is the same bit for bit; keys end in their unit; what is no number is null.
    """
    model = model or type(record)
    marks = measured(model)
    return {
        f"{name}_{marks[name].si}" if name in marks else name: _plain(getattr(record, name), named_by(info))
        for name, info in fields(model).items()
    }


def _plain(value: Any, named: str | None = None) -> Any:
    if named is not None:
        every = [as_file(one) for one in value]
        return {one.pop(named): one for one in every}
    if isinstance(value, FileRecord):
        return as_file(value)
    if is_tuple(value):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, np.ndarray):
        return np.asarray(value, dtype=float).tolist()
    return value.value if isinstance(value, Enum) else value


def named_by(info: pydantic.fields.FieldInfo) -> str | None:
    """The field that names the records of this one in the file."""
    return next((mark.field for mark in info.metadata if isinstance(mark, Named)), None)
