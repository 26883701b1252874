"""Files in and out: safe YAML that knows its lines, models with units in their keys, atomic writes."""

from __future__ import annotations

import hashlib
import math
import os
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

import pydantic
import yaml

from qsframework import units
from qsframework.errors import InputError, Problem, nearest

_LARGEST = 5_000_000
_DEEPEST = 30
Key = str | int


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


def read_text(path: str | Path, largest: int = _LARGEST) -> str:
    """The text of a file. InputError if it is missing, a directory, too large or not UTF-8."""
    path = Path(path)
    if not path.exists():
        raise InputError(Problem("no such file", file=str(path)))
    if not path.is_file():
        raise InputError(Problem("is not a file", file=str(path)))
    if path.stat().st_size > largest:
        raise InputError(Problem(f"is larger than {largest // 1_000_000} MB", file=str(path)))
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(Problem(f"is not UTF-8 text (byte {error.start})", file=str(path))) from error
    except OSError as error:
        raise InputError(Problem(f"cannot be read: {error.strerror}", file=str(path))) from error


def read_yaml(path: str | Path) -> Document:
    """Read a YAML mapping safely: no tags, anchors or aliases, no tabs, no key twice."""
    path = Path(path)
    text = read_text(path)
    for number, line in enumerate(text.splitlines(), start=1):
        if "\t" in line[: len(line) - len(line.lstrip())]:
            raise InputError(Problem("a tab in the indentation; YAML wants spaces", file=str(path), line=number))
    try:
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) or getattr(event, "tag", None):
                mark = event.start_mark.line + 1
                raise InputError(Problem("anchors, aliases and tags are not allowed", file=str(path), line=mark))
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        if not isinstance(node, yaml.MappingNode):
            raise InputError(Problem("must hold `key: value` lines; it is empty or a list", file=str(path)))
        lines: dict[tuple[Key, ...], int] = {(): 1}
        data = _construct(node, (), lines, path)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = None if mark is None else mark.line + 1
        text = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise InputError(Problem(f"is not YAML: {text}", file=str(path), line=line)) from error
    except RecursionError as error:
        raise InputError(Problem("is nested too deeply", file=str(path))) from error
    return Document(path, data, lines)


def _construct(node: yaml.Node, at: tuple[Key, ...], lines: dict[tuple[Key, ...], int], path: Path) -> Any:
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
                raise InputError(Problem(f"key {key!r} stands here twice", file=str(path), line=line))
            lines[(*at, key)] = line
            out[key] = _construct(value, (*at, key), lines, path)
        return out
    if isinstance(node, yaml.SequenceNode):
        for i, item in enumerate(node.value):
            lines[(*at, i)] = item.start_mark.line + 1
        return [_construct(item, (*at, i), lines, path) for i, item in enumerate(node.value)]
    try:
        value = yaml.SafeLoader("").construct_object(node)
    except (ValueError, yaml.YAMLError) as error:
        raise InputError(
            Problem(f"cannot read {node.value!r}", file=str(path), line=node.start_mark.line + 1)
        ) from error
    # YAML 1.1 reads 1e5 as text and 2026-01-01 as a date; files mean a number and a text
    if isinstance(value, str) and node.style is None:  # type: ignore[union-attr]
        try:
            return float(value)
        except ValueError:
            return value
    return value if value is None or isinstance(value, str | int | float | bool) else str(node.value)


@dataclass(frozen=True)
class Unit:
    """Mark of a field in SI whose key in the file ends in a unit: `lever: Annotated[float, Unit("m")]`."""

    si: str


class FileModel(pydantic.BaseModel):
    """A frozen model of a file's mapping; unknown keys are errors, measured keys end in their unit."""

    model_config = pydantic.ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    @classmethod
    def measured(cls) -> dict[str, str]:
        """SI unit of each field whose key in the file ends in a unit."""
        out: dict[str, str] = {}
        for name, info in cls.model_fields.items():
            for mark in (
                *info.metadata,
                *(m for a in get_args(info.annotation) for m in getattr(a, "__metadata__", ())),
            ):
                if isinstance(mark, Unit):
                    out[name] = mark.si
        return out


