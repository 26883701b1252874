"""An arm from a table of Denavit and Hartenberg: a CSV file with a row for each joint.

    standard:        T_k = Rz(theta_k + q_k) Tz(d_k) Tx(a_k) Rx(alpha_k)
    modified, Craig: T_k = Rx(alpha_k) Tx(a_k) Rz(theta_k + q_k) Tz(d_k)

The flange is at T_1 T_2 ... T_n of the base. In the modified table a row holds a and alpha from the axis before.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

import numpy as np

from qsf_onboarding.chain import MOST_JOINTS
from qsframework import plausible, units
from qsframework.errors import InputError, Problem, nearest, refuse
from qsframework.files import read_text
from qsframework.plugin import Array
from qsframework.robot.denavit import along
from qsframework.robot.urdf import Joint, Link, Origin, Urdf
from qsframework.robot.xml_tree import XmlPlace

_KINDS = {"a": "m", "alpha": "rad", "d": "m", "theta": "rad", "min": "rad", "max": "rad"}
_SHOWN = ("a_mm", "alpha_deg", "d_mm", "theta_deg")
_OPTIONAL = ("joint", "min_deg", "max_deg")


@dataclass(frozen=True)
class _Row:
    """A joint: its name, its numbers in SI by column, the line in the file."""

    joint: str
    values: dict[str, float]
    line: int


def read_denavit(path: Path, modified: bool = False) -> Urdf:
    """The arm of a table: links `base`, `link_1` .. `link_n`, `flange`; every joint turns about its z.

    Columns: a_mm, alpha_deg, d_mm, theta_deg, and if wished joint, min_deg, max_deg; other units of length and angle
    are read too. InputError with every wrong cell.
    """
    lines = _lines(path)
    columns = _columns(path, *lines[0])
    rows = _rows(path, lines[1:], columns)
    between = [along(0, row.values["a"], row.values["alpha"]) for row in rows]
    steps = [b @ along(2, row.values["d"], row.values["theta"]) for row, b in zip(rows, between, strict=True)]
    end = np.eye(4)
    if not modified:
        theta = [along(2, 0.0, row.values["theta"]) for row in rows]
        after = [along(2, row.values["d"], 0.0) @ b for row, b in zip(rows, between, strict=True)]
        steps = [before @ t for before, t in zip([np.eye(4), *after[:-1]], theta, strict=True)]
        end = after[-1]
    steps = [*steps, end]
    if max(abs(row.values["d"]) for row in rows) > _LONG:
        steps = _slid(steps)
    lengths = [float(np.linalg.norm(step[:3, 3])) for step in steps]
    refuse(list(_other_units(path, lines[0][0], columns, rows, max(lengths) > _LONG)))
    if max(lengths) > plausible.RANGES["m"].most:
        row, hint = max(rows, key=lambda row: abs(row.values["d"])), "Large d of parallel axes must cancel each other."
        message = f"joint {row.joint!r} leads {max(lengths):.6g} m away: no arm has such a link"
        raise InputError(Problem(message, file=str(path), line=row.line, allowed="up to 100 m", hint=hint))
    names = ["base", *(f"link_{k + 1}" for k in range(len(rows))), "flange"]
    links = tuple(Link(name, XmlPlace(str(path), None), None, ()) for name in names)
    joints = [
        _joint(path, row, names[k], names[k + 1], steps[k], "revolute" if "min" in row.values else "continuous")
        for k, row in enumerate(rows)
    ]
    last = _joint(path, _Row("to_flange", {}, rows[-1].line), names[-2], names[-1], steps[-1], "fixed")
    return Urdf(path, links, (*joints, last), ())


def _slid(steps: list[Array]) -> list[Array]:
    """The placements of joints and flange, each in the one before, with frames slid along their joints' axes to the
    point that is nearest to the frame before: nearly parallel axes have far frames, whose d cancel."""
    frames = list(accumulate(steps, np.matmul))
    for k, frame in enumerate(frames[:-1]):
        before = frames[k - 1][:3, 3] if k else np.zeros(3)
        frames[k] = frame @ along(2, (before - frame[:3, 3]) @ frame[:3, 2], 0.0)
    return [np.linalg.solve(before, frame) for before, frame in zip([np.eye(4), *frames[:-1]], frames, strict=True)]


def _joint(path: Path, row: _Row, parent: str, child: str, placement: Array, kind: str) -> Joint:
    return Joint(
        name=row.joint,
        kind=kind,
        parent=parent,
        child=child,
        origin=Origin(placement[:3, 3], _rpy(placement[:3, :3])),
        axis=np.array([0.0, 0.0, 1.0]),
        limits=(row.values["min"], row.values["max"]) if "min" in row.values else None,
        mimic=None,
        place=XmlPlace(str(path), row.line),
    )


def _rpy(rotation: Array) -> Array:
    """Roll, pitch and yaw (3,) of Rz(yaw) Ry(pitch) Rx(roll), to rounding also where the pitch is a quarter turn."""
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    s, c = np.sin(yaw), np.cos(yaw)
    pitch = np.arctan2(-rotation[2, 0], c * rotation[0, 0] + s * rotation[1, 0])
    roll = np.arctan2(s * rotation[0, 2] - c * rotation[1, 2], c * rotation[1, 1] - s * rotation[0, 1])
    return np.array([roll, pitch, yaw])


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """The cells of the header and of each joint, each with its line in the file; separated by , ; tabs or blanks."""
    lines = [(n, text) for n, text in enumerate(read_text(path).splitlines(), 1) if text.strip(" ,;\t")]
    lines = [(n, text) for n, text in lines if not text.lstrip().startswith("#")]
    if len(lines) < 2:
        hint = f"The first line is {','.join(_SHOWN)}, then a line follows for each joint."
        raise InputError(Problem("holds no joint", file=str(path), hint=hint))
    if len(lines) - 1 > MOST_JOINTS:
        allowed = f"up to {MOST_JOINTS}"
        raise InputError(Problem(f"holds {len(lines) - 1} joints", file=str(path), allowed=allowed))
    head = lines[0][1].rstrip(" ,;\t")
    between = next((mark for mark in ";,\t" if mark in head), None)
    width = len(head.split(between))
    out: list[tuple[int, list[str]]] = []
    for n, text in lines:
        cells = [cell.strip() for cell in (next(csv.reader([text], delimiter=between)) if between else text.split())]
        while len(cells) > width and not cells[-1]:
            cells.pop()
        out.append((n, text.split() if between == "\t" and len(cells) != width else cells))
    return out


def _rows(path: Path, lines: list[tuple[int, list[str]]], columns: list[tuple[str, str]]) -> list[_Row]:
    """The joints; InputError with every wrong cell."""
    problems: list[Problem] = []
    rows = [_row(path, k, line, columns, problems) for k, line in enumerate(lines, 1)]
    for k, row in enumerate(rows):
        if row.joint in [other.joint for other in rows[:k]]:
            message = f"joint {row.joint!r} stands here a second time"
            problems.append(Problem(message, file=str(path), line=row.line, column="joint"))
    refuse(problems)
    return rows


def _other_units(
    path: Path, line: int, columns: list[tuple[str, str]], rows: list[_Row], far: bool
) -> Iterator[Problem]:
    """Columns whose numbers are those of another unit than their header's. far: a link is longer than arms have them"""
    for stem, unit in columns:
        numbers = [abs(row.values[stem]) for row in rows if row.values.get(stem)]
        found = np.array(units.from_si(np.array(numbers), unit)) if stem in _KINDS else np.zeros(0)
        meant = _meant(stem, unit, found, far) if len(found) > 1 else ""
        if meant:
            message = f"the numbers of {stem}_{unit} look like {meant}"
            hint = f"Name the column {stem}_{meant} if they are; else correct them."
            shown = f"up to {found.max():g} {unit}"
            yield Problem(message, file=str(path), line=line, column=f"{stem}_{unit}", found=shown, hint=hint)


