"""Times as other programs write them: seconds, times of day, dates with times, counts from 1970."""

from __future__ import annotations

import datetime
import re

from qsframework import units

_DAY = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d+)?))?\s*([AaPp][Mm])?")
_DATES = ("%Y-%m-%d", "%Y/%m/%d", "%d.%m.%Y")
"""Dates that can be read in one way only: 03/04/2025 is none."""
_EPOCH = 1e8
"""s since 1970 of any clock that is set; smaller numbers are counted from somewhere else."""
CLOCKS = ("date", "day", "count")
"""What a time is counted from: 1970, midnight, or anything."""


def moment(cell: str, unit: str, date: str = "") -> tuple[float, str] | None:
    """Seconds, and what they are counted from; None for what is no time. unit: of a plain number.

    date: of a column of its own, for a time of day
    """
    cell = f"{date} {cell}".strip().lstrip("'")
    try:
        value = float(cell.replace(",", "."))
    except ValueError:
        return _clock(cell)
    if not unit:
        return None
    seconds = float(units.to_si(value, unit))
    return seconds, "date" if seconds > _EPOCH else "count"


def _clock(cell: str) -> tuple[float, str] | None:
    day, _, rest = cell.replace("T", " ", 1).partition(" ")
    if ":" in day:
        seconds = _seconds(cell)
        return None if seconds is None else (seconds, "day")
    seconds = _seconds(rest.strip().removesuffix("Z"))
    if seconds is None:
        return None
    for form in _DATES:
        try:
            found = datetime.datetime.strptime(day, form).replace(tzinfo=datetime.UTC)
        except ValueError:
            continue
        return found.timestamp() + seconds, "date"
    return None


def _seconds(text: str) -> float | None:
    """Seconds since midnight."""
    found = _DAY.fullmatch(text)
    if found is None:
        return None
    hour, minute, second = int(found[1]), int(found[2]), float((found[3] or "0").replace(",", "."))
    if found[4]:
        hour = hour % 12 + (12 if found[4].lower() == "pm" else 0)
    return 3600.0 * hour + 60.0 * minute + second if hour < 24 and minute < 60 and second < 61 else None
