"""ACME's language: `P1 = [10.0, 20.0, ...]` states a point in deg, `MOVE P1` goes there, `;` begins a remark."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from qsframework.plugin import (
    NUMBER,
    Language,
    Orientation,
    Parts,
    Programme,
    ProgrammeMotion,
    ProgrammePoint,
    SourceStatement,
    bracketed,
    numbers,
    statements,
    tokenise,
    unmoved,
)

GRAMMAR = re.compile(rf"(?P<remark>;[^\n]*)|(?P<end>\n)|(?P<word>[A-Za-z]\w*)|{NUMBER}|(?P<sign>[^\s\w])")


class Acme(Language):
    """Joint angles only: a pose is kept as it is."""

    maker = "ACME"
    endings = written = (".acme",)
    form = "acme"
    pose = Orientation(axes=("X", "Y", "Z", "A", "B", "C"), letter="J", stated="X, Y, Z, A, B, C in mm and deg")

    def read(self, texts: Mapping[Path, str]) -> Parts:
        """The points and the motions of a file."""
        ((path, text),) = texts.items()
        lines = list(statements(path, tokenise(text, GRAMMAR)))
        points = [point for line in lines if (point := stated(line)) is not None]
        known = {point.name for point in points}
        motions = [motion(line, known) for line in lines if line.upper[0] == "MOVE"]
        return lines, points, motions, {}, {}

    def write(self, programme: Programme, name: str) -> tuple[str, ...]:
        """One point and one motion for each stop."""
        lines = [f"; {name}, at {programme.speed} percent"]
        for number, move in enumerate(programme.moves, start=1):
            angles = ", ".join(f"{angle:.4f}" for angle in np.rad2deg(move.pendant))
            lines += [f"P{number} = [{angles}]", f"; {move.pose}", f"MOVE P{number}"]
        return ("\n".join(lines) + "\n",)


def stated(line: SourceStatement) -> ProgrammePoint | None:
    """The point that a line states: each number with the characters where it stands."""
    if len(line.tokens) < 4 or line.tokens[1].text != "=" or line.remark is not None:
        return None
    cells = numbers(bracketed(line.tokens, 2) or ()) or []
    named = {f"J{k}": cell for k, cell in enumerate(cells, start=1)}
    return ProgrammePoint(name=line.tokens[0].text, path=line.path, line=line.line, cells=named)


def motion(line: SourceStatement, known: set[str]) -> ProgrammeMotion:
    """Where a line moves to; a point that the file does not state cannot be corrected."""
    name = line.tokens[1].text if len(line.tokens) > 1 else ""
    problem = None if name in known else unmoved(line, f"{name or 'nothing'} is not stated in the file", name)
    return ProgrammeMotion(statement=line, points=(name,) if name in known else (), keep=name, problem=problem)
