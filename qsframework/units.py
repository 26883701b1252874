"""Units at the border: a name in a file ends in its unit, everything inside is SI.

`lever_m`, `limits_deg`, `value_urad/(N m)`: what follows the quantity's name is the unit. Pint
reads it; angles are counted as a dimension of their own, so that an angle and a ratio cannot be
mistaken for each other.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from qsframework.errors import InputError, Problem

_ALIASES = {"Nm": "N*m", "kNm": "kN*m", "kp": "kgf", "percent": "percent", "": "dimensionless"}
_LONGEST = 40
_SHAPE = re.compile(r"(?:1\s*(?=/)|[^\W\d]\w*+|[°%²³]|(?:\*\*|\^)\s*-?\d(?![\w.]|\s*(?:\*\*|\^))|[*/()\s])+")
"""Names joined by * and /, each to a power of one digit: pint would also work out 9**9**9."""

ALLOWED: dict[str, tuple[str, ...]] = {
    "rad": ("deg", "rad", "mrad", "urad", "arcmin"),
    "m": ("mm", "m", "um"),
    "N": ("N", "kN"),
    "N m": ("Nm", "kNm"),
    "kg": ("kg",),
    "Pa": ("bar", "MPa", "Pa"),
    "m^2": ("cm^2", "mm^2", "m^2"),
    "m^3": ("l", "cm^3", "m^3"),
    "s": ("s", "min", "h"),
    "K": ("degC", "K"),
    "": ("percent",),
}
"""For each SI unit, the suffixes to offer in messages; pint accepts any other of its dimension."""


_LENGTH, _FORCE, _TIME = "[length]", "[mass] * [length] / [time] ** 2", "[time]"
_MOMENT, _GIVE = "[mass] * [length] ** 2 / [time] ** 2", "[time] ** 2 / [mass] / [length] ** 2"


def _ordered(dimension: str) -> str:
    """A dimension with its factors in the order of their names: pint's own depends on how a unit was made."""
    up, *down = dimension.split(" / ")
    return " / ".join([" * ".join(sorted(up.split(" * "))), *sorted(down)])


_OFTEN: dict[str, tuple[float, float, str]] = {"degC": (1.0, 273.15, "[temperature], angle^0")} | {
    unit: (factor, 0.0, f"{_ordered(dimension)}, angle^{angle}")
    for dimension, angle, units in (
        ("dimensionless", 1, {"rad": 1.0, "deg": math.pi / 180.0, "mrad": 1e-3, "urad": 1e-6}),
        ("dimensionless", 0, {"": 1.0, "percent": 0.01, "um/m": 1e-6}),
        (_LENGTH, 0, {"m": 1.0, "mm": 1e-3, "um": 1e-6}),
        (f"{_LENGTH} / {_TIME} ** 2", 0, {"m/s^2": 1.0}),
        ("[mass]", 0, {"kg": 1.0}),
        (_FORCE, 0, {"N": 1.0, "kN": 1e3}),
        (_MOMENT, 0, {"N m": 1.0, "Nm": 1.0, "kNm": 1e3}),
        (_GIVE, 1, {"rad/(N m)": 1.0, "urad/(N m)": 1e-6}),
        ("[mass] / [time] ** 2", 0, {"N/m": 1.0}),
        ("[time] ** 2 / [mass]", 0, {"m/N": 1.0, "um/N": 1e-6}),
        (f"[mass] / {_LENGTH} / [time] ** 2", 0, {"Pa": 1.0, "MPa": 1e6, "bar": 1e5}),
        (f"{_LENGTH} ** 2", 0, {"m^2": 1.0, "cm^2": 1e-4}),
        (f"{_LENGTH} ** 3", 0, {"m^3": 1.0, "l": 1e-3}),
        (f"[mass] * {_LENGTH} ** 2", 0, {"kg m^2": 1.0}),
        ("[temperature]", 0, {"K": 1.0}),
        (_TIME, 0, {"s": 1.0}),
    )
    for unit, factor in units.items()
}
"""What pint says of the units of every robot: pint itself takes longer to import than such a robot to read."""

_ANGLES = ("radian", "degree", "arcminute", "arcsecond", "turn", "gradian")


@cache
def _registry() -> Any:
    import pint

    library = cast("Any", pint)  # its registry is generic in kinds that nobody names
    return library.UnitRegistry(autoconvert_offset_to_baseunit=True)


def _text(unit: str) -> str:
    return _ALIASES.get(unit, unit.replace(" ", "*") if "(" not in unit else unit.replace("N m", "N*m"))


@lru_cache(maxsize=2048)
def conversion(unit: str) -> tuple[float, float, str]:
    """`(factor, offset, dimension)` with SI value = factor * value + offset.

    Raises ValueError if pint does not know the unit, or if it is no straight line to SI, as decibels are not.
    """
    if unit in _OFTEN:
        return _OFTEN[unit]
    return _ask_pint(unit)


