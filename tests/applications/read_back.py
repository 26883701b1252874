"""What an exported file says, by the reader of programmes: a proof that it says what the plan says."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from qsf_controllers.writing import plain
from qsframework.experiment import Plan
from qsframework.plans.programme import Programme, load_name
from qsframework.plugin import Array
from qsframework.plugin.language import endings as known_endings, languages, parse_source, read_source
from qsframework.plugin.source import Source
from qsframework.units import JointUnits

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
    return parse_csv(path.read_text()) if path.suffix == ".csv" else parsed(read_source(path))


def parse(ending: str, *texts: str) -> Parsed:
    """The same of texts."""
    endings = (".src", ".dat") if ending == ".src" else (ending,)
    return parsed(
        parse_source(known_endings()[ending], {Path(f"way{e}"): t for e, t in zip(endings, texts, strict=True)}, {})
    )


_ROBOT, _AXES = re.compile(r"robot (\S+)"), re.compile(r"axes ((?:[A-Z]\d ?)+)")
_VISIT, _LOAD = re.compile(r"(?:pose )?(\S+) visit (\d+)"), re.compile(r"(?:now hang|load) (\S+)")
_SPEEDS = {"kuka": "$VEL_AXIS", "abb": "VELSET"}
_WAITS = {"WAIT": 0, "WAITTIME": 0, "SLEEP": 0, "PAUSE": None, "HALT": None, "STOP": None, "POPUP": None}


def parsed(source: Source) -> Parsed:
    """What the reader of programmes finds in a file of `qsf export`, stop by stop."""
    points, convention = {p.name: p for p in source.points}, languages()[source.language].pose
    motions = {m.statement.tokens[-1]: m for m in source.motions if not m.stands}
    remarks = [said for s in source.lines if (said := s.remark) is not None]
    robot = next((m[1] for said in remarks if (m := _ROBOT.fullmatch(said))), "")
    order = next((m[1].split() for said in remarks if (m := _AXES.fullmatch(said))), None)
    stops, frames, visit, speed = list[Stop](), set[tuple[str, str]](), ("", 0), 0
    for statement in source.lines:
        words, motion = statement.upper, motions.get(statement.tokens[-1])
        if (said := statement.remark) is not None:
            if match := _LOAD.fullmatch(said):
                stops[-1] = stops[-1].hanging(match[1])
            elif match := _VISIT.fullmatch(said):
                visit = (match[1], int(match[2]))
        elif motion is not None:
            assert motion.problem is None
            point = points[motion.points[0]]
            axes = order or [f"{convention.letter}{k}" for k in range(1, 1 + sum(k[0] != "E" for k in point.cells))]
            angles = np.array([point.cells[axis].value for axis in axes]) * convention.angle
            stops.append(Stop(*visit, angles, _speed(source.language, words) or speed, 0.0))
            visit = ("", 0)
            frames.add((point.tool, point.frame))
        elif words[0] in _WAITS:
            seconds = [float(t.text) for t in statement.tokens if t.kind == "number"]
            stops[-1] = stops[-1].waiting(None if _WAITS[words[0]] is None else seconds[0])
        elif (named := _SPEEDS.get(source.language)) in words:
            speed = int(words[words.index(named) + 5 if source.language == "kuka" else words.index(named) + 1])
    if not robot or len(frames) != 1:
        raise ValueError("is no programme of `qsf export`, or states more than one tool or frame")
    return Parsed(robot, tuple(stops), *(("", "") if source.language == "ur" else frames.pop()))


def _speed(maker: str, words: list[str]) -> int:
    """The share of the largest speed, in percent, that a motion states itself; 0 if it states none."""
    if maker == "fanuc":
        return int(words[words.index("%") - 1])
    return round(100.0 * float(words[words.index("V") + 2]) / _FASTEST) if maker == "ur" else 0


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
