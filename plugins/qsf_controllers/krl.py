"""KUKA KRL modules: the motions of the .src, the points of the .dat and of both."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from qsf_controllers.names import GUIDED, Given, Names, Track, changing, guided, walked
from qsf_controllers.writing import (
    LOAD_DATA,
    arm_axes,
    axis_cells,
    axis_order,
    check_name,
    file_text,
    opening_remarks,
    way_lines,
)
from qsframework.plugin import (
    AMBIGUOUS,
    AXES,
    NUMBER,
    Array,
    Cell,
    Language,
    Orientation,
    Parts,
    Problem,
    Programme,
    ProgrammeMotion,
    ProgrammePoint,
    SourceStatement,
    Token,
    bracketed,
    called,
    enclosed,
    left_of,
    matrix,
    number,
    refuse,
    shown,
    split,
    statements,
    tokenise,
    variable,
)

GRAMMAR = re.compile(
    rf"(?P<remark>;[^\n]*)|(?P<string>\"[^\"\n]*\"|'[^'\n]*')|{NUMBER}"
    r"|(?P<word>[$#&]?[^\W\d]\w*)|(?P<end>\n)|(?P<sign>[=<>]=|\S)"
)
POSE = Orientation(
    axes=("X", "Y", "Z", "A", "B", "C"),
    letter="A",
    turns="ZYX",
    stated="X, Y, Z, A, B, C in mm and deg",
    left_out="they stay where the arm stands, and their correction has no number to go to; write all axes",
)
_MOTION = re.compile(r"(S?(?:PTP|LIN|CIRC)|SPL)(_REL)?|ASYPTP")
_TYPES = ("E6AXIS", "AXIS", "E6POS", "POS", "FRAME")
_BEFORE = ("DECL", "GLOBAL", "CONST", "PUBLIC")
_BEGIN = {"IF": False, "SWITCH": False, "LOOP": True, "WHILE": True, "FOR": True, "REPEAT": True}
_OTHER = ("ELSE", "CASE", "DEFAULT")
_END = ("ENDIF", "ENDSWITCH", "ENDLOOP", "ENDWHILE", "ENDFOR", "UNTIL")
_CELL = re.compile(r"[AE][1-6]|[XYZABC]")
_ENDS = ("WITH", "C_PTP", "C_DIS", "C_VEL", "C_ORI", "C_SPL", "C_JERK")
_ALLOWED = "A1 to A6 or X, Y, Z, A, B, C, S, T; E1 to E6; each with a number"
_REMOTE = "the tool stands in the cell (IPO_FRAME #TCP) and the arm holds the work, which is not corrected"
_NULL = (["$NULLFRAME"], ["$WORLD"])
_WORDS = {"IF", "WHILE", "UNTIL", "SWITCH", "CASE", "FOR", "TO", "STEP", "WHEN", "DO", "THEN", "RETURN"}
_WORDS |= {"WAIT", "SEC", "AND", "OR", "NOT", "EXOR", "B_AND", "B_OR", "B_NOT", "B_EXOR"}
"""Words that may stand before a bracket and call nothing."""
_READS = re.compile(
    r"BAS|INVERSE|FORWARD|INV_POS|[CS]WRITE|CAST_TO|VAR(?:STATE|TYPE)|E[KBO]|PULSE|REAL"
    r"|ABS|SQRT|SIN|COS|TAN|ACOS|ATAN2|MSG(?:NOTIFY|QUIT|STOP|DIALOG)"
    r"|S(?:BASE|TOOL2?|IPO_MODE|LOAD|(?:VEL|ACC)_(?:JOINT|CP)|(?:GEAR_)?JERK|APO(?:_PTP)?|TECH)"
)
"""Routines of KRL that change no point which they are given."""
_PACKAGES = r"(?:RSI|ST|FTC?|TRACC|CONV(?:EYOR)?|CVY|SEAM)_(?:\w+_)?"
_SENSOR = re.compile(_PACKAGES + r"(?:MOVECORR|ON1?|START|FOLLOW|TRACK|SKIPSENS)|SET_TORQUE_LIMITS")
_SENSOR_OFF = re.compile(_PACKAGES + r"(?:OFF|STOP|QUIT|END)|RESET_TORQUE_LIMITS")
"""Routines of technology packages that begin and end to shift the path."""
_CORRECTION = re.compile(r"\$(?:CORR|TECH)\w*")
"""System variables of corrections of the path and of functions that move the tool about it."""
_ELSEWHERE = "?"
"""A parameter, given by reference, of a routine in another file."""
_CHOICES = {"$TOOL": "tool", "$BASE": "base", "$IPO_MODE": "ipo"}
_Move = tuple[SourceStatement, dict[str, str]]


@dataclass(frozen=True)
class _Data:
    """What chooses tools and bases. fdat: tool, base and whether the tool stands in the cell, by their names; places:
    matrices (4, 4) m of "tool" and "base" that the programme states in numbers, by the words that state them."""

    fdat: dict[str, tuple[str, str, bool]]
    places: dict[str, dict[str, Array]]

    def named(self, name: str) -> tuple[str, str, bool]:
        return self.fdat.get(name.upper(), ("", "", False))


def read(texts: Mapping[Path, str]) -> Parts:
    """The parts of a module's files. InputError where one is not whole, or has no .src."""
    lines, problems = list[SourceStatement](), list[Problem]()
    for path, text in texts.items():
        own = list(statements(path, _closed(path, text, problems)))
        problems += _module(path, own)
        lines += own
    if not any(path.suffix.lower() == ".src" for path in texts) and not problems:
        hint = "Put the .src of the same name beside it."
        problems.append(
            Problem("holds points, and no .src says which the arm goes to", str(next(iter(texts))), hint=hint)
        )
    refuse(problems)
    names = Names(literal=literal, here=("$AXIS_ACT", "$POS_ACT", "$AXIS_INT"))
    data, code = _Data(_frames(lines), {"tool": {}, "base": {}}), [line for line in lines if line.remark is None]
    for line in code:
        _definitions(line, names)
    upset = dict[int, list[str]]()
    for given in _changing(code):
        names.change(given.statement, given.variable, given.caller.text)
        upset.setdefault(id(given.statement), []).append(given.variable.upper())
    data.fdat.update({k: (AMBIGUOUS, AMBIGUOUS, data.fdat[k][2]) for k in data.fdat if k in names.changes})

    def walk(track: Track) -> list[_Move]:
        moves = list[_Move]()
        for line in code:
            _follow(line, track, data)
            track.now |= {_CHOICES[name]: AMBIGUOUS for name in upset.get(id(line), ()) if name in _CHOICES}
            if (at := _verb(line)) is not None:
                moves.append((line.after(at), track.here()))
        return moves

    motions = [_motion(line, here, names, data) for line, here in walked(walk)]
    points = names.stated({f"X{key[1:]}": own[:2] for key, own in data.fdat.items() if key.startswith("F")})
    points = [_set_when_it_runs(point, names) for point in points]
    return lines, points, motions, data.places["tool"], data.places["base"]


