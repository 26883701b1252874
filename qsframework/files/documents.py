"""Text and YAML files in: safe, with the line of every key."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import yaml

from qsframework.errors import InputError, Problem, nearest

_LARGEST = 5_000_000
_DEEPEST = 30
_MOST = 200_000
_OPEN = (yaml.MappingStartEvent, yaml.SequenceStartEvent)
_SHUT = (yaml.MappingEndEvent, yaml.SequenceEndEvent)
_LOOKED_AT = 1000
"""Files of a folder among which a near name is sought."""
_LONGEST = 1000
Key = str | int
Tags = Mapping[str, Callable[[str], Any]]
"""What makes a value of the text behind each tag that a file may use, such as `!degrees 90`."""
DECIMAL = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)


@dataclass(frozen=True)
class Document:
    """A YAML mapping and the line of every key in it."""

    path: Path
    data: dict[str, Any]
    lines: Mapping[tuple[Key, ...], int]

    def line(self, *keys: Key) -> int | None:
        """Line of the entry at the keys, or of the nearest entry around it."""
        for stop in range(len(keys), -1, -1):
            if keys[:stop] in self.lines:
                return self.lines[keys[:stop]]
        return None

    def problem(self, message: str, *keys: Key, **more: Any) -> Problem:
        """A problem of the entry at the keys."""
        return Problem(message, str(self.path), self.line(*keys), **more)


def read_text(path: str | Path, largest: int = _LARGEST) -> str:
    """The text of a file. InputError if it is missing, a directory, too large or not UTF-8."""
    try:
        return read_bytes(path, largest).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(Problem(f"is not UTF-8 text (byte {error.start})", file=_shown(path))) from error


def read_bytes(path: str | Path, largest: int = _LARGEST) -> bytes:
    """The content of a file. InputError if it is missing, a directory or too large."""
    path, shown = Path(path), _shown(path)
    try:
        if not path.exists():
            raise InputError(Problem("no such file", file=shown, hint=nearest_file(path)))
        if not path.is_file():
            raise InputError(Problem("is not a file", file=shown))
        too_large = InputError(Problem(f"is larger than {largest // 1_000_000} MB", file=shown))
        if path.stat().st_size > largest:
            raise too_large
        with path.open("rb") as stream:
            content = stream.read(largest + 1)  # what grows while it is read ends here too
        if len(content) > largest:
            raise too_large
        return content
    except OSError as error:
        raise InputError(Problem(f"cannot be read: {error.strerror}", file=shown)) from error


def _shown(path: str | Path) -> str:
    return str(path) if len(str(path)) <= _LONGEST else str(path)[:_LONGEST] + "..."


def nearest_file(path: Path) -> str | None:
    """A sentence with the file of the same folder whose name is nearest, or None."""
    try:
        beside = [p.name for p in islice(path.parent.iterdir(), _LOOKED_AT)]
    except OSError:
        return None
    return nearest(path.name, beside)


def read_yaml(path: str | Path, tags: Tags | None = None, doubled: list[Problem] | None = None) -> Document:
    """Read a YAML mapping safely: no tags but those given, no anchors or aliases, no tabs, no key twice.

    doubled: takes up the keys that stand there twice, of which the later counts, in place of refusing them
    """
    path = Path(path)
    text = read_text(path)
    if path.suffix.lower() == ".csv":
        hint = "Tables of readings, poses or targets stand behind the experiment.yaml that they belong to."
        raise InputError(Problem("is a table, where a YAML file is expected", file=str(path), hint=hint))
    for number, line in enumerate(text.splitlines(), start=1):
        if "\t" in line[: len(line) - len(line.lstrip())]:
            raise InputError(Problem("a tab in the indentation; YAML wants spaces", file=str(path), line=number))
    try:
        _refuse_bombs(text, path, tags or {})
        node = yaml.compose(text, Loader=_LOADER)
        if not isinstance(node, yaml.MappingNode):
            raise InputError(Problem("must hold `key: value` lines; it is empty or a list", file=str(path)))
        lines: dict[tuple[Key, ...], int] = {(): 1}
        data = _construct(node, (), lines, path, tags or {}, doubled)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = None if mark is None else mark.line + 1
        text = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise InputError(Problem(f"is not YAML: {text}", file=str(path), line=line)) from error
    except RecursionError as error:
        raise InputError(Problem("is nested too deeply", file=str(path))) from error
    return Document(path, data, lines)


_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The parser in C is twenty times as fast; where PyYAML comes without it, its own does the same."""


