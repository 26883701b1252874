"""The points of a programme that exists already, FANUC LS (.ls) or KUKA KRL (.src and .dat): where each number stands.

A point is joint angles or a pose of the tool in a user frame. What is not a point is never touched: `replaced` puts new
numbers in the places of the old ones and leaves every other character as it is.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from qsframework.errors import InputError, Problem
from qsframework.files import read_text

ENDINGS = (".ls", ".src", ".dat")
POSES = {"fanuc": ("X", "Y", "Z", "W", "P", "R"), "kuka": ("X", "Y", "Z", "A", "B", "C")}
"""Names of a pose's numbers, mm and degrees; FANUC turns about x, y, z, KUKA about z, y, x."""
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_MOST = 20_000
"""Points of a programme."""


@dataclass(frozen=True)
class Cell:
    """A number of a point: its value as the file has it, mm or deg, and the characters where it stands."""

    value: float
    start: int
    stop: int


@dataclass(frozen=True, kw_only=True)
class ProgrammePoint:
    """A point of a programme. cells: its numbers by their names; tool, frame: as the point states them, "" if not."""

    name: str
    path: Path
    line: int
    cells: Mapping[str, Cell]
    tool: str = ""
    frame: str = ""

    @property
    def cartesian(self) -> bool:
        return "X" in self.cells


@dataclass(frozen=True, kw_only=True)
class Source:
    """A programme: the text of each of its files, its points, and the lines whose motion is shifted when it runs."""

    maker: str
    texts: Mapping[Path, str]
    points: tuple[ProgrammePoint, ...]
    shifted: tuple[int, ...] = ()


def read_source(path: str | Path) -> Source:
    """Read a programme by its ending; of KRL the module, .src and .dat, whichever of the two is named.

    InputError with every problem, each with its line.
    """
    path = Path(path)
    if path.suffix.lower() == ".ls":
        return parse_source("fanuc", {path: read_text(path)})
    both = [p for p in (path.with_suffix(".src"), path.with_suffix(".dat")) if p.is_file()]
    return parse_source("kuka", {p: read_text(p) for p in both or [path]})


def parse_source(maker: str, texts: Mapping[Path, str]) -> Source:
    """A programme of "fanuc" or "kuka" from the text of each of its files. InputError as of `read_source`."""
    if maker == "kuka":
        return _read_krl(dict(texts))
    ((path, text),) = texts.items()
    return _read_fanuc(path, text)


def skeleton(source: Source) -> dict[Path, str]:
    """The texts with a mark in the place of every number of a point and of the blanks before it."""
    out: dict[Path, str] = {}
    for path, text in source.texts.items():
        cells = [cell for p in source.points if p.path == path for cell in p.cells.values()]
        for cell in sorted(cells, key=lambda c: -c.start):
            text = text[: cell.start].rstrip(" ") + "#" + text[cell.stop :]
        out[path] = text
    return out


def replaced(source: Source, values: Mapping[str, Mapping[str, float]]) -> dict[Path, str]:
    """The texts with new numbers, by the points' names; everything else as it stands."""
    edits: dict[Path, list[tuple[Cell, float]]] = {path: [] for path in source.texts}
    for point in source.points:
        edits[point.path] += [(point.cells[name], value) for name, value in values.get(point.name, {}).items()]
    out: dict[Path, str] = {}
    for path, text in source.texts.items():
        for cell, value in sorted(edits[path], key=lambda e: -e[0].start):
            text = _put(text, cell, value)
        out[path] = text
    return out


def _put(text: str, cell: Cell, value: float) -> str:
    """The number in its place; blanks in front of it make room where there are any."""
    old = text[cell.start : cell.stop]
    digits = max(4, len(old.partition(".")[2]) if "e" not in old.lower() else 0)
    new = f"{value + 0.0:.{digits}f}"
    before = text[: cell.start]
    blanks = len(before) - len(before.rstrip(" "))
    room = min(max(len(new) - len(old), 0), max(blanks - 1, 0))
    return before[: len(before) - room] + new.rjust(len(old)) + text[cell.stop :]


def _line(text: str, at: int) -> int:
    return text.count("\n", 0, at) + 1


def _check(points: Sequence[ProgrammePoint], problems: list[Problem]) -> None:
    """InputError with the problems so far, with names that stand twice, and where there is no point at all."""
    seen: dict[str, ProgrammePoint] = {}
    for point in points:
        if (other := seen.setdefault(point.name, point)) is not point:
            said = f"{point.name} stands here a second time, first in line {other.line}"
            problems.append(Problem(said, str(point.path), point.line))
    if problems:
        raise InputError(problems[:1000])


def _cells(text: str, start: int, stop: int, pattern: re.Pattern[str]) -> dict[str, Cell]:
    """Numbers by their names in a part of a text; the pattern's groups: name, number."""
    found = pattern.finditer(text, start, stop)
    return {m[1].upper(): Cell(float(m[2]), m.start(2), m.end(2)) for m in found}


