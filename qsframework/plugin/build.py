"""From a spec entry `{effect: ..., joints: all, lc_m: ...}` to effect instances."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

from qsframework import plausible, units
from qsframework.errors import InputError, Problem, nearest
from qsframework.files.plain import is_list
from qsframework.plugin.facts import RobotFacts
from qsframework.plugin.kinds import Effect
from qsframework.plugin.registry import find
from qsframework.plugin.settings import AXES, DIRECTIONS, place_fields, plural


def build_effects(
    entry: Mapping[str, Any], robot: RobotFacts, markers: Sequence[str] = (), effect: type[Effect] | None = None
) -> tuple[Effect, ...]:
    """The instances that one entry of `effects:` asks for. InputError with every problem found.

    effect: the class where it is known already; else it is the installed one that the entry names
    """
    if effect is None:
        if not isinstance(entry.get("effect"), str):
            raise InputError(Problem("an entry of effects needs the key 'effect' with the effect's name"))
        effect = find(entry["effect"])
    problems: list[Problem] = []
    everywhere = {
        "joint": robot.driven,
        "axis": AXES,
        "direction": DIRECTIONS,
        "link": robot.links,
        "marker": tuple(markers),
    }
    chosen: dict[str, Sequence[Any]] = {}
    for key, value in entry.items():
        if key != "effect":
            _read_key(effect, key, value, everywhere, chosen, problems)
    missing = [f for f in _fields(effect).values() if f.name not in chosen and f.default is dataclasses.MISSING]
    for f in missing if not problems else ():
        problems.append(Problem(f"effect {effect.effect_name()} needs {_spelling(f)}"))
    if problems:
        raise InputError(problems)
    instances = tuple(
        effect(**dict(zip(chosen, values, strict=True))) for values in itertools.product(*chosen.values())
    )
    for instance in instances:
        instance.require_fit(robot)
    return instances


def _fields(effect: type[Effect]) -> dict[str, dataclasses.Field[Any]]:
    """The configuration of an effect, which is a dataclass."""
    return {f.name: f for f in dataclasses.fields(cast("Any", effect))}


def _spelling(f: dataclasses.Field[Any]) -> str:
    if f.metadata.get("place"):
        return f"{f.name} (or {plural(f.name)})"
    unit = f.metadata.get("unit", "")
    return units.allowed_names(f.name, unit) if unit else f.name


def _read_key(
    effect: type[Effect],
    key: str,
    value: Any,
    everywhere: Mapping[str, Sequence[str]],
    chosen: dict[str, Sequence[Any]],
    problems: list[Problem],
) -> None:
    fields = _fields(effect)
    for place in place_fields(effect):
        if key == plural(place):
            chosen[place] = _places(place, value, everywhere, problems)
            return
    if key in fields and not fields[key].metadata.get("unit"):
        chosen[key] = [_plain(effect, fields[key], value, problems)]
        return
    measured = [name for name, f in fields.items() if f.metadata.get("unit")]
    parts = units.split(key, measured)
    if parts is None:
        allowed = [_spelling(f) for f in fields.values()]
        hint = nearest(key, [a for name in allowed for a in name.split(", ")])
        unit_is_missing = "the unit is missing" if key in measured else "unknown key"
        problems.append(
            Problem(
                f"effect {effect.effect_name()}: {unit_is_missing}",
                found=repr(key),
                allowed="; ".join(allowed) or "no keys",
                hint=hint,
            )
        )
        return
    name, unit = parts
    chosen[name] = [_quantity(effect, key, unit, fields[name], value, problems)]


def _places(place: str, value: Any, everywhere: Mapping[str, Sequence[str]], problems: list[Problem]) -> Sequence[Any]:
    if value == "all":
        return list(everywhere.get(place, ()))
    if is_list(value) and value and all(isinstance(v, str) for v in value):
        return value
    problems.append(Problem(f"{plural(place)} must be 'all' or a list of names", found=repr(value)))
    return []


def _plain(effect: type[Effect], f: dataclasses.Field[Any], value: Any, problems: list[Problem]) -> Any:
    numeric = f.type in ("float", float)
    if numeric and (isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value)):
        problems.append(Problem(f"effect {effect.effect_name()}: {f.name} must be a number", found=repr(value)))
    elif f.name == "axis" and value not in AXES:
        problems.append(Problem(f"effect {effect.effect_name()}: unknown axis", found=repr(value), allowed="x, y, z"))
    elif f.type in ("str", str) and not isinstance(value, str):
        problems.append(Problem(f"effect {effect.effect_name()}: {f.name} must be a name", found=repr(value)))
    return value


def _quantity(
    effect: type[Effect], key: str, unit: str, f: dataclasses.Field[Any], value: Any, problems: list[Problem]
) -> float:
    where, si, span = f"effect {effect.effect_name()}", f.metadata["unit"], f.metadata["span"]
    stem = key[: -len(unit) - 1]
    if not units.known(unit) or not units.same_dimension(unit, si):
        problems.append(
            Problem(f"{where}: {key!r} does not end in a unit of {si}", allowed=units.allowed_names(stem, si))
        )
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        problems.append(Problem(f"{where}: {key} must be a finite number", found=repr(value)))
        return math.nan
    converted = float(units.to_si(float(value), unit))
    own = plausible.PlausibleRange(f"{stem} of an arm", span[1], effect.effect_name(), span[0])
    if (far := plausible.outside(converted, own) or plausible.beyond(converted, si)) is not None:
        allowed = plausible.allowed(far, si, unit)
        hint = "Look at the unit and the digits."
        problems.append(Problem(f"{where}: {key} is no {far.quantity}", found=repr(value), allowed=allowed, hint=hint))
    return converted
