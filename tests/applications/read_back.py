"""What an exported file says, read back: an independent proof that it says what the plan says."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from qsframework.applications.controller_names import MOST, plain
from qsframework.applications.programme import Programme, load_name
from qsframework.experiment import Plan
from qsframework.plugin import Array
from qsframework.units import JointUnits

_UNUSED = "9E+09"
_FASTEST = float(np.deg2rad(120.0))
"""rad/s of which URScript's speed is a share."""
ROUNDING = float(np.deg2rad(0.00005 * 1.001))
"""Files state angles to a ten-thousandth of a degree, 5 um at an arm of 3 m; URScript to 1e-7 rad."""


@dataclass(frozen=True, eq=False)
class Stop:
    """A stop of an exported file: pose "" in between; pause 0: none, None: until started by hand.

    load: what is hung there once the arm has stopped, or as much of its name as the format holds
    """

    pose: str
    repeat: int
    pendant: Array
    speed: int
    pause: float | None
    load: str = ""

    def waiting(self, pause: float | None) -> Stop:
        """The stop with its pause."""
        return replace(self, pause=pause)

    def hanging(self, load: str) -> Stop:
        """The stop with its load."""
        return replace(self, load=load)

    def holds(self, load: str) -> bool:
        """Whether this is its load."""
        return bool(self.load) == bool(load) and plain(load).startswith(plain(self.load))


@dataclass(frozen=True, eq=False)
class Parsed:
    """A file that was read back. tool, frame: as it states them, "" where it states none."""

    robot: str
    stops: tuple[Stop, ...]
    tool: str = ""
    frame: str = ""

    def differences(self, programme: Programme) -> list[str]:
        """Where the file says something else than the programme; empty for a good one."""
        out = [] if self.robot == programme.robot else [f"robot {self.robot}, not {programme.robot}"]
        if len(self.stops) != len(programme.moves):
            return [*out, f"{len(self.stops)} stops, not {len(programme.moves)}"]
        for what, said, meant in (("tool", self.tool, programme.tool), ("frame", self.frame, programme.frame)):
            if said and meant and said != meant:
                out.append(f"{what} {said}, not {meant}")
        for i, (stop, move) in enumerate(zip(self.stops, programme.moves, strict=True), start=1):
            pause = programme.pause if move.measured else 0.0
            said, meant = (stop.pose, stop.repeat), (move.pose, move.repeat)
            if said != meant or stop.speed != programme.speed or stop.pause != pause:
                out.append(f"stop {i}: {said}, {stop.speed} %, pause {stop.pause}")
            if not stop.holds(move.load):
                out.append(f"stop {i}: the load {stop.load!r} is hung there, not {move.load!r}")
            if stop.pendant.shape != move.pendant.shape or np.abs(stop.pendant - move.pendant).max() > ROUNDING:
                out.append(f"stop {i}: other angles")
        return out

    def plan_differences(self, plan: Plan) -> list[str]:
        """Where the measured stops differ from the plan: another pose, other angles, load or number of repeats."""
        out: list[str] = []
        for i, (name, pendant, repeats) in enumerate(zip(plan.pose, plan.pendant, plan.repeats, strict=True)):
            own = [s for s in self.stops if s.pose == name]
            if len(own) != repeats:
                out.append(f"{name}: {len(own)} visits, not {repeats}")
            if any(np.abs(s.pendant - pendant).max() > ROUNDING for s in own):
                out.append(f"{name}: other angles")
            if not all(s.holds(load_name(plan, i)) for s in own):
                out.append(f"{name}: another load")
        known = set(plan.pose) | {""}
        return out + [f"{s.pose}: not in the plan" for s in self.stops if s.pose not in known]


def read_export(path: Path) -> Parsed:
    """A file that `export` wrote, by its ending: .ls, .src (with its .dat), .mod, .script or .csv."""
    text = path.read_text()
    if path.suffix == ".src":
        return parse_krl(text, path.with_suffix(".dat").read_text())
    parsers = {".ls": parse_fanuc, ".mod": parse_rapid, ".script": parse_urscript}
    return parsers.get(path.suffix, parse_csv)(text)


def remarked_axes(text: str, sign: str, letter: str, count: int) -> list[str]:
    """The order of the axes that a file states after the sign of a remark, or the plain one of `count` axes."""
    found = re.search(rf"{re.escape(sign)}\s*axes ((?:[A-Z]\d ?)+)", text)
    return found[1].split() if found else [f"{letter}{k}" for k in range(1, count + 1)]


_KRL_POINT = re.compile(r"DECL E6AXIS XP(\d+)=\{([^}]*)\}")
_KRL_VISIT = re.compile(r";pose (\S+) visit (\d+)")
_KRL_LOAD = re.compile(r";(?:now hang|load) (\S+)")


