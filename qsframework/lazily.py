"""Packages whose names are loaded when they are asked for: a command pays for the modules that it uses."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from types import ModuleType
from typing import Any


def lazily(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """The `__getattr__` of a package. homes: its modules, and the names of each, with spaces between them.

    A name that a module of the package has too stays the name, whatever has been imported.
    """
    home = {name: module for module, names in homes.items() for name in names.split()}

    def get(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{home[name]}"), name)

    def held(name: str) -> property:
        return property(lambda _: get(name), lambda _, __: None)

    both = {name: held(name) for name in home if name in homes}
    if both:
        sys.modules[package].__class__ = type("Package", (ModuleType,), both)
    return get
