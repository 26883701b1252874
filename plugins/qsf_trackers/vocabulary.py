"""The words of other programs: what a column is called, which unit or state is meant, which time a cell says, and what
the name of a point says: pose, marker, state, load, repeat and cycle."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from qsf_trackers.campaign import Campaign
from qsframework import units
from qsframework.experiment import XYZ

FOUND_BY = ("name", "pose", "marker", "state", "load_id", "repeat", "cycle")
"""Roles that say which reading of which state a row is."""
PLAIN = ("group", "collection", "block", *FOUND_BY, "series", "date")
"""Roles of words."""
MEASURED = {"x": "m", "y": "m", "z": "m", "time": "s", "temperature": "K", "sigma": "m"}
"""Roles of numbers, with their SI unit; angles q1, q2, ... are beside them."""
UNIT_COLUMNS = ("unit", "units", "einheit", "length unit", "unit of length", "uom")
"""A column of the unit of each row's coordinates."""
LOADED = ("loaded", "fullload", "belastet")
UNLOADED = ("unloaded", "noload", "free", "empty", "unbelastet", "leer")
"""Words that can mean nothing else: single letters, and words such as load and last, must be stated."""
WITH = ("with", "mit", "avec", "con", "load", "last", "weight", "gewicht", "charge", "carga")
WITHOUT = ("without", "ohne", "sans", "sin", "no")
"""Words that seem to speak of a load: a `word` that states their meaning is proposed."""

_FILLERS = """coord coordinate coordinates koordinate pos position point punkt value wert actual act measured meas
measurement ist istwert mess messwert cartesian cart center centre tracker location field
leica faro api"""
AXIS_FILLERS = frozenset(_FILLERS.split())
"""Words that may stand beside x, y or z and leave it a measured coordinate; nominal, deviation and sd are none."""
_OTHERS = """nominal nom soll sollwert theoretical theo dev deviation abw abweichung diff delta tol tolerance sigma std
stdev sd rms uncertainty error err rotation rot quat quaternion orientation angle angular velocity vel speed
acceleration acc force moment normal direction tilt u95 u expected commanded desired reference residual"""
NOT_MEASURED = frozenset(_OTHERS.split())
"""Words beside x, y or z, or over it, that say it is no measured coordinate."""
BLOCK = "block of columns"
"""Heading of what a block of columns was called, once the blocks stand in rows."""
_OF_ITS_OWN = {
    "name": "name|point|pointname|point name|point id|pointid|target|target name|targetname|id|label|feature|"
    "feature name|element name|object|object name|objectname|punkt|punktname|bezeichnung|ptid|measurement name|"
    "point label",
    "group": "group|group name|point group|groupname|gruppe",
    "collection": "collection|collection name",
    "block": BLOCK,
    "pose": "pose|pose name|stellung",
    "marker": "marker|reflector|smr|reflektor",
    "state": "state|zustand",
    "series": "series|station|instrument|serie",
    "repeat": "repeat|wiederholung",
    "cycle": "cycle|zyklus",
    "load_id": "load id|load_id",
    "time": "time|timestamp|time stamp|stamp|zeit|zeitstempel|uhrzeit|measurement time|meas time|date time|datetime|"
    "field header stamp|header stamp",
    "date": "date|datum",
    "temperature": "temperature|temp|temperatur|measurement temperature|meas temperature|air temperature",
}
_ROLE_OF = {w.strip(): role for role, text in _OF_ITS_OWN.items() for w in text.split("|")}
_NOT_AN_ANGLE = re.compile(r"velocit|effort|speed|torque|current|accel|desired|target|error|temp|soll|goal")
_JOINT = (
    (
        re.compile(
            r"(?:axis act |axis act meas |act |actual |ist )?[ajq](?:oints?|xis|chse)? ?(\d)(?: act| actual| ist)?"
        ),
        0,
    ),
    (re.compile(r"(?:theta|joint angle|gelenk|joint position|joint pos) ?(\d)"), 0),
    (re.compile(r".*\bjoint[ _]?(\d)\b.*\bposition"), 0),
    (re.compile(r"(?:.* )?(?:position|actual q) ?(\d)"), 1),
)
"""What a joint's column is called, and 1 where it is counted from 0, as ROS does."""
_SPELLINGS = {
    "mm": "mm millimeter millimeters millimetre millimetres",
    "m": "m meter meters metre metres",
    "cm": "cm",
    "um": "um \u00b5m \u03bcm micron microns",
    "inch": 'in inch inches zoll "',
    "foot": "ft foot feet",
    "deg": "deg degree degrees \u00b0 grad",
    "rad": "rad radian radians",
    "s": "s sec second seconds",
    "ms": "ms",
    "us": "us",
    "ns": "ns",
    "min": "min",
    "h": "h",
    "degC": "\u00b0c degc c celsius",
    "K": "k kelvin",
    "degF": "\u00b0f degf f fahrenheit",
}
_UNITS = {word: unit for unit, words in _SPELLINGS.items() for word in words.split()}
"""What a unit is called, and how pint calls it."""
_IN_HEADER = re.compile(r"\s*[\[(/]\s*([^\[\]()/]{1,12}?)\s*[\])]?\s*$")
_SAID_ABOVE = re.compile(r"units?\b\s*(?:of\s+\w+\s*)?[:=]?\s*([A-Za-z°µμ\"]+)", re.IGNORECASE)