def _set_when_it_runs(point: ProgrammePoint, names: Names) -> ProgrammePoint:
    """A pose cannot be corrected where the programme itself sets the data of its tool or of its base."""
    data = {"TOOL_DATA": point.tool, "BASE_DATA": point.frame, "$ROBROOT": "", "$WORLD": ""}
    for name in (n for kind, number_of in data.items() for n in (kind, f"{kind}[{number_of}]")):
        given = names.points.get(name)
        if point.cartesian and point.problem is None and (given or name in names.changes):
            said = names.changes.get(name, f"{name} is set when the programme runs")
            return replace(point, problem=Problem(f"{point.name}: {said}", str(point.path), point.line))
    return point


def _changing(lines: Sequence[SourceStatement]) -> list[Given]:
    """The variables that routines are given which may change them."""
    heads = [_head(line) for line in lines]
    routines = {name: params for name, params, _ in filter(None, heads)}
    assigned = {(name, _ELSEWHERE) for name in routines}  # what the routine of another file does is not known
    given, within = list[Given](), ""
    for line, head in zip(lines, heads, strict=True):
        words = line.upper
        if head is not None:
            within = head[0] if head[2] else within
            continue
        assigned |= {(within, left[0].text.upper()) for left in _assigned(line)}
        verb = _verb(line)
        for k, parts in called(line.tokens, _WORDS):
            moves = verb is not None and verb < k and words[k] not in routines  # it computes a place
            handed = enumerate(map(variable, parts if not moves else ()))
            given += [Given(line, within, line.tokens[k], place, name) for place, name in handed if name]
    return changing(given, routines, assigned, _READS)


