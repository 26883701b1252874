"""What the columns of a table are: a point list, a joint log, or one of our own tables written by a spreadsheet."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from qsf_trackers.layout import NO_SIGHT, Sheet
from qsf_trackers.options import ImportOptions
from qsf_trackers.sheets import NUMBER
from qsf_trackers.vocabulary import (
    MEASURED,
    NOT_MEASURED,
    PLAIN,
    UNIT_COLUMNS,
    Meaning,
    header_parts,
    meaning,
    moment,
    plain,
    unit_kind,
    unit_of,
    units_above,
    words_of,
)
from qsframework import units
from qsframework.errors import InputError, Problem, nearest, refuse
from qsframework.experiment import XYZ, joint_stems
from qsframework.files.documents import DECIMAL
from qsframework.plugin import Array

_JOINT_NAME = re.compile(r".*\bname\s?[\[_.]?(\d)\]?")
"""Columns that name the joints of a row, as ROS writes them."""
_POLAR = re.compile(r"theta|phi|azimuth|az|hz|zenith|[a-z]+[ _]?(angle|winkel)", re.IGNORECASE)
"""Columns of points that are not x, y and z."""
_BEYOND = 1e20
"""Coordinates that some instruments write where they see nothing."""
_GROUPED = re.compile(r"[-+]?\d{1,3}(\.\d{3})+")
_WITH_UNIT = re.compile(rf"({NUMBER.pattern})\s*([^\d\s.,+-]\S{{0,12}})")


@dataclass(frozen=True, kw_only=True)
class StatedProblem(Problem):
    """A problem of what is stated of the files: in which part (columns, names), under which key, and its value."""

    stated: tuple[str, str, str]


@dataclass(frozen=True)
class Taken:
    """A column that was taken: as what, in which unit ("" for words), and how that is known.

    by: "header", "above", "stated", "cells", "ros", "kuka", "format" of a time that says it itself, or ""
    """

    role: str
    column: str
    unit: str
    by: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Listing:
    """The rows of a sheet by role: words, and numbers in SI. (N,) each; NaN where a cell is empty.

    unit: of the coordinates, "" where nobody says it (they are then as the file has them)
    clock: what times are counted from; left: columns of which nothing was taken
    hidden (N,): rows in which the instrument saw nothing
    """

    sheet: Sheet
    taken: tuple[Taken, ...]
    left: tuple[str, ...]
    texts: Mapping[str, tuple[str, ...]]
    numbers: Mapping[str, Array]
    hidden: npt.NDArray[np.bool_]
    unit: str = ""
    clock: str = ""

    def __len__(self) -> int:
        return len(self.sheet.rows)

    @property
    def is_points(self) -> bool:
        """Whether it holds coordinates."""
        return "x" in self.numbers

    @cached_property
    def xyz(self) -> Array:
        """Coordinates (N, 3)."""
        return np.stack([self.numbers[a] for a in XYZ], axis=1)

    @property
    def plain_names(self) -> list[str]:
        """The names of its rows, made plain."""
        return [plain(name) for name in self.texts["name"]]

    def angles(self, joints: int) -> Array:
        """Pendant angles (N, joints) rad of a table that holds them."""
        return np.stack([self.numbers[q] for q in joint_stems(joints)], axis=1)

    def column(self, role: str) -> str | None:
        """The file's name of what was taken as a role."""
        return next((t.column for t in self.taken if t.role == role), None)

    def problem(self, i: int | None, role: str, message: str, **more: Any) -> Problem:
        """A problem of row i (None: of the heading)."""
        return replace(self.sheet.problem(i, message, **more), column=self.column(role))


def stated_units(texts: Sequence[str]) -> dict[str, str]:
    """Stated units by what they measure. InputError for what is no unit, or two of one kind."""
    out: dict[str, str] = {}
    for text in texts:
        unit = unit_of(text) or text
        kind = unit_kind(unit)
        if kind is None:
            message = "no unit of length, angle, time or temperature"
            allowed = "mm, m, in, deg, rad, s, ms, degC, ..."
            raise InputError(Problem(message, found=repr(text), allowed=allowed))
        if out.setdefault(kind, unit) != unit:
            raise InputError(Problem("two units of one kind are stated", found=f"{out[kind]} and {unit}"))
    return out


