"""Packages whose names are loaded when they are asked for: a command pays for the modules that it uses."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from types import ModuleType
from typing import Any


def lazily(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """The `__getattr__` of a package.

    homes: its modules, and the names of each, with spaces between them; `name=own` where the module says it otherwise.
    A name that a module of the package has too stays the name, whatever has been imported.
    """
    words = [(*word.partition("="), module) for module, said in homes.items() for word in said.split()]
    home = {name: (module, own or name) for name, _, own, module in words}

    def get(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, own = home[name]
        return getattr(import_module(f"{package}.{module}"), own)

    def kept(name: str) -> property:
        def put(holder: ModuleType, value: Any) -> None:
            if not isinstance(value, ModuleType):  # what the import of that module sets
                holder.__dict__[name] = value

        return property(lambda holder: holder.__dict__[name] if name in holder.__dict__ else get(name), put)

    both = home.keys() & {module.partition(".")[0] for module in homes}
    if both:
        sys.modules[package].__class__ = type("Package", (ModuleType,), {name: kept(name) for name in both})
    return get