def _head(line: SourceStatement) -> tuple[str, dict[int | str, str], bool] | None:
    """The folded name of the routine that a line begins or declares, its parameters, and whether it begins there."""
    words = line.upper
    first = next((word for word in words if word not in _BEFORE), "")
    if first not in ("DEF", "DEFFCT", "EXT", "EXTFCT") or "(" not in words:
        return None
    at, own = words.index("("), first.startswith("DEF")
    parts = [[t.text.upper() for t in part] for part in split(bracketed(line.tokens, at) or ())]
    params = ["" if part[-1:] == ["IN"] else part[0] if own else _ELSEWHERE for part in parts if part]
    return words[at - 1], dict(enumerate(params)), own


def _assigned(line: SourceStatement) -> Iterator[Sequence[Token]]:
    """What stands on the left of each `=`."""
    for k, token in enumerate(line.tokens):
        if token.text == "=" and token.kind == "sign" and k:
            yield line.tokens[left_of(line.tokens, k) : k]


def programmed(path: Path, text: str) -> list[ProgrammePoint]:
    """The points that a text gives numbers, whatever else it holds."""
    names = Names(literal=literal)
    for line in statements(path, tokenise(text, GRAMMAR)):
        if line.remark is None:
            _definitions(line, names)
    return list(names.points.values())


def _closed(path: Path, text: str, problems: list[Problem]) -> list[Token]:
    """The tokens, each line for itself: what is opened in it ends in it."""
    out, opened = list[Token](), list[Token]()
    for token in tokenise(text, GRAMMAR):
        if token.text == "{" and token.kind == "sign":
            opened.append(token)
        elif token.text == "}" and opened:
            opened.pop()
        elif token.kind == "end" and opened:
            own = [t for t in out[-200:] if t.line == token.line]
            named = [a.text for a, b in itertools.pairwise(own) if b.text == "="] or ["the point of this motion"]
            message = f"{named[0]} does not end"
            hint = "A point stands in braces on one line."
            problems.append(Problem(message, str(path), token.line, found=shown(own, 40), hint=hint))
            opened = []
        out.append(token)
    return out


def _module(path: Path, lines: Sequence[SourceStatement]) -> list[Problem]:
    """What a file of a module begins and ends with."""
    opened, closed = ("DEFDAT", "ENDDAT") if path.suffix.lower() == ".dat" else ("DEF", "END")
    first = [w[1] if w[0] == "GLOBAL" and len(w) > 1 else w[0] for line in lines if (w := line.upper)]
    if {opened, f"{opened}FCT"} & set(first) and {closed, f"{closed}FCT"} & set(first):
        return []
    begins = bool({opened, f"{opened}FCT"} & set(first))
    where, missing = (lines[-1].line, closed) if begins else (1, opened)
    message = f"is no whole {path.suffix.lower()} of KRL: {missing} is missing"
    return [Problem(message, str(path), where, allowed=f"{opened} ... {closed}")]


