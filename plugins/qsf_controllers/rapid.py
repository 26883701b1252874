"""ABB RAPID modules (.mod, .modx, .prg, .sys, .sysx): targets, tools, work objects by name, array or in the motion."""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import pairwise
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
    NUMBER,
    Array,
    Cell,
    InputError,
    Language,
    Orientation,
    Parts,
    Problem,
    Programme,
    ProgrammeMotion,
    SourceStatement,
    Token,
    bracketed,
    called,
    enclosed,
    left_of,
    numbers,
    quaternion_pose,
    shown,
    split,
    statements,
    tokenise,
    variable,
)

GRAMMAR = re.compile(
    rf"(?P<remark>![^\n]*)|(?P<string>\"(?:[^\"\n]|\"\")*\")|{NUMBER}|(?P<word>[^\W\d]\w*)|(?P<end>;)|(?P<sign>:=|\S)"
)
_MOTION = re.compile(
    r"MOVE(?:ABSJ|J|L|C|EXTJ)(?:DO|AO|GO|SYNC|STD)?|TRIGG(?:ABSJ|J|L|C)(?:IOS)?|SEARCH(?:L|C|EXTJ)|EGM(?:MOVE[LC]|RUN\w+)"
    r"|(?:ARC|CAP|CUT|DISP|LASER|PAINT)[LC](?:START|END|\d)?|(?:NUT|SPOTM?|STUD)[LJ]"
)
_INSTRUCTION = re.compile(r"\w+(?:ABSJ|J|L|C|M)(?:\d|START|END|DO|AO|GO|SYNC|STD)?")
"""How another motion may be named; it is one where a target, a speed or a zone, and more follow."""
_SPEED = re.compile(r"V[0-9]+|VMAX|Z[0-9]+|FINE")
"""A speed or a zone that every controller knows."""
_SUFFIX = re.compile(r"(?:\d|START|END|DO|AO|GO|SYNC|STD|IOS)+$")
_TYPES, _DATA = ("ROBTARGET", "JOINTTARGET"), ("TOOLDATA", "WOBJDATA")
_BEFORE_NAMES = ("PROC", "FUNC", "TRAP", ".", "\\", ",", "(", "[", ":=", *_TYPES)
"""Behind them stands a name, whatever instruction ends as it does."""
_UNUSED = 8.9e9
_ROUGH = 1e-3
_SHIFT = "a programme displacement (PDispOn, PDispSet) shifts it when it runs"
_FORCE = "the arm gives way or is guided here (SoftAct, FCAct, EGM): it does not end at its point"
_SHIFTS = {"PDISPON": _SHIFT, "PDISPSET": _SHIFT, "PDISPOFF": "", "SOFTACT": _FORCE, "SOFTDEACT": ""}
_SHIFTS |= {"FCACT": _FORCE, "FCDEACT": "", "EGMSTREAMSTART": _FORCE, "EGMSTREAMSTOP": ""}
_SENSORS = ("CORR", "TRACK")
_BLOCKS = {"FOR": True, "WHILE": True, "TEST": False}
_ENDS = {f"END{word}" for word in ("IF", "FOR", "WHILE", "TEST", "PROC", "FUNC", "TRAP", "MODULE")}
_LEADS = {":", "THEN", "ELSE", "DO", "ERROR", "UNDO", "BACKWARD", "DEFAULT", *_ENDS}
"""Behind them an instruction begins."""
_WORDS = {*_LEADS, "IF", "ELSEIF", "FOR", "FROM", "TO", "STEP", "WHILE", "TEST", "CASE", "RETURN"}
_WORDS |= {"AND", "OR", "XOR", "NOT", "DIV", "MOD", "GOTO", "RAISE", "CONNECT", "WITH", *_TYPES}
"""Words of the language, which call nothing."""
_HEADS, _STORED = ("PROC", "FUNC", "TRAP"), ("VAR", "PERS", "CONST", "ALIAS")
_READS = re.compile(
    r"OFFS|RELTOOL|DISTANCE|CALC(?:JOINT|ROB)T|CROBT|CJOINTT|CPOS|MIRPOS|ORIENTZYX|EULERZYX|ABS|SQRT|DIM"
    r"|POSE(?:MULT|INV|VECT)|VECTMAGN|DOTPROD|DEF(?:D|ACC)?FRAME|ROUND|TRUNC|(?:VAL|NUM)TOSTR|PRESENT|ARGNAME"
    r"|IS(?:PERS|VAR)|TP(?:WRITE|SHOW)|WRITE(?:ANY)?(?:BIN)?|PACKRAWBYTES|ERR(?:WRITE|LOG)|UIMSGBOX|STOP|EXIT"
    r"|WAIT(?:TIME|UNTIL|ROB|[DAG][IO])|PDISP(?:ON|SET)|WZ(?:BOX|CYL|SPH|HOMEJOINT|LIMJOINT)DEF|GRIPLOAD|SETSYSDATA|EGM\w+"
)
"""Routines of RAPID that change no point which they are given."""
_REMOTE = "stands in the cell (robhold FALSE) and the arm holds the work, which is not corrected"
_HELD = "is held or moved by a robot or a positioner, which is not corrected"
_Move = tuple[SourceStatement, bool, dict[str, str]]
_Data = dict[str, tuple[Array | None, str]]
_FASTEST_TOOL = 5000
"""mm/s of the tool centre point that `VelSet` allows at most."""


