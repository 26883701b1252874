"""A robot programme as it was read: tokens, statements, points, motions, and where each number of a point stands.

Every motion is accounted for: it goes to points of numbers, to where the arm stands, or `problem` says why it cannot be
corrected. `replaced` puts new numbers in the places of the old ones and leaves every other character as it is.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from qsframework.errors import Problem
from qsframework.plugin.facts import Array

NUMBER = r"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
_OPEN, _SHUT = "([{", ")]}"
AMBIGUOUS = "?"
"""A tool or frame that depends on the way that the programme takes."""
_SHOWN = 60


@dataclass(frozen=True, slots=True)
class Token:
    """A piece of a text; kind: the name of the group of its language's pattern."""

    kind: str
    text: str
    start: int
    line: int

    @property
    def stop(self) -> int:
        return self.start + len(self.text)


@dataclass(frozen=True)
class SourceStatement:
    """One instruction, or one remark, of a file."""

    path: Path
    tokens: Sequence[Token]

    @property
    def line(self) -> int:
        return self.tokens[0].line

    @property
    def upper(self) -> list[str]:
        """Its tokens in capitals."""
        return [token.text.upper() for token in self.tokens]

    @property
    def remark(self) -> str | None:
        """What a remark says, without its sign and its end; None of an instruction."""
        if self.tokens[0].kind != "remark":
            return None
        return re.sub(r"^\s*[0-9]*\s*:?\s*(?:--\w*:?|//|[!;#])\s*|\s*;?\s*$", "", self.tokens[0].text)

    def after(self, start: int) -> SourceStatement:
        """From a token on."""
        return SourceStatement(self.path, self.tokens[start:])

    def __str__(self) -> str:
        return shown(self.tokens)


@dataclass(frozen=True)
class Cell:
    """A number of a point: its value as the file has it, and the characters where it stands."""

    value: float
    start: int
    stop: int


@dataclass(frozen=True, kw_only=True)
class ProgrammePoint:
    """A point of a programme. cells: its numbers by their names; tool, frame: as the programme states them, "" if not.

    label: the name that a FANUC position bears beside its number; problem: why its numbers cannot be corrected
    """

    name: str
    path: Path
    line: int
    cells: Mapping[str, Cell]
    tool: str = ""
    frame: str = ""
    label: str = ""
    problem: Problem | None = None

    @property
    def cartesian(self) -> bool:
        return "X" in self.cells


@dataclass(frozen=True, kw_only=True)
class ProgrammeMotion:
    """A motion. points: where it goes, and through; keep: the name by which it is left as it is; stands: it goes where
    the arm stands; problem: why it cannot be corrected, whatever its points are."""

    statement: SourceStatement
    points: tuple[str, ...] = ()
    keep: str = ""
    stands: bool = False
    problem: Problem | None = None

    @property
    def line(self) -> int:
        return self.statement.line


@dataclass(frozen=True, kw_only=True)
class Source:
    """A programme: its files' texts and encodings, its statements, points and motions in the order of the files.

    language: its name; tools, frames: matrices (4, 4) m of those whose numbers the programme itself states
    """

    language: str
    texts: Mapping[Path, str]
    encodings: Mapping[Path, str]
    lines: tuple[SourceStatement, ...]
    points: tuple[ProgrammePoint, ...]
    motions: tuple[ProgrammeMotion, ...]
    tools: Mapping[str, Array] = field(default_factory=dict[str, Array])
    frames: Mapping[str, Array] = field(default_factory=dict[str, Array])


Parts = tuple[list[SourceStatement], list[ProgrammePoint], list[ProgrammeMotion], dict[str, Array], dict[str, Array]]
"""What the reader of a language finds: statements, points, motions, and the tools and frames that it has in numbers."""


def tokenise(text: str, grammar: re.Pattern[str]) -> Iterator[Token]:
    """The tokens of a text, each of the kind of the group that it matches."""
    line, at = 1, 0
    for found in grammar.finditer(text):
        line += text.count("\n", at, found.start())
        at = found.start()
        yield Token(found.lastgroup or "", found[0], at, line)


def statements(path: Path, tokens: Iterable[Token], joined: bool = False) -> Iterator[SourceStatement]:
    """Instructions between tokens of the kind "end", and remarks; joined: an end within brackets ends nothing."""
    own, depth = list[Token](), 0
    for token in tokens:
        depth = max(0, depth + (token.text in _OPEN) - (token.text in _SHUT)) if token.kind == "sign" else depth
        if token.kind == "remark":
            yield SourceStatement(path, (token,))
        elif token.kind != "end":
            own.append(token)
        elif own and not (joined and depth):
            yield SourceStatement(path, tuple(own))
            own, depth = [], 0
    if own:
        yield SourceStatement(path, tuple(own))


def split(tokens: Sequence[Token], sign: str = ",") -> list[list[Token]]:
    """The parts between signs that stand in no bracket."""
    out, depth = [list[Token]()], 0
    for token in tokens:
        depth += (token.text in _OPEN) - (token.text in _SHUT) if token.kind == "sign" else 0
        if depth == 0 and token.text == sign:
            out.append([])
        else:
            out[-1].append(token)
    return out