def interpret(sheet: Sheet, options: ImportOptions, stated: Mapping[str, str], joints: Sequence[str]) -> Listing:
    """What the columns of a sheet are, by their names and by what is stated; joints: the robot's names of its joints.

    InputError where it is neither a point list nor a joint log, where a column could be several things or several
    columns one thing, where a cell is no number; with a proposal what to state.
    """
    roles = _complete(sheet, _roles(sheet, options, joints), len(joints))
    hidden, above = _hidden(sheet, roles), units_above(sheet.above)
    problems: list[Problem] = []
    unit_place, each = _unit_column(sheet, roles, stated, problems)
    texts = {role: tuple(sheet.cells(k)) for role, (k, _) in roles.items() if role in PLAIN}
    found: dict[str, _Numbers] = {}
    for role, (k, told) in roles.items():
        if role in PLAIN:
            continue
        unit, by = _unit(MEASURED.get(role, "rad"), told, above, stated)
        if role == "time":
            dates = texts.get("date", ("",) * len(sheet.rows))
            read = _times(sheet, k, dates, unit, by, options, problems)
        else:
            own = each if role in XYZ and not told.unit else []
            read = _measured(sheet, role, k, unit, by, hidden, own, problems)
        if read is not None:
            found[role] = read
    said = {role: ("", "stated" if role in options.columns else "header") for role in texts}
    said |= {role: (read.unit, read.by) for role, read in found.items()}
    taken = tuple(Taken(role, sheet.column(k), *said[role]) for role, (k, _) in roles.items() if role in said)
    refuse([*problems, *_unit_problems(sheet, taken)])
    places = {unit_place, *(k for k, _ in roles.values())}
    left = [k for k in range(sheet.width) if k not in places]
    idle = [sheet.column(k) for role, (k, _) in roles.items() if role not in said]
    return Listing(
        sheet=sheet,
        taken=taken,
        left=(*map(sheet.column, left), *sheet.left, *idle),
        texts=texts,
        numbers={role: read.values for role, read in found.items()},
        hidden=hidden,
        unit=found["x"].unit if "x" in found else "",
        clock=found["time"].clock if "time" in found else "",
    )


def _unit_column(
    sheet: Sheet, roles: Mapping[str, tuple[int, Meaning]], stated: Mapping[str, str], problems: list[Problem]
) -> tuple[int, list[str]]:
    """The column that says the unit of each row's coordinates, -1 where there is none, and these units."""
    free = [k for k in range(len(sheet.header)) if k not in {c for c, _ in roles.values()}]
    k = next((k for k in free if "x" in roles and sheet.header[k].strip().lower() in UNIT_COLUMNS), -1)
    if k < 0:
        return -1, []
    found = [unit_of(cell) for cell in sheet.cells(k)]
    wrong = [i for i, unit in enumerate(found) if unit is None or unit_kind(unit) != "m"]
    for i in wrong:
        cell = repr(sheet.rows[i].cells[k])
        problems.append(sheet.problem(i, "is no unit of length", k, found=cell, allowed="mm, m, in, ..."))
    if "m" in stated and {unit or "m" for unit in found} != {stated["m"]}:
        message = "this column says the unit of each row"
        hint = "Leave the stated unit of length out."
        problems.append(sheet.problem(None, message, k, found=f"and {stated['m']} is stated", hint=hint))
    return k, [] if problems else [unit or "" for unit in found]


