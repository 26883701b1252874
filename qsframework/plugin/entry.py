"""From an effect's instance to the spec entry that builds it: the inverse of `build_effects`."""

from __future__ import annotations

import dataclasses
from typing import Any, cast

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.plugin.kinds import Effect

_SPELLED = {"N m": "Nm"}


def effect_entry(effect: Effect) -> dict[str, Any]:
    """The entry of `effects:` for one instance, its measured settings in SI; settings at their default left out."""
    entry: dict[str, Any] = {"effect": effect.effect_name()}
    for f in dataclasses.fields(cast("Any", effect)):
        value = getattr(effect, f.name)
        if value == f.default:
            continue
        unit = f.metadata.get("unit", "")
        key = f"{f.name}_{_SPELLED.get(unit, unit)}" if unit else f.name
        entry[key] = _plain(effect, f.name, value)
    return entry


def _plain(effect: Effect, name: str, value: Any) -> Any:
    """A value that a file can hold; numbers keep all digits."""
    number = value
    if isinstance(value, np.bool_ | np.integer | np.floating):
        return number.item()
    if isinstance(value, bool | str | int | float):
        return value
    if isinstance(value, tuple):
        return [_plain(effect, name, v) for v in cast("tuple[Any, ...]", value)]
    raise InputError(
        Problem(
            f"{effect.name}: {name} cannot be written to a file",
            found=repr(value)[:80],
            hint="List the effect in robot.yaml or experiment.yaml, whose own entry is kept.",
        )
    )
