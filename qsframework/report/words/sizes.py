"""Sizes as people read them: arcmin, urad/(N m) with the stiffness in MN m/rad, mm, percent."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TypeVar

from qsframework.plugin import Parameter

K = TypeVar("K")
V = TypeVar("V")
_SCALES: dict[str, tuple[tuple[float, str], ...]] = {
    "m": ((1e-3, "mm"), (1e-6, "um")),
    "rad/(N m)": ((1e-6, "urad/(N m)"), (1e-9, "nrad/(N m)")),
    "rad/(N m)^3": ((1e-15, "urad/(kN m)^3"),),
    "m/N^3": ((1e-15, "um/kN^3"),),
    "m/N": ((1e-6, "mm/kN"), (1e-9, "um/kN")),
    "N/m": ((1e6, "kN/mm"), (1e3, "N/mm")),
    "m/s": ((1e-6 / 3600.0, "um/h"),),
    "1/K": ((1e-6, "um/(m K)"),),
    "": ((1e-2, "%"),),
}
"""For each SI unit the size of one shown unit, largest first; the first one in which a value is large enough."""
_DEGREE = math.pi / 180.0
_ARCMIN = _DEGREE / 60.0
_ANGLES = ((_DEGREE, "deg"), (_ARCMIN, "arcmin"), (1e-6, "urad"))
_SEEN = 0.1
_SEEN_ANGLE = 0.01
"""Play and offsets are said in arcmin even where they are small."""
_STIFF = {
    "rad/(N m)": ((1e6, "MN m/rad"), (1e3, "kN m/rad"), (1.0, "N m/rad")),
    "m/N": ((1e6, "kN/mm"), (1e3, "N/mm"), (1.0, "N/m")),
}


def people_size(parameter: Parameter, value: float, stiffness: bool = True) -> str:
    """A value of a parameter, SI, with its unit: `1.0 arcmin`, `0.43 urad/(N m) (2.3 MN m/rad)`."""
    if not math.isfinite(value):
        return "unknown"
    size, unit = shown_unit(parameter, value)
    return f"{three(value / size)} {unit}".strip() + (_stiffness(parameter, value) if stiffness else "")


def people_estimate(parameter: Parameter, value: float, sd: float) -> str:
    """A value and its standard deviation in one unit: `1.020 ± 0.030 arcmin`; a stiffness beside a compliance.

    The unit is that of the larger of the two: what is nothing within its uncertainty is 0.0 ± 5.0 mm.
    """
    size, unit = shown_unit(parameter, max(abs(value), sd))
    return f"{with_sd(value / size, sd / size)} {unit}".strip() + _stiffness(parameter, value)


def shown_unit(parameter: Parameter, value: float) -> tuple[float, str]:
    """SI size of the unit in which people read a value of this size, and its text."""
    scales = _ANGLES if parameter.unit == "rad" else _SCALES.get(parameter.unit, ((1.0, parameter.unit),))
    if parameter.unit == "rad" and abs(value) < _DEGREE:
        scales = scales[1:]
    seen = _SEEN_ANGLE if parameter.unit == "rad" else _SEEN
    for size, unit in scales[:-1]:
        if abs(value) >= seen * size or value == 0.0:
            return size, unit
    return scales[-1]


def _stiffness(parameter: Parameter, value: float) -> str:
    """In brackets behind the compliance of a spring; nothing for what only changes a compliance, such as hardening."""
    spring = parameter.name.partition("[")[0].endswith("compliance")
    said = stiffness_words(parameter.unit, value) if spring else ""
    return f" ({said})" if said else ""


def three(value: float) -> str:
    """Three digits without an exponent where that stays readable."""
    return _digits(value, 3)


def two(value: float) -> str:
    """Two digits, for standard deviations."""
    return _digits(value, 2)


def _digits(value: float, digits: int) -> str:
    if value == 0.0 or not math.isfinite(value):
        return "0" if value == 0.0 else "unknown"
    power = math.floor(math.log10(abs(value)))
    if not -4 <= power < 6:
        return f"{value:.{digits - 1}e}"
    rounded = round(value, digits - 1 - power)
    return f"{rounded:z.{max(digits - 1 - power, 0)}f}"


def grouped(pairs: Iterable[tuple[K, V]]) -> dict[K, list[V]]:
    """What belongs to each key, in the order of the first of each."""
    out: dict[K, list[V]] = {}
    for key, value in pairs:
        out.setdefault(key, []).append(value)
    return out


def kind_and_place(name: str) -> tuple[str, str]:
    """`joint_backlash[joint_3]` -> joint_backlash, joint_3."""
    kind, _, where = name.partition("[")
    return kind, where.removesuffix("]")


def number(value: float, written: str) -> str:
    """A number in a format such as `.3f`; a dash where there is none."""
    return format(value, written.replace(".", "z.", 1)) if math.isfinite(value) else "-"


def mm(value: float, digits: int = 3) -> str:
    """A length, m, in mm; a dash where there is none."""
    return f"{1e3 * value:z.{digits}f}" if math.isfinite(value) else "-"


_SHOWN = {"rad/(N m)": (1e6, "urad/(N m)"), "m/N": (1e6, "um/N"), "m": (1e3, "mm"), "rad": (1e3, "mrad")}


def shown(value: float, unit: str) -> tuple[float, str]:
    """A value in the one unit that tables show for its SI unit: compliances in urad/(N m)."""
    factor, name = _SHOWN.get(unit, (1.0, unit))
    return value * factor, name


def shown_number(value: float, unit: str, digits: int = 4) -> str:
    """The number of `shown`, without its unit."""
    return f"{shown(value, unit)[0]:z.{digits}g}"


def unit_shown(unit: str) -> str:
    """The unit that tables show for an SI unit."""
    return shown(1.0, unit)[1]


def shown_with_sd(value: float, sd: float, unit: str) -> str:
    """A value with its sd, where one is quoted, in the unit that tables show."""
    return with_sd(shown(value, unit)[0], shown(sd, unit)[0])


def with_sd(value: float, sd: float) -> str:
    """`0.1610 ± 0.0062`: the sd to two digits, the value to the same place."""
    if not (math.isfinite(sd) and sd > 0.0):
        return f"{value:z.4g}"
    digits = 1 - int(f"{sd:.1e}".partition("e")[2])
    if not -2 <= digits <= 9:
        power = math.floor(math.log10(abs(value))) if value else -digits
        return f"{value:.{max(power + digits, 0)}e} ± {sd:.1e}"
    return f"{round(value, digits):z.{max(digits, 0)}f} ± {round(sd, digits):.{max(digits, 0)}f}"


def value_words(value: float, sd: float, unit: str) -> str:
    """A value with its sd in the unit that tables show; fixed and bound ones say so instead."""
    text = f"{shown_with_sd(value, sd, unit)} {unit_shown(unit)}"
    return text.strip() if sd > 0.0 else f"{text} {unquoted(sd)}"


def unquoted(sd: float) -> str:
    """Why no sd is quoted, in brackets."""
    return "(at bound)" if math.isnan(sd) else "(fixed)"


def stiffness_words(unit: str, value: float) -> str:
    """The stiffness of a compliance, `5.96 MN m/rad`; "" for what is no compliance or not above zero."""
    if unit not in _STIFF or value <= 0.0:
        return ""
    stiff = _STIFF[unit]
    size, name = next((s for s in stiff if 1.0 / value >= _SEEN * s[0]), stiff[-1])
    return f"{three(1.0 / value / size)} {name}"
