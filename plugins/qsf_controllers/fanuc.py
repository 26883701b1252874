"""FANUC TP listings (.ls): motions under /MN, positions under /POS."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from qsf_controllers.writing import axis_order, bad_name, check_name, file_text, opening_remarks, plain, way_lines
from qsframework.plugin import (
    NUMBER,
    Cell,
    InputError,
    Language,
    Move,
    Orientation,
    Parts,
    Problem,
    Programme,
    ProgrammeMotion,
    ProgrammePoint,
    SourceStatement,
    Token,
    axis_names,
    bracketed,
    number,
    refuse,
    shown,
    split,
    tokenise,
    unmoved,
)

GRAMMAR = re.compile(
    r"(?P<section>^/[A-Z]+\b)"
    r"|(?P<remark>^[ \t\r]*[0-9]*[ \t]*:[ \t]*(?:!|//|--)[^\n]*)|(?P<head>^[ \t\r]*[0-9]*[ \t]*:)"
    r"|(?P<text>MESSAGE[ \t]*\[[^\]\n]*\])|(?P<label>(?<=[0-9]):[^\]\n]*(?=\]))"
    rf"|(?P<string>\"[^\"\n]*\"|'[^'\n]*')|(?P<stars>\*+)|{NUMBER}|(?P<word>[^\W\d]\w*)|(?P<end>;)|(?P<sign>\S)",
    re.MULTILINE,
)
_PARTS = ("/PROG", "/MN", "/POS", "/END")
_MOTIONS = ("J", "L", "C", "A", "S")
_REMOTE = ("RX", "RY", "RZ", "RW", "RP", "RR")
_OPTIONS = {
    "RTCP": "the tool stands in the cell (remote TCP) and the arm holds the work, which is not corrected",
    "INC": "it is relative to where the arm stands",
    "COORD": "it is coordinated with a positioner, which moves its user frame",
}
_SENSORS = ("TRACK", "SOFTFLOAT", "SENSOR_ON", "SENSOR_OFF")
_ANY = "?"
"""Any number of UFRAME and UTOOL."""
_SHIFT = re.compile(r"(TOOL_)?V?OFFSET")
_CELL = re.compile(r"[JE][1-9]|[XYZWPR]")
_REMARK = 32
"""Characters that a remark may have on a controller."""
_LOAD_NAME = _REMARK - len("!now hang ")
_MOST_AXES = 9
_PER_LINE = 3


def read_listing(path: Path, text: str) -> Parts:
    """The parts of a listing. InputError where it is not whole."""
    sections, found = dict[str, list[Token]](), list[str]()
    for token in tokenise(text, GRAMMAR):
        if token.kind == "section":
            found.append(token.text)
        sections.setdefault(found[-1] if found else "", []).append(token)
    if "" in sections or [part for part in found if part in _PARTS] != list(_PARTS):
        missing = [m for m in _PARTS if m not in found] or ["the order of its parts"]
        message = f"is no whole FANUC listing: {', '.join(missing)} is missing or not in its place"
        raise InputError(Problem(message, str(path), 1, allowed="/PROG, /ATTR, /MN, /POS, /END"))
    points = positions(path, sections["/POS"])
    lines = list(_lines(path, sections["/MN"][1:]))
    set_in = {key: line.line for line in reversed(lines) if line.remark is None for key in _sets(line)}
    points = [_set_when_it_runs(point, set_in) for point in points]
    conveyor = "LINE_TRACK_SCHEDULE_NUMBER" in (words := [t.text for t in sections.get("/APPL", ())])
    conveyor = conveyor and "0" not in words[words.index("LINE_TRACK_SCHEDULE_NUMBER") :][2:3]
    known, shifts = dict.fromkeys(p.name for p in points), list(_shifts(lines))
    if any("JMP" in line.upper for line in lines):  # what holds at the end may hold from the beginning
        shifts = list(_shifts(lines, shifts[-1]))
    shifts = ["its points are relative to a conveyor (LINE_TRACK)" if conveyor else said for said in shifts]
    motions = [m for line, said in zip(lines, shifts, strict=True) if (m := _motion(line, known, said)) is not None]
    return lines, points, motions, {}, {}


def _set_when_it_runs(point: ProgrammePoint, set_in: Mapping[tuple[str, str], int]) -> ProgrammePoint:
    """A pose cannot be corrected where the programme itself sets its tool or its user frame, `UFRAME[2]=PR[5]`."""
    own = (
        ("UFRAME", point.frame, point.cartesian),
        ("UTOOL", point.tool, point.cartesian),
        ("P", point.name[2:-1], True),
    )
    for data, number_of, concerned in own:
        line = set_in.get((data, number_of), set_in.get((data, _ANY)))
        if concerned and point.problem is None and line is not None:
            said = f"{point.name}: {data}[{number_of}] is set in line {line} when the programme runs"
            return replace(point, problem=Problem(said, str(point.path), point.line))
    return point


def _sets(line: SourceStatement) -> Iterator[tuple[str, str]]:
    """The data and their numbers that a line sets: `UFRAME[2]=PR[5]`, `UTOOL[R[1]]=...`, `$MNUFRAME[1,2]=...`."""
    words = line.upper
    for k, word in enumerate(words):
        system = k and words[k - 1] == "$" and word in ("MNUFRAME", "MNUTOOL", "UFRAME", "UTOOL")
        if system and "=" in words[k:]:
            yield word.removeprefix("MN"), _ANY
        inside = bracketed(line.tokens, k + 1) if word in ("UFRAME", "UTOOL", "P") else None
        if inside and words[k + len(inside) + 3 :][:1] == ["="]:
            yield word, inside[0].text if inside[0].kind == "number" else _ANY


def _shifts(lines: Sequence[SourceStatement], said: str = "") -> Iterator[str]:
    """Why the path is shifted at each line, "" where it is not."""
    for line in lines:
        words = line.upper
        if line.remark is None and (words[0] in _SENSORS or words[:2] == ["TOUCH", "OFFSET"]):
            off = "END" in words or words[0] == "SENSOR_OFF"
            said = "" if off else f"{shown(line.tokens)} in line {line.line} shifts it when it runs"
        yield said


def _lines(path: Path, tokens: Sequence[Token]) -> Iterator[SourceStatement]:
    """The numbered lines; a line without a number goes on with the one before, where that has not ended."""
    own = list[Token]()
    for token in tokens:
        starts = token.kind in ("head", "remark") and token.text.strip(" \t\r:") != ""
        if own and (token.kind == "end" or starts):
            yield SourceStatement(path, tuple(own))
            own = []
        if token.kind == "remark":
            yield SourceStatement(path, (token,))
        elif token.kind not in ("head", "end") and token.text != "@":  # @: where the arm stood when it was listed
            own.append(token)
    if own:
        yield SourceStatement(path, tuple(own))


def _motion(line: SourceStatement, known: dict[str, None], shift: str) -> ProgrammeMotion | None:
    """The motion of a line: J, L, C, A or S, and what is numbered in brackets; shift: why it does not end there."""
    tokens, words = line.tokens, line.upper
    if words[0] not in _MOTIONS or len(tokens) < 3 or tokens[1].kind != "word" or words[2] != "[":
        return None
    goes, at = list[str](), 1
    while at < len(tokens) - 1 and words[at + 1] == "[" and (at == 1 or words[at] in ("P", "PR")):
        inside = [t for t in bracketed(tokens, at + 1) or () if t.kind != "label"]
        goes.append(f"{words[at]}[{shown(inside)}]")
        at += next((k for k, word in enumerate(words[at:]) if word == "]"), 0) + 1
        at += sum(word == "]" for word in words[at : at + 1])  # of P[R[1]]
    keep, problem = f"line {line.line}", None
    said = [_OPTIONS[w] for w in words[at:] if w in _OPTIONS]
    said += ["it is shifted by a register when it runs" for w in words[at:] if _SHIFT.fullmatch(w)]
    said += [shift] if shift else []
    targets = list[str]()
    for name in goes:
        if name in known:
            targets.append(name)
        elif re.fullmatch(r"P\[\D.*\]", name):
            targets += known  # its number is chosen when it runs
        else:
            held = (
                "has no position under /POS" if name.startswith("P[") else "is held by the controller, not by the file"
            )
            said, keep = [*said, f"{name} is moved to, but {held}"], name if not said else keep
    if said:
        problem = unmoved(line, said[0], keep, allowed="P[n] with a position under /POS")
    return ProgrammeMotion(statement=line, points=tuple(dict.fromkeys(targets)), keep=keep, problem=problem)


def positions(path: Path, tokens: Sequence[Token]) -> list[ProgrammePoint]:
    """The positions `P[n]{...};`. InputError for one that does not end."""
    out, problems = list[ProgrammePoint](), list[Problem]()
    starts = [k for k, t in enumerate(tokens) if t.text == "P" and [u.text for u in tokens[k + 1 : k + 2]] == ["["]]
    for k, stop in pairwise([*starts, len(tokens)]):
        own = tokens[k:stop]
        inside = bracketed(own, 1) or []
        name = f"P[{shown([t for t in inside if t.kind != 'label'])}]"
        block = own[3 + len(inside) :]
        if not block or block[0].text != "{":
            continue  # named in a motion, not given
        body = bracketed(block)
        if body is None or [t.text for t in block[len(body) + 2 :][:1]] != [";"]:
            hint = "A point ends in `};` before the next one begins."
            problems.append(Problem(f"{name} does not end", str(path), own[0].line, hint=hint))
            continue
        label = next((t.text for t in inside if t.kind == "label"), "").strip(':" \t')
        out.append(_position(path, name, label, own[0].line, body))
    refuse(problems)
    return out


def _position(path: Path, name: str, label: str, line: int, body: Sequence[Token]) -> ProgrammePoint:
    """A position: the numbers of group 1, the arm; other groups are positioners, which nothing bends."""
    heads = [k for k, t in enumerate(body) if re.fullmatch(r"GP[0-9]", t.text)]
    groups = {body[k].text: body[k + 2 : m] for k, m in pairwise([*heads, len(body)])}
    arm = groups.pop("GP1", [] if groups else body)
    cells, stated, problem = dict[str, Cell](), dict[str, str](), None
    for part in filter(None, split(arm)):
        key, sign = part[0].text, part[1].text if len(part) > 1 else ""
        if sign == ":":
            stated[key] = shown(part[2:])
            continue
        cell = number(part[2:-1]) if part[-1].text in ("deg", "mm") else None
        if cell is None or sign != "=" or key in cells or not _CELL.fullmatch(key):
            said = f"{name}: {key} is no number with its unit"
            found = shown(part[2:]) or "nothing"
            if key in _REMOTE:
                said = f"{name} is a pose for a remote TCP: {_OPTIONS['RTCP']}"
                found = shown(part)
            allowed = "J1, ... or X, Y, Z, W, P, R, a number with deg or mm each"
            problem = problem or Problem(said, str(path), part[0].line, found=found[:40], allowed=allowed)
        else:
            cells[key] = cell
    if not arm:
        problem = Problem(
            f"{name} moves no arm: it has no group 1", str(path), line, found=", ".join(groups) or "nothing"
        )
    elif problem is None and not {"UF", "UT"} <= stated.keys():
        problem = Problem(f"{name} states no UF and UT", str(path), line)
    other = [g for g, tokens in groups.items() if {"X", "J6"} & {t.text for t in tokens}]
    if other and problem is None:
        problem = Problem(f"{name} moves a second arm, {other[0]}, which is not corrected", str(path), line)
    tool, frame = stated.get("UT", ""), stated.get("UF", "")
    return ProgrammePoint(
        name=name, path=path, line=line, cells=cells, tool=tool, frame=frame, label=label, problem=problem
    )


def write_fanuc(programme: Programme, name: str) -> str:
    """The listing. `name` is the programme's name on the controller: letters, digits and _, up to 36."""
    check_name(name, r"[A-Z][A-Z0-9_]{0,35}", "a letter, then letters, digits and _, up to 36")
    remarked: dict[str, str] = {}
    for load in (m.load for m in programme.moves if m.load):
        if (other := remarked.setdefault(plain(load)[:_LOAD_NAME], load)) != load:
            raise bad_name(load, f"a name that differs from that of {other!r} in its first {_LOAD_NAME} characters")
    names = axis_names(len(programme.moves[0].pendant), programme.external, "J", _MOST_AXES)
    remarks = [*opening_remarks(programme, "set PAYLOAD of tool and weight"), *axis_order(names, "J")]
    if len(remarks[0]) >= _REMARK:
        allowed = f"a robot's name of up to {_REMARK - 7} characters, for a remark holds no more"
        raise bad_name(programme.robot, allowed)
    motions = [(f"J P[{i}] {programme.speed}% FINE", "PAUSE") for i in range(1, len(programme.moves) + 1)]
    wait = f"WAIT {programme.pause or 0:6.2f}(sec)"
    lines = [f"!{text}" for text in remarks]
    lines += [f"UFRAME_NUM={programme.frame}", f"UTOOL_NUM={programme.tool}"]
    lines += way_lines(programme, "!", motions, wait, visit="", longest=_REMARK)
    texts = [f"{text}    ;" if text.startswith("J P[") else f"  {text} ;" for text in lines]
    where = f"UF : {programme.frame}, UT : {programme.tool}"
    positions = [_written_position(i, m, names, where) for i, m in enumerate(programme.moves, start=1)]
    head = [
        f"/PROG  {name}",
        "/ATTR",
        "OWNER\t\t= MNEDITOR;",
        'COMMENT\t\t= "qsf export";',
        f"LINE_COUNT\t= {len(lines)};",
        "PROTECT\t\t= READ_WRITE;",
        "TCD:  STACK_SIZE\t= 0,",
        "      TASK_PRIORITY\t= 50,",
        "      TIME_SLICE\t= 0,",
        "      BUSY_LAMP_OFF\t= 0,",
        "      ABORT_REQUEST\t= 0,",
        "      PAUSE_REQUEST\t= 0;",
        "DEFAULT_GROUP\t= 1,*,*,*,*;",
        "CONTROL_CODE\t= 00000000 00000000;",
        "/MN",
    ]
    numbered = (f"{k:4d}:{text}" for k, text in enumerate(texts, start=1))
    return file_text([*head, *numbered, "/POS", *positions, "/END"])