def _roles(sheet: Sheet, options: ImportOptions, joints: Sequence[str]) -> dict[str, tuple[int, Meaning]]:
    """The column of each role: the stated one, else the only one whose name says it."""
    every: dict[str, list[tuple[int, Meaning]]] = {}
    for k, name in enumerate(sheet.header):
        found = meaning(name, joints)
        if found is not None:
            every.setdefault(found.role, []).append((k, found))
    every = _counted_from_one(sheet, every, joints)
    out: dict[str, tuple[int, Meaning]] = {}
    for role, name in options.columns.items():
        k = _place(sheet, name)
        if k is not None:
            told = meaning(sheet.header[k], joints) if k < len(sheet.header) else None
            out[role] = (k, told or Meaning(role))
    problems: list[Problem] = []
    used = {k for k, _ in out.values()}
    for role, places in every.items():
        free = [at for at in places if at[0] not in used]
        if role in out or not free or (role == "time" and len(free) > 1 and options.join != "time"):
            continue
        if len(free) > 1:
            names = ", ".join(repr(sheet.column(k)) for k, _ in free)
            message = f"several columns could be {role}"
            hint = "State which one is meant."
            argument = ("map", f"{role}={sheet.column(free[0][0])!r}")
            problems.append(sheet.problem(None, message, found=names, hint=hint, argument=argument))
        else:
            out[role] = free[0]
    refuse(problems)
    return out


def _counted_from_one(
    sheet: Sheet, every: dict[str, list[tuple[int, Meaning]]], joints: Sequence[str]
) -> dict[str, list[tuple[int, Meaning]]]:
    """The roles with joints from q1 on: those that are counted from 0 one on, those of a row that names its joints by
    these names, as ROS does in another order than the arm's."""
    if "q0" in every:
        first = every.pop("q0")
        others = [every.pop(q, []) for q in joint_stems(len(joints))]
        if all(others[:-1]) and not others[-1]:
            every |= {f"q{k}": own for k, own in enumerate([first, *others[:-1]], start=1)}
    told = {int(m[1]): sheet.rows[0].cells[k] for k, h in enumerate(sheet.header) if (m := _JOINT_NAME.fullmatch(h))}
    names = [told.get(k, "") for k in range(len(joints))]
    if sorted(names) == sorted(joints):
        own = [every.pop(q, []) for q in joint_stems(len(joints))]
        every |= {f"q{joints.index(name) + 1}": found for name, found in zip(names, own, strict=True)}
    return every


def _place(sheet: Sheet, name: str) -> int | None:
    """The column that a stated name or number means in this sheet."""
    if name in sheet.header:
        return sheet.header.index(name)
    lowered = [h.lower() for h in sheet.header]
    if name.lower() in lowered:
        return lowered.index(name.lower())
    return int(name) - 1 if not sheet.header and name.isdecimal() and 1 <= int(name) <= sheet.width else None


def check_columns(sheets: Sequence[Sheet], stated: Mapping[str, str], joints: int) -> None:
    """InputError for roles that there are not, and for stated columns that no file has."""
    allowed = (*PLAIN, *MEASURED, *joint_stems(joints))
    problems: list[Problem] = []
    for role, name in stated.items():
        at = ("columns", role, name)
        if role not in allowed:
            message, listed = "no column can be taken as this", ", ".join(allowed)
            hint = nearest(role, allowed)
            problems.append(StatedProblem(message, found=repr(role), allowed=listed, hint=hint, stated=at))
        elif all(_place(sheet, name) is None for sheet in sheets):
            names = [sheet.column(k) for sheet in sheets for k in range(sheet.width)]
            files = ", ".join(str(s.path) for s in sheets)
            message, hint, listed = f"no column is called {name!r}", nearest(name, names), ", ".join(names)
            problems.append(StatedProblem(message, files, found=f"{role}={name}", allowed=listed, hint=hint, stated=at))
    refuse(problems)