def read(path: Path, text: str) -> Parts:
    """The parts of a module. InputError where it is not whole."""
    lines = list(statements(path, tokenise(text, GRAMMAR)))
    words = {w for line in lines if line.remark is None for w in line.upper}
    if not {"MODULE", "ENDMODULE"} <= words:
        missing = next(w for w in ("MODULE", "ENDMODULE") if w not in words)
        message = f"is no whole module of RAPID: {missing} is missing"
        raise InputError(Problem(message, str(path), 1, allowed="MODULE ... ENDMODULE"))
    names, code = Names(literal=literal), [line for line in lines if line.remark is None]
    data: dict[str, _Data] = {"TOOLDATA": {}, "WOBJDATA": {}}
    for line in code:
        _declared(line, names, data)
    verbs = [list(_verbs(line, names)) for line in code]
    routines, changed = _changing(code, verbs)
    for given in changed:
        names.change(given.statement, given.variable, given.caller.text)
        said = f"is given to {given.caller.text} in line {given.statement.line}, which may change it"
        for kept in data.values():
            kept[given.variable.lower()] = None, said
    for line, found in zip(code, verbs, strict=True):
        for at in found:
            _searched(line.after(at), names)

    def walk(track: Track) -> list[_Move]:
        return [move for line, found in zip(code, verbs, strict=True) for move in _walk(line, found, track, routines)]

    motions = [_motion(line, names, data, ends, here) for line, ends, here in walked(walk)]
    tools, frames = ({n: m for n, (m, _) in data[k].items() if m is not None} for k in _DATA)
    return lines, names.stated(), motions, tools, frames


def _walk(line: SourceStatement, found: Sequence[int], track: Track, routines: Collection[str]) -> Iterator[_Move]:
    """The motions of a line, each with what holds there; what shifts the path goes on into the next routine."""
    words = line.upper
    sole = "IF" in words and "THEN" not in words  # the one instruction of an IF
    for k, word in enumerate(words):
        if word in _HEADS:
            before = track.now
            track.reset(_head(line.tokens, k))
            track.now = before | track.now
        elif word in _BLOCKS or word == "THEN":
            if word == "THEN" and next((w for w in reversed(words[:k]) if w in ("IF", "ELSEIF")), "") == "ELSEIF":
                track.other()
            else:
                track.begin(_BLOCKS.get(word, False))
        elif word in ("ELSE", "CASE", "DEFAULT"):
            track.other()
        elif word == "RETURN":
            track.returns()
        elif word in ("ENDIF", "ENDFOR", "ENDWHILE", "ENDTEST"):
            track.end()
        elif word in _SHIFTS:
            if sole:
                track.begin(False)
            track.now[GUIDED] = _SHIFTS[word]
            if sole:
                track.end()
        elif word in routines and not any(w in _HEADS for w in words[max(k - 2, 0) : k]):
            track.call(word, certain=not sole)
        elif k in found:
            stop = next((at for at in found if at > k), len(words))
            yield SourceStatement(line.path, line.tokens[k:stop]), stop == len(words), track.here()


