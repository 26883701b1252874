"""Effects from files: Python code that a robot or an experiment names by `file:`, run only where the user says so.

Without trust nothing of the file is run or imported. With it the file runs once, as the user, and its class works as
an installed effect does. Trust is given for one call (`load_experiment(path, trust=True)`) or one command.
"""

from __future__ import annotations

import dataclasses
import hashlib
import sys
import traceback
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from qsframework.errors import InputError, Problem
from qsframework.files import read_text
from qsframework.plugin.kinds import Effect
from qsframework.plugin.registry import registry

_LARGEST = 1_000_000
_ORIGIN = "_qsf_origin"
"""Attribute of a class from a file: the file and its text."""
_trusting = False
_loaded: dict[tuple[str, str], dict[str, type[Effect]]] = {}


@contextmanager
def trusting() -> Generator[None, None, None]:
    """For the time of the context, effects from files are run where a call does not say otherwise."""
    global _trusting
    before, _trusting = _trusting, True
    try:
        yield
    finally:
        _trusting = before


def trusted(trust: bool | None) -> bool:
    """Whether effects from files may run: what the call says, else what `trusting` says; by default they may not."""
    return _trusting if trust is None else trust


def refusal(file: str) -> Problem:
    """What to tell a user who has not said that files are trusted."""
    return Problem(
        f"{file!r} is Python code that would run as you, with access to all your files; nothing of it was run",
        hint="Read it. If you trust it, say so: trust=True to load_robot or load_experiment.",
        argument=("trust", ""),
    )


def effect_of_file(path: Path, name: str | None = None) -> type[Effect]:
    """Run a file and take its effect: the one of this name, or its only one. The caller has checked the trust."""
    return _choose(path, _effects(path, read_text(path, _LARGEST)), name)


def file_of(effect: type[Effect]) -> Path | None:
    """The file that an effect comes from; None for an installed one."""
    origin = effect.__dict__.get(_ORIGIN)
    return None if origin is None else Path(origin[0])


def _choose(path: Path, found: dict[str, type[Effect]], name: str | None) -> type[Effect]:
    if not found:
        hint = "A class of the file derives from Spring, Load or another kind of qsframework.plugin."
        raise InputError(Problem("holds no effect", file=str(path), hint=hint))
    if name is None and len(found) > 1:
        raise InputError(Problem("holds several effects; say which by `effect:`", str(path), allowed=", ".join(found)))
    if name is not None and name not in found:
        raise InputError(Problem(f"holds no effect {name!r}", file=str(path), allowed=", ".join(found)))
    chosen = next(iter(found)) if name is None else name
    if chosen in registry():
        raise InputError(Problem(f"the effect {chosen!r} has the name of an installed one", file=str(path)))
    return found[chosen]


def _effects(path: Path, text: str) -> dict[str, type[Effect]]:
    """The effects of a file by name, from its text; the same classes for the same text."""
    key = (str(path.resolve()), text)
    if key not in _loaded:
        module = _run(path, text)
        own = [v for v in vars(module).values() if isinstance(v, type) and v.__module__ == module.__name__]
        effects = {v.effect_name(): v for v in own if issubclass(v, Effect) and not v.__abstractmethods__}
        plain = [n for n, v in effects.items() if not dataclasses.is_dataclass(v)]
        if plain:
            raise InputError(Problem(f"the effect {plain[0]!r} is no @dataclass(frozen=True)", file=str(path)))
        for effect in effects.values():
            setattr(effect, _ORIGIN, key)
            effect.__reduce__ = _reduced  # pyright: ignore[reportAttributeAccessIssue]
        _loaded[key] = effects
    return _loaded[key]


def _run(path: Path, text: str) -> ModuleType:
    """The file's module; it is in `sys.modules` only while it runs, so that no import finds it."""
    module = ModuleType(f"qsf_file_{path.stem}_{hashlib.sha256(text.encode()).hexdigest()[:12]}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module
    try:
        exec(compile(text, str(path), "exec"), module.__dict__)
    except (Exception, SystemExit) as error:
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        line = error.lineno if isinstance(error, SyntaxError) else frames[-1].lineno if frames else None
        message = f"cannot be run: {type(error).__name__}: {error}"
        raise InputError(Problem(message, file=str(path), line=line)) from error
    finally:
        del sys.modules[module.__name__]
    return module


def _reduced(effect: Any) -> tuple[Any, ...]:
    """An instance for a pickle: another process, which cannot import its class, makes it from the same text."""
    values = {f.name: getattr(effect, f.name) for f in dataclasses.fields(effect)}
    origin: tuple[str, str] = getattr(effect.__class__, _ORIGIN)
    return _rebuilt, (*origin, effect.effect_name(), values)


def _rebuilt(path: str, text: str, name: str, values: dict[str, Any]) -> Effect:
    effect: Any = _effects(Path(path), text)[name]
    return effect(**values)