def _complete(sheet: Sheet, roles: dict[str, tuple[int, Meaning]], joints: int) -> dict[str, tuple[int, Meaning]]:
    """The roles without joints that are not all there beside coordinates, or that are a quaternion.

    InputError where the columns are neither three coordinates nor all angles; proposes what the cells suggest.
    """
    stems = joint_stems(joints)
    angles = [s for s in stems if s in roles]
    if len({roles[s][0] for s in angles}) == joints == sheet.width:  # what is stated of the points beside it is not its
        roles = {s: roles[s] for s in stems}
    axes = [a for a in XYZ if a in roles]
    if len(axes) == len(XYZ) and (len(angles) < joints or _is_quaternion(sheet, [roles[s][0] for s in stems])):
        return {role: at for role, at in roles.items() if role not in stems}
    if len(angles) == joints and len(axes) in (0, len(XYZ)):
        return roles
    if "x" not in roles and (polar := [h for h in sheet.header if _POLAR.fullmatch(header_parts(h)[0].strip())]):
        message = "these are cylindrical or spherical coordinates, not x, y and z"
        hint = "Export the points in Cartesian coordinates."
        raise InputError(sheet.problem(None, message, found=", ".join(polar), hint=hint))
    missing = [s for s in stems if s not in roles] if angles and not axes else [a for a in XYZ if a not in roles]
    if axes and angles:
        missing += [s for s in stems if s not in roles]
    names = ", ".join(repr(sheet.column(k)) for k in range(sheet.width))
    wanted = _wanted(sheet, roles, missing)
    message = f"no column says that it is {', '.join(missing)}"
    if not sheet.header:
        message = f"the columns have no names, so none is {', '.join(missing)}"
    row = "points with a name and x, y, z" if "x" in missing else f"the angles of all {joints} joints"
    hint, argument = f"Export {row}, one a row.", None
    if wanted:
        hint = f"Say which column is which; as proposed, the first rows are {first_rows(sheet, wanted)}."
        if not sheet.header and sheet.width == joints and wanted[0] == ("x", 0):
            hint += f" Of a joint log: {','.join(f'{s}={k}' for k, s in enumerate(stems, start=1))}."
        pairs = ",".join(f"{role}={sheet.column(k)}" for role, k in wanted)
        argument = ("map", pairs if re.fullmatch(r"[\w=.,]*", pairs) else quoted_word(pairs))
    raise InputError(sheet.problem(None, message, found=names, hint=hint, argument=argument))


def _is_quaternion(sheet: Sheet, columns: Sequence[int]) -> bool:
    """Whether four columns hold numbers whose squares sum to one."""
    cells = [_decimals(sheet, k) for k in columns]
    if len(columns) != 4 or any(len(own) < len(sheet.rows) for own in cells):
        return False
    return all(abs(sum(c**2 for c in row) - 1.0) < 1e-3 for row in zip(*cells, strict=True))


def _decimals(sheet: Sheet, k: int) -> list[float]:
    """The numbers of a column, whichever their decimal sign."""
    return [float(c) for cell in sheet.cells(k) if DECIMAL.fullmatch(c := cell.replace(",", "."))]


def _hidden(sheet: Sheet, roles: Mapping[str, tuple[int, Meaning]]) -> npt.NDArray[np.bool_]:
    """Rows (N,) in which no coordinate was seen: all three empty, no number by any name, or beyond any place; in blocks
    of columns, as motion capture writes them, zero too."""
    places = [roles[a][0] for a in XYZ if a in roles]

    def blind(cell: str) -> bool:
        text = cell.lower().replace(",", ".")
        size = abs(float(text)) if DECIMAL.fullmatch(text) else 1.0
        return text in NO_SIGHT or size > _BEYOND or (size == 0.0 and bool(sheet.blocks))

    return np.array([bool(places) and all(blind(r.cells[k]) for k in places) for r in sheet.rows], dtype=bool)


def first_rows(sheet: Sheet, columns: Sequence[tuple[str, int]]) -> str:
    """The first three rows as they are read."""
    return "; ".join(", ".join(f"{role} {row.cells[k]}" for role, k in columns) for row in sheet.rows[:3])