_DAY = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d+)?))?\s*([AaPp][Mm])?")
_DATES = ("%Y-%m-%d", "%Y/%m/%d", "%d.%m.%Y")
"""Dates that can be read in one way only: 03/04/2025 is none."""
_EPOCH = 1e8
"""s since 1970 of any clock that is set; smaller numbers are counted from somewhere else."""
_TOKEN = re.compile(r"[^\W\d_]+\d*|\d+")
_COUNT = re.compile(r"(r|rep|repeat|c|cycle)0*([1-9]\d{0,4})")
HALF = "half"
"""What says in a name that half of the load hung."""


@dataclass(frozen=True)
class Meaning:
    """What a column is: its role, and its unit, "" where it has none or says none; `by`: how the unit is known."""

    role: str
    unit: str = ""
    by: str = ""


def unit_of(text: str) -> str | None:
    """The unit that a text names, as pint spells it; None where it is none."""
    return _UNITS.get(text.strip().lower())


def unit_kind(unit: str) -> str | None:
    """SI unit of what a unit measures: "m", "rad", "s" or "K"; None of anything else."""
    kinds = ("m", "rad", "s", "K") if units.known(unit) else ()
    return next((si for si in kinds if units.same_dimension(unit, si)), None)


def units_above(lines: Sequence[str]) -> dict[str, str]:
    """Units that the text above a table states, by SI unit; of two that differ neither."""
    found: dict[str, set[str]] = {}
    for line in lines:
        for text in _SAID_ABOVE.findall(line):
            unit = unit_of(text) or ""
            if kind := unit_kind(unit):
                found.setdefault(kind, set()).add(unit)
    return {kind: next(iter(own)) for kind, own in found.items() if len(own) == 1}


def meaning(header: str, joints: Sequence[str]) -> Meaning | None:
    """What the name of a column says; joints: the robot's own names of its joints. None where it says nothing known."""
    name, unit = header_parts(header)
    words = words_of(name.lower())
    key = " ".join(words)
    if not key:
        return None
    axes = [w for w in words if w in XYZ]
    by = "header" if unit else ""
    if len(axes) == 1 and all(w in AXIS_FILLERS for w in words if w not in XYZ):
        return Meaning(axes[0], unit, by)
    squeezed = re.fullmatch(r"(?:coord|pos)?([xyz])(?:coord|pos|coordinate|koordinate)?", key.replace(" ", ""))
    if squeezed is not None:
        return Meaning(squeezed[1], unit, by)
    if role := _ROLE_OF.get(key) or _ROLE_OF.get(key.replace(" ", "")):
        if role == "time" and not unit and (header.lstrip().startswith("%") or key.endswith("header stamp")):
            return Meaning(role, "ns", "ros")
        return Meaning(role, unit, by)
    return _joint(header, key, unit, joints)


def _joint(header: str, key: str, unit: str, joints: Sequence[str]) -> Meaning | None:
    """The joint that a name says: q1, q2, ..., or q0 where somebody counts from zero."""
    own = {" ".join(words_of(name.lower())): k for k, name in enumerate(joints, start=1)}
    ending = re.fullmatch(r"(.*?)(?: position| pos)?", key)
    named = [k for name, k in own.items() if ending is not None and f" {ending[1]}".endswith(f" {name}")]
    place = named[0] if len(named) == 1 else None
    ros = place is not None and key.endswith("position")
    if _NOT_AN_ANGLE.search(key):
        return None
    if place is None:
        for pattern, first in _JOINT:
            found = pattern.fullmatch(key)
            if found is not None:
                place, ros = int(found[1]) + first, "position" in key
                break
    if place is None or not 0 <= place <= len(joints):
        return None
    if unit:
        return Meaning(f"q{place}", unit, "header")
    if ros:
        return Meaning(f"q{place}", "rad", "ros")
    if key.startswith("actual q"):
        return Meaning(f"q{place}", "rad", "rtde")
    if header.lstrip().upper().startswith("$AXIS_ACT"):
        return Meaning(f"q{place}", "deg", "kuka")
    return Meaning(f"q{place}")


def header_parts(header: str) -> tuple[str, str]:
    """Name and unit of a header such as `X [mm]`, `X (in)`, `x_mm` or `Time/s`."""
    found = _IN_HEADER.search(header)
    unit = unit_of(found[1]) if found is not None else None
    if found is not None and unit is not None:
        return header[: found.start()], unit
    stem, _, last = header.rpartition("_")
    unit = unit_of(last) if stem else None
    if unit is None and " " in header.strip():
        stem, _, last = header.strip().rpartition(" ")
        unit = unit_of(last) if len(last) > 1 else None
    return (stem, unit) if unit is not None else (header, "")


def words_of(text: str) -> list[str]:
    """Its runs of letters and digits."""
    return re.findall(r"[^\W_]+", text)


