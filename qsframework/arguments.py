"""Arguments of verbs and options: each is what its annotation says, or an error says which one, what it is and how to
get what is wanted."""

from __future__ import annotations

import functools
import inspect
import numbers
import os
import re
import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, ParamSpec, TypeVar, get_args, get_origin

from qsframework.errors import InputError, Problem

P = ParamSpec("P")
T = TypeVar("T")

_NOT = object()
"""What a value is where it is nothing of the kind."""
_PLAIN: dict[str, tuple[type, ...]] = {
    "None": (type(None),),
    "bool": (bool,),
    "int": (numbers.Integral,),
    "float": (numbers.Real,),
    "str": (str,),
    "Path": (os.PathLike, str),
}
_ARRAYS, _CALLED, _ANY = ("Array", "ArrayLike"), ("Tell", "Progress", "Callable"), ("Any", "object")
_WORDS = {
    "Array": "an array of numbers",
    "ArrayLike": "an array of numbers",
    "int": "a whole number",
    "float": "a number",
}
_WORDS |= {"Tell": "a function", "Progress": "a function", "str": "a text", "Path": "a path", "bool": "True or False"}
_HOW = {
    "Experiment": "Read it with load_experiment(path)",
    "Readings": "Read them with read_readings(path, experiment)",
    "Plan": "Make it with design(experiment, poses), or read it with read_plan(path, experiment)",
    "FitRecord": "Read it with read_fit(path), or make it with identify(experiment, readings)",
    "Fit": "Make it with identify(experiment, readings)",
    "Targets": "Read them with read_targets(path, experiment), or make them with joint_targets(experiment, ...)",
    "Robot": "Load it with load_robot(name)",
    "Task": "Read it with load_task(path)",
    "Diagnosis": "Make it with diagnose(experiment, readings)",
    "FollowUp": "Make it with follow_up(diagnosis)",
    "Programme": "Make it with make_programme(experiment, plan)",
}
_LEAST = {"candidates": 1, "count": 1, "repeats": 1, "samples": 1, "cycles": 1, "seed": 0, "largest": 0}
"""What a whole number is at least, whichever verb it is given to."""
_SHARES = {"level": 0.5, "power": 1.0, "share": 1.0}
"""What a probability or a share is below; all are above 0."""
_OF_ROBOTS = ("Plan", "Readings", "Targets")


def checked(verb: Callable[P, T]) -> Callable[P, T]:
    """The verb, whose arguments are checked against their annotations first: one item is taken as a sequence of one, a
    list of numbers as an array. InputError with all that are something else, or of another robot than the experiment.
    """
    signature = inspect.signature(verb)

    @functools.wraps(verb)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            given = signature.bind(*args, **kwargs)
        except TypeError:
            return verb(*args, **kwargs)  # Python's own words name the verb and the argument
        given.arguments.update(_taken(given.arguments, _plain(verb, verb.__annotations__)))
        _check_robots(given.arguments)
        return verb(*given.args, **given.kwargs)

    return run


def check_options(options: object) -> None:
    """Check the values of a dataclass of options against their annotations, as `checked` does those of a verb."""
    annotations: dict[str, str] = {}
    for kind in reversed(type(options).__mro__):
        annotations |= _plain(kind, vars(kind).get("__annotations__", {}))
    for name, value in _converted(vars(options), annotations).items():
        object.__setattr__(options, name, value)


def _plain(declared: Any, annotations: Mapping[str, Any]) -> dict[str, str]:
    """Annotations without what they say of options: an alias of an annotated type stands for the type."""
    names = vars(sys.modules[declared.__module__])
    return {name: _type_in(stated, names) for name, stated in annotations.items()}


def _type_in(stated: Any, names: Mapping[str, Any]) -> str:
    """The type of an annotation: a text, or what it stands for in a module that does not keep texts."""
    if isinstance(stated, str) and stated.startswith("Annotated["):
        return _parts(stated.removeprefix("Annotated["), ", ")[0]
    meant = names.get(stated) if isinstance(stated, str) else stated
    if get_origin(meant) is Annotated:
        meant = get_args(meant)[0]
    elif isinstance(stated, str):
        return stated
    return re.sub(r"\w+\.", "", meant.__name__ if isinstance(meant, type) else str(meant))


def _taken(given: Mapping[str, Any], annotations: Mapping[str, str]) -> dict[str, Any]:
    values = _converted(given, annotations)
    beyond = {name: words for name, value in values.items() if (words := _beyond(name, value))}
    if beyond:
        raise InputError([Problem(f"{name} must be {words}, found {values[name]:g}") for name, words in beyond.items()])
    return values


