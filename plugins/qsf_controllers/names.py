"""What the names of a programme stand for: points of numbers that are given once, or something that changes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

from qsframework.plugin import (
    AMBIGUOUS,
    Cell,
    Problem,
    ProgrammeMotion,
    ProgrammePoint,
    SourceStatement,
    Token,
    bracketed,
    shown,
    unmoved,
)

Literal = Callable[[Sequence[Token]], tuple[dict[str, Cell], str] | None]
"""Numbers of a point by their names, and what is wrong with them, "" if nothing is; None of what is no point."""
GUIDED = "guided"
"""The key of what shifts the path when the programme runs: why no motion ends at its point."""
_WALKS = 8
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Names:
    """The points of a programme by their names, and why the names stand for no point.

    literal: reads a point of numbers; here: names of where the arm stands; fold: how a name is compared; copies: names
    that stand for another's point; routines: where in a file they begin, and the names of what they are given
    """

    literal: Literal
    here: Sequence[str] = ()
    fold: Callable[[str], str] = str.upper
    points: dict[str, ProgrammePoint] = field(default_factory=dict[str, ProgrammePoint])
    changes: dict[str, str] = field(default_factory=dict[str, str])
    copies: dict[str, str] = field(default_factory=dict[str, str])
    frames: dict[str, set[tuple[str, str]]] = field(default_factory=dict[str, set[tuple[str, str]]])
    routines: dict[Path, dict[int, set[str]]] = field(default_factory=dict[Path, dict[int, set[str]]])

    def begin(self, head: SourceStatement) -> None:
        """A routine begins; until the next of its file, what it is given hides what else has the name."""
        given = bracketed(head.tokens, head.upper.index("(") if "(" in head.upper else 0) or ()
        self.routines.setdefault(head.path, {})[head.tokens[0].start] = {self.fold(token.text) for token in given}
        for token in given:
            self.change(head, token.text)

    def _key(self, statement: SourceStatement, name: str) -> str:
        """By what a name is known where a statement stands."""
        key, begins = self.fold(name), self.routines.get(statement.path, {})
        at = max((start for start in begins if start <= statement.tokens[0].start), default=-1)
        return f"{at} {key}" if re.split(r"[\[{.]", key)[0] in begins.get(at, ()) else key

    def give(self, statement: SourceStatement, name: str, value: Sequence[Token]) -> bool:
        """Name gets a value: a point of numbers or another's, if this is the first value that it gets. Whether it is a
        point."""
        key, read, other = self._key(statement, name), self.literal(value), self._key(statement, shown(value))
        given = key in self.points or key in self.changes or key in self.copies
        if not given and (other in self.points or other in self.copies):
            self.copies[key] = other
            return True
        if given or read is None:
            self.change(statement, name)
            return read is not None
        cells, wrong = read
        problem = Problem(f"{name}: {wrong}", str(statement.path), statement.line) if wrong else None
        self.points[key] = ProgrammePoint(
            name=name, path=statement.path, line=statement.line, cells=cells, problem=problem
        )
        return True

    def change(self, statement: SourceStatement, name: str, routine: str = "") -> None:
        """Name, or a part of it, gets a value when the programme runs; of an array every element may.

        routine: the one that is given the name and may change it
        """
        key = self._key(statement, name)
        first = self.points.get(key)
        at = f"in lines {first.line} and {statement.line}" if first else f"in line {statement.line}"
        said = f"{name} gets its value {at} when the programme runs"
        if routine:
            said = f"{name} is given to {routine} in line {statement.line}, which may change it when the programme runs"
        self.changes.setdefault(key, said)

    def motion(
        self, statement: SourceStatement, targets: Sequence[Sequence[Token]], stated: tuple[str, str], wrong: str = ""
    ) -> ProgrammeMotion:
        """A motion to targets with a tool and a frame; wrong: why it is not corrected, whatever the targets are."""
        goes, keep, stands = list[str](), f"line {statement.line}", False
        for k, tokens in enumerate(targets, start=1):
            name = f"line {statement.line}" + (f".{k}" if len(targets) > 1 else "")
            if tokens and tokens[0].text.upper() in self.here and (len(tokens) == 1 or tokens[1].text == "("):
                stands = True
            elif tokens and self.literal(tokens) is not None:
                while self.fold(name) in self.points:
                    name += "'"
                self.give(statement, name, tokens)
                goes.append(name)
            else:
                found, said = self._named(statement, tokens)
                goes += found
                wrong = wrong or said
                if said and len(tokens) == 1 and self._key(statement, tokens[0].text) == self.fold(tokens[0].text):
                    keep = tokens[0].text
        wrong = wrong or ("" if goes or stands else "it names no point")
        for name in goes if not wrong else ():
            self.frames.setdefault(self.fold(name), set()).add(stated)
        names = tuple(dict.fromkeys(self.points[self.fold(name)].name for name in goes))
        problem = unmoved(statement, wrong, keep, allowed="a point of numbers in this programme") if wrong else None
        return ProgrammeMotion(
            statement=statement, points=names, keep=keep, stands=stands and not names, problem=problem
        )

    def _named(self, statement: SourceStatement, tokens: Sequence[Token]) -> tuple[list[str], str]:
        """The points that a name, or the element of an array, may be, and why it is none."""
        inside = bracketed(tokens, 1) if len(tokens) > 3 and tokens[1].text in "[{" else None
        if not tokens or tokens[0].kind != "word" or len(tokens) not in (1, 3 + len(inside or ())):
            return [], f"{shown(tokens) or 'its place'} is computed when the programme runs"
        if len(tokens) == 1 or (inside and inside[0].kind == "number"):
            keys = [self._key(statement, shown(tokens))]
        else:  # any element
            start = self._key(statement, shown(tokens[:2]))
            keys = [key for known in (self.points, self.changes) for key in known if key.startswith(start)]
        passed = [self._key(statement, tokens[0].text), *keys]
        while copied := [key for key in keys if key in self.copies]:
            keys = [self.copies.get(key, key) for key in keys]
            passed += [self.copies[key] for key in copied]
        changed = next((self.changes[key] for key in passed if key in self.changes), "")
        if changed or not keys or not all(key in self.points for key in keys):
            return [], changed or f"{shown(tokens)} has no position of numbers in this programme"
        return keys, ""

    def stated(self, by_name: Mapping[str, tuple[str, str]] | None = None) -> list[ProgrammePoint]:
        """The points with the tool and the frame of the motions that go there; by_name: what is stored with a name."""
        out = list[ProgrammePoint]()
        for key, point in self.points.items():
            stored = (by_name or {}).get(key, ("", ""))
            used = self.frames.get(key) or {("", "")}
            tool, frame = (_one({pair[k] or stored[k] for pair in used}, stored[k]) for k in (0, 1))
            out.append(replace(point, tool=tool, frame=frame))
        return out


def _one(used: set[str], stored: str) -> str:
    """The one tool or frame of a point; what is stored with it counts, too, unless numbers in the programme hold."""
    if stored and not all(name.startswith("{") for name in used):
        used = used | {stored}
    return next(iter(used)) if len(used) == 1 else AMBIGUOUS


class Track:
    """What holds at each place of a programme (tool, frame, GUIDED) on every way there; AMBIGUOUS where ways differ.

    enters, leaves: what holds at the calls of a routine, of which only GUIDED is taken, and what it has set at its end
    """

    def __init__(self) -> None:
        self.now = dict[str, str]()
        self.enters = dict[str, dict[str, str]]()
        self.leaves = dict[str, dict[str, str]]()
        self._routine = ""
        self._returns = list[dict[str, str]]()
        self._seen = list[dict[str, str]]()
        self._open = list[tuple[dict[str, str], list[dict[str, str]], int | None, str]]()

    def begin(self, loop: bool, routine: str = "") -> None:
        """A branch, or a loop, or a routine within the programme, begins."""
        self._open.append((dict(self.now), [], len(self._seen) if loop else None, routine))
        self.now |= self.enters.get(routine, {})

    def other(self) -> None:
        """Another branch begins where the first one did."""
        if self._open:
            self._open[-1][1].append(self.now)
            self.now = dict(self._open[-1][0])

    def end(self) -> None:
        """The branches meet again; what a loop changes is not certain in it before the change."""
        if self._open:
            start, ends, first, routine = self._open.pop()
            if routine:
                self._leave(routine, {k: v for k, v in self.now.items() if v != start.get(k)})
                self.now = start
                return
            differs = {k for way in (start, *ends) for k in {*way, *self.now} if way.get(k) != self.now.get(k)}
            for seen in self._seen[first:] if first is not None else ():
                seen.update({k: AMBIGUOUS for k in differs if seen.get(k) == start.get(k)})
            self.now = {**self.now, **dict.fromkeys(differs, AMBIGUOUS)}

    def back(self) -> None:
        """What was said since the last beginning holds no more."""
        self.now = self._open.pop()[0] if self._open else self.now

    def reset(self, routine: str = "") -> None:
        """Another routine begins, of whose tool and frame nothing is known."""
        self._leave(self._routine, self.now)
        self._routine, self._open, self._seen = routine, [], []
        self.now = dict(self.enters.get(routine, {}))

    def returns(self) -> None:
        """The routine may be left here."""
        self._returns.append(dict(self.now))

    def _leave(self, routine: str, ends: Mapping[str, str]) -> None:
        """What a routine has set at its end, where it has done so before every return."""
        certain = {k: v for k, v in ends.items() if all(way.get(k) == v for way in self._returns)}
        self.leaves[routine] = dict.fromkeys(ends, AMBIGUOUS) | certain
        self._returns = []

    def call(self, routine: str, certain: bool = True) -> None:
        """A routine of the programme is called; not certain: it may be, from here on."""
        if self.now.get(GUIDED):
            self.enters.setdefault(routine, {})[GUIDED] = self.now[GUIDED]
        left = self.leaves.get(routine, {})
        self.now |= left if certain else dict.fromkeys(left, AMBIGUOUS)

    def here(self) -> dict[str, str]:
        """What holds here; it is changed when the end of a loop around it tells more."""
        self._seen.append(dict(self.now))
        return self._seen[-1]


def walked(walk: Callable[[Track], list[T]]) -> list[T]:
    """What a walk through the programme finds once it knows with what every routine is entered and left."""
    track, found = Track(), list[T]()
    for _ in range(_WALKS):
        before = repr((track.enters, track.leaves))
        track.reset()
        found = walk(track)
        track.reset()
        if repr((track.enters, track.leaves)) == before:
            break
    return found


def guided(here: Mapping[str, str]) -> str:
    """Why no motion here ends at its point, "" where it does."""
    said = here.get(GUIDED, "")
    return "on one of the ways there its path is shifted when it runs" if said == AMBIGUOUS else said


@dataclass(frozen=True)
class Given:
    """A variable that a routine is given: in which statement and routine, as which of the arguments (by its number
    from 0, or by its name); caller: the routine's name as the programme writes it, as variable is."""

    statement: SourceStatement
    within: str
    caller: Token
    place: int | str
    variable: str


def changing(
    given: Sequence[Given],
    routines: Mapping[str, Mapping[int | str, str]],
    assigned: Iterable[tuple[str, str]],
    reads: re.Pattern[str],
) -> list[Given]:
    """Those whose routine may change the variable: it does so itself, hands it on to one that may, or is not known.

    Args:
        given: all of the programme.
        routines: its routines; by the places of their arguments the folded names, "" of an argument that is a copy.
        assigned: routines, and folded names of variables that they assign.
        reads: names of routines of the language that only read.
    """
    changed, count, out = set(assigned), -1, list[Given]()

    def may_change(routine: str, place: int | str) -> bool:
        if routine not in routines:
            return reads.fullmatch(routine) is None
        name = routines[routine].get(place)
        return name is None or (routine, name) in changed

    while count != len(changed):
        count = len(changed)
        out = [g for g in given if may_change(g.caller.text.upper(), g.place)]
        changed |= {(g.within, re.split(r"[\[{]", g.variable)[0].upper()) for g in out}
    return out
