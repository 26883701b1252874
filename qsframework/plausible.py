"""What a quantity of a robot cell can be: a number beyond it is a slip of a unit, a digit or a column.

One table, asked by every reader of files and options. The limits are wide: what is unusual passes, what cannot be does
not. Each says what it rests on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from qsframework import units


@dataclass(frozen=True)
class PlausibleRange:
    """Sizes of one kind of quantity, SI: 0, or `least` to `most`, of either sign."""

    quantity: str
    most: float
    source: str
    least: float = 0.0


_TURNS = 100 * 2.0 * math.pi
RANGES: dict[str, PlausibleRange] = {
    "m": PlausibleRange("length", 100.0, "laser trackers measure to 80 m; gantries and tracks are shorter"),
    "rad": PlausibleRange("angle", _TURNS, "100 turns; external axes and sixth joints turn fewer between two zeros"),
    "kg": PlausibleRange("mass", 50e3, "the heaviest arm on the market weighs 13 t and lifts 2.3 t"),
    "N": PlausibleRange("force", 1e6, "ten times the weight of the heaviest arm"),
    "N m": PlausibleRange("moment", 1e7, "a force of 1 MN at 10 m"),
    "rad/(N m)": PlausibleRange("compliance", 1.0, "an arm that turns by 1 rad under 1 N m holds nothing", 1e-20),
    "m/N": PlausibleRange("compliance", 1.0, "an arm that gives 1 m under 1 N holds nothing", 1e-20),
    "N/m": PlausibleRange("stiffness", 1e13, "steel of 1 m by 1 m, 20 mm thick", 1e-6),
    "m/s^2": PlausibleRange("acceleration", 15.0, "gravity on Earth is 9.76 to 9.84; tables turn, they do not leave"),
    "Pa": PlausibleRange("pressure", 1e9, "gas balancers hold below 20 MPa"),
    "m^2": PlausibleRange("area", 1e3, "of a piston"),
    "m^3": PlausibleRange("volume", 1e3, "of gas in a balancer"),
    "K": PlausibleRange("temperature", 1e3, "of a cell, 200 to 400"),
    "s": PlausibleRange("time", 1e11, "3,000 years after any clock's zero"),
    "kg m^2": PlausibleRange("inertia", 1e7, "13 t at 25 m"),
}
"""By SI unit; quantities of other units are bounded by `files.models.GREATEST` alone."""
LOADS = 20.0
"""Weights of the payload beyond which a force is a slip: arms are tested at up to twice the payload, and newtons for
kilonewtons are a thousandfold."""


ARM = 0.3
"""Metres from the wrist at which data sheets state a payload's centre: 0.2 to 0.5 of heavy arms."""
TOOL = 10.0
"""Metres from the flange beyond which a load's point is a slip: no tool is as long as the longest arm reaches."""


def beyond(value: float, si: str) -> PlausibleRange | None:
    """The range that a value, SI, lies outside of; None where it may be, and for what is no number."""
    known = RANGES.get(si)
    return None if known is None else outside(value, known)


def outside(value: float, known: PlausibleRange) -> PlausibleRange | None:
    """The range, where a value lies outside of it."""
    return None if value == 0.0 or math.isnan(value) or known.least <= abs(value) <= known.most else known


def allowed(known: PlausibleRange, si: str, unit: str = "") -> str:
    """The range as an error tells it, in a unit of its dimension."""
    factor = units.conversion(unit)[0] if unit else 1.0
    shown = unit or si
    low = f"0, {known.least / factor:.3g} to " if known.least else "up to "
    return f"{low}{known.most / factor:.6g} {shown} ({known.source})"


class StrongLoad(NamedTuple):
    """A force or moment that no test of an arm applies: its size and the limit, in words."""

    quantity: str
    found: str
    allowed: str


def too_strong(wrench: Sequence[float], payload: float | None, gravity: float) -> StrongLoad | None:
    """Of a force and moment (3,) or (6,) N, N m what no test of an arm applies; None where it may be.

    payload: kg, None where nobody states one
    """
    weight = LOADS * (payload or math.inf) * (gravity or 9.81)
    parts = (("force", wrench[:3], weight, "N", ""), ("moment", wrench[3:], ARM * weight, "N m", f" at {ARM:g} m"))
    for quantity, values, most, unit, arm in parts:
        size = math.sqrt(sum(value * value for value in values))
        if size > most:
            allowed = f"up to {most:.0f} {unit}, {LOADS:g} times the payload{arm}"
            return StrongLoad(quantity, f"{size:.0f} {unit}", allowed)
    return None