def literal(tokens: Sequence[Token]) -> tuple[dict[str, Cell], str] | None:
    """The numbers of `{X 1.0,Y 2.0,...}`."""
    inside = enclosed(tokens, "{")
    if inside is None:
        return None
    if len(inside) > 1 and inside[1].text == ":":
        inside = inside[2:]
    cells, wrong = dict[str, Cell](), ""
    for part in split(inside):
        key = part[0].text.upper() if part else ""
        cell = number(part[1:])
        if key in ("S", "T"):
            continue
        if cell is None or not _CELL.fullmatch(key) or key in cells:
            found = shown(part[1:])[:40] or "nothing"
            wrong = wrong or f"{key or 'an empty part'} is no number of a point; found {found}; allowed: {_ALLOWED}"
        else:
            cells[key] = cell
    return cells, wrong


def _frames(lines: Sequence[SourceStatement]) -> dict[str, tuple[str, str, bool]]:
    """Tool, base and whether the tool stands in the cell, of each FDAT by its name."""
    out: dict[str, tuple[str, str, bool]] = {}
    for line in lines:
        words = line.upper
        at = next((k for k, word in enumerate(words) if word not in _BEFORE), 0)
        if words[at : at + 1] == ["FDAT"] and words[at + 2 : at + 3] == ["="]:
            out[words[at + 1]] = _fdat(line.tokens[at + 3 :])
    return out


def _fdat(tokens: Sequence[Token]) -> tuple[str, str, bool]:
    parts = {p[0].text.upper(): shown(p[1:]) for p in split(bracketed(tokens) or ()) if p}
    return parts.get("TOOL_NO", ""), parts.get("BASE_NO", ""), parts.get("IPO_FRAME", "").upper() == "#TCP"


def _definitions(line: SourceStatement, names: Names) -> None:
    """What a line gives to names: declarations of points, and assignments."""
    words = line.upper
    at = next((k for k, word in enumerate(words) if word not in _BEFORE), 0)
    if words[at] in ("DEF", "DEFFCT"):
        names.begin(line)
        return
    declared = words[at] in _TYPES and len(words) > at + 1
    sides = [split(part, "=") for part in split(line.tokens[at + 1 :])] if declared else [split(line.tokens[at:], "=")]
    plain = [pair for pair in sides if len(pair) == 2 and pair[0] and pair[0][0].kind == "word"]
    plain = [(left, value) for left, value in plain if declared or left_of(line.tokens, at + len(left)) == at]
    for left, value in plain:
        own = left[: 4 if len(left) > 3 and variable(left) != left[0].text else 1]
        whole, point = len(own) == len(left), names.literal(value)
        if whole and own[0].text[0] == "$":
            continue
        if whole and (declared or names.fold(shown(own)) in names.points or (point and not point[1])):
            names.give(line, shown(own), value)
        else:
            names.change(line, shown(own))
    others = [] if plain or declared else list(_assigned(line))
    if others and (words[at] in ("FOR", "ELSE", "DEFAULT") or others[0][0] not in line.tokens[: at + 2]):
        for left in others:  # behind other words, DO, FOR, ANIN ON; with one word before it is declared
            names.change(line, variable(left))


def _verb(line: SourceStatement) -> int | None:
    """Where the motion of a line begins: with the line, or behind the word that leads to it."""
    for k, word in enumerate(line.upper):
        if _MOTION.fullmatch(word) and (k == 0 or line.upper[k - 1] in ("THEN", "ELSE", "DO", ":")):
            return k
    return None


