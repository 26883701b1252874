"""The files of a robot: robot.yaml and nominal.yaml."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import degrees, radians
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from qsframework import plausible, units
from qsframework.errors import InputError, Problem, ProblemPlace, nearest
from qsframework.files import Document, FileModel, Unit
from qsframework.files.models import GREATEST
from qsframework.files.plain import is_list, is_mapping
from qsframework.plugin import Effect, Loop, Parameter, RobotFacts
from qsframework.plugin.loops import loop_problems, with_branches
from qsframework.plugin.registry import suggestion
from qsframework.plugin.settings import twice_hint
from qsframework.robot.named_files import entry_effects
from qsframework.robot.urdf import Mimic

PROPOSED = "assumed by qsf new"
"""How the source of a value begins that stands in nominal.yaml until somebody states one."""
_WORDS = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")
"""That YAML does not read as text."""


class JointSpec(FileModel):
    """One joint of `controller:`: limits of what the pendant shows (`limits_mm` where the joint slides), the URDF's
    value in what the pendant shows, the largest static torque of its actuator (`force_limit_N`), how far along its axis
    from its frame its bearing tilts, whether the controller
    counts it among its external axes (E1, ...), turns of the motor per turn of the joint, and counts of its encoder per
    turn of the motor, where the maker states them."""

    limits: Annotated[list[float] | None, Unit("rad")] = None
    travel: Annotated[list[float] | None, Unit("m", "limits")] = None
    equals: str | None = None
    torque_limit: Annotated[float | None, Unit("N m")] = Field(default=None, gt=0)
    force_limit: Annotated[float | None, Unit("N")] = Field(default=None, gt=0)
    bearing: Annotated[float | None, Unit("m")] = None
    external: bool = False
    motor_ratio: float | None = None
    counts_per_turn: float | None = Field(default=None, gt=0)


class RobotSpec(FileModel):
    """robot.yaml. `gravity` is the acceleration in the base frame, for an arm on a wall or ceiling."""

    name: str
    title: str
    urdf: str
    base: str
    flange: str
    controller: dict[str, JointSpec]
    limits_tolerance: Annotated[float, Unit("rad")] = radians(0.01)
    effects: list[dict[str, Any]] = Field(default_factory=list[dict[str, Any]])
    nominal: str | None = None
    payload: Annotated[float | None, Unit("kg")] = Field(default=None, gt=0)
    gravity: Annotated[list[float], Unit("m/s^2")] = Field(default_factory=lambda: [0.0, 0.0, -9.81])


def read_effects(
    document: Document,
    entries: list[dict[str, Any]],
    facts: RobotFacts,
    markers: tuple[str, ...] = (),
    *,
    trust: bool = False,
) -> tuple[tuple[Effect, ...], list[Problem]]:
    """The effects of a list `effects:` in the order of the pipeline, and the problems with file and line.

    trust: whether an entry may name an effect by `file:`, which runs its code
    """
    effects: dict[str, Effect] = {}
    places: dict[str, ProblemPlace] = {}
    problems: list[Problem] = []
    refused: dict[int, list[Problem]] = {}

    def read(i: int) -> None:
        here: ProblemPlace = {"file": str(document.path), "line": document.line("effects", i)}
        try:
            for effect in entry_effects(entries[i], document.path.parent, facts, markers, trust=trust):
                if effect.name in effects:
                    hint = twice_hint(type(effect))
                    problems.append(Problem(f"the effect {effect.name} stands here a second time", **here, hint=hint))
                effects[effect.name], places[effect.name] = effect, here
            refused.pop(i, None)
        except InputError as error:
            refused[i] = [p if p.file else replace(p, **here) for p in error.problems]

    for i in range(len(entries)):
        read(i)
    facts = with_branches(facts, [*effects.values()])
    for i in [*refused]:  # it may hang on a link that a loop of the list brings along
        read(i)
    problems += [p for told in refused.values() for p in told]
    loops = [effect for effect in effects.values() if isinstance(effect, Loop)]
    problems += [replace(p, **places[name]) for name, p in loop_problems(loops, facts).items()]
    return tuple(sorted(effects.values(), key=lambda e: (e.stage, e.order))), problems


def read_nominal(
    document: Document,
    parameters: Mapping[str, Parameter],
    effects: Sequence[Effect],
    facts: RobotFacts,
    complete: bool = True,
) -> tuple[dict[str, Parameter], list[Problem]]:
    """The parameters that the effects declare, with the values of nominal.yaml, and the problems.

    `complete` is False where an effect could not be read: an unknown name is then no problem of this file.
    """
    out = dict(parameters)
    problems: list[Problem] = []
    for name, entry in document.data.items():
        if name in parameters:
            value = _Entry(document, parameters[name])
            out[name] = value.read(entry)
            problems += value.problems
        elif complete:
            message, hint = f"no effect has the parameter {name!r}", suggestion(name, parameters)
            problems.append(document.problem(message, name, allowed=", ".join(parameters), hint=hint))
    for effect in effects if not problems else ():
        own = [out[p.name] for p in effect.parameters(facts)]
        stated = [p.name for p in own if p.name in document.data]
        if not stated:
            continue
        try:
            if effect.whole and len(stated) < len(own):
                raise InputError(_incomplete(effect, own, stated))
            effect.validate_values(np.array([p.nominal for p in own]), facts)
        except InputError as error:
            here: ProblemPlace = {"file": str(document.path), "line": document.line(stated[0])}
            problems += [replace(p, **here) for p in error.problems]
    return out, problems


def _incomplete(effect: Effect, own: Sequence[Parameter], stated: Sequence[str]) -> Problem:
    """That a file states some values of an effect whose values belong together, and not the others."""
    missing = [p.name for p in own if p.name not in stated]
    return Problem(
        f"{effect.name}: a value is missing for {', '.join(missing)}",
        found=f"{len(stated)} values",
        allowed=f"{len(own)}, as the effect's settings say",
        hint="All values of this effect belong together; take the file that was written with it.",
    )


def nominal_entry(p: Parameter, value: float, sd: float | None, source: str) -> dict[str, Any]:
    """A parameter's entry as a nominal file holds it: with this value, sd and source, and its own earlier values."""
    suffix = f"_{p.unit}" if p.unit else ""
    out: dict[str, Any] = {f"value{suffix}": float(value)}
    out |= {f"sd{suffix}": float(sd)} if sd else {}
    out |= {"source": source} if source else {}
    earlier = ((None if before is None else float(before), used) for before, used in p.earlier)
    stages = [{f"value{suffix}": before, "readings": list(used)} for before, used in earlier]
    return out | ({"earlier": stages} if stages else {})