def _wanted(sheet: Sheet, roles: Mapping[str, tuple[int, Meaning]], missing: Sequence[str]) -> list[tuple[str, int]]:
    """Columns for the missing roles, told from the cells: for each the first numbers that nothing else has taken."""
    used = {k for k, _ in roles.values()}
    first = sheet.rows[0].cells
    free = [k for k in range(sheet.width) if k not in used and k < len(first)]
    numeric = [k for k in free if NUMBER.fullmatch(first[k]) and not _counts(sheet, k)]
    numeric = ("x" in missing and _alike(sheet, numeric)) or numeric
    named = [k for k in free if not NUMBER.fullmatch(first[k]) and re.search(r"\w", first[k])]
    if len(numeric) < len(missing):
        return []
    wanted = [(role, numeric[i]) for i, role in enumerate(missing)]
    texts = [r for r in ("collection", "group", "name") if r not in roles]
    if "name" in texts and named and len({*sheet.cells(named[-1])}) > 1:
        wanted = [*zip(texts[-min(len(named), 3) :], named, strict=False), *wanted]
    return wanted


def _alike(sheet: Sheet, numeric: Sequence[int]) -> list[int]:
    """Three columns whose names differ in x, y and z alone: coordinates rather than others, with a unit of length."""
    columns = {sheet.column(k).lower()[:99]: k for k in numeric}
    triples = [[h[:i] + axis + h[i + 1 :] for axis in XYZ] for h in columns for i in range(len(h))]

    def order(triple: list[str]) -> tuple[bool, bool]:
        unit = header_parts(triple[0])[1]
        return not NOT_MEASURED.isdisjoint(words_of(triple[0])), unit_kind(unit) != "m"

    return [columns[h] for h in min((t for t in triples if columns.keys() >= {*t}), key=order, default=())]


def _counts(sheet: Sheet, k: int) -> bool:
    """Whether a column only counts the rows."""
    cells = sheet.cells(k)
    counts = [int(c) for c in cells if c.isdecimal()]
    return len(cells) == len(counts) > 1 and all(b == a + 1 for a, b in itertools.pairwise(counts))


def _unit(si: str, told: Meaning, above: Mapping[str, str], stated: Mapping[str, str]) -> tuple[str, str]:
    """The unit of a column and how it is known: by its name, by the user, by the text above, by what wrote it."""
    if told.unit and told.by == "header":
        return told.unit, told.by
    if si in stated:
        return stated[si], "stated"
    if si in above:
        return above[si], "above"
    return told.unit, told.by


class _Numbers(NamedTuple):
    """A column of numbers (N,): in SI, or as the file has them where nobody says the unit; clock: of times."""

    values: Array
    unit: str
    by: str
    clock: str = ""


def _measured(
    sheet: Sheet,
    role: str,
    k: int,
    unit: str,
    by: str,
    hidden: npt.NDArray[np.bool_],
    each: Sequence[str],
    problems: list[Problem],
) -> _Numbers | None:
    """The numbers of a role, in the unit of their own cells, of a column (each), or else in this; None for nothing."""
    cells, si, optional = sheet.cells(k), MEASURED.get(role, "rad"), role in ("temperature", "sigma")
    if role in XYZ:
        cells = ["" if blind else cell for cell, blind in zip(cells, hidden, strict=True)]
    values, own = _cell_numbers(sheet, k, cells, hidden | optional, problems)
    if each and not own:
        values, own = values * np.array([units.to_si(1.0, one) for one in each]), "m"
    if own and unit and own != unit:
        problems.append(sheet.problem(0, "the cells say another unit", k, found=own, allowed=unit))
    unit, by = (own, "cells") if own else (unit, by)
    if unit and unit_kind(unit) != si:
        problems.append(sheet.problem(None, f"{unit!r} is no unit of this kind", k, allowed=f"a unit of {si}"))
    elif unit or not optional:
        return _Numbers(units.to_si(values, unit) if unit else values, unit, by)
    return None


