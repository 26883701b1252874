"""Commands from what is declared elsewhere: the options of a verb's record are those of its command."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import typer

from qsframework.cli.pairs import pairs
from qsframework.option import Option, hints_of, option_of

Values = Mapping[str, Any]
_EMPTY = inspect.Parameter.empty


def expanded(function: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameters that are records are one parameter for each annotated field, as typer reads it.

    `Annotated[Values, Record]` hands over what was typed for the fields, by their names, and makes no record of it.
    """
    hints = {name: hint for name, hint in hints_of(function).items() if name != "return"}
    defaults = {name: parameter.default for name, parameter in inspect.signature(function).parameters.items()}
    typed = [one for name, hint in hints.items() for one in _parameters(name, hint, defaults[name])]

    def run(**given: Any) -> None:
        function(**{name: _value(name, hint, given) for name, hint in hints.items()})

    run.__name__, run.__doc__, run.__module__ = function.__name__, function.__doc__, function.__module__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in typed}
    run.__dict__["__signature__"] = inspect.Signature(typed)
    return run


def _record(hint: Any) -> type[Any] | None:
    """The record whose fields a parameter stands for."""
    marks = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    return next((mark for mark in marks if inspect.isclass(mark) and is_dataclass(mark)), None)


def _parameters(name: str, hint: Any, default: Any) -> Iterator[inspect.Parameter]:
    record = _record(hint)
    if record is None:
        yield _parameter(name, hint, default)
        return
    hints = hints_of(record)
    for field in fields(record):
        if get_origin(hints[field.name]) is Annotated:
            missing = field.default is MISSING and field.default_factory is MISSING
            yield _parameter(field.name, hints[field.name], _EMPTY if missing else field.default)


def _parameter(name: str, hint: Any, default: Any) -> inspect.Parameter:
    """What typer reads of an option, or of what is typer's own already."""
    kind, *marks = get_args(hint)
    option = option_of(hint)
    if option is not None and option.switch:
        kind, default = bool, default == option.switch
    elif _several(kind) is not None:
        kind = list[Path if get_args(kind)[0] is Path else str]
        kind, default = (kind, default) if default is _EMPTY else (kind | None, None)
    elif option is not None and option.unit and default:
        default = default / option.scale
    info = (
        marks[0]
        if option is None
        else _typed(name, option, kind is bool and bool(default), _several(get_args(hint)[0]))
    )
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, info])


def _several(kind: Any) -> Any:
    """What a repeatable option holds several of: what a tuple of any length holds, or the values of a mapping."""
    origin, own = get_origin(kind), get_args(kind)
    return own[0] if origin is tuple and own[-1] is ... else own[1] if origin is Mapping else None


def _typed(name: str, option: Option, on: bool, several: Any) -> Any:
    """An option as typer has it. on: whether it is a switch that is on; several: what it holds several of."""
    named = option.named(name)
    return typer.Option(
        *([f"-{option.short}"] if option.short else []),
        f"--{named}/--no-{named}" if on else f"--{named}",
        help=option.help if several is None else f"{option.help.removesuffix('.')} (repeat).",
        metavar=option.form or _choices(option) or None,
        min=option.least,
        max=option.most,
        show_default=option.shown,
        rich_help_panel=option.group or None,
    )


def _choices(option: Option) -> str:
    """The values that an option has where they are words, as `names|order|time`."""
    words = [choice for choice in option.choices if choice]
    return "|".join(words) if all(word.replace("-", "_").isidentifier() for word in words) else ""


def _value(name: str, hint: Any, given: Values) -> Any:
    """What a command is given for a parameter. InputError where it is none."""
    record = _record(hint)
    if record is None:
        return _read(name, hint, given[name])
    if get_origin(hint) is Annotated:
        return {field: tuple(v or ()) if _several(get_args(its)[0]) else v for field, its, v in _given(record, given)}
    return record(**{field: _read(field, its, value) for field, its, value in _given(record, given)})


def _given(record: type[Any], given: Values) -> Iterator[tuple[str, Any, Any]]:
    """The annotated fields of a record with what was typed for them."""
    hints = hints_of(record)
    return ((name, hint, given[name]) for name, hint in hints.items() if get_origin(hint) is Annotated)


def _read(name: str, hint: Any, value: Any) -> Any:
    """What was typed, as a field holds it."""
    kind, option = get_args(hint)[0], option_of(hint)
    if option is not None and option.switch:
        return option.switch if value else ""
    several = _several(kind)
    if option is not None and get_origin(kind) is Mapping:
        texts = pairs(f"--{option.named(name)}", value or (), option.form)
        return {key: several(text) for key, text in texts.items()}
    if several is not None and get_origin(several) is tuple:
        return tuple(tuple(word.strip() for word in text.split(",")) for text in value or ())
    if several is not None:
        return tuple(value or ())
    return value if value is None or option is None or not option.unit else option.scale * value