def _meant(stem: str, unit: str, found: Array, far: bool) -> str:
    """The unit of which the sizes (two or more, not 0) of a column are, where it is not its own."""
    largest, turn = found.max(), 2.0 * np.pi
    if unit == "mm":
        return "m" if largest < _SHORT else ""
    if unit == "m":
        return "mm" if largest > _LONG and far else ""
    limits = stem in ("min", "max")
    if unit == "deg":
        eighths = found / (turn / 8.0)
        return (
            "rad" if largest <= 1.01 * turn and (limits or np.allclose(eighths, np.round(eighths), atol=0.01)) else ""
        )
    return "deg" if unit == "rad" and largest > (4.0 * turn if limits else 1.01 * turn) else ""


_SHORT, _LONG = 5.0, 30.0
"""mm, m: no arm has links that are all shorter, or any that is longer."""
_FAR = 1e4
"""m: of d, where axes are nearly parallel and the next d cancels it."""


def _columns(path: Path, line: int, head: list[str]) -> list[tuple[str, str]]:
    """What each column holds, and its unit. InputError with every unknown one and what is missing."""
    problems: list[Problem] = []
    allowed = ", ".join((*_SHOWN, *_OPTIONAL))
    found: list[tuple[str, str]] = []
    for name in head:
        stem, unit = ("joint", "") if name == "joint" else units.split(name, list(_KINDS)) or (name, "")
        wrong = None
        if stem not in (*_KINDS, "joint"):
            wrong = "unknown column"
        elif stem in [other for other, _ in found]:
            wrong = f"a second column for {stem}"
        elif stem != "joint" and not (units.known(unit) and units.same_dimension(unit, _KINDS[stem])):
            wrong = f"{name!r} does not end in a unit of {'length' if _KINDS[stem] == 'm' else 'angle'}"
        if wrong:
            hint = nearest(name, (*_SHOWN, *_OPTIONAL))
            problems.append(Problem(wrong, file=str(path), line=line, column=name, allowed=allowed, hint=hint))
        found.append((stem, unit))
    stems = [stem for stem, _ in found]
    missing = [name for name in _SHOWN if name.partition("_")[0] not in stems]
    missing += [f"{a}_deg" for a, b in (("min", "max"), ("max", "min")) if b in stems and a not in stems]
    if missing and not problems:
        message = f"column{'s' * (len(missing) > 1)} missing: {', '.join(missing)}"
        problems.append(Problem(message, file=str(path), line=line, found=", ".join(head), allowed=allowed))
    refuse(problems)
    return found


