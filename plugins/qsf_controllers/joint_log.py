"""Joint angles that a controller's programme holds: a joint log for the points of a tracker."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from qsf_controllers import fanuc, krl
from qsframework.plugin import (
    MeasuredFile,
    PointTable,
    ProgrammePoint,
    Source,
    languages,
    parse_source,
    programme_files,
    read_source,
    tokenise,
)

_SIGNS = {
    "fanuc": re.compile(r"\bP\[\s*[0-9]+[^\]\n]*\]\s*\{"),
    "kuka": re.compile(r"=\s*\{\s*(?:\w+\s*:\s*)?A1\s", re.IGNORECASE),
    "abb": re.compile(r"^\s*MODULE\s.*\bMoveAbsJ\b", re.IGNORECASE | re.DOTALL | re.MULTILINE),
    "ur": re.compile(r"^\s*def\s.*\bmovej\s*\(", re.DOTALL | re.MULTILINE),
}
_POSE = re.compile(r"pose (\S+) visit [0-9]+")


def read(file: MeasuredFile) -> PointTable | None:
    """The positions in joint angles that a text holds; None if it holds none.

    A FANUC position has the name that stands in it, if any; a KUKA one that of its variable, without the X in front;
    others, and those of a KUKA module's .src, the pose that a remark before their motion names, else their own.
    """
    path, text = file.path, file.text
    name = next((name for name, sign in _SIGNS.items() if sign.search(text)), "")
    if path.suffix.lower() == ".src" and len(programme_files(path)) > 1:
        name, found = "kuka", list(_moved(read_source(path)))
    elif name == "fanuc":
        found = [(p.label, p) for p in fanuc.positions(path, list(tokenise(text, fanuc.GRAMMAR)))]
    elif name == "kuka":
        found = [(re.sub(r"^X(?=\w)", "", p.name), p) for p in krl.programmed(path, text)]
    elif name:
        found = list(_moved(parse_source(name, {path: text}, {})))
    else:
        return None
    pose = languages()[name].pose
    unit = "deg" if pose.angle < 1.0 else "rad"
    rows = [(p.line, (label, *angles)) for label, p in found if (angles := _angles(p, pose.letter))]
    axes = min((len(cells) - 1 for _, cells in rows), default=0)
    header = ("name", *(f"{pose.letter}{k + 1} [{unit}]" for k in range(axes)))
    logged = tuple((line, cells[: axes + 1]) for line, cells in rows)
    return PointTable("positions of a controller's programme", header, logged) if rows else None


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
