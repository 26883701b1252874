"""Robot programmes by their endings: FANUC .ls, KUKA .src and .dat, ABB .mod, Universal Robots .script."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from qsframework.applications.programmes import fanuc, krl, rapid, urscript
from qsframework.applications.programmes.poses import POSES
from qsframework.applications.programmes.source import ProgrammePoint, Source, tokenise
from qsframework.errors import InputError, Problem, refuse
from qsframework.files.documents import read_bytes

MAKERS = {
    ".ls": "fanuc",
    ".src": "kuka",
    ".dat": "kuka",
    ".mod": "abb",
    ".prg": "abb",
    ".sys": "abb",
    ".script": "ur",
}
ENDINGS = tuple(MAKERS)
_MOST = 20_000
"""Points of a programme."""


def programme_files(path: Path) -> list[Path]:
    """The files of a programme: of KRL the module, whichever of the two is named."""
    if MAKERS.get(path.suffix.lower()) != "kuka":
        return [path]
    beside = {p.suffix.lower(): p for p in sorted(path.parent.glob(f"{_plain(path.stem)}.*")) if p.is_file()}
    return [beside[e] for e in (".src", ".dat") if e in beside] or [path]


def _plain(stem: str) -> str:
    return "".join(f"[{c}]" if c in "*?[" else c for c in stem)


def read_source(path: str | Path) -> Source:
    """Read a programme by its ending; of KRL the module, .src and .dat, whichever of the two is named.

    InputError with every problem, each with its line.
    """
    texts, encodings = dict[Path, str](), dict[Path, str]()
    for file in programme_files(Path(path)):
        texts[file], encodings[file] = decoded(file, read_bytes(file))
    return parse_source(MAKERS[Path(path).suffix.lower()], texts, encodings)


def decoded(path: Path, content: bytes) -> tuple[str, str]:
    """The text of a programme and its encoding, by which it becomes the same bytes again."""
    if b"\x00" in content:
        hint = "Save it as UTF-8 or as Latin-1."
        raise InputError(Problem("is no text of one byte a character", str(path), 1, found="a zero byte", hint=hint))
    utf8 = "utf-8-sig" if content.startswith(codecs.BOM_UTF8) else "utf-8"
    try:
        return content.decode(utf8), utf8
    except UnicodeDecodeError:
        return content.decode("latin-1"), "latin-1"


def parse_source(maker: str, texts: Mapping[Path, str], encodings: Mapping[Path, str]) -> Source:
    """A programme of "fanuc", "kuka", "abb" or "ur" from the texts of its files. InputError as of `read_source`."""
    (path, text), *_ = texts.items()
    readers = {"fanuc": fanuc.read, "abb": rapid.read, "ur": urscript.read}
    lines, points, motions, tools, frames = krl.read(texts) if maker == "kuka" else readers[maker](path, text)
    _check(path, points, len(motions))
    order = list(texts)
    points.sort(key=lambda p: (order.index(p.path), p.line))
    return Source(
        maker=maker,
        texts=texts,
        encodings=encodings,
        lines=tuple(lines),
        points=tuple(points),
        motions=tuple(motions),
        tools=tools,
        frames=frames,
    )


def _check(path: Path, points: list[ProgrammePoint], motions: int) -> None:
    """InputError for names that stand twice, for too many points, and where nothing moves."""
    seen: dict[str, ProgrammePoint] = {}
    problems = [
        Problem(f"{p.name} stands here a second time, first in line {first.line}", str(p.path), p.line)
        for p in points
        if (first := seen.setdefault(p.name, p)) is not p
    ]
    if len(points) > _MOST:
        hint = "Split the programme."
        found, allowed = f"{len(points)} points", f"up to {_MOST}"
        problems.append(
            Problem("holds too many points", str(path), points[_MOST].line, found=found, allowed=allowed, hint=hint)
        )
    if not motions and not problems:
        problems.append(Problem("holds no motion", str(path), 1))
    refuse(problems)


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