def _head(tokens: Sequence[Token], at: int) -> str:
    """The folded name of a routine whose head begins at a place."""
    return tokens[min(at + 1 + (tokens[at].text.upper() == "FUNC"), len(tokens) - 1)].text.upper()


def _changing(lines: Sequence[SourceStatement], verbs: Sequence[Sequence[int]]) -> tuple[Collection[str], list[Given]]:
    """The routines of a module, and the variables that routines are given which may change them."""
    heads = [next((k for k, w in enumerate(line.upper) if w in _HEADS), None) for line in lines]
    pairs = [(line.tokens, at) for line, at in zip(lines, heads, strict=True) if at is not None]
    routines = {_head(tokens, at): _parameters(tokens[at:]) for tokens, at in pairs}
    assigned, given, within = set[tuple[str, str]](), list[Given](), ""
    for line, head, found in zip(lines, heads, verbs, strict=True):
        within = within if head is None else _head(line.tokens, head)
        assigned |= {(within, line.upper[start]) for start, _ in _assigned(line)}
        stop = found[0] if found else len(line.tokens)
        calls = [(k, p) for k, p in called(line.tokens, _WORDS) if k < stop or line.upper[k] in routines]
        calls += [own] if (own := _procedure(line, stop)) is not None else []
        for k, parts in calls:
            caller, text = line.tokens[k], parts[0][0] if parts[0] else line.tokens[k]
            by_name = line.upper[k] == "SETDATAVAL" and text.kind == "string"
            handed = [(0, text.text.strip('"'))] if by_name else list(_arguments(parts))
            given += [Given(line, within, caller, place, name) for place, name in handed]
    return routines, changing(given, routines, assigned, _READS)


def _parameters(tokens: Sequence[Token]) -> dict[int | str, str]:
    """The folded names of a routine's parameters by their places, of optional ones by their names; "" of a copy."""
    at = next((k for k, t in enumerate(tokens[:4]) if t.text == "("), len(tokens))
    out, count = dict[int | str, str](), 0
    for part in split(bracketed(tokens, at) or ()):
        for k, own in enumerate(split(part, "\\")):
            words = [t.text.upper() for t in itertools.takewhile(lambda t: t.text != "{", own) if t.kind == "word"]
            if words:
                out[words[-1] if k else count] = words[-1] if {"VAR", "PERS", "INOUT", "REF"} & set(words) else ""
                count += k == 0
    return out


def _arguments(parts: Sequence[Sequence[Token]]) -> Iterator[tuple[int | str, str]]:
    """The variables among a call's arguments, with their places; those of optional ones with their names."""
    place = 0
    for part in parts:
        for k, own in enumerate(split(part, "\\")):
            sides = split(own, ":=")
            if own and (name := variable(sides[-1])) and (k == 0 or len(sides) > 1):
                yield own[0].text.upper() if k else place, name
            place += bool(own) and k == 0


def _procedure(line: SourceStatement, stop: int) -> tuple[int, list[list[Token]]] | None:
    """Where a procedure is called before a place, `IF high pick p1,50`, and its arguments."""
    words, at = line.upper[:stop], _begin(line.tokens[:stop])
    own = line.tokens[at:stop]
    gives = own and words[at] == "IF" and any(_assigned(SourceStatement(line.path, own)))
    if not own or gives or any(word in (*_HEADS, *_STORED) for word in words[at:]):
        return None
    first, start = split(own)[0], 0
    if words[at] == "IF" or own[0].text == "%":  # behind a condition a name begins where two follow each other
        starts = [
            k
            for k, (token, after) in enumerate(pairwise(first))
            if after.kind in ("word", "string", "number")
            and after.text.upper() not in _WORDS
            and (token.text == "%" or (token.kind == "word" and token.text.upper() not in _WORDS))
        ]
        start = starts[-1] if starts else -1
    elif own[0].kind != "word" or words[at] in _WORDS or (":=" in words and variable(split(own, ":=")[0])):
        start = -1
    return (at + start, split(own[start + 1 :])) if start >= 0 else None