def _refuse_bombs(text: str, path: Path, tags: Tags) -> None:
    """InputError for what would grow or take for ever, at the event that shows it: nothing is built before."""
    depth = 0
    for count, event in enumerate(yaml.parse(text, Loader=_LOADER)):
        depth += isinstance(event, _OPEN) - isinstance(event, _SHUT)
        wrong = None
        tagged = getattr(event, "tag", None) not in (None, "", *tags)
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) or tagged:
            wrong = "anchors, aliases and tags are not allowed"
        elif depth > _DEEPEST + 1:
            wrong = "is nested too deeply"
        elif count > _MOST:
            wrong = f"holds more than {_MOST} values"
        if wrong:
            raise InputError(Problem(wrong, file=str(path), line=event.start_mark.line + 1))


def _construct(
    node: yaml.Node,
    at: tuple[Key, ...],
    lines: dict[tuple[Key, ...], int],
    path: Path,
    tags: Tags,
    doubled: list[Problem] | None,
) -> Any:
    if len(at) > _DEEPEST:
        raise InputError(Problem("is nested too deeply", file=str(path), line=node.start_mark.line + 1))
    if isinstance(node, yaml.MappingNode):
        out: dict[str, Any] = {}
        for key_node, value in node.value:
            line = key_node.start_mark.line + 1
            key = key_node.value
            if not isinstance(key_node, yaml.ScalarNode):
                raise InputError(Problem("a key must be a name", file=str(path), line=line))
            if key in out:
                twice = Problem(f"key {key!r} stands here twice", file=str(path), line=line)
                if doubled is None:
                    raise InputError(twice)
                doubled.append(twice)
            lines[(*at, key)] = line
            out[key] = _construct(value, (*at, key), lines, path, tags, doubled)
        return out
    if isinstance(node, yaml.SequenceNode):
        for i, item in enumerate(node.value):
            lines[(*at, i)] = item.start_mark.line + 1
        return [_construct(item, (*at, i), lines, path, tags, doubled) for i, item in enumerate(node.value)]
    return _scalar(node, path, tags)


@cache
def _scalars() -> yaml.SafeLoader:
    return yaml.SafeLoader("")


def _scalar(node: yaml.Node, path: Path, tags: Tags) -> Any:
    """Numbers are decimal: YAML 1.1 reads 1e5 as text, 010 as 8, 1:30 as 90 and 2026-01-01 as a date."""
    if node.tag in tags:
        try:
            return tags[node.tag](node.value)
        except ValueError as error:
            line = node.start_mark.line + 1
            raise InputError(Problem(f"{node.tag} {node.value[:80]!r}: {error}", file=str(path), line=line)) from error
    plain = not getattr(node, "style", None)  # None or, from the parser in C, ""
    if plain and DECIMAL.fullmatch(node.value):
        return float(node.value) if set(node.value) & set(".eE") or len(node.value) > 18 else int(node.value)
    try:
        value = _scalars().construct_object(node)
    except (ValueError, yaml.YAMLError) as error:
        raise InputError(
            Problem(f"cannot read {node.value!r}", file=str(path), line=node.start_mark.line + 1)
        ) from error
    infinite = isinstance(value, float) and (value != value or value in (float("inf"), -float("inf")))
    return value if value is None or infinite or isinstance(value, str | bool) else str(node.value)