@dataclass
class _Entry:
    """One parameter's entry: `value_<unit>`, `sd_<unit>` or `sd_percent`, `source`; where identified, `earlier`."""

    document: Document
    parameter: Parameter
    problems: list[Problem] = field(default_factory=list[Problem])

    def read(self, entry: Any) -> Parameter:
        """The parameter with the entry's values; unchanged where there is a problem."""
        if not is_mapping(entry):
            self.problem("must be a mapping with its value", found=repr(entry))
            return self.parameter
        found: dict[str, Any] = {}
        for key, value in entry.items():
            self._key(key, value, found)
        if "value" not in found and not self.problems:
            self.problem(
                f"needs its value, such as value_{self.parameter.unit}" if self.parameter.unit else "needs its value"
            )
        if self.problems:
            return self.parameter
        sd = abs(found["value"]) * found["percent"] if "percent" in found else found.get("sd")
        self._bounds(found["value"], sd)
        if self.problems:
            return self.parameter
        source, earlier = found.get("source", self.parameter.source), found.get("earlier", ())
        return replace(self.parameter, nominal=found["value"], sd=sd, source=source, earlier=earlier)

    def _key(self, key: str, value: Any, found: dict[str, Any]) -> None:
        if key == "source":
            found["source"] = str(value)
            return
        unit = self.parameter.unit
        if key == "earlier":
            found["earlier"] = tuple(self._stages(value, f"value_{unit}" if unit else "value"))
            return
        stem, suffix = units.split(key, ("value", "sd")) or ((key, "") if key in ("value", "sd") else ("", ""))
        name = "percent" if (stem, suffix) == ("sd", "percent") else stem
        allowed = f"value_{unit}, sd_{unit}, sd_percent, " if unit else "value, sd, sd_percent, "
        allowed += "source, earlier"
        if not stem:
            self.problem("unknown key", key, found=repr(key), allowed=allowed, hint=nearest(key, allowed.split(", ")))
        elif not suffix and unit:
            self.problem(f"{key!r} does not say its unit", key, allowed=allowed)
        elif name != "percent" and not (units.known(suffix) and units.same_dimension(suffix, unit)):
            self.problem(f"{key!r} does not end in a unit of {unit or 'a ratio'}", key, allowed=allowed)
        elif isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= GREATEST:
            self.problem(f"{key} must be a finite number", key, found=repr(value))
        elif name in found or {name, *found} >= {"sd", "percent"}:
            self.problem(f"{stem} is given twice", key)
        else:
            scale = {"percent": 0.01, "sd": units.conversion(suffix)[0]}
            found[name] = value * scale[name] if name in scale else units.to_si(float(value), suffix)
            if name == "value" and (far := plausible.beyond(found[name], unit)) is not None:
                allowed = plausible.allowed(far, unit, suffix)
                self.problem(f"{key} is no {far.quantity}", key, found=repr(value), allowed=allowed)

    def _stages(self, stages: Any, key: str) -> Iterator[tuple[float | None, tuple[str, ...]]]:
        """Values that stood there before readings were used, null for none, each with the hashes of these readings."""
        for stage in stages if is_list(stages) else [stages]:
            value, used = (stage.get(key, ""), stage.get("readings")) if is_mapping(stage) else ("", None)
            number = value is None or (isinstance(value, int | float) and not isinstance(value, bool))
            if not number or not is_list(used) or len(stage) != 2:
                words = f"earlier is a list of {key} and readings: the values before, and the hashes of what came after"
                self.problem(words, "earlier", found=repr(stage)[:80])
                return
            yield None if value is None else float(value), tuple(str(one) for one in used)

    def _bounds(self, value: float, sd: float | None) -> None:
        p = self.parameter
        if not p.lower <= value <= p.upper:
            self.problem(
                "the value is outside its bounds", found=f"{value:g}", allowed=f"{p.lower:g} to {p.upper:g} {p.unit}"
            )
        if sd is not None and not sd > 0:
            hint = "A share of zero is zero: give sd with a unit." if value == 0 else None
            self.problem("the sd must be positive", found=f"{sd:g}", hint=hint)

    def problem(self, message: str, *keys: str, **more: Any) -> None:
        text = f"{self.parameter.name}: {message}"
        self.problems.append(self.document.problem(text, self.parameter.name, *keys, **more))


def coupling_text(joint: str, mimic: Mimic) -> str:
    """The entry of `effects:` for a URDF's mimic."""
    offset = f", offset_deg: {degrees(mimic.offset):.10g}" if mimic.offset else ""
    follows = f"{{{yaml_key(mimic.joint)}: {mimic.multiplier:.10g}}}"
    return f"{{effect: coupling, joint: {yaml_key(joint)}, follows: {follows}{offset}}}"


def yaml_key(name: str) -> str:
    """A name as YAML reads it back: plain where it can be."""
    return name if re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII) and name.lower() not in _WORDS else json.dumps(name)
