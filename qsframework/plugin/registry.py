"""Finding effects by name, built-ins and third parties both."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import EntryPoint
from types import MappingProxyType

from qsframework.errors import InputError, PluginError, Problem, nearest
from qsframework.installed import EFFECTS, entries, label, load
from qsframework.plugin.kinds import Effect


@cache
def registry() -> Mapping[str, type[Effect]]:
    """All installed effects by name. Raises PluginError if two packages claim one name, or one is no effect."""
    return MappingProxyType({name: _effect(entry) for name, entry in entries(EFFECTS).items()})


def _effect(entry: EntryPoint) -> type[Effect]:
    effect = load(entry)
    if not (isinstance(effect, type) and issubclass(effect, Effect)):
        raise PluginError(f"{label(entry)} is not a subclass of an effect kind")
    if effect.effect_name() != entry.name:
        words = f"{label(entry)} calls itself {effect.effect_name()!r}"
        raise PluginError(f"{words}; the entry point's name and the class must agree")
    return effect


def with_role(role: str) -> tuple[type[Effect], ...]:
    """The installed effects that are this to an arm."""
    return tuple(effect for effect in registry().values() if effect.role == role)


def find(name: str) -> type[Effect]:
    """The effect of a name; an InputError offers the nearest."""
    effects = registry()
    if name not in effects:
        near = suggestion(name, effects)
        words = f"unknown effect {name!r}" + (f" ({near})" if near else "")
        raise InputError(Problem(words, allowed=", ".join(effects)))
    return effects[name]


def suggestion(name: str, known: Iterable[str]) -> str | None:
    """What to write for an unknown effect or parameter: what replaced it, else the nearest name that is known."""
    return replaced(name) or nearest(name, known)


def replaced(name: str) -> str | None:
    """What to write for an effect or parameter of an old file; None where it has not been replaced."""
    old = re.split(r"[\[.]", name)[0]
    for effect in registry().values():
        was, frame = effect.replaces
        if old and old == was:
            return f"Use {effect.effect_name()}: it is stated in {frame}, {was} was in that of the moving link"
    return None
