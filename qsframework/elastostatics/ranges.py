"""Predictions beyond what a law was learned from: it stays constant there, and that has to be said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.elastostatics.evaluation import evaluate_stages
from qsframework.elastostatics.structure import Structure, chunks
from qsframework.errors import some_of
from qsframework.plugin import Array, Context, Effect, Poses, Range, SpringLaw

_SLACK = 0.01
"""Share of a range by which a value may lie outside: the equilibrium moves torques a little."""
_SHOWN = 3
_SHOWN_IN = {"rad": ("deg", 180.0 / np.pi, 0.0), "K": ("degC", 1.0, -273.15), "m": ("mm", 1e3, 0.0)}
"""How people say a unit: its name, factor and shift."""


@dataclass(frozen=True, kw_only=True)
class Beyond:
    """An effect at poses beyond what its law was learned from.

    label, unit: of what it depends on, SI; low, high: as it was seen; value: the farthest, at pose `worst`;
    poses: all that are outside, by number
    """

    effect: str
    label: str
    unit: str
    low: float
    high: float
    value: float
    worst: int
    poses: tuple[int, ...]


def beyond(model: Structure, poses: Poses, x: Array | None = None) -> tuple[Beyond, ...]:
    """What the laws of a model are asked at poses (N,) beyond where they hold, in either state of a pose."""
    if not any(type(e).ranges is not Effect.ranges for e in model.effects):
        return ()
    values = model.nominal if x is None else x
    found: dict[tuple[str, str, bool], tuple[Range, list[Array]]] = {}
    for _, part in chunks(poses):
        for loaded in (True, False):
            for name, seen in _ranges(model, part, values, loaded):
                found.setdefault((name, seen.label, loaded), (seen, []))[1].append(seen.values)
    both: dict[tuple[str, str], Beyond] = {}
    for (name, label, _), (seen, parts) in found.items():
        one = _outside(name, seen, np.concatenate(parts))
        if one is not None:
            both[name, label] = _farther(one, both.get((name, label), one))
    return tuple(both.values())


def _ranges(model: Structure, poses: Poses, x: Array, loaded: bool) -> list[tuple[str, Range]]:
    """Every range of every effect, by the effect's name, in one state."""
    stages = evaluate_stages(model, poses, x, preload=True, loaded=loaded)
    assert stages.preload is not None
    torque = stages.preload + stages.tau if loaded else stages.preload
    rows = dict(zip((e.name for e in model.effects if isinstance(e, SpringLaw)), model.law_rows, strict=True))
    context = Context(model.facts, poses, loaded)
    out: list[tuple[str, Range]] = []
    for effect in model.effects:
        at = torque[list(rows.get(effect.name, ()))].T
        out += [(effect.name, r) for r in effect.ranges(at, context)]
    return out


def _outside(name: str, seen: Range, values: Array) -> Beyond | None:
    """The poses that lie outside by more than the slack."""
    far = np.maximum(seen.low - values, values - seen.high)
    out = np.flatnonzero(far > _SLACK * (seen.high - seen.low))
    if not len(out):
        return None
    worst = int(np.argmax(far))
    return Beyond(
        effect=name,
        label=seen.label,
        unit=seen.unit,
        low=seen.low,
        high=seen.high,
        value=float(values[worst]),
        worst=worst,
        poses=tuple(map(int, out)),
    )


def _farther(one: Beyond, other: Beyond) -> Beyond:
    """The farther of two states, with the poses of both."""
    far = max(one, other, key=lambda b: max(b.low - b.value, b.value - b.high))
    poses = tuple(sorted({*one.poses, *other.poses}))
    return replace(far, poses=poses)


def range_notes(model: Structure, poses: Poses, names: Sequence[str], x: Array | None = None) -> tuple[str, ...]:
    """A sentence for each law that is asked beyond where it holds; names (N,): of the poses."""
    return tuple(_note(b, names) for b in beyond(model, poses, x))


def _note(b: Beyond, names: Sequence[str]) -> str:
    unit, factor, shift = _SHOWN_IN.get(b.unit, (b.unit, 1.0, 0.0))
    low, high, value = (f"{factor * v + shift:.4g}" for v in (b.low, b.high, b.value))
    others = list(dict.fromkeys(names[i] for i in b.poses if names[i] != names[b.worst]))
    also = f" (outside also at {some_of(others, _SHOWN)})" if others else ""
    spaced = f" {unit}" if unit else ""
    return (
        f"{b.effect} was learned between {low} and {high}{spaced} of {b.label} and is held constant beyond: "
        f"{value}{spaced} at {names[b.worst]}{also}; expect larger errors there than said"
    )
