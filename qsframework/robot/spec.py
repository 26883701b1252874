"""The files of a robot: robot.yaml and nominal.yaml."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from qsframework import units
from qsframework.errors import InputError, Problem, nearest
from qsframework.files import Document, FileModel, Quantity
from qsframework.plugin import Effect, Parameter, RobotFacts, build_effects


class JointSpec(FileModel):
    """One joint of `controller:`: limits of what the pendant shows, and the URDF angle in pendant angles."""

    limits: Quantity("rad", list[float])
    equals: str | None = None


class RobotSpec(FileModel):
    """robot.yaml."""

    name: str
    title: str
    urdf: str
    base: str
    flange: str
    controller: dict[str, JointSpec]
    limits_tolerance: Quantity("rad") = 1.7453292519943296e-4
    effects: list[dict[str, Any]] = []
    nominal: str | None = None


def read_effects(
    document: Document, entries: list[dict[str, Any]], facts: RobotFacts, markers: tuple[str, ...] = ()
) -> tuple[tuple[Effect, ...], list[Problem]]:
    """The effects of a list `effects:` and the problems in it, with file and line."""
    effects: list[Effect] = []
    problems: list[Problem] = []
    for i, entry in enumerate(entries):
        try:
            effects.extend(build_effects(entry, facts, markers))
        except InputError as error:
            here = document.line("effects", i)
            problems += [replace(p, file=str(document.path), line=here) for p in error.problems]
    return tuple(effects), problems


def read_nominal(document: Document, parameters: Mapping[str, Parameter]) -> tuple[dict[str, Parameter], list[Problem]]:
    """Put the values of nominal.yaml into the parameters that the effects declare."""
    out: dict[str, Parameter] = {}
    problems: list[Problem] = []
    for name, entry in document.data.items():
        if name not in parameters:
            problems.append(
                Problem(f"no effect has the parameter {name!r}", str(document.path), document.line(name),
                        allowed=", ".join(parameters), hint=nearest(name, parameters))
            )  # fmt: skip
            continue
        try:
            out[name] = _nominal(document, parameters[name], entry)
        except InputError as error:
            problems += error.problems
    return out, problems


def _nominal(document: Document, parameter: Parameter, entry: Any) -> Parameter:
    path, line = str(document.path), document.line(parameter.name)
    if not isinstance(entry, dict):
        raise InputError(Problem(f"{parameter.name} must be a mapping with a value", path, line, found=repr(entry)))
    found: dict[str, Any] = {}
    problems: list[Problem] = []
    for key, value in entry.items():
        if key == "source" and isinstance(value, str):
            found["source"] = value
            continue
        parts = units.split(key, ("value", "sd")) or (("value", "") if key == "value" and not parameter.unit else None)
        allowed = f"value_<unit>, sd_<unit>, sd_percent, source; the unit measures {parameter.unit or 'a ratio'}"
        number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf")
        where = document.line(parameter.name, key)
        if parts is None or not number:
            problems.append(Problem(f"{parameter.name}: cannot read {key!r}", path, where, found=repr(value), allowed=allowed))
        elif parts == ("sd", "percent"):
            found["percent"] = value / 100.0
        elif not units.known(parts[1]) or not units.same_dimension(parts[1], parameter.unit):
            problems.append(Problem(f"{parameter.name}: {key!r} has a wrong unit", path, where, allowed=allowed))
        else:
            found["nominal" if parts[0] == "value" else "sd"] = units.conversion(parts[1])[0] * value
    if "nominal" not in found and not problems:
        problems.append(Problem(f"{parameter.name} needs its value_<unit>", path, line))
    nominal = found.get("nominal", parameter.nominal)
    if not problems and not parameter.lower <= nominal <= parameter.upper:
        limits = f"{parameter.lower:g} to {parameter.upper:g} {parameter.unit}"
        problems.append(Problem(f"{parameter.name}: the value is outside its bounds", path, line, found=f"{nominal:g}", allowed=limits))
    sd = found.get("sd", abs(nominal) * found["percent"] if "percent" in found else None)
    if not problems and sd is not None and not sd > 0:
        problems.append(Problem(f"{parameter.name}: the sd must be positive", path, line, found=f"{sd:g}"))
    if problems:
        raise InputError(problems)
    return replace(parameter, nominal=nominal, sd=sd, source=found.get("source", parameter.source))