def _begin(tokens: Sequence[Token]) -> int:
    """Where the last instruction of a line begins: behind THEN, a label, or the head of a routine."""
    at, depth = 0, 0
    for k, token in enumerate(tokens):
        depth += (token.text in ("(", "[", "{")) - (token.text in (")", "]", "}")) if token.kind == "sign" else 0
        word = token.text.upper()
        if depth == 0 and (word in _LEADS or (word == ")" and any(t.text.upper() in _HEADS for t in tokens[at:k]))):
            at = k + 1
        elif word == "TRAP":
            at = k + 2
    return at


def _assigned(line: SourceStatement) -> Iterator[tuple[int, int]]:
    """Where what gets a value begins, and where its `:=` stands; not of options."""
    for k, token in enumerate(line.tokens):
        start = left_of(line.tokens, k) if token.text == ":=" and k else 0
        if token.text == ":=" and (start == 0 or line.tokens[start - 1].text != "\\"):
            yield start, k


def _searched(line: SourceStatement, names: Names) -> None:
    """A search writes the place that it finds into its second argument."""
    parts = [own for part in split(line.tokens[1:]) if (own := split(part, "\\")[0])]
    if line.upper[0].startswith("SEARCH") and len(parts) > 1:
        names.change(line, variable(parts[1]) or shown(parts[1]))


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
        if word in _HEADS:
            names.begin(line.after(k))
        elif word in _TYPES and (":=" not in words[k + 2 : k + 6] or ")" in words[k + 2 : k + 6]):
            names.change(line.after(k), line.tokens[k + 1].text)  # a variable, or what a routine is given
    if ":=" not in words:
        return
    at = words.index(":=")
    value = line.tokens[at + 1 :]
    kind = next(
        (k for k, w in enumerate(words[:at]) if w in _TYPES + _DATA and words[at - 1] in (words[k + 1], "}")), None
    )
    if kind is None:
        for start, at in _assigned(line):
            for kept in data.values():
                kept[words[start].lower()] = None, "gets other values when the programme runs"
            value = line.tokens[at + 1 :]
            if at - start == 1 or (line.tokens[at - 1].text == "}" and names.literal(value) is not None):
                names.give(line, shown(line.tokens[start:at]), value)
            else:
                names.change(line, variable(line.tokens[start:at]))
        return
    name, own = line.tokens[kind + 1].text, line.after(kind + 1)
    if words[kind] in _DATA:
        data[words[kind]].setdefault(name.lower(), (_tool if words[kind] == "TOOLDATA" else _work_object)(value))
    elif words[kind + 2] == "{":
        for k, element in enumerate(split(enclosed(value, "[") or ()), start=1):
            names.give(own, f"{name}{{{k}}}", element)
    else:
        names.give(own, name, value)


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
    user, place = _frame(parts[3]), _frame(parts[4])
    fixed = [shown(p).upper() for p in parts[:2]] == ["FALSE", "TRUE"]
    return None if user is None or place is None else user @ place, "" if fixed else _HELD


def _frame(tokens: Sequence[Token]) -> Array | None:
    parts = [numbers(enclosed(part, "[") or ()) for part in split(enclosed(tokens, "[") or ())]
    values = [cell.value for part in parts for cell in part or ()]
    return quaternion_pose(np.array(values)) if len(values) == 7 and any(values[3:]) else None