def parse_krl(src: str, dat: str) -> Parsed:
    """Read a pair of files that `write_krl` wrote."""
    robot, speed = re.search(r"^;robot (\S+)$", src, re.MULTILINE), re.search(r"\$VEL_AXIS\[K\]=(\d+)", src)
    if robot is None or speed is None:
        raise ValueError("is no module of `qsf export`")
    order = remarked_axes(src, ";", "A", MOST)
    stated = {int(m[1]): dict(re.findall(r"([AE]\d) (-?[\d.]+)", m[2])) for m in _KRL_POINT.finditer(dat)}
    points = {i: np.deg2rad([float(cells[axis]) for axis in order]) for i, cells in stated.items()}
    tool, frame = (re.search(rf"^BAS\(#{what},(\d+)\)$", src, re.MULTILINE) for what in ("TOOL", "BASE"))
    if tool is None or frame is None:
        raise ValueError("does not say its tool and its base")
    stops: list[Stop] = []
    visit: tuple[str, int] = ("", 0)
    for line in src.splitlines():
        if match := _KRL_LOAD.fullmatch(line):
            stops[-1] = stops[-1].hanging(match[1])
        elif match := _KRL_VISIT.fullmatch(line):
            visit = (match[1], int(match[2]))
        elif match := re.fullmatch(r"PTP XP(\d+)", line):
            if int(match[1]) not in points:
                raise ValueError(f"XP{match[1]} has no position in the .dat")
            stops.append(Stop(*visit, points[int(match[1])], int(speed[1]), 0.0))
            visit = ("", 0)
        elif match := re.fullmatch(r"WAIT SEC ([\d.]+)", line):
            stops[-1] = stops[-1].waiting(float(match[1]))
        elif line == "HALT":
            stops[-1] = stops[-1].waiting(None)
    return Parsed(robot[1], tuple(stops), tool[1], frame[1])


_FANUC_MOVE = re.compile(r"\s*\d+:\s*J P\[(\d+)\] (\d+)% FINE\s*;")
_FANUC_VISIT = re.compile(r"\s*\d+:\s*!(\S+) visit (\d+) ;")
_FANUC_LOAD = re.compile(r"\s*\d+:\s*!(?:now hang|load) (\S+) ;")
_FANUC_WAIT = re.compile(r"\s*\d+:\s*(?:WAIT\s+([\d.]+)\(sec\)|(PAUSE)) ;")
_FANUC_FRAMES = re.compile(r"UF : (\d+), UT : (\d+),")
_FANUC_POINT = re.compile(r"P\[(\d+)[^\]]*\]\{(.*?)\};", re.DOTALL)


def parse_fanuc(text: str) -> Parsed:
    """Read a listing that `write_fanuc` wrote."""
    robot = re.search(r"!robot (\S+) ;", text)
    if not text.startswith("/PROG") or robot is None or "/POS" not in text:
        raise ValueError("is no listing of `qsf export`")
    body, positions = text.split("/POS", 1)
    stated = {
        int(m[1]): dict(re.findall(r"([JE]\d)=\s*(-?[\d.]+) deg", m[2])) for m in _FANUC_POINT.finditer(positions)
    }
    points = {
        i: np.deg2rad([float(cells[axis]) for axis in remarked_axes(body, "!", "J", len(cells))])
        for i, cells in stated.items()
    }
    frame, tool = (re.search(rf"{what}_NUM=(\d+) ;", body) for what in ("UFRAME", "UTOOL"))
    if frame is None or tool is None or set(_FANUC_FRAMES.findall(positions)) - {(frame[1], tool[1])}:
        raise ValueError("does not state one tool and one user frame")
    stops: list[Stop] = []
    visit: tuple[str, int] = ("", 0)
    for line in body.splitlines():
        if match := _FANUC_VISIT.fullmatch(line):
            visit = (match[1], int(match[2]))
        elif match := _FANUC_LOAD.fullmatch(line):
            stops[-1] = stops[-1].hanging(match[1])
        elif match := _FANUC_MOVE.fullmatch(line):
            if int(match[1]) not in points:
                raise ValueError(f"P[{match[1]}] has no position")
            stops.append(Stop(*visit, points[int(match[1])], int(match[2]), 0.0))
            visit = ("", 0)
        elif match := _FANUC_WAIT.fullmatch(line):
            stops[-1] = stops[-1].waiting(None if match[2] else float(match[1]))
    return Parsed(robot[1], tuple(stops), tool[1], frame[1])


_RAPID_POINT = re.compile(r"\s*LOCAL CONST jointtarget jp(\d+):=\[\[([^\]]*)\],\[([^\]]*)\]\];")
_RAPID_VISIT = re.compile(r"\s*! pose (\S+) visit (\d+)")
_RAPID_LOAD = re.compile(r"\s*! (?:now hang|load) (\S+)")
_RAPID_MOVE = re.compile(r"\s*MoveAbsJ jp(\d+)\\NoEOffs,vmax,fine,(\w+)\\WObj:=(\w+);")
_RAPID_WAIT = re.compile(r"\s*(?:WaitTime\\InPos,([\d.]+)|(Stop));")


