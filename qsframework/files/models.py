"""The shape of a file: models with units in their keys, all problems at once."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator
from functools import cache
from typing import Any, TypeVar, get_args

import pydantic

from qsframework import plausible, units
from qsframework.errors import InputError, Problem, nearest
from qsframework.files.declared import FileModel, FileRecord, fields, measured, named_by
from qsframework.files.documents import Document, Key
from qsframework.files.plain import is_list, is_mapping

M = TypeVar("M", bound=FileModel | FileRecord)


def validate(document: Document, model: type[M], data: Any = None) -> M:
    """Check the document (or a part of it, `data`) against a model.

    InputError with all problems, each with file and line.
    """
    data = document.data if data is None else data
    problems = list(_beyond(document, data, ()))
    converted = _to_si(document, model, data, (), problems)
    try:
        result = _made(model, converted)
    except pydantic.ValidationError as error:
        problems.extend(_problem(document, model, e) for e in _one_arm(error.errors()))
        result = None
    if problems or result is None:
        unique = {(p.line, p.message): p for p in problems}
        raise InputError(sorted(unique.values(), key=lambda p: p.line or 0))
    return result


def _made(model: type[M], data: Any) -> M:
    """A record is read as from JSON, where a list is a tuple and a word a member of an Enum."""
    if issubclass(model, FileModel):
        return model.model_validate(data)
    return _reader(model).validate_json(json.dumps(data))


@cache
def _reader(model: type[Any]) -> pydantic.TypeAdapter[Any]:
    return pydantic.TypeAdapter(model)


GREATEST = 1e30
"""No quantity in a file is larger: the square of a number beyond 1e154 is infinite."""


_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
"""Characters that a terminal obeys instead of showing them."""


def _beyond(document: Document, data: Any, at: tuple[Key, ...]) -> Iterator[Problem]:
    """Numbers that are finite and yet none of a robot, and texts that a terminal would obey."""
    if any(isinstance(text, str) and _CONTROL.search(text) for text in (data, *at[-1:])):
        yield document.problem("a control character in a text", *at, found=_short(data))
    if is_mapping(data) or is_list(data):
        for key, value in data.items() if is_mapping(data) else enumerate(data):
            yield from _beyond(document, value, (*at, key))
    elif isinstance(data, int | float) and GREATEST < abs(data) < math.inf:
        yield document.problem(f"{_spoken(at)} is beyond {GREATEST:g}, which no quantity is", *at, found=_short(data))


def _nested(info: pydantic.fields.FieldInfo) -> tuple[type[Any] | None, bool, bool]:
    """The model inside a field, and whether it stands in a list or in a mapping."""
    text: list[Any] = [info.annotation]
    in_list = in_map = False
    while text:
        kind = held = text.pop()
        if isinstance(kind, type) and issubclass(kind, FileModel | FileRecord):
            return kind, in_list, in_map
        origin = getattr(held, "__origin__", None)
        in_list |= origin in (list, tuple)
        in_map |= origin is dict
        text.extend(get_args(held))
    return None, False, False


def _to_si(document: Document, model: type[Any], data: Any, at: tuple[Key, ...], problems: list[Problem]) -> Any:
    """A copy with measured keys renamed to their fields and converted, nested models included."""
    if not is_mapping(data):
        return data
    marks, known = measured(model), fields(model)
    stems: dict[str, dict[str, str]] = {}  # by the stem of keys the fields that it may mean, with their SI units
    for name, mark in marks.items():
        stems.setdefault(mark.stem, {})[name] = mark.si
    out: dict[str, Any] = {}
    for key, value in data.items():
        parts = units.split(key, list(stems))
        if key in known and key not in marks:
            (inner, in_list, in_map), named, here = _nested(known[key]), named_by(known[key]), (*at, key)
            if inner is not None and in_list and is_list(value):
                value = [_to_si(document, inner, v, (*here, i), problems) for i, v in enumerate(value)]
            elif inner is not None and (named is not None or in_map) and is_mapping(value):
                value = {k: _to_si(document, inner, v, (*here, k), problems) for k, v in value.items()}
                if named is not None:
                    value = {k: {named: k, **v} if is_mapping(v) else v for k, v in value.items()}
            elif inner is not None:
                value = _to_si(document, inner, value, here, problems)
            out[key] = value
        elif key in stems:
            allowed = _names(stems[key].values(), key)
            problems.append(document.problem(f"key {key!r} does not say its unit", *at, key, allowed=allowed))
        elif parts is not None:
            stem, unit = parts
            fits = [f for f, si in stems[stem].items() if units.known(unit) and units.same_dimension(unit, si)]
            name = fits[0] if fits else stem
            if not fits:
                allowed = _names(stems[stem].values(), stem)
                problems.append(
                    document.problem(f"key {key!r} ends in no unit of this kind", *at, key, allowed=allowed)
                )
            elif name in out:
                problems.append(document.problem(f"{name} is given twice", *at, key))
            else:
                out[name] = _converted(document, value, unit, stems[stem][name], (*at, key), problems)
        else:
            out[key] = value
    for stem, own in stems.items():
        if not own.keys() & out.keys() and any(units.split(k, [stem]) or k == stem for k in data):
            out[next(iter(own))] = _placeholder(model, next(iter(own)))
    return out


def _names(kinds: Iterable[str], stem: str) -> str:
    """The spellings to offer for a quantity of one or several dimensions."""
    return ", ".join(units.allowed_names(stem, si) for si in kinds)


def _placeholder(model: type[Any], name: str) -> Any:
    """A value that validates, for a field whose problem has been told already."""
    kind = str(fields(model)[name].annotation)
    return [0.0, 0.0, 0.0] if "list" in kind else {} if "dict" in kind else 1.0


def _converted(document: Document, value: Any, unit: str, si: str, at: tuple[Key, ...], problems: list[Problem]) -> Any:
    if is_list(value):
        return [_converted(document, v, unit, si, (*at, i), problems) for i, v in enumerate(value)]
    if is_mapping(value):
        return {k: _converted(document, v, unit, si, (*at, k), problems) for k, v in value.items()}
    if value is None:
        return None  # whether it may be left open, says the field
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        problems.append(document.problem(f"{_spoken(at)} must be a finite number", *at, found=repr(value)))
        return 1.0
    converted = float(units.to_si(float(value), unit))
    if (known := plausible.beyond(converted, si)) is not None:
        allowed = plausible.allowed(known, si, unit)
        problems.append(
            document.problem(f"{_spoken(at)} is no {known.quantity}", *at, found=repr(value), allowed=allowed)
        )
    return converted


def _spellings(model: type[Any]) -> Iterator[str]:
    marks = measured(model)
    for name in fields(model):
        mark = marks.get(name)
        yield name if mark is None else f"{mark.stem}_{units.ALLOWED.get(mark.si, (mark.si,))[0]}"


def _spoken(keys: tuple[Key, ...]) -> str:
    """The last key with what it needs to be understood: `point_mm[1]`, `joint_limits_deg.joint_2[0]`."""
    text = ""
    for key in keys:
        text += f"[{key}]" if isinstance(key, int) else f".{key}" if text else key
    return text


def _one_arm(errors: list[Any]) -> list[Any]:
    """Without what pydantic says of the other arm, where a field is a mapping or one of a few words, or a file."""
    words = {e["loc"][:-1]: e for e in errors if e["type"] == "literal_error" and str(e["loc"][-1]).startswith("lit")}
    tables = {e["loc"][: k + 1] for e in errors for k in range(len(e["loc"]) - 1) if "dict[" in str(e["loc"][k + 1])}
    words |= {e["loc"][:-1]: e for e in errors if e["type"] == "string_type" and e["loc"][:-1] in tables}
    out: list[Any] = []
    for e in errors:
        owner = next((loc for loc in words if e["loc"][: len(loc)] == loc and loc), None)
        if owner is None:
            out.append(e)
        elif isinstance(words[owner]["input"], dict):
            if e is not words[owner]:
                out.append({**e, "loc": (*owner, *e["loc"][len(owner) + 1 :])})
        elif e is words[owner]:
            word = f"the word {e['ctx']['expected']}" if "ctx" in e else "the name of a file"
            kind = e["type"] if "ctx" in e else ""
            out.append({**e, "loc": owner, "type": kind, "msg": f"must be a mapping, or {word}"})
    return out


_WORDS = {
    "model_type": "must be a mapping",
    "dataclass_type": "must be a mapping",
    "tuple_type": "must be a list",
    "dict_type": "must be a mapping",
    "list_type": "must be a list",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "string_type": "must be text",
    "bool_type": "must be true or false",
}


def _problem(document: Document, model: type[Any], error: Any) -> Problem:
    """A pydantic error in the words of the file."""
    loc = tuple(k for k in error["loc"] if not (isinstance(k, str) and k.startswith(("function-", "list[", "dict["))))
    owner = _owner(model, loc)
    where = ".".join(str(k) for k in loc)
    keys = _file_keys(document, loc)
    if error["type"] == "extra_forbidden":
        allowed = list(_spellings(owner))
        hint = nearest(str(loc[-1]), allowed)
        return document.problem(f"unknown key {loc[-1]!r}", *keys, allowed=", ".join(allowed), hint=hint)
    if error["type"] == "missing":
        mark = measured(owner).get(str(loc[-1]))
        name = units.allowed_names(mark.stem, mark.si) if mark else str(loc[-1])
        info = fields(owner).get(str(loc[-1]))
        shown = info.examples if info else None
        hint = f"Add for example {' or '.join(f'`{name}: {text}`' for text in shown)}." if shown else None
        return document.problem(f"key {name!r} is missing", *loc[:-1], hint=hint)
    found = _found(document, keys) if len(keys) == len(loc) else error.get("input")
    said = _WORDS.get(error["type"], error["msg"].removeprefix("Value error, "))
    allowed = (
        ", ".join(_spellings(_owner(model, (*loc, "")))) if error["type"] in ("model_type", "dataclass_type") else None
    )
    return document.problem(f"{where}: {said}", *keys, found=_short(found), allowed=allowed)


def _short(value: Any) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


def _found(document: Document, keys: tuple[Key, ...]) -> Any:
    """The value as the file has it, before its conversion to SI."""
    value: Any = document.data
    for key in keys:
        value = value[key]
    return value


def _owner(model: type[Any], loc: tuple[Key, ...]) -> type[Any]:
    for key in loc[:-1]:
        if isinstance(key, str) and key in fields(model):
            inner, _, _ = _nested(fields(model)[key])
            model = inner or model
    return model


def _file_keys(document: Document, loc: tuple[Key, ...]) -> tuple[Key, ...]:
    """The keys as the file spells them (with units)."""
    here: list[Key] = []
    for key in loc:
        known = [k[len(here)] for k in document.lines if k[: len(here)] == tuple(here) and len(k) > len(here)]
        match = [k for k in known if k == key or (isinstance(k, str) and k.startswith(f"{key}_"))]
        if not match:
            break
        here.append(key if key in match else match[0])
    return tuple(here)