def _cell_numbers(
    sheet: Sheet, k: int, cells: Sequence[str], optional: npt.NDArray[np.bool_], problems: list[Problem]
) -> tuple[Array, str]:
    """Numbers (N,) of a column, NaN where a cell that may be empty (N,) is, and the unit where the cells say it."""
    values = np.full(len(cells), math.nan)
    said: dict[str, int] = {}
    bare: list[int] = []
    for i, cell in enumerate(cells):
        if not cell:
            if not optional[i]:
                problems.append(sheet.problem(i, "this cell is empty", k, allowed="a number"))
            continue
        found = _WITH_UNIT.fullmatch(cell)
        unit = unit_of(found[2]) if found is not None else None
        text = found[1] if found is not None and unit is not None else cell
        bare += [] if found is not None else [i]
        if unit is not None:
            said.setdefault(unit, i)
        if NUMBER.fullmatch(text) is None or (sheet.decimal == "," and _GROUPED.fullmatch(text)):
            hint = "Write no sign between thousands." if {",", "."} <= set(cell) or "'" in cell else None
            problems.append(sheet.problem(i, "is no number", k, found=repr(cell), hint=hint))
            continue
        values[i] = float(text.replace(",", "."))
        if not math.isfinite(values[i]) or abs(values[i]) > _BEYOND:
            problems.append(sheet.problem(i, "is beyond what any column holds", k, found=repr(cell)))
    hint = "Export all points in one unit."
    if len(said) > 1:
        (one, _), (other, i) = list(said.items())[:2]
        problems.append(sheet.problem(i, f"two units in one column: {one}, and here {other}", k, hint=hint))
    elif said and bare:
        found = repr(cells[bare[0]])
        problems.append(sheet.problem(bare[0], "says no unit, other rows do", k, found=found, hint=hint))
    return values, next(iter(said)) if len(said) == 1 and not bare else ""


def _times(
    sheet: Sheet, k: int, dates: Sequence[str], unit: str, by: str, options: ImportOptions, problems: list[Problem]
) -> _Numbers | None:
    """Times (N,) s, and what they are counted from; None for counts of no unit that nobody needs."""
    cells = sheet.cells(k)
    if not unit and NUMBER.fullmatch(cells[0]) and options.join != "time" and "time" not in options.columns:
        return None
    values = np.full(len(cells), math.nan)
    clocks: dict[str, int] = {}
    for i, (cell, date) in enumerate(zip(cells, dates, strict=True)):
        found = moment(cell, unit, date)
        if found is not None:
            values[i] = found[0]
            clocks.setdefault(found[1], i)
        elif NUMBER.fullmatch(cell):
            message, argument = "nothing says the unit of these times", ("unit", "s")
            problems.append(sheet.problem(i, message, k, hint="State it.", argument=argument))
            break
        else:
            message = "is no time that can be read in one way"
            allowed = "seconds, 13:45:01.5, or 2026-03-09 13:45:01.5"
            hint = "Leave the column out, if no time is needed."
            argument = ("ignore", quoted_word(sheet.column(k)))
            found = repr(cell)
            problems.append(sheet.problem(i, message, k, found=found, allowed=allowed, hint=hint, argument=argument))
    if len(clocks) > 1:
        i = list(clocks.values())[1]
        problems.append(sheet.problem(i, "times of two kinds in one column", k, found=repr(cells[i])))
    return _Numbers(values, unit, by if unit else "format", next(iter(clocks), ""))


def quoted_word(text: str) -> str:
    """A word as a shell takes it."""
    return f"'{text}'" if re.search(r"[^\w.]", text) else text


def _unit_problems(sheet: Sheet, taken: Sequence[Taken]) -> list[Problem]:
    """Coordinates in different units, and angles in different units or in none that anybody says."""
    out: list[Problem] = []
    for what, wanted in (("coordinates", XYZ), ("angles", joint_stems(12))):
        own = [t for t in taken if t.role in wanted]
        found = list(dict.fromkeys(t.unit for t in own))
        if len(found) > 1:
            names = ", ".join(f"{t.column} in {t.unit or 'no stated unit'}" for t in own)
            message, hint = f"the {what} are in several units", "Export them in one unit."
            out.append(sheet.problem(None, message, found=names, hint=hint))
        elif found == [""] and what == "angles":
            places = [k for t in own if (k := _place(sheet, t.column)) is not None]
            small = all(abs(v) <= 6.3 for k in places for v in _decimals(sheet, k))  # a whole turn, in rad
            problem = sheet.problem(None, "nothing says the unit of the angles", hint="State it.")
            out.append(replace(problem, column=own[0].column, argument=("unit", "rad" if small else "deg")))
    return out
