"""What is installed under the entry points of a group: effects, readers, languages and commands, ours and others'."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from types import MappingProxyType
from typing import Any

from qsframework.errors import PluginError

EFFECTS = "qsframework.effects"
READERS = "qsframework.readers"
LANGUAGES = "qsframework.languages"
COMMANDS = "qsframework.commands"


@cache
def entries(group: str) -> Mapping[str, EntryPoint]:
    """The entry points of a group by name, less those of packages that are gone. Raises PluginError if two packages
    claim one name."""
    return MappingProxyType({name: entry for name, entry in _stated(group).items() if _found(entry)})


def lacking(group: str) -> Mapping[str, str]:
    """The names in a group whose package is gone, each with its package."""
    return {name: _package(entry) for name, entry in _stated(group).items() if not _found(entry)}


def load(entry: EntryPoint) -> Any:
    """What an entry point names. Raises PluginError, with the file and the line where the import fails."""
    try:
        return entry.load()
    except Exception as error:  # a third party's module may fail in any way
        raise PluginError(f"{label(entry)} cannot be imported{_place(error)}: {error}") from error


def label(entry: EntryPoint) -> str:
    """How messages name what an entry point stands for."""
    return f"{_kind(entry.group)} {entry.name!r} ({entry.value})"


def _stated(group: str) -> Mapping[str, EntryPoint]:
    """What the metadata of installed distributions state."""
    stated: dict[str, EntryPoint] = {}
    for entry in sorted(entry_points(group=group), key=lambda entry: entry.name):
        if (other := stated.setdefault(entry.name, entry).value) != entry.value:
            words = f"{_kind(group)} {entry.name!r} is registered twice: {other} and {entry.value}"
            raise PluginError(f"{words}; uninstall one of the two packages")
    return stated


def _package(entry: EntryPoint) -> str:
    return entry.module.partition(".")[0]


def _found(entry: EntryPoint) -> bool:
    return find_spec(_package(entry)) is not None


def _kind(group: str) -> str:
    return group.rpartition(".")[2].removesuffix("s")


def _place(error: Exception) -> str:
    """File and line from which an error comes; nothing where the module itself was not found."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if "importlib" not in f.filename]
    return f" ({frames[-1].filename}, line {frames[-1].lineno})" if len(frames) > 1 else ""
