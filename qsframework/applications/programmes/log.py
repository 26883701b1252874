"""The programmed positions of a programme as a log of joint angles, for `import`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from qsframework.applications.programmes import fanuc, krl
from qsframework.applications.programmes.poses import POSES
from qsframework.applications.programmes.reading import parse_source, programme_files, read_source
from qsframework.applications.programmes.source import ProgrammePoint, Source, tokenise

_SIGNS = {
    "fanuc": re.compile(r"\bP\[\s*[0-9]+[^\]\n]*\]\s*\{"),
    "kuka": re.compile(r"=\s*\{\s*(?:\w+\s*:\s*)?A1\s", re.IGNORECASE),
    "abb": re.compile(r"^\s*MODULE\s.*\bMoveAbsJ\b", re.IGNORECASE | re.DOTALL | re.MULTILINE),
    "ur": re.compile(r"^\s*def\s.*\bmovej\s*\(", re.DOTALL | re.MULTILINE),
}
_POSE = re.compile(r"pose (\S+) visit [0-9]+")


def joint_log(path: Path, text: str) -> tuple[tuple[str, ...], list[tuple[int, tuple[str, ...]]]] | None:
    """Header and rows, each with its line, of the positions in joint angles that a text holds; None if it holds none.

    A FANUC position has the name that stands in it, if any; a KUKA one that of its variable, without the X in front;
    others, and those of a KUKA module's .src, the pose that a remark before their motion names, else their own.
    """
    maker = next((maker for maker, sign in _SIGNS.items() if sign.search(text)), "")
    if len(module := programme_files(path)) > 1 and path.suffix.lower() == ".src":
        maker, found = "kuka", list(_moved(read_source(module[0])))
    elif maker == "fanuc":
        found = [(p.label, p) for p in fanuc.positions(path, list(tokenise(text, fanuc.GRAMMAR)))]
    elif maker == "kuka":
        found = [(re.sub(r"^X(?=\w)", "", p.name), p) for p in krl.programmed(path, text)]
    elif maker:
        found = list(_moved(parse_source(maker, {path: text}, {})))
    else:
        return None
    letter, unit = POSES[maker].letter, "deg" if POSES[maker].angle < 1.0 else "rad"
    rows = [(p.line, (name, *angles)) for name, p in found if (angles := _angles(p, letter))]
    axes = min((len(cells) - 1 for _, cells in rows), default=0)
    header = ("name", *(f"{letter}{k + 1} [{unit}]" for k in range(axes)))
    return (header, [(line, cells[: axes + 1]) for line, cells in rows]) if rows else None


def _moved(source: Source) -> Iterator[tuple[str, ProgrammePoint]]:
    """The points that motions go to, by the poses that remarks name."""
    points, name, seen = {p.name: p for p in source.points}, "", set[str]()
    goes = {(m.statement.path, m.statement.tokens[-1].start): m.points for m in source.motions}
    for statement in source.lines:
        if statement.remark is not None:
            name = said[1] if (said := _POSE.fullmatch(statement.remark)) else name
            continue
        for point in goes.get((statement.path, statement.tokens[-1].start), ()):
            shown, name = name or point, ""
            if shown not in seen:
                seen.add(shown)
                yield shown, points[point]


def _angles(point: ProgrammePoint, letter: str) -> Iterable[str]:
    """The angles of axes 1, 2, ... as far as they follow each other."""
    out = list[str]()
    while (cell := point.cells.get(f"{letter}{len(out) + 1}")) is not None:
        out.append(repr(cell.value))
    return out
