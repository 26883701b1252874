"""Robot programmes by their endings: FANUC .ls, KUKA .src and .dat, ABB .mod, Universal Robots .script."""

from __future__ import annotations

import codecs
from collections.abc import Mapping
from pathlib import Path

from qsframework.applications.programmes import fanuc, krl, rapid, urscript
from qsframework.applications.programmes.source import ProgrammePoint, Source
from qsframework.errors import InputError, Problem
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
    if problems:
        raise InputError(problems[:1000])