_BLOCK = re.compile(r"^[ \t]*P\[\s*(\d+)\s*(?::[^\]\n]*)?\]\s*\{([^{}]*)\}\s*;", re.MULTILINE)
_OPENED = re.compile(r"^[ \t]*P\[\s*(\d+)", re.MULTILINE)
_GROUP = re.compile(r"\bGP(\d+)\s*:")
_FRAMES = re.compile(r"UF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)")
_FANUC_CELL = re.compile(rf"\b([JE]\d|[XYZWPR])\s*=\s*({_NUMBER})\s*(?:deg|mm)\b")
_FANUC_NAME = re.compile(r"\b([JE]\d|[XYZWPR])\s*=\s*([^,\n]*)")
_USED = re.compile(r"\bP\[\s*(\d+)")
_SHIFT = re.compile(r"^\s*\d+:\s*[JLCA] .*\b(?:INC|Offset|Tool_Offset|VOFFSET)\b", re.MULTILINE)


def _read_fanuc(path: Path, text: str) -> Source:
    problems = list[Problem]()
    head, mark, _ = text.partition("/POS")
    start, end = len(head), text.rfind("/END")
    if not text.lstrip().startswith("/PROG") or "/MN" not in head or not mark or end < start:
        missing = [m for m in ("/PROG", "/MN", "/POS", "/END") if m not in text] or ["the order of its parts"]
        message = f"is no whole FANUC listing: {', '.join(missing)} is missing or not in its place"
        raise InputError(Problem(message, str(path), 1, allowed="/PROG, /ATTR, /MN, /POS, /END"))
    points = list[ProgrammePoint]()
    closed = {m.start() for m in _BLOCK.finditer(text, start, end)}
    for opened in _OPENED.finditer(text, start, end):
        if opened.start() not in closed:
            hint = "A point ends in `};` before the next one begins."
            problems.append(Problem(f"P[{opened[1]}] does not end", str(path), _line(text, opened.start()), hint=hint))
    for block in _BLOCK.finditer(text, start, end):
        points += _fanuc_point(path, text, block, problems)
    body = text.index("/MN")
    known = {m[1] for m in _OPENED.finditer(text, start, end)}
    for used in _USED.finditer(text, body, start):
        if used[1] not in known:
            line = _line(text, used.start())
            problems.append(Problem(f"P[{used[1]}] is moved to, but has no position under /POS", str(path), line))
            known.add(used[1])
    if not points and not problems:
        problems.append(Problem("holds no position under /POS", str(path), _line(text, start)))
    _check(points, problems)
    shifted = tuple(_line(text, m.start()) for m in _SHIFT.finditer(text, body, start))
    return Source(maker="fanuc", texts={path: text}, points=tuple(points[:_MOST]), shifted=shifted)


def _fanuc_point(path: Path, text: str, block: re.Match[str], problems: list[Problem]) -> list[ProgrammePoint]:
    """The first group of a point; the others are positioners, which nothing bends."""
    name, (start, stop) = f"P[{block[1]}]", block.span(2)
    groups = list(_GROUP.finditer(text, start, stop))
    if groups:
        start = groups[0].end()
        stop = groups[1].start() if len(groups) > 1 else stop
    frames = _FRAMES.search(text, start, stop)
    cells = _cells(text, start, stop, _FANUC_CELL)
    for m in _FANUC_NAME.finditer(text, start, stop):
        if m[1] not in cells:
            line, found = _line(text, m.start()), m[2].strip() or "nothing"
            message, allowed = f"{name}: {m[1]} is no number with its unit", "a number with deg or mm"
            problems.append(Problem(message, str(path), line, found=found[:40], allowed=allowed))
            return []
    if frames is None:
        problems.append(Problem(f"{name} states no UF and UT", str(path), _line(text, block.start())))
        return []
    line = _line(text, block.start())
    return [ProgrammePoint(name=name, path=path, line=line, cells=cells, tool=frames[2], frame=frames[1])]