def moment(cell: str, unit: str, date: str = "") -> tuple[float, str] | None:
    """Seconds, and what they are counted from: "date" (1970), "day" (midnight) or "count" (anything); None for what is
    no time.

    unit: of a plain number; date: of a column of its own, for a time of day
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


@dataclass(frozen=True, kw_only=True)
class Said:
    """What a name says; None or "" where it says nothing of it. several: what it says twice, such as two poses.

    unknown: words that say nothing
    """

    pose: str | None = None
    marker: str | None = None
    loaded: bool | None = None
    load: str = ""
    repeat: int | None = None
    cycle: int | None = None
    several: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()


@dataclass(frozen=True)
class Vocabulary:
    """Everything that a word of a name may mean, by the word made plain: its kind and its value."""

    meanings: Mapping[str, tuple[tuple[str, str], ...]]
    longest: int

    def meant(self, word: str, kind: str) -> list[str]:
        """What a whole word may mean of one kind."""
        return [value for own, value in self.meanings.get(plain(word), ()) if own == kind]


def plain(text: str) -> str:
    """Letters and digits alone, small, without zeros in front of a number: P-07 and p7 are one."""
    return re.sub(r"(?<!\d)0+(?=\d)", "", "".join(words_of(text.lower())))


def vocabulary(campaign: Campaign, markers: Sequence[str], words: Mapping[str, str]) -> Vocabulary:
    """The words of a campaign, and those that the user states: found=meant."""
    found: dict[str, list[tuple[str, str]]] = {}

    def add(kind: str, names: Iterable[str]) -> None:
        for name in names:
            own = found.setdefault(plain(name), [])
            if (kind, name) not in own:
                own.append((kind, name))

    add("pose", campaign.poses)
    add("marker", markers)
    loads = {(i, name) for own in campaign.names.values() for i, name in own.items() if name}
    for load, name in sorted(loads):
        found.setdefault(plain(name), []).append(("load", load or name))
    for state, spelled in (("loaded", LOADED), ("unloaded", UNLOADED)):
        for word in spelled:
            if word not in found:
                found[word] = [("state", state)]
    for word in (HALF, "halfload"):
        found.setdefault(word, [("half", HALF)])
    for word, meant in words.items():
        target = found.get(plain(meant))
        if target is not None:
            found[plain(word)] = list(target)
    longest = max((len(_TOKEN.findall(t)) for t in (*campaign.poses, *markers, *words)), default=1)
    loads_long = max((len(_TOKEN.findall(name)) for _, name in loads), default=1)
    return Vocabulary({k: tuple(v) for k, v in found.items() if k}, max(longest, loads_long, 2))


def state_word(name: str, unknown: Sequence[str]) -> str:
    """FOUND=STATE by the words of a name that speak of a load, such as `ohne Last=unloaded`; "" where none does."""
    spoken = [word for word in unknown if word.lower() in (*WITH, *WITHOUT)]
    if not spoken:
        return ""
    words = " ".join(spoken) if plain("".join(spoken)) in plain(name) else spoken[0]
    return f"{words}={'unloaded' if any(word.lower() in WITHOUT for word in spoken) else 'loaded'}"


def decode(text: str, known: Vocabulary) -> Said:
    """What a name says, by the longest runs of its words that mean something."""
    tokens = _TOKEN.findall(text)
    told: dict[str, list[str]] = {}
    unknown: list[str] = []
    i = 0
    while i < len(tokens):
        for size in range(min(known.longest, len(tokens) - i), 0, -1):
            meanings = known.meanings.get(plain("".join(tokens[i : i + size])))
            if meanings:
                for kind, value in meanings:
                    told.setdefault(kind, []).append(value)
                i += size
                break
        else:
            two = "".join(tokens[i : i + 2]).lower()  # repeat 2, as the day's sheet writes it
            counts = [found for text in (tokens[i].lower(), two) if (found := _COUNT.fullmatch(text)) is not None]
            if counts:
                told.setdefault("repeat" if counts[0][1][0] == "r" else "cycle", []).append(counts[0][2])
                i += len(counts[0][0]) > len(tokens[i])
            else:
                unknown.append(tokens[i])
            i += 1
    return _said(told, unknown)


def _said(told: Mapping[str, Sequence[str]], unknown: Sequence[str]) -> Said:
    one = {kind: list(dict.fromkeys(values)) for kind, values in told.items()}
    several = [f"{kind} {' or '.join(v)}" for kind, v in one.items() if len(v) > 1 and kind != "load"]
    shared = set(one.get("pose", ())) & set(one.get("marker", ()))
    several += [f"pose or marker {name}" for name in sorted(shared)]
    first = {kind: values[0] for kind, values in one.items()}
    load = HALF if "half" in one else first.get("load", "")
    state = first.get("state")
    loaded = None if state is None else state == "loaded"
    if loaded is None and load:
        loaded = True
    return Said(
        pose=first.get("pose"),
        marker=first.get("marker"),
        loaded=loaded,
        load=load,
        repeat=int(first["repeat"]) if "repeat" in first else None,
        cycle=int(first["cycle"]) if "cycle" in first else None,
        several=tuple(several),
        unknown=tuple(unknown),
    )