def _follow(line: SourceStatement, track: Track, data: _Data) -> None:
    """What a line says of the tool, the base and the interpolation from there on."""
    words = line.upper
    first = words[1] if words[0] == "GLOBAL" and len(words) > 1 else words[0]
    if first in ("DEF", "DEFFCT"):
        track.reset(words[words.index("(") - 1] if "(" in words else "")
        return
    if "RETURN" in words:
        track.returns()
    _shift(line, track)
    if first in _BEGIN:
        track.begin(_BEGIN[first])
    elif first in _OTHER:
        track.other()
    elif first in _END:
        track.end()
    elif first in ("SPLINE", "PTP_SPLINE"):
        track.begin(False)
        track.now |= _chosen(line.tokens[words.index("WITH") + 1 :] if "WITH" in words else [], data)
    elif first == "ENDSPLINE":
        track.back()
    elif first == "FDAT_ACT" and words[1] == "=":
        tool, base, remote = data.named(words[2]) if len(words) == 3 else _fdat(line.tokens[2:])
        track.now |= {"tool": tool, "base": base, "ipo": "#TCP" if remote else "#BASE"}
    elif first == "BAS" and len(words) > 4 and words[2] in ("#TOOL", "#BASE", "#INITMOV"):
        new = {"#TOOL": ["tool"], "#BASE": ["base"], "#INITMOV": ["tool", "base", "ipo"]}[words[2]]
        track.now |= dict.fromkeys(new, "" if words[2] == "#INITMOV" else shown(line.tokens[4:-1]))
    elif first == "FDAT_ACT":  # a part of it
        track.now |= {"tool": AMBIGUOUS, "base": AMBIGUOUS}
    if "WITH" not in words:  # what a motion has WITH it holds for that motion
        track.now |= _chosen(line.tokens, data)


def _shift(line: SourceStatement, track: Track) -> None:
    """What a line says of corrections of the path, and what the routines that it calls leave."""
    for k, _ in called(line.tokens, _WORDS):
        name = line.upper[k]
        if _SENSOR.fullmatch(name):
            track.now[GUIDED] = f"{name} in line {line.line} shifts the path when it runs"
        elif _SENSOR_OFF.fullmatch(name):
            track.now[GUIDED] = ""
        track.call(name, certain=not {"DO", "THEN"} & set(line.upper))
    for left in _assigned(line):
        if _CORRECTION.fullmatch(left[0].text.upper()):
            off = line.upper[-1] in ("FALSE", "#OFF", "#NONE")
            said = f"{left[0].text} in line {line.line} lets its path be shifted when it runs"
            track.now[GUIDED] = "" if off else said


def _chosen(tokens: Sequence[Token], data: _Data) -> dict[str, str]:
    """The tool, base or interpolation that assignments choose: `$TOOL=TOOL_DATA[3]`, `$BASE=SBASE(FP1.BASE_NO)`."""
    out: dict[str, str] = {}
    for part in split(tokens):
        sides = split(part, "=")
        if len(sides) > 1 and sides[-2]:
            left = sides[-2][left_of(sides[-2], len(sides[-2])) :]
            if key := _CHOICES.get(left[0].text.upper()):
                sole = len(sides) == 2 and len(left) == len(sides[0]) == 1  # no part of it, and not behind DO
                out[key] = _choice(key, sides[1], data) if sole else AMBIGUOUS
    return out


def _choice(key: str, tokens: Sequence[Token], data: _Data) -> str:
    """The name of the tool, base or interpolation that a value is; numbers are kept by themselves."""
    value = list(itertools.takewhile(lambda t: t.text.upper() not in _ENDS, tokens))
    words = [t.text.upper() for t in value]
    inside = bracketed(value, 1) if len(value) > 2 else None
    whole = inside is not None and len(inside) == len(value) - 3
    named = data.fdat.get(inside[0].text.upper()) if inside and words[0].startswith("S") else None
    if whole and named is not None:
        return {"tool": named[0], "base": named[1], "ipo": "#TCP" if named[2] else "#BASE"}[key]
    if whole and inside is not None and words[0] in ("TOOL_DATA", "BASE_DATA"):
        return shown(inside)
    own = "0" if words in _NULL else shown(value, 400).upper()
    stated = literal(value)
    if stated is not None and not stated[1] and stated[0].keys() >= {*POSE.axes}:
        numbers = np.array([stated[0][axis].value for axis in POSE.axes])
        data.places["tool" if key == "tool" else "base"][own] = matrix(POSE, numbers)
    return own


