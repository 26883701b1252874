"""Points as JSON: one object a line, or a list of objects, as recorders and scripts write them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import cast

from qsframework.plugin import InputError, MeasuredFile, PointTable, Problem

_MOST_COLUMNS = 1000
_DEEPEST = 8
"""Objects within objects."""
_JSON = re.compile(r"\s*\[?\s*\{\s*[\"}]")
_BETWEEN = re.compile(r"[ \t\r\n,]*")
_OF_POINT = ("position", "pos", "point", "xyz", "coordinates", "coords", "p")
"""What a list of three numbers is called that is a point."""


def read(file: MeasuredFile) -> PointTable | None:
    """The points of a text of JSON objects, None where it is none. InputError where one line is spoilt."""
    path, text = file.path, file.text
    if _JSON.match(text) is None:
        return None
    found: list[tuple[int, Mapping[str, object]]] = []
    for line, value in _values(path, text):
        if not isinstance(value, Mapping):
            raise InputError(Problem("is no object of a point", str(path), line, found=repr(value)[:60]))
        found.append((line, dict(_flat("", cast("Mapping[str, object]", value), 0))))
    header = list(dict.fromkeys(name for _, own in found for name in own))
    if len(header) > _MOST_COLUMNS:
        raise InputError(Problem(f"holds more than {_MOST_COLUMNS} columns", str(path)))
    cells = [(line, [own.get(name) for name in header]) for line, own in found]
    rows = tuple((line, tuple("" if v is None else str(v) for v in values)) for line, values in cells)
    return PointTable("points as JSON", tuple(header), rows)


def _values(path: Path, text: str) -> Iterator[tuple[int, object]]:
    """The records of a list, or one after the other, each with its line."""
    decoder, line, last = json.JSONDecoder(), 1, 0
    at = _BETWEEN.match(text, text.index("[") + 1 if text.lstrip().startswith("[") else 0)
    while at is not None and at.end() < len(text) and text[at.end()] != "]":
        line, last = line + text.count("\n", last, at.end()), at.end()
        try:
            value, end = decoder.raw_decode(text, last)
        except (ValueError, RecursionError) as error:
            found = repr(text[last : last + 60])
            hint = "Export one object a line, or one list of objects."
            raise InputError(Problem("is no JSON", str(path), line, found=found, hint=hint)) from error
        yield line, value
        at = _BETWEEN.match(text, end)


def _flat(name: str, value: object, depth: int) -> Iterator[tuple[str, object]]:
    """What an object holds, by the names that lead there: `position.x`, `joints 1`; a point's three numbers x, y, z."""
    if isinstance(value, Mapping) and depth < _DEEPEST:
        for key, own in cast("Mapping[str, object]", value).items():
            yield from _flat(f"{name}.{key}" if name else str(key), own, depth + 1)
    elif isinstance(value, list) and depth < _DEEPEST:
        parts = cast("list[object]", value)
        last = name.rpartition(".")[2].lower()
        stem, _, unit = last.partition("_")
        of_point = len(parts) == 3 and stem in _OF_POINT
        for k, own in enumerate(parts):
            place = f"{'xyz'[k]}{f' [{unit}]' if unit else ''}" if of_point else f"{name} {k}"
            yield from _flat(place, own, depth + 1)
    else:
        yield name, value