M = TypeVar("M", bound=FileModel)


def validate(document: Document, model: type[M], data: Any = None, at: tuple[Key, ...] = ()) -> M:
    """Check the document (or the part `data` at the keys `at`) against a model.

    InputError with all problems, each with file and line.
    """
    data = document.data if data is None and not at else data
    problems: list[Problem] = []
    converted = _to_si(document, model, data, at, problems)
    try:
        result = model.model_validate(converted)
    except pydantic.ValidationError as error:
        problems.extend(_problem(document, model, at, e) for e in error.errors())
        result = None
    if problems or result is None:
        unique = {(p.line, p.message): p for p in problems}
        raise InputError(sorted(unique.values(), key=lambda p: p.line or 0))
    return result


def _nested(info: pydantic.fields.FieldInfo) -> tuple[type[FileModel] | None, bool, bool]:
    """The model inside a field, and whether it stands in a list or in a mapping."""
    text: list[Any] = [info.annotation]
    in_list = in_map = False
    while text:
        kind = text.pop()
        if isinstance(kind, type) and issubclass(kind, FileModel):
            return kind, in_list, in_map
        origin = getattr(kind, "__origin__", None)
        in_list |= origin in (list, tuple)
        in_map |= origin is dict
        text.extend(get_args(kind))
    return None, False, False


def _to_si(document: Document, model: type[FileModel], data: Any, at: tuple[Key, ...], problems: list[Problem]) -> Any:
    """A copy with measured keys renamed to their fields and converted, nested models included."""
    if not isinstance(data, dict):
        return data
    measured = model.measured()
    out: dict[str, Any] = {}
    for key, value in data.items():
        parts = units.split(key, list(measured))
        if key in model.model_fields and key not in measured:
            inner, in_list, in_map = _nested(model.model_fields[key])
            here = (*at, key)
            if inner is not None and in_list and isinstance(value, list):
                value = [_to_si(document, inner, v, (*here, i), problems) for i, v in enumerate(value)]
            elif inner is not None and in_map and isinstance(value, dict):
                value = {k: _to_si(document, inner, v, (*here, k), problems) for k, v in value.items()}
            elif inner is not None:
                value = _to_si(document, inner, value, here, problems)
            out[key] = value
        elif key in measured:
            allowed = units.allowed_names(key, measured[key])
            problems.append(_at(document, (*at, key), f"key {key!r} does not say its unit", allowed=allowed))
        elif parts is not None:
            name, unit = parts
            if not units.known(unit) or not units.same_dimension(unit, measured[name]):
                allowed = units.allowed_names(name, measured[name])
                problems.append(_at(document, (*at, key), f"key {key!r} ends in no unit of this kind", allowed=allowed))
            elif name in out:
                problems.append(_at(document, (*at, key), f"{name} is given twice"))
            else:
                out[name] = _converted(document, value, unit, (*at, key), problems)
        else:
            out[key] = value
    for name in measured:
        if name not in out and any(units.split(k, [name]) or k == name for k in data):
            out[name] = None if not model.model_fields[name].is_required() else _placeholder(model, name)
    return out


def _placeholder(model: type[FileModel], name: str) -> Any:
    """A value that validates, for a field whose problem has been told already."""
    kind = str(model.model_fields[name].annotation)
    return [0.0, 0.0, 0.0] if "list" in kind else {} if "dict" in kind else 1.0


def _converted(document: Document, value: Any, unit: str, at: tuple[Key, ...], problems: list[Problem]) -> Any:
    if isinstance(value, list):
        return [_converted(document, v, unit, (*at, i), problems) for i, v in enumerate(value)]
    if isinstance(value, dict):
        return {k: _converted(document, v, unit, (*at, k), problems) for k, v in value.items()}
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        problems.append(_at(document, at, f"{at[-1]} must be a finite number", found=repr(value)))
        return 1.0
    return float(units.to_si(float(value), unit))


