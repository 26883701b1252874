"""Languages of controllers: text to motions, motions to text, and what a language cannot keep.

A language is a class in one file with one entry point in `qsframework.languages`. `compensate` reads programmes by it
and writes the corrected points back; `qsf export` writes plans in it. Every motion is accounted for: it goes to points
of numbers, to where the arm stands, or its `problem` says why it cannot be corrected.
"""

from __future__ import annotations

import codecs
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

from qsframework.errors import InputError, PluginError, Problem, refuse
from qsframework.files.documents import read_bytes
from qsframework.installed import LANGUAGES, entries, label, lacking, load
from qsframework.plugin.check import Report, cuts
from qsframework.plugin.facts import Array
from qsframework.plugin.poses import Orientation
from qsframework.plugin.source import Parts, ProgrammePoint, Source, replaced, skeleton
from qsframework.units import JointUnits


@dataclass(frozen=True, eq=False)
class Move:
    """A joint move to what the pendant is to show (n,), rad or m.

    pose: the plan's name, "" for a pose in between or home.

    repeat: 1, 2, ... counts the visits of the pose; load: the name of what is hung once the arm has stopped there;
    station: where the tracker is to stand from here on, "" where it stays
    """

    pendant: Array
    pose: str = ""
    repeat: int = 0
    load: str = ""
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    station: str = ""

    @property
    def measured(self) -> bool:
        return self.pose != ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Programme:
    """What the robot is to do. speed: percent of every joint's largest; pause: s at each pose, None: until started.

    length, length_as_planned: rad of the slowest joint, in this order and in the plan's, both from home and back
    where `home` says so; external: which angles are external axes of the controller; tool, frame: the controller's
    numbers or names of the tool and of the user frame, "" for those that the format begins with
    """

    robot: str
    title: str
    payload: float | None
    moves: tuple[Move, ...]
    units: JointUnits
    speed: int
    pause: float | None
    length: float = 0.0
    length_as_planned: float = 0.0
    notes: tuple[str, ...] = field(default=())
    home: bool = False
    external: tuple[int, ...] = ()
    tool: str = ""
    frame: str = ""

    @property
    def loaded(self) -> bool:
        """Whether anything is hung anywhere."""
        return any(m.load for m in self.moves)

    @property
    def vias(self) -> int:
        """How many poses in between were needed; home is none."""
        return sum(1 for m in self.moves if not m.measured) - 2 * self.home


AXES = 6
"""Axes of an arm, and external axes, that most languages can state."""
_TABLES = (".csv", ".txt")
_MOST = 20_000
"""Points of a programme."""
_MAKERS = ("FANUC", "KUKA", "ABB", "YASKAWA", "MOTOMAN", "UNIVERSAL ROBOTS", "STAUBLI", "KAWASAKI", "COMAU", "NACHI")


class Language(ABC):
    """A controller's language.

    maker: as titles of robots name it, in capitals; endings: of programmes, in small letters; pose: how it writes
    angles and poses; form: what `qsf export` calls it, "" where plans are not written in it; written: endings of an
    exported programme's files; tool, frame: those where none are asked for, "" where it states none for joint angles;
    name_of_frame, names_of_frames: a pattern for names of tools and frames, and what messages call these
    """

    maker: ClassVar[str]
    endings: ClassVar[tuple[str, ...]]
    pose: ClassVar[Orientation]
    form: ClassVar[str] = ""
    written: ClassVar[tuple[str, ...]] = ()
    tool: ClassVar[str] = ""
    frame: ClassVar[str] = ""
    name_of_frame: ClassVar[str] = r"\d{1,2}"
    names_of_frames: ClassVar[str] = "a number"

    @abstractmethod
    def read(self, texts: Mapping[Path, str]) -> Parts:
        """Statements, points, motions, tools and frames of a programme's files. InputError with every problem."""

    def write(self, programme: Programme, name: str) -> tuple[str, ...]:
        """The texts of a plan's files, one for each of `written`. InputError for what the language cannot hold."""
        raise InputError(Problem(f"plans are not written for controllers by {self.maker}", found=name))

    def files(self, path: Path) -> list[Path]:
        """The files of the programme of which one is named."""
        return [path]


@cache
def languages() -> Mapping[str, Language]:
    """The installed languages by name. Raises PluginError if two packages claim one name, one ending or one form."""
    found: dict[str, Language] = {}
    claimed: dict[str, str] = {}
    for name, entry in entries(LANGUAGES).items():
        kind = load(entry)
        if not (isinstance(kind, type) and issubclass(kind, Language)):
            raise PluginError(f"{label(entry)} is not a subclass of Language")
        for claim in {*kind.endings, kind.form} - {""}:
            if (other := claimed.setdefault(claim, name)) != name:
                raise PluginError(f"{label(entry)} claims {claim!r}, which is of the language {other!r}")
        found[name] = kind()
    return MappingProxyType(found)


def endings() -> dict[str, str]:
    """The names of languages by the endings of their programmes."""
    return {ending: name for name, language in languages().items() for ending in language.endings}


