"""URScript of Universal Robots (.script, .urscript): joint angles in rad, poses in m and rotation vectors in rad."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from qsf_controllers.names import GUIDED, Names, Track, guided, walked
from qsf_controllers.writing import check_name, file_text, opening_remarks, plain, way_lines
from qsframework.plugin import (
    AMBIGUOUS,
    AXES,
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
    matrix,
    numbers,
    split,
    statements,
    tokenise,
)

POSE = Orientation(
    axes=("X", "Y", "Z", "RX", "RY", "RZ"),
    letter="J",
    length=1.0,
    angle=1.0,
    turns="vector",
    digits=7,
    stated="X, Y, Z in m and the rotation vector RX, RY, RZ in rad",
)
GRAMMAR = re.compile(
    rf"(?P<remark>#[^\n]*)|(?P<string>\"[^\"\n]*\"|'[^'\n]*')|{NUMBER}|(?P<word>[^\W\d]\w*)"
    r"|(?P<end>\n)|(?P<sign>[=<>!]=|\S)"
)
_MOTIONS = {
    "movej": 1,
    "movel": 1,
    "movep": 1,
    "movec": 2,
    "optimovej": 1,
    "optimovel": 1,
    "servoj": 1,
    "servoc": 1,
    "servol": 1,
    "speedj": 0,
    "speedl": 0,
}
"""Motions, and how many points each goes to; 0: it moves by a speed."""
_HERE = tuple(f"GET_{which}_{what}" for which in ("ACTUAL", "TARGET") for what in ("JOINT_POSITIONS", "TCP_POSE"))
_ROUTINES, _BLOCKS = ("def", "thread", "sec"), ("if", "while", "for")
_CONVEYOR, _OFFSET = "its points are relative to a conveyor", "a path offset shifts it"
_FORCE = "the arm gives way to forces there"
_SHIFTS = {
    "track_conveyor_linear": _CONVEYOR,
    "track_conveyor_circular": _CONVEYOR,
    "path_offset_enable": _OFFSET,
    "path_offset_set": _OFFSET,
    "force_mode": _FORCE,
    "freedrive_mode": _FORCE,
    "teach_mode": _FORCE,
    **dict.fromkeys(("stop_conveyor_tracking", "path_offset_disable", "end_force_mode"), ""),
    **dict.fromkeys(("end_freedrive_mode", "end_teach_mode"), ""),
}
"""Why motions after a call are not corrected; "" where they are again."""
_TARGETS = ("q", "pose", "pose_via", "pose_to")
_Move = tuple[SourceStatement, Sequence[Token], dict[str, str]]
TOOL, FRAME = "tcp", "base"
"""Names of the installation's tool and of the frame of all poses."""
_FASTEST_JOINT = float(np.deg2rad(120.0))
_ACCELERATION = 0.5
"""rad/s^2, of the joint that turns farthest."""


def read(path: Path, text: str) -> Parts:
    """The parts of a script. InputError where a routine does not end."""
    lines = list(statements(path, tokenise(text, GRAMMAR), joined=True))
    _whole(path, lines)
    names, tools = Names(literal=literal, here=_HERE, fold=str), dict[str, Array]()
    code = [line for line in lines if line.remark is None]
    for line in code:
        _given(line, names)

    def walk(track: Track) -> list[_Move]:
        return [move for line in code for move in _walk(line, track, tools)]

    motions = [_motion(line, inside, names, here) for line, inside, here in walked(walk)]
    gone = {name for motion in motions for name in motion.points}
    return lines, [p for p in names.stated() if p.name in gone], motions, tools, {}


def _walk(line: SourceStatement, track: Track, tools: dict[str, Array]) -> Iterator[_Move]:
    """The motions of a line, each with what holds there."""
    _follow(line, track, tools)
    for k, token in enumerate(line.tokens[:-1]):
        if token.text in _MOTIONS and line.tokens[k + 1].text == "(":
            own = line.after(k)
            inside = bracketed(own.tokens, 1)
            end = len(own.tokens) if inside is None else len(inside) + 3
            yield SourceStatement(line.path, own.tokens[:end]), inside or (), track.here()


def _whole(path: Path, lines: Sequence[SourceStatement]) -> None:
    firsts = [line.tokens[0] for line in lines if line.remark is None and line.upper[1:2] != ["="]]
    opened = [t for t in firsts if t.text in _ROUTINES + _BLOCKS]
    if len(opened) != sum(t.text == "end" for t in firsts):
        last = (opened or firsts or [Token("", "", 0, 1)])[-1]
        message = "is no whole script: `def`, `if`, `while`, `thread` and `end` do not match"
        raise InputError(Problem(message, str(path), last.line, allowed="def name(): ... end"))


def literal(tokens: Sequence[Token]) -> tuple[dict[str, Cell], str] | None:
    """The numbers of `[q1,...,q6]` or `p[x,y,z,rx,ry,rz]`."""
    pose = len(tokens) > 1 and tokens[0].text == "p"
    inside = enclosed(tokens[1:] if pose else tokens, "[")
    found = numbers(inside) if inside else None
    if found is None or len(found) != 6:
        return None
    return dict(zip(POSE.axes if pose else [f"J{k}" for k in range(1, 7)], found, strict=True)), ""