def _verbs(line: SourceStatement, names: Names) -> Iterator[int]:
    """Where motions begin: at their names, or at those of an option with a target, a speed or a zone, and more."""
    words, verb = line.upper, -2
    for k, word in enumerate(words):
        before, after = words[k - 1] if k else "", words[k + 1] if k + 1 < len(words) else ";"
        named = before in _BEFORE_NAMES or after in (":=", "{", ".") or verb == k - 1
        if line.tokens[k].kind != "word" or named:
            continue
        parts = split(line.tokens[k + 1 :]) if _INSTRUCTION.fullmatch(word) else ()
        fast = bool(parts) and any(_SPEED.fullmatch(w) for w in words[k + 1 :])
        if _MOTION.fullmatch(word) or (len(parts) > 3 and _goes(split(parts[0], "\\")[0], names, fast)):
            verb = k
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
    line: SourceStatement, names: Names, data: Mapping[str, _Data], ends: bool, here: dict[str, str]
) -> ProgrammeMotion:
    """A motion by its line, from its verb on."""
    verb, parts = line.upper[0], [split(p, "\\")[0] for p in split(line.tokens[1:])]
    parts = [p for p in parts if p]
    if verb.startswith("SEARCH") and len(parts) > 1:
        parts = parts[2:]
    count = 0 if verb.startswith("EGMRUN") else 2 if _SUFFIX.sub("", verb).endswith("C") else 1
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
    elif any(words[k - 1] == "\\" and word in _SENSORS for k, word in enumerate(words)):
        wrong = "a sensor shifts its path when it runs (\\Corr, \\Track)"
    wrong = wrong or (_FORCE if verb.startswith(("FC", "EGMRUN")) else guided(here))
    for kind, name in (("TOOLDATA", tool), ("WOBJDATA", frame)):
        wrong = wrong or (f"{name} {held}" if (held := data[kind].get(name, (None, ""))[1]) else "")
    return names.motion(line, parts[:count], (tool, frame), wrong)


def write_rapid(programme: Programme, name: str) -> str:
    """The module. `name` is the module's name: a letter, then letters, digits and _, up to 28."""
    allowed = "a letter, then letters, digits and _, up to 28, for the procedure is named run_ and this"
    check_name(name, r"[A-Za-z][A-Za-z0-9_]{0,27}", allowed)
    names = arm_axes(programme, "J", "RAPID")
    points, motions = list[str](), list[tuple[str, str]]()
    for i, move in enumerate(programme.moves, start=1):
        arm, beside = (",".join(cell for _, cell in axis_cells(names, move, k, "9E+09")) for k in "JE")
        points.append(f"  LOCAL CONST jointtarget jp{i}:=[[{arm}],[{beside}]];")
        motions.append((f"MoveAbsJ jp{i}\\NoEOffs,vmax,fine,{programme.tool}\\WObj:={programme.frame};", "Stop;"))
    body = [f"VelSet {programme.speed},{_FASTEST_TOOL};"]
    body += way_lines(programme, "! ", motions, f"WaitTime\\InPos,{programme.pause or 0:.2f};")
    remarks = [f"  ! {remark}" for remark in opening_remarks(programme, LOAD_DATA, axis_order(names, "J"))]
    lines = [f"MODULE {name}", *remarks, *points, f"  PROC run_{name}()", *(f"    {line}" for line in body)]
    return file_text([*lines, "  ENDPROC", "ENDMODULE"])


class Rapid(Language):
    """RAPID. It knows no share of each joint's largest speed: `VelSet` takes the share of `vmax`, the largest of the
    tool centre point and of its turning."""

    maker = "ABB"
    endings = (".mod", ".modx", ".prg", ".sys", ".sysx")
    pose = Orientation(
        axes=("X", "Y", "Z", "Q1", "Q2", "Q3", "Q4"),
        letter="J",
        stated="X, Y, Z, RX, RY, RZ in mm and deg, turns about the fixed x, then y, then z",
    )
    form, written = "rapid", (".mod",)
    tool, frame = "tool0", "wobj0"
    name_of_frame, names_of_frames = r"[A-Za-z]\w{0,31}", "the name of a tooldata or wobjdata"

    def read(self, texts: Mapping[Path, str]) -> Parts:
        """The parts of a module. InputError where it is not whole."""
        ((path, text),) = texts.items()
        return read(path, text)

    def write(self, programme: Programme, name: str) -> tuple[str, ...]:
        """The module."""
        return (write_rapid(programme, name),)