def _ask_pint(unit: str) -> tuple[float, float, str]:
    if len(unit) > _LONGEST or (unit and _SHAPE.fullmatch(_text(unit)) is None):
        raise ValueError(f"unknown unit {unit[:_LONGEST]!r}")
    registry = _registry()
    try:
        parsed = registry.Unit(_text(unit))
        zero = registry.Quantity(0.0, parsed).to_base_units()
        one = registry.Quantity(1.0, parsed).to_base_units()
        two = registry.Quantity(2.0, parsed).to_base_units().magnitude
    except Exception as error:  # pint raises many kinds on text that is no unit
        raise ValueError(f"unknown unit {unit!r}") from error
    factor, offset = float(one.magnitude - zero.magnitude), float(zero.magnitude)
    if not (0.0 < factor < math.inf and math.isclose(two - one.magnitude, factor, rel_tol=1e-9)):
        raise ValueError(f"the unit {unit!r} has no constant factor to SI")
    angle = sum(power for name, power in dict(parsed._units).items() if name.endswith(_ANGLES))
    return factor, offset, f"{_ordered(str(one.dimensionality))}, angle^{angle:g}"


def known(unit: str) -> bool:
    """Whether pint can read the unit."""
    try:
        conversion(unit)
    except ValueError:
        return False
    return True


def same_dimension(unit: str, si: str) -> bool:
    """Whether the unit measures the same kind of quantity as the SI unit `si`."""
    return conversion(unit)[2] == conversion(si)[2]


def to_si(value: Any, unit: str) -> Any:
    """A number or array in the unit, as SI. ValueError as `conversion` has it, InputError for what is no number."""
    factor, offset, _ = conversion(unit)
    return _number(value) * factor + offset


def from_si(value: Any, unit: str) -> Any:
    """An SI number or array in the unit. Errors as of `to_si`."""
    factor, offset, _ = conversion(unit)
    return (_number(value) - offset) / factor


def _number(value: Any) -> Any:
    """The value where it can be reckoned with; a list as an array."""
    number: Any = np.asarray(cast("Any", value)) if isinstance(value, list | tuple) else value
    if np.asarray(number).dtype.kind in "USO":
        found = f"{cast('Any', value)!r} ({type(cast('Any', value)).__name__})"
        raise InputError(Problem(f"value: found {found}", allowed="a number or an array of numbers"))
    return number


def split(name: str, stems: tuple[str, ...] | list[str]) -> tuple[str, str] | None:
    """`(stem, unit)` of a name `stem_unit` whose stem is among `stems`, else None."""
    for stem in sorted(stems, key=len, reverse=True):
        if name.startswith(stem + "_"):
            return stem, name[len(stem) + 1 :]
    return None


def allowed_names(stem: str, si: str) -> str:
    """The spellings to offer for a quantity: `lever_mm, lever_m, lever_um`."""
    return ", ".join(f"{stem}_{unit}" for unit in ALLOWED.get(si, (si,)))


@dataclass(frozen=True)
class JointUnit:
    """The units of one joint, as text: si and shown of its value, load of what acts on it, give of its compliance.

    factor: one shown unit in SI; per: shown units in one of SI
    """

    si: str
    shown: str
    load: str
    give: str
    factor: float
    per: float

    def text(self, value: float, digits: int = 6) -> str:
        """A value, SI, as people read it: `-12.5 deg`, `1200 mm`."""
        return f"{value * self.per + 0.0:.{digits}g} {self.shown}"

    def between(self, low: float, high: float) -> str:
        """A range, SI, as people read it: `-185 to 185 deg`."""
        return f"{low * self.per + 0.0:g} to {high * self.per + 0.0:g} {self.shown}"


TURNS = JointUnit("rad", "deg", "N m", "rad/(N m)", math.pi / 180.0, 180.0 / math.pi)
SLIDES = JointUnit("m", "mm", "N", "m/N", 1e-3, 1e3)


@dataclass(frozen=True)
class JointUnits:
    """The units of a row of joint values: mm where a joint slides, deg where it turns; the one place that knows.

    sliding (n,): which of them slide
    """

    sliding: tuple[bool, ...]

    def __getitem__(self, k: int) -> JointUnit:
        return SLIDES if self.sliding[k] else TURNS

    def __len__(self) -> int:
        return len(self.sliding)

    def names(self, stem: str = "q") -> tuple[str, ...]:
        """The columns (n,) of a file: `q1_mm`, `q2_deg`, ..."""
        return tuple(f"{stem}{k + 1}_{self[k].shown}" for k in range(len(self)))

    def labels(self, stem: str = "J") -> tuple[str, ...]:
        """The heads (n,) of a table: `J1 mm`, `J2 deg`, ..."""
        return tuple(f"{stem}{k + 1} {self[k].shown}" for k in range(len(self)))

    @property
    def one(self) -> str:
        """The unit of all where they are alike, else each in turn: `deg`, or `mm, deg, deg, ...`."""
        found = [self[k].shown for k in range(len(self))]
        return found[0] if len(set(found)) == 1 else ", ".join(found)

    def fields(self, stem: str, values: npt.NDArray[np.float64]) -> dict[str, Any]:
        """A row of values (n,) as JSON has it: one list `q_deg`, or `q1_mm`, `q2_deg`, ... where units differ."""
        row = self.shown(values).tolist()
        if len({*self.sliding}) == 1:
            return {f"{stem}_{self[0].shown}": row}
        return dict(zip(self.names(stem), row, strict=True))

    def shown(self, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Values (..., n) in mm and deg of values in SI."""
        return np.asarray(values, dtype=np.float64) * [self[k].per for k in range(len(self))]

    def si(self, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Values (..., n) in SI of values in mm and deg."""
        return np.asarray(values, dtype=np.float64) * [self[k].factor for k in range(len(self))]