def _row(
    path: Path, number: int, at: tuple[int, list[str]], columns: list[tuple[str, str]], problems: list[Problem]
) -> _Row:
    line, cells = at

    def refuse(message: str, column: str | None = None, found: str | None = None, allowed: str | None = None) -> None:
        place = XmlPlace(str(path), line)
        problems.append(place.problem(message, column=column, found=found, allowed=allowed))

    if len(cells) != len(columns):
        refuse("has not as many cells as there are columns", found=f"{len(cells)}", allowed=f"{len(columns)}")
        return _Row(f"joint_{number}", {}, line)
    joint, values = f"joint_{number}", dict[str, float]()
    for (stem, unit), cell in zip(columns, cells, strict=True):
        name = f"{stem}_{unit}"
        if stem == "joint":
            joint = cell or joint
            continue
        if not cell and stem in ("min", "max"):
            continue
        try:
            value = float(units.to_si(float(cell), unit)) if cell.isascii() else np.nan
        except ValueError:
            value = np.nan
        if not abs(value) <= (_FAR if stem == "d" else plausible.RANGES[_KINDS[stem]].most):
            shown = plausible.allowed(plausible.RANGES[_KINDS[stem]], _KINDS[stem])
            refuse(f"{name} must be a number, with a decimal point", name, found=repr(cell[:40]), allowed=shown)
        values[stem] = value
    if ("min" in values) != ("max" in values):
        refuse("has one limit of two", "min" if "max" in values else "max")
    elif "min" in values and values["min"] >= values["max"]:
        refuse("the lower limit must be below the upper", found=f"{values['min']:g} .. {values['max']:g} rad")
    return _Row(joint, values, line)