def parse_rapid(text: str) -> Parsed:
    """Read a module that `write_rapid` wrote."""
    robot, speed = re.search(r"^  ! robot (\S+)$", text, re.MULTILINE), re.search(r"VelSet (\d+),", text)
    if not text.startswith("MODULE ") or robot is None or speed is None or "ENDMODULE" not in text:
        raise ValueError("is no module of `qsf export`")
    points = {int(m[1]): _angles(m[2], m[3], text) for line in text.splitlines() if (m := _RAPID_POINT.fullmatch(line))}
    stops, frames = list[Stop](), set[tuple[str, str]]()
    visit: tuple[str, int] = ("", 0)
    for line in text.splitlines():
        if match := _RAPID_LOAD.fullmatch(line):
            stops[-1] = stops[-1].hanging(match[1])
        elif match := _RAPID_VISIT.fullmatch(line):
            visit = (match[1], int(match[2]))
        elif match := _RAPID_MOVE.fullmatch(line):
            if int(match[1]) not in points:
                raise ValueError(f"jp{match[1]} has no position")
            stops.append(Stop(*visit, points[int(match[1])], int(speed[1]), 0.0))
            frames.add((match[2], match[3]))
            visit = ("", 0)
        elif match := _RAPID_WAIT.fullmatch(line):
            stops[-1] = stops[-1].waiting(None if match[2] else float(match[1]))
    if len(frames) != 1:
        raise ValueError("has no move, or moves in more than one tool or work object")
    return Parsed(robot[1], tuple(stops), *frames.pop())


def _angles(own: str, beside: str, text: str) -> Array:
    cells = {f"J{k}": v for k, v in enumerate(own.split(","), start=1)}
    cells |= {f"E{k}": v for k, v in enumerate(beside.split(","), start=1)}
    used = sum(v != _UNUSED for v in cells.values())
    return np.deg2rad([float(cells[name]) for name in remarked_axes(text, "!", "J", used)])


_URSCRIPT_VISIT = re.compile(r"  # pose (\S+) visit (\d+)")
_URSCRIPT_LOAD = re.compile(r"  # (?:now hang|load) (\S+)")
_URSCRIPT_MOVE = re.compile(r"  movej\(\[([-\d., ]+)\], a=[\d.]+, v=([\d.]+)\)")
_URSCRIPT_WAIT = re.compile(r"  (?:sleep\(([\d.]+)\)|(popup)\(\".*\", title=\"measure\", blocking=True\))")


def parse_urscript(text: str) -> Parsed:
    """Read a script that `write_urscript` wrote."""
    robot = re.search(r"^  # robot (\S+)$", text, re.MULTILINE)
    if not text.startswith("def ") or robot is None or not text.rstrip().endswith("\nend"):
        raise ValueError("is no script of `qsf export`")
    stops: list[Stop] = []
    visit: tuple[str, int] = ("", 0)
    for line in text.splitlines():
        if match := _URSCRIPT_LOAD.fullmatch(line):
            stops[-1] = stops[-1].hanging(match[1])
        elif match := _URSCRIPT_VISIT.fullmatch(line):
            visit = (match[1], int(match[2]))
        elif match := _URSCRIPT_MOVE.fullmatch(line):
            angles = np.array([float(v) for v in match[1].split(",")])
            stops.append(Stop(*visit, angles, round(100.0 * float(match[2]) / _FASTEST), 0.0))
            visit = ("", 0)
        elif match := _URSCRIPT_WAIT.fullmatch(line):
            stops[-1] = stops[-1].waiting(None if match[2] else float(match[1]))
    return Parsed(robot[1], tuple(stops))


def parse_csv(text: str) -> Parsed:
    """Read a table that `write_csv` wrote."""
    robot = re.match(r"# robot: (\S+)\n", text)
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    if robot is None or not rows or not {"stop", "pose", "visit", "pause_s"} <= rows[0].keys():
        raise ValueError("is no table of `qsf export`")
    angles = [name for name in rows[0] if re.fullmatch(r"q\d+_(deg|mm)", name)]
    joints = JointUnits(tuple(name.endswith("mm") for name in angles))
    return Parsed(
        robot[1],
        tuple(
            Stop(
                r["pose"],
                int(r["visit"]),
                joints.si([float(r[a]) for a in angles]),
                int(r["speed_percent"]),
                None if r["pause_s"] == "hold" else float(r["pause_s"]),
                r.get("load") or "",
            )
            for r in rows
        ),
    )