def _converted(given: Mapping[str, Any], annotations: Mapping[str, str]) -> dict[str, Any]:
    values = {name: _as(value, annotations.get(name, "Any")) for name, value in given.items()}
    wrong = [name for name, value in values.items() if value is _NOT]
    if wrong:
        raise InputError([_problem(name, given[name], annotations[name]) for name in wrong])
    return values


def _beyond(name: str, value: Any) -> str:
    """What is allowed, of a number that is not; "" of all else."""
    if name in _LEAST and _is(value, int) and not _is(value, bool) and value < _LEAST[name]:
        return f"{_LEAST[name]} or more"
    if name in _SHARES and _is(value, float, int) and not 0.0 < value < _SHARES[name]:
        return f"between 0 and {_SHARES[name]:g}"
    return ""


def _as(value: Any, annotation: str) -> Any:
    """The value as the first kind of the annotation that it is, else `_NOT`."""
    kinds = _parts(annotation, " | ")
    return next((v for kind in kinds if (v := _as_kind(value, kind)) is not _NOT), _NOT)


def _as_kind(value: Any, kind: str) -> Any:
    name, _, inner = kind.partition("[")
    if inner:
        return _as_many(value, name, inner.removesuffix("]"))
    if kind in _PLAIN:
        truth = _is(value, bool) or "bool_" in _names(value)
        fits = truth if kind == "bool" else _is(value, *_PLAIN[kind]) and not truth
        return (Path(value) if kind == "Path" else value) if fits else _NOT
    if kind in _ARRAYS:
        array = _numbers(value)
        return _NOT if array is None else array if kind == "Array" else value
    fits = kind in _ANY or (callable(value) if kind in _CALLED else kind in _names(value))
    return value if fits else _NOT


def _as_many(value: Any, name: str, inner: str) -> Any:
    """A collection as it is where all its items are of the inner kind, converted; one item as a tuple of one."""
    if name in ("Mapping", "dict"):
        return value if _is(value, Mapping) else _NOT
    if name in _CALLED:
        return value if callable(value) else _NOT
    kind, *more = _parts(inner, ", ")
    if more and more != ["..."]:
        return value if _is(value, Collection) and len(value) == 1 + len(more) else _NOT
    if _is(value, str, Mapping) or not _is(value, Collection):
        one = _as(value, kind)
        return _NOT if one is _NOT else (one,)
    items = [_as(item, kind) for item in value]
    if any(item is _NOT for item in items):
        return _NOT
    return tuple(items) if name in ("tuple", "Sequence") else value


def _is(value: Any, *kinds: type) -> bool:
    return isinstance(value, kinds)


def _parts(text: str, between: str) -> list[str]:
    """A text cut at a sign, not within brackets."""
    out: list[str] = []
    for piece in text.split(between):
        if out and out[-1].count("[") > out[-1].count("]"):
            out[-1] += between + piece
        else:
            out.append(piece)
    return out


def _numbers(value: Any) -> Any:
    """An array of float64, one that is one as it is; None where it is none, or a single number."""
    import numpy as np  # not before it is needed

    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return array if array.ndim else None


def _names(value: object) -> tuple[str, ...]:
    return tuple(c.__name__ for c in type(value).__mro__)


def _problem(name: str, value: Any, annotation: str) -> Problem:
    plain = _is(value, str, numbers.Number, os.PathLike)
    found = f"{repr(value)[:60]} ({type(value).__name__})" if plain else type(value).__name__
    found = "None" if value is None else found
    kinds = [kind for kind in _parts(annotation, " | ") if kind != "None"]
    hints = list(dict.fromkeys(_HOW[kind] for kind in kinds if kind in _HOW))
    allowed, hint = _either(map(_worded, kinds)), f"{hints[0]}." if hints else None
    return Problem(f"{name}: found {found}", allowed=allowed, hint=hint)


def _worded(kind: str) -> str:
    name, _, inner = kind.partition("[")
    if inner and name not in ("Mapping", "dict"):
        return f"a sequence of {_either(_worded(k) for k in _parts(_parts(inner.removesuffix(']'), ', ')[0], ' | '))}"
    return "a mapping" if inner else _WORDS.get(kind, kind)


def _either(words: Iterable[str]) -> str:
    return " or ".join(dict.fromkeys(words))


def _check_robots(given: Mapping[str, Any]) -> None:
    experiment = given.get("experiment")
    own = experiment.robot.name if experiment is not None else ""
    for name, value in given.items():
        several = value if _is(value, tuple) else (value,)
        found = {getattr(one, "robot", "") for one in several if set(_OF_ROBOTS) & set(_names(one))}
        of = "".join(sorted(found - {"", own})[:1])
        if own and of:
            hint = "Give the experiment of that robot, or read or make them with this one."
            raise InputError(Problem(f"{name}: of another robot", found=of, allowed=own, hint=hint))