def _at(document: Document, keys: tuple[Key, ...], message: str, **more: Any) -> Problem:
    return Problem(message, file=str(document.path), line=document.line(*keys), **more)


def _spellings(model: type[FileModel]) -> Iterator[str]:
    measured = model.measured()
    for name in model.model_fields:
        yield f"{name}_{units.ALLOWED.get(measured[name], (measured[name],))[0]}" if name in measured else name


def _problem(document: Document, model: type[FileModel], at: tuple[Key, ...], error: Any) -> Problem:
    """A pydantic error in the words of the file."""
    loc = tuple(k for k in error["loc"] if not (isinstance(k, str) and k.startswith(("function-", "list[", "dict["))))
    owner = _owner(model, loc)
    where = ".".join(str(k) for k in loc)
    keys = (*at, *_file_keys(document, at, loc))
    if error["type"] == "extra_forbidden":
        allowed = list(_spellings(owner))
        return _at(
            document, keys, f"unknown key {loc[-1]!r}", allowed=", ".join(allowed), hint=nearest(str(loc[-1]), allowed)
        )
    if error["type"] == "missing":
        si = owner.measured().get(str(loc[-1]))
        name = units.allowed_names(str(loc[-1]), si) if si else str(loc[-1])
        return _at(document, (*at, *loc[:-1]), f"key {name!r} is missing")
    found = repr(error.get("input"))
    return _at(document, keys, f"{where}: {error['msg'].removeprefix('Value error, ')}", found=found[:80])


def _owner(model: type[FileModel], loc: tuple[Key, ...]) -> type[FileModel]:
    for key in loc[:-1]:
        if isinstance(key, str) and key in model.model_fields:
            inner, _, _ = _nested(model.model_fields[key])
            model = inner or model
    return model


def _file_keys(document: Document, at: tuple[Key, ...], loc: tuple[Key, ...]) -> tuple[Key, ...]:
    """The keys as the file spells them (with units)."""
    here: list[Key] = []
    for key in loc:
        known = [
            k[len(at) + len(here)]
            for k in document.lines
            if k[: len(at) + len(here)] == (*at, *here) and len(k) > len(at) + len(here)
        ]
        match = [k for k in known if k == key or (isinstance(k, str) and k.startswith(f"{key}_"))]
        if not match:
            break
        here.append(key if key in match else match[0])
    return tuple(here)


def json_schema(model: type[FileModel]) -> dict[str, Any]:
    """JSON schema of the file: measured fields appear as patterns `name_<unit>`."""
    schema = model.model_json_schema()
    models = {model.__name__: (schema, model)}
    queue = [model]
    while queue:
        for info in queue.pop().model_fields.values():
            inner, _, _ = _nested(info)
            if inner is not None and inner.__name__ not in models:
                models[inner.__name__] = (schema["$defs"][inner.__name__], inner)
                queue.append(inner)
    for part, owner in models.values():
        for name, si in owner.measured().items():
            body = part["properties"].pop(name)
            body["description"] = f"{name} in a unit of {si}: {units.allowed_names(name, si)}"
            part.setdefault("patternProperties", {})[f"^{name}_[^_]+$"] = body
            if name in part.get("required", []):
                part["required"].remove(name)
    return schema


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Write to a temporary file beside the target, then rename: never half a file."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise InputError(Problem(f"cannot be written: {error.strerror}", file=str(path))) from error
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        Path(temporary).unlink(missing_ok=True)
        raise InputError(Problem(f"cannot be written: {error.strerror}", file=str(path))) from error
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    return path


def write_text(path: str | Path, text: str) -> Path:
    """Write UTF-8 text, all or nothing."""
    return write_bytes(path, text.encode("utf-8"))


def sha256(path: str | Path) -> str:
    """Hash of a file's bytes."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