_DECLARED = re.compile(
    r"^[ \t]*(?:(?:GLOBAL|DECL)[ \t]+){0,2}(E6AXIS|AXIS|E6POS|POS)[ \t]+(\$?\w+)[ \t]*=[ \t]*([^\n]*)",
    re.MULTILINE | re.IGNORECASE,
)
_FDAT = re.compile(
    r"^[ \t]*(?:DECL[ \t]+)?(?:GLOBAL[ \t]+)?FDAT[ \t]+(\w+)[ \t]*=[ \t]*\{TOOL_NO (\d+),BASE_NO (\d+)",
    re.MULTILINE | re.IGNORECASE,
)
_INLINE = re.compile(r"^[ \t]*S?(?:PTP|LIN|CIRC)[ \t]*(\{[^;\n]*)", re.MULTILINE | re.IGNORECASE)
_RELATIVE = re.compile(r"^[ \t]*S?(?:PTP|LIN|CIRC)_REL\b", re.MULTILINE | re.IGNORECASE)
_AGGREGATE = re.compile(r"\{([^{}]*)\}")
_KRL_CELL = re.compile(rf"\b([AEae][1-6]|[XYZABCxyzabc])[ \t]+({_NUMBER})(?=[ \t]*[,}}])")
_KRL_NAME = re.compile(r"(?<=[{,])[ \t]*([A-Za-z]\w*)\b[ \t]*([^,{}]*)")
_UNTOUCHED = ("S", "T")


def _read_krl(texts: dict[Path, str]) -> Source:
    points, problems, shifted = list[ProgrammePoint](), list[Problem](), list[int]()
    frames: dict[str, tuple[str, str]] = {}
    for path, text in texts.items():
        _module(path, text, problems)
        frames |= {m[1].upper(): (m[2], m[3]) for m in _FDAT.finditer(text)}
        shifted += [_line(text, m.start()) for m in _RELATIVE.finditer(text)]
    for path, text in texts.items():
        for name, start, stop in _aggregates(path, text, problems):
            point = _krl_point(path, text, name, (start, stop), problems)
            tool, frame = frames.get(f"F{name[1:]}".upper(), ("", ""))
            points += [] if point is None else [replace(point, tool=tool, frame=frame)]
    path = next(iter(texts))
    if not points and not problems:
        problems.append(Problem("holds no point of numbers", str(path), 1))
    _check(points, problems)
    return Source(maker="kuka", texts=texts, points=tuple(points[:_MOST]), shifted=tuple(shifted))


def _module(path: Path, text: str, problems: list[Problem]) -> None:
    """What a file of a module begins and ends with."""
    opened, closed = ("DEFDAT", "ENDDAT") if path.suffix.lower() == ".dat" else ("DEF", "END")
    lines = [line.strip().upper() for line in text.splitlines()]
    begins = any(re.match(rf"(GLOBAL\s+)?{opened}(FCT)?\b", line) for line in lines)
    ends = any(re.match(rf"{closed}(FCT)?\b", line) for line in lines)
    if not begins or not ends:
        where, missing = (len(lines), closed) if begins else (1, opened)
        message = f"is no whole {path.suffix.lower()} of KRL: {missing} is missing"
        problems.append(Problem(message, str(path), max(where, 1), allowed=f"{opened} ... {closed}"))


def _aggregates(path: Path, text: str, problems: list[Problem]) -> Iterator[tuple[str, int, int]]:
    """Every aggregate of a point: its name, and where it stands."""
    for m in _DECLARED.finditer(text):
        whole = _AGGREGATE.match(text, m.start(3), m.end(3))
        if whole is None:
            message, hint = f"{m[2]} does not end", "A point stands in braces on one line."
            problems.append(Problem(message, str(path), _line(text, m.start()), found=m[3].strip()[:40], hint=hint))
        else:
            yield m[2], *whole.span()
    for m in _INLINE.finditer(text):
        line, end = _line(text, m.start()), m.end(1)
        parts = list(_AGGREGATE.finditer(text, m.start(1), end))
        if (
            not parts
            or text.count("{", m.start(1), end) != len(parts)
            or text.count("}", m.start(1), end) != len(parts)
        ):
            problems.append(Problem("the point of this motion does not end", str(path), line, found=m[1].strip()[:40]))
            continue
        for k, part in enumerate(parts, start=1):
            yield f"line {line}" + (f".{k}" if len(parts) > 1 else ""), *part.span()


def _krl_point(
    path: Path, text: str, name: str, span: tuple[int, int], problems: list[Problem]
) -> ProgrammePoint | None:
    line, cells = _line(text, span[0]), _cells(text, *span, _KRL_CELL)
    for m in _KRL_NAME.finditer(text, *span):
        if m[1].upper() not in cells and m[1].upper() not in _UNTOUCHED:
            message = f"{name}: {m[1]} is no number of a point"
            allowed = "A1 to A6 or X, Y, Z, A, B, C, S, T; E1 to E6; each with a number"
            problems.append(Problem(message, str(path), line, found=m[2].strip()[:40] or "nothing", allowed=allowed))
            return None
    return ProgrammePoint(name=name, path=path, line=line, cells=cells)


def incomplete(point: ProgrammePoint, needed: Iterable[str]) -> Problem | None:
    """What a point lacks of the numbers that it needs."""
    missing = [name for name in needed if name not in point.cells]
    if not missing:
        return None
    found = ", ".join(point.cells) or "nothing"
    return Problem(f"{point.name} lacks {', '.join(missing)}", str(point.path), point.line, found=found)