def bracketed(tokens: Sequence[Token], start: int = 0) -> Sequence[Token] | None:
    """What stands in the bracket that opens at a place; None where none opens there, or it does not end."""
    depth = 0
    for k in range(start, len(tokens)):
        depth += (tokens[k].text in _OPEN) - (tokens[k].text in _SHUT) if tokens[k].kind == "sign" else 0
        if depth == 0:
            return tokens[start + 1 : k] if k > start else None
    return None


def enclosed(tokens: Sequence[Token], opening: str) -> Sequence[Token] | None:
    """What stands in a bracket that is all of it."""
    inside = bracketed(tokens) if tokens and tokens[0].text == opening else None
    return inside if inside is not None and len(inside) == len(tokens) - 2 else None


def left_of(tokens: Sequence[Token], at: int) -> int:
    """Where the variable begins that stands before a token: `p{1}.trans.z`, `XP[I].Z`."""
    k, depth = at - 1, 0
    while k > 0:
        depth += (tokens[k].text in _SHUT) - (tokens[k].text in _OPEN)
        if depth == 0 and tokens[k].text not in ("[", "{", ".") and tokens[k - 1].text != ".":
            break
        k -= 1
    return max(k, 0)


def variable(tokens: Sequence[Token]) -> str:
    """The name of a variable or of a part of it, with its element where that has a number; "" of all else."""
    if not tokens or tokens[0].kind != "word":
        return ""
    at = 1
    while at < len(tokens):
        inside = bracketed(tokens, at) if tokens[at].text in ("[", "{") else None
        if inside is None and tokens[at].text != ".":
            return ""
        at += 2 if inside is None else len(inside) + 2
    element = len(tokens) > 3 and tokens[1].text in ("[", "{") and number(tokens[2:3]) and tokens[3].text in _SHUT
    return shown(tokens[: 4 if element else 1])


def called(tokens: Sequence[Token], words: Collection[str]) -> Iterator[tuple[int, list[list[Token]]]]:
    """Where routines with brackets are called, and their arguments; words: of the language, which call nothing."""
    for k, token in enumerate(tokens[:-1]):
        if token.kind == "word" and tokens[k + 1].text == "(" and token.text.upper() not in words:
            inside = bracketed(tokens, k + 1)
            yield k, split(tokens[k + 2 :] if inside is None else inside)


def number(tokens: Sequence[Token]) -> Cell | None:
    """The number that the tokens are, sign and all."""
    signed = len(tokens) == 2 and tokens[0].text in ("-", "+")
    if len(tokens) != 1 + signed or tokens[-1].kind != "number":
        return None
    value = float(tokens[-1].text)
    return Cell(-value if tokens[0].text == "-" else value, tokens[0].start, tokens[-1].stop)


def numbers(tokens: Sequence[Token]) -> list[Cell] | None:
    """The numbers between commas, or None where any part is none."""
    cells = [number(part) for part in split(tokens)]
    return None if None in cells else [cell for cell in cells if cell is not None]


def shown(tokens: Sequence[Token], most: int = _SHOWN) -> str:
    """The tokens as a message shows them."""
    text = "".join(
        (" " if k and tokens[k - 1].stop < token.start else "") + token.text for k, token in enumerate(tokens)
    )
    return text if len(text) <= most else text[:most] + "..."


def unmoved(statement: SourceStatement, said: str, keep: str, *, allowed: str | None = None) -> Problem:
    """The problem of a motion that cannot be corrected, with the way to leave it as it is."""
    hint = f"Teach a point of numbers there, or keep {keep!r} as it is."
    here = str(statement.path)
    argument = ("keep", f"'{keep}'")
    return Problem(said, here, statement.line, found=str(statement), allowed=allowed, hint=hint, argument=argument)


def skeleton(source: Source) -> dict[Path, str]:
    """The texts with a mark in the place of every number of a point and of the blanks before it."""
    out: dict[Path, str] = {}
    for path, text in source.texts.items():
        cells = [cell for p in source.points if p.path == path for cell in p.cells.values()]
        for cell in sorted(cells, key=lambda c: -c.start):
            text = text[: cell.start].rstrip(" ") + "#" + text[cell.stop :]
        out[path] = text
    return out


def replaced(
    source: Source, values: Mapping[str, Mapping[str, float]], decimals: Callable[[str], int]
) -> dict[Path, str]:
    """The texts with new numbers, by the points' names; decimals: how many each has at least; all else as it stands."""
    out: dict[Path, str] = {}
    for path, text in source.texts.items():
        own = [p for p in source.points if p.path == path]
        edits = [(p.cells[k], v, decimals(k)) for p in own for k, v in values.get(p.name, {}).items()]
        parts, stop = list[str](), len(text)
        for cell, value, digits in sorted(edits, key=lambda e: -e[0].start):
            start, new = _put(text, cell, value, digits)
            parts += [text[cell.stop : stop], new]
            stop = start
        out[path] = "".join(reversed([*parts, text[:stop]]))
    return out


def _put(text: str, cell: Cell, value: float, digits: int) -> tuple[int, str]:
    """Where the new number begins, and the number; blanks in front of the old one make room where there are any."""
    old = text[cell.start : cell.stop]
    new = f"{value + 0.0:.{max(digits, len(old.partition('.')[2]) if 'e' not in old.lower() else 0)}f}"
    before = text[max(0, cell.start - 40) : cell.start]
    room = min(max(len(new) - len(old), 0), max(len(before) - len(before.rstrip(" ")) - 1, 0))
    return cell.start - room, new.rjust(len(old))