def _motion(line: SourceStatement, here: dict[str, str], names: Names, data: _Data) -> ProgrammeMotion:
    """A motion by its line, from its verb on, and what holds there."""
    tokens, verb = line.tokens, line.upper[0]
    ends = [k for k, word in enumerate(line.upper) if word in _ENDS]
    here = here | _chosen(tokens[line.upper.index("WITH") + 1 :] if "WITH" in line.upper else [], data)
    parts = [p for p in split(tokens[1 : ends[0] if ends else len(tokens)]) if p]
    wrong = ""
    if verb.endswith("_REL"):
        wrong = "it is relative to where the arm stands"
    elif verb == "ASYPTP":
        wrong = "it moves external axes alone"
    elif "CIRC" in verb and len(parts) != 2:
        wrong = "its end is given by its angle (CA), not by a point" if len(parts) > 2 else "it lacks a point"
    elif "CIRC" not in verb and len(parts) != 1:
        wrong = "it is no motion to one point"
    remote = [data.named(f"F{t.text[1:]}")[2] for p in parts for t in p[:1]]
    if here.get("ipo") == "#TCP" or any(remote):
        wrong = _REMOTE
    wrong = guided(here) or wrong
    goes = [] if verb.endswith("_REL") else parts[: 1 + ("CIRC" in verb)]
    return names.motion(line, goes, (here.get("tool", ""), here.get("base", "")), wrong)


def write_krl(programme: Programme, name: str) -> tuple[str, str]:
    """The .src with the motion and the .dat with the points. `name` is the module's name: a letter, then letters,
    digits and _, up to 24."""
    allowed = "a letter, then letters, digits and _, up to 24, for the file bears the module's name"
    check_name(name, r"[A-Za-z][A-Za-z0-9_]{0,23}", allowed)
    names = arm_axes(programme, "A", "KRL")
    motions = [(f"PTP XP{i}", "HALT") for i in range(1, len(programme.moves) + 1)]
    src = [
        "&ACCESS RVP",
        "&REL 1",
        f"DEF {name}( )",
        *(f";{remark}" for remark in opening_remarks(programme, LOAD_DATA, axis_order(names, "A"))),
        "DECL INT K",
        "BAS(#INITMOV,0)",
        f"BAS(#TOOL,{programme.tool})",
        f"BAS(#BASE,{programme.frame})",
        f"FOR K=1 TO {AXES}",
        f"$VEL_AXIS[K]={programme.speed}",
        "ENDFOR",
        *(f"$VEL_EXTAX[{k}]={programme.speed}" for k in range(1, len(programme.external) + 1)),
        "PTP $AXIS_ACT",
        *way_lines(programme, ";", motions, f"WAIT SEC {programme.pause or 0:.2f}"),
        "END",
    ]
    dat = ["&ACCESS RVP", "&REL 1", f"DEFDAT {name}"]
    for i, move in enumerate(programme.moves, start=1):
        angles = [",".join(f"{axis} {cell}" for axis, cell in axis_cells(names, move, k, "0.0")) for k in "AE"]
        dat.append(f"DECL E6AXIS XP{i}={{{','.join(angles)}}}")
    return file_text(src), file_text([*dat, "ENDDAT"])


class Krl(Language):
    """KRL: a module of .src with the motions and .dat with the points."""

    maker = "KUKA"
    endings = written = (".src", ".dat")
    pose = POSE
    form = "krl"
    tool, frame = "1", "0"

    def files(self, path: Path) -> list[Path]:
        """The module, whichever of its two files is named."""
        stem = "".join(f"[{c}]" if c in "*?[" else c for c in path.stem)
        beside = {p.suffix.lower(): p for p in sorted(path.parent.glob(f"{stem}.*")) if p.is_file()}
        return [beside[e] for e in self.endings if e in beside] or [path]

    def read(self, texts: Mapping[Path, str]) -> Parts:
        """The parts of a module's files. InputError where one is not whole, or has no .src."""
        return read(texts)

    def write(self, programme: Programme, name: str) -> tuple[str, ...]:
        """The .src and the .dat."""
        return write_krl(programme, name)