def language_of(path: Path) -> str:
    """The language of a programme by its ending. InputError where none is installed for it."""
    if (name := endings().get(path.suffix.lower())) is None:
        gone = ", ".join(sorted({*lacking(LANGUAGES).values()}))
        hint = f"Other languages are of {gone}, which is not there: install qsframework again." if gone else None
        allowed = ", ".join(endings()) or "none: no language is installed"
        raise InputError(Problem("is no programme of a known language", str(path), allowed=allowed, hint=hint))
    return name


def is_programme(path: Path) -> bool:
    """Whether a file of targets is a programme: no table, by its ending."""
    return path.suffix.lower() in endings() or (bool(lacking(LANGUAGES)) and path.suffix.lower() not in _TABLES)


def programme_files(path: Path) -> list[Path]:
    """The files of a programme: of a language with several, all, whichever of them is named."""
    return languages()[language_of(path)].files(path)


def read_source(path: str | Path) -> Source:
    """Read a programme by its ending; of several files all, whichever of them is named.

    InputError with every problem, each with its line.
    """
    texts, encodings = dict[Path, str](), dict[Path, str]()
    for file in programme_files(Path(path)):
        texts[file], encodings[file] = decoded(file, read_bytes(file))
    return parse_source(language_of(Path(path)), texts, encodings)


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


def parse_source(name: str, texts: Mapping[Path, str], encodings: Mapping[Path, str]) -> Source:
    """A programme of a language, by its name, from the texts of its files. InputError as of `read_source`."""
    return source_of(name, languages()[name], texts, encodings)


def source_of(name: str, language: Language, texts: Mapping[Path, str], encodings: Mapping[Path, str]) -> Source:
    """A programme of a language that need not be installed. InputError as of `read_source`."""
    lines, points, motions, tools, frames = language.read(texts)
    order = list(texts)
    _check(order[0], points, len(motions))
    return Source(
        language=name,
        texts=texts,
        encodings=encodings,
        lines=tuple(lines),
        points=tuple(sorted(points, key=lambda p: (order.index(p.path), p.line))),
        motions=tuple(motions),
        tools=tools,
        frames=frames,
    )


def _check(path: Path, points: Sequence[ProgrammePoint], motions: int) -> None:
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
        hint = "Give the programme that moves the arm: one that this calls, or that calls this."
        problems.append(Problem("holds no motion", str(path), 1, hint=hint))
    refuse(problems)


def maker_of(title: str) -> str | None:
    """The maker that a robot's title names, in capitals; None where it names none that is known."""
    makers = (*_MAKERS, *(language.maker for language in languages().values()))
    return next((m for m in makers if m in title.upper()), None)


def axis_names(count: int, external: Sequence[int], letter: str, most: int = AXES) -> tuple[str, ...]:
    """The controller's name of each of `count` angles, such as A1, A2 or E1, in the order of the plan's columns.

    letter: of the arm's own axes; most: how many of them there may be. InputError where there are more, or more than
    six external ones.
    """
    arm = [k for k in range(count) if k not in external]
    beside = [k for k in range(count) if k in external]
    if len(arm) > most or len(beside) > AXES:
        hint = "Say `external: true` in robot.yaml, controller, at each joint that the controller shows as E1, E2, ..."
        found = f"{len(arm)} axes of the arm and {len(beside)} external ones"
        allowed = f"up to {most} and {AXES}"
        raise InputError(Problem("more axes than the format holds", found=found, allowed=allowed, hint=hint))
    names = {k: f"{letter}{i}" for i, k in enumerate(arm, start=1)} | {
        k: f"E{i}" for i, k in enumerate(beside, start=1)
    }
    return tuple(names[k] for k in range(count))


def check_language(language: Language, example: Path) -> Report:
    """Does a language keep the protocol? Run it on every language you write.

    Args:
        language: an instance.
        example: a programme of it, with a point of numbers.

    Returns:
        The names of the checks that held, and what did not.
    """
    report = Report()
    texts = {file: decoded(file, file.read_bytes())[0] for file in language.files(example)}
    source = report.attempt("reads its example", lambda: source_of("checked", language, texts, {}))
    if not isinstance(source, Source):
        return report
    report.record("finds a point of numbers", any(p.cells for p in source.points), "none")
    known = {p.name for p in source.points}
    lost = [m.line for m in source.motions if m.problem is None and not m.stands and not {*m.points} <= known]
    report.record("accounts for every motion", not lost, f"line {lost[:1]} goes to no point, and says no problem")
    step = {k: 2.0 * 10.0 ** -language.pose.decimals(k) for p in source.points for k in p.cells}
    values = {p.name: {k: c.value + step[k] for k, c in p.cells.items()} for p in source.points}
    moved = replaced(source, values, language.pose.decimals)
    back = report.attempt("reads what it corrected", lambda: source_of("checked", language, moved, {}))
    if isinstance(back, Source):
        same = all(abs(c.value - values[p.name][k]) < 0.5 * step[k] for p in back.points for k, c in p.cells.items())
        report.record(
            "finds corrected numbers", same and skeleton(back) == skeleton(source), "others than were put there"
        )
    for file, text in texts.items():
        for cut in cuts(len(text)):
            spoilt = {**texts, file: text[:cut]}
            label = f"bears {file.name} that ends after {cut} characters"
            report.bears(label, lambda own=spoilt: language.read(own))
    return report