def _given(line: SourceStatement, names: Names) -> None:
    """What a line gives to a name: a point, a list of points, or something else."""
    if line.tokens[0].text in _ROUTINES:
        for token in line.tokens[2:]:
            names.change(line, token.text)  # what a routine is given hides what is known by the same name
        return
    for k, token in enumerate(line.tokens[:-3]):
        if token.kind == "word" and [line.tokens[k + n].text for n in (1, 3)] == [".", "("]:
            names.change(line, token.text)  # a list changes itself, `ways.append(...)`
    sides = split(line.tokens, "=")
    named = [t for t in sides[0] if t.text not in ("global", "local")]
    if len(sides) != 2 or len(named) != 1 or named[0].kind != "word":
        for side in sides[:-1]:
            names.change(line, side[left_of(side, len(side))].text if side else "")
        return
    elements = split(enclosed(sides[1], "[") or ())
    if names.literal(sides[1]) is None and len(elements) > 1 and all(map(names.literal, elements)):
        for k, element in enumerate(elements):
            names.give(line, f"{named[0].text}[{k}]", element)
    else:
        names.give(line, named[0].text, sides[1])


def _follow(line: SourceStatement, track: Track, tools: dict[str, Array]) -> None:
    """What a line says of the tool from there on."""
    tokens = line.tokens
    first = tokens[0].text
    if first in _ROUTINES:
        track.begin(False, tokens[1].text if len(tokens) > 1 else "")
        return
    for k, _ in called(tokens, ()):
        if tokens[k].text in _SHIFTS:
            why = _SHIFTS[tokens[k].text]
            track.now[GUIDED] = why and f"{why} when it runs ({tokens[k].text} in line {line.line})"
        track.call(tokens[k].text, certain=tokens[k - 1].text != "run")
    if first in _BLOCKS:
        track.begin(first in ("while", "for"))
    elif first in ("elif", "else"):
        track.other()
    elif first == "end":
        track.end()
    elif first == "return":
        track.returns()
    elif first == "set_tcp":
        point = literal(split(bracketed(tokens, 1) or ())[0])
        name = f"set_tcp of line {line.line}" if point else AMBIGUOUS
        track.now["tool"] = name
        if point:
            values = np.array([cell.value for cell in point[0].values()])
            same = next((n for n, m in tools.items() if np.array_equal(m, matrix(POSE, values))), name)
            tools[same] = matrix(POSE, values)
            track.now["tool"] = same


def _motion(line: SourceStatement, inside: Sequence[Token], names: Names, here: dict[str, str]) -> ProgrammeMotion:
    """A motion by its call, with the arguments that stand in its brackets."""
    verb = line.tokens[0].text
    named = [(p[0].text, p[2:]) if [t.text for t in p[1:2]] == ["="] else ("q", p) for p in split(inside) if p]
    parts = [p for name, p in named if name in _TARGETS]
    count = _MOTIONS[verb]
    wrong = "" if count else "it moves by a speed, not to a point"
    if not inside:
        wrong = "it does not end, or goes nowhere"
    wrong = guided(here) or wrong
    return names.motion(line, [_reached(p) for p in parts[:count]], (here.get("tool", TOOL), FRAME), wrong)


def _reached(tokens: Sequence[Token]) -> Sequence[Token]:
    """The pose of `get_inverse_kin(pose, qnear=...)`, and else what is given."""
    if tokens and tokens[0].text == "get_inverse_kin":
        return split(bracketed(tokens, 1) or ())[0]
    return tokens


def write_urscript(programme: Programme, name: str) -> str:
    """The script. `name` is the function's name: a letter, then letters, digits and _, up to 32."""
    check_name(name, r"[A-Za-z][A-Za-z0-9_]{0,31}", "a letter, then letters, digits and _, up to 32")
    count = len(programme.moves[0].pendant)
    if count != AXES or programme.external:
        found = f"{count} joints, {len(programme.external)} of them external"
        words = "URScript states the six joints of the arm"
        raise InputError(Problem(words, found=found, allowed="6 joints", argument=("to", "csv")))
    remarks = opening_remarks(
        programme,
        "set the payload and its centre of gravity, of tool and weight, before the start",
        [
            f"speed {programme.speed} percent of {np.rad2deg(_FASTEST_JOINT):g} deg/s",
            "tool and frame: joint angles need none; set_tcp stays as the installation has it",
        ],
    )
    velocity, motions = f"{_FASTEST_JOINT * programme.speed / 100.0:.5f}", list[tuple[str, str]]()
    for move in programme.moves:
        load = f"now hang {plain(move.load)}, take it off before you continue" if move.load else "nothing hangs here"
        text = f"{f'tracker at {plain(move.station)}, ' if move.station else ''}{load}"
        ask = f'popup("{move.pose} visit {move.repeat}: {text}", title="measure", blocking=True)'
        angles = ", ".join(f"{v + 0.0:.7f}" for v in move.pendant)
        motions.append((f"movej([{angles}], a={_ACCELERATION}, v={velocity})", ask))
    body = [f"# {remark}" for remark in remarks]
    body += way_lines(programme, "# ", motions, f"sleep({programme.pause or 0:.2f})")
    return file_text([f"def {name}():", *(f"  {line}" for line in body), "end"])


class URScript(Language):
    """URScript. A joint move takes the speed of the joint that turns farthest, in rad/s: the share is of 120 deg/s, the
    largest of the slowest joints that the maker has."""

    maker = "UNIVERSAL ROBOTS"
    endings = (".script", ".urscript")
    pose = POSE
    form, written = "urscript", (".script",)

    def read(self, texts: Mapping[Path, str]) -> Parts:
        """The parts of a script. InputError where it is not whole."""
        ((path, text),) = texts.items()
        return read(path, text)

    def write(self, programme: Programme, name: str) -> tuple[str, ...]:
        """The script."""
        return (write_urscript(programme, name),)
