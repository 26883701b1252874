"""ABB RAPID modules (.mod, .prg, .sys): targets, tools and work objects by name, array or in the motion itself."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from qsframework.applications.programmes.names import Names
from qsframework.applications.programmes.poses import quaternion_pose
from qsframework.applications.programmes.source import (
    NUMBER,
    Cell,
    Parts,
    ProgrammeMotion,
    SourceStatement,
    Token,
    bracketed,
    enclosed,
    numbers,
    shown,
    split,
    statements,
    tokenise,
)
from qsframework.errors import InputError, Problem
from qsframework.plugin import Array

GRAMMAR = re.compile(
    rf"(?P<remark>![^\n]*)|(?P<string>\"(?:[^\"\n]|\"\")*\")|{NUMBER}|(?P<word>[^\W\d]\w*)|(?P<end>;)|(?P<sign>:=|\S)"
)
_MOTION = re.compile(
    r"MOVE(?:ABSJ|J|L|C|EXTJ)(?:DO|AO|GO|SYNC|STD)?|TRIGG(?:ABSJ|J|L|C)(?:IOS)?|SEARCH(?:L|C|EXTJ)|EGMMOVE[LC]"
    r"|(?:ARC|CAP|CUT|DISP|LASER|PAINT)[LC](?:START|END|\d)?|(?:NUT|SPOTM?|STUD)[LJ]"
)
_INSTRUCTION = re.compile(r"\w+(?:ABSJ|J|L|C|M)(?:\d|START|END|DO|AO|GO|SYNC|STD)?")
"""How another motion may be named; it is one where a target, a speed or a zone, and more follow."""
_SPEED = re.compile(r"V[0-9]+|VMAX|Z[0-9]+|FINE")
"""A speed or a zone that every controller knows."""
_SUFFIX = re.compile(r"(?:\d|START|END|DO|AO|GO|SYNC|STD|IOS)+$")
_TYPES, _DATA = ("ROBTARGET", "JOINTTARGET"), ("TOOLDATA", "WOBJDATA")
_UNUSED = 8.9e9
_ROUGH = 1e-3
_SHIFTS = {"PDISPON": True, "PDISPSET": True, "PDISPOFF": False}
_REMOTE = "stands in the cell (robhold FALSE) and the arm holds the work, which is not corrected"
_HELD = "is held or moved by a robot or a positioner, which is not corrected"
_Move = tuple[SourceStatement, bool, bool]
_Data = dict[str, tuple[Array | None, str]]


def read(path: Path, text: str) -> Parts:
    """The parts of a module. InputError where it is not whole."""
    lines = list(statements(path, tokenise(text, GRAMMAR)))
    words = {w for line in lines if line.remark is None for w in line.upper}
    if not {"MODULE", "ENDMODULE"} <= words:
        missing = next(w for w in ("MODULE", "ENDMODULE") if w not in words)
        message = f"is no whole module of RAPID: {missing} is missing"
        raise InputError(Problem(message, str(path), 1, allowed="MODULE ... ENDMODULE"))
    names, moves, shifted = Names(literal=literal), list[_Move](), False
    data: dict[str, _Data] = {"TOOLDATA": {}, "WOBJDATA": {}}
    for line in lines:
        if line.remark is None:
            _declared(line, names, data)
    for line in lines:
        if line.remark is None:
            shifted = next((_SHIFTS[w] for w in line.upper if w in _SHIFTS), shifted)
            found = list(_verbs(line, names))
            for at, stop in pairwise([*found, len(line.tokens)]):
                moves.append((SourceStatement(path, line.tokens[at:stop]), stop == len(line.tokens), shifted))
    motions = [_motion(line, names, data, ends, on) for line, ends, on in moves]
    tools, frames = ({n: m for n, (m, _) in data[k].items() if m is not None} for k in _DATA)
    return lines, names.stated(), motions, tools, frames


def literal(tokens: Sequence[Token]) -> tuple[dict[str, Cell], str] | None:
    """The numbers of `[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[eax_a,...]]` or `[[j1,...],[eax_a,...]]`."""
    inside = enclosed(tokens, "[")
    parts = [enclosed(part, "[") for part in split(inside)] if inside is not None else []
    if len(parts) not in (2, 4) or None in parts:
        return None
    read = [numbers(part or ()) for part in parts]
    if None in read or [len(r or ()) for r in read] not in ([3, 4, 4, 6], [6, 6]):
        return {}, f"is no target of numbers; found {shown(tokens, 40)}"
    own = ["X", "Y", "Z", "Q1", "Q2", "Q3", "Q4"] if len(parts) == 4 else [f"J{k}" for k in range(1, 7)]
    found = [*(read[0] or ()), *((read[1] or ()) if len(parts) == 4 else ())]
    length = float(np.linalg.norm([c.value for c in read[1] or ()]))
    if len(parts) == 4 and abs(length - 1.0) > _ROUGH:
        return {}, f"its quaternion has the length {length:.6g}, not 1"
    beside = {f"E{k}": c for k, c in enumerate(read[-1] or (), start=1) if c.value < _UNUSED}
    return {n: c for n, c in zip(own, found, strict=True) if c.value < _UNUSED} | beside, ""


def _declared(line: SourceStatement, names: Names, data: Mapping[str, _Data]) -> None:
    """What a line gives to names: declarations of targets, arrays of them, tools, work objects; assignments."""
    words = line.upper
    for k, word in enumerate(words[:-1]):
        if word in _TYPES and ":=" not in words[k + 2 : k + 6]:
            names.change(line, line.tokens[k + 1].text)  # a variable, or what a routine is given
    if ":=" not in words:
        return
    at = words.index(":=")
    value = line.tokens[at + 1 :]
    kind = next(
        (k for k, w in enumerate(words[:at]) if w in _TYPES + _DATA and words[at - 1] in (words[k + 1], "}")), None
    )
    if kind is None:
        start = _left(line.tokens, at)
        for kept in data.values() if "\\" not in words[:at] else ():
            kept[words[start].lower()] = None, "gets other values when the programme runs"
        if at - start == 1 or (line.tokens[at - 1].text == "}" and names.literal(value) is not None):
            names.give(line, shown(line.tokens[start:at]), value)
        else:
            names.change(line, line.tokens[start].text)
        return
    name, own = line.tokens[kind + 1].text, line.after(kind + 1)
    if words[kind] in _DATA:
        data[words[kind]].setdefault(name.lower(), (_tool if words[kind] == "TOOLDATA" else _work_object)(value))
    elif words[kind + 2] == "{":
        for k, element in enumerate(split(enclosed(value, "[") or ()), start=1):
            names.give(own, f"{name}{{{k}}}", element)
    else:
        names.give(own, name, value)


def _left(tokens: Sequence[Token], at: int) -> int:
    """Where the name begins that stands before a token: `p{1}.trans.z`."""
    k, depth = at - 1, 0
    while k > 0:
        depth += (tokens[k].text == "}") - (tokens[k].text == "{")
        if depth == 0 and tokens[k].text not in "{." and tokens[k - 1].text != ".":
            break
        k -= 1
    return k


def _tool(value: Sequence[Token]) -> tuple[Array | None, str]:
    """The matrix of `[robhold,[[x,y,z],[q1,...]],load]`, and why no motion with it is corrected."""
    parts = split(enclosed(value, "[") or ())
    if len(parts) != 3:
        return None, ""
    return _frame(parts[1]), "" if shown(parts[0]).upper() == "TRUE" else _REMOTE


def _work_object(value: Sequence[Token]) -> tuple[Array | None, str]:
    """The same of `[robhold,ufprog,ufmec,uframe,oframe]`."""
    parts = split(enclosed(value, "[") or ())
    if len(parts) != 5:
        return None, ""
    user, own = _frame(parts[3]), _frame(parts[4])
    fixed = [shown(p).upper() for p in parts[:2]] == ["FALSE", "TRUE"]
    return None if user is None or own is None else user @ own, "" if fixed else _HELD


def _frame(tokens: Sequence[Token]) -> Array | None:
    parts = [numbers(enclosed(part, "[") or ()) for part in split(enclosed(tokens, "[") or ())]
    values = [cell.value for part in parts for cell in part or ()]
    return quaternion_pose(np.array(values)) if len(values) == 7 and any(values[3:]) else None


def _verbs(line: SourceStatement, names: Names) -> Iterator[int]:
    """Where motions begin: at their names, or at those of an option with a target, a speed or a zone, and more."""
    words = line.upper
    for k, word in enumerate(words):
        before, after = words[k - 1] if k else "", words[k + 1] if k + 1 < len(words) else ";"
        if line.tokens[k].kind != "word" or before in ("PROC", "FUNC", "TRAP", ".", "\\") or after == ":=":
            continue
        parts = split(line.tokens[k + 1 :]) if _INSTRUCTION.fullmatch(word) and before not in (",", "(", ":=") else ()
        fast = bool(parts) and any(_SPEED.fullmatch(w) for w in words[k + 1 :])
        if _MOTION.fullmatch(word) or (len(parts) > 3 and _goes(split(parts[0], "\\")[0], names, fast)):
            yield k


def _goes(tokens: Sequence[Token], names: Names, fast: bool) -> bool:
    """Whether an argument is a target: numbers, what is known or computed as one, beside a speed or a zone any name."""
    if not tokens or names.literal(tokens) is not None:
        return bool(tokens)
    inside = bracketed(tokens, 1) if len(tokens) > 2 and tokens[1].text in "{(" else ()
    name = names.fold(tokens[0].text)
    known = name in ("OFFS", "RELTOOL") or not {name, f"{name}{{1}}"}.isdisjoint(names.points)
    return inside is not None and len(tokens) == 1 + len(inside) + 2 * (len(tokens) > 1) and (known or fast)


def _motion(
    line: SourceStatement, names: Names, data: Mapping[str, _Data], ends: bool, shifted: bool
) -> ProgrammeMotion:
    """A motion by its line, from its verb on."""
    verb, parts = line.upper[0], [split(p, "\\")[0] for p in split(line.tokens[1:])]
    parts = [p for p in parts if p]
    if verb.startswith("SEARCH") and len(parts) > 1:
        names.change(line, shown(parts[1]))
        parts = parts[2:]
    count = 2 if _SUFFIX.sub("", verb).endswith("C") else 1
    last = parts[count + 2 if verb.startswith(("MOVE", "EGM")) else -1 :][:1]
    tool = shown(last[0]).lower() if last and len(parts) > count + 1 else ""
    words = line.upper
    named = [
        k + 3 for k, w in enumerate(words) if w == "WOBJ" and words[k - 1] == "\\" and words[k + 1 : k + 2] == [":="]
    ]
    frame = shown(line.tokens[named[0] - 1 : named[0]]).lower() if named else "wobj0"
    wrong = ""
    if verb.endswith("EXTJ"):
        wrong = "it moves external axes alone"
    elif not ends:
        wrong = "it does not end with `;` before the next one"
    elif shifted:
        wrong = "a programme displacement (PDispOn, PDispSet) shifts it when it runs"
    for kind, name in (("TOOLDATA", tool), ("WOBJDATA", frame)):
        wrong = wrong or (f"{name} {held}" if (held := data[kind].get(name, (None, ""))[1]) else "")
    return names.motion(line, parts[:count], (tool, frame), wrong)
