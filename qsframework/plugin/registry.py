"""Finding effects by name: built-ins and third parties both, by the entry points `qsframework.effects`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.metadata import entry_points
from types import MappingProxyType

from qsframework.errors import InputError, PluginError, Problem, nearest
from qsframework.plugin.kinds import Effect

GROUP = "qsframework.effects"


@cache
def registry() -> Mapping[str, type[Effect]]:
    """All installed effects by name. Raises PluginError if two packages claim one name."""
    found: dict[str, type[Effect]] = {}
    for name, effect in _load():
        if name in found and found[name] is not effect:
            raise PluginError(f"effect {name!r} is registered twice: {found[name].__module__} and {effect.__module__}")
        found[name] = effect
    return MappingProxyType(dict(sorted(found.items())))


def _load() -> Iterator[tuple[str, type[Effect]]]:
    for entry in entry_points(group=GROUP):
        try:
            effect = entry.load()
        except Exception as error:  # a third party's module may fail in any way
            raise PluginError(f"effect {entry.name!r} ({entry.value}) cannot be imported: {error}") from error
        if not (isinstance(effect, type) and issubclass(effect, Effect)):
            raise PluginError(f"effect {entry.name!r} ({entry.value}) is not a subclass of an effect kind")
        if effect.effect_name() != entry.name:
            raise PluginError(
                f"effect {entry.name!r} ({entry.value}) calls itself {effect.effect_name()!r}; "
                "the entry point's name and the class must agree"
            )
        yield entry.name, effect


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