def _written_position(index: int, move: Move, names: tuple[str, ...], where: str) -> str:
    degrees = dict(zip(names, np.rad2deg(move.pendant) + 0.0, strict=True))
    cells = [f"{axis}={degrees[axis]:11.4f} deg" for axis in sorted(names, key=lambda a: (a[0] == "E", a))]
    rows = [",\t".join(cells[s : s + _PER_LINE]) for s in range(0, len(cells), _PER_LINE)]
    label = f':"{move.pose[:16]}"' if move.measured else ""
    return f"P[{index}{label}]{{\n   GP1:\n\t{where},\t\n\t" + ",\n\t".join(rows) + "\n};"


class Fanuc(Language):
    """TP listings. Joint positions are what the pendant shows; J3 is what robot.yaml's `controller:` says it is."""

    maker = "FANUC"
    endings = (".ls",)
    pose = Orientation(
        axes=("X", "Y", "Z", "W", "P", "R"), letter="J", most=_MOST_AXES, stated="X, Y, Z, W, P, R in mm and deg"
    )
    form, written = "fanuc-ls", (".ls",)
    tool, frame = "1", "0"

    def read(self, texts: Mapping[Path, str]) -> Parts:
        """The parts of a listing. InputError where it is not whole."""
        ((path, text),) = texts.items()
        return read_listing(path, text)

    def write(self, programme: Programme, name: str) -> tuple[str, ...]:
        """The listing."""
        return (write_fanuc(programme, re.sub(r"\W", "_", name).upper()),)
