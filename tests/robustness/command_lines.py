"""Whole commands: lines made from the parser of `qsf`, with good and spoiled files, run by `main()` in this process.

A case is named by its command and its seed. A run is a fault where it ends in anything but exit code 0 (of check 1 too)
or a refusal with 2; where a refusal names neither a file nor an option; where a table or JSON that it wrote holds a
number that is not finite; where it warns; where it changes a file that it was given to read, or leaves half a file; and
where it takes more than 10 s of CPU.
"""

from __future__ import annotations

import functools
import io
import json
import math
import random
import re
import shutil
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import typer
import yaml
from fuzzing import TIME_LIMIT, Found, Outcome
from mutate import NUMBERS, TEXTS, mutated

from qsframework.cli.app import app, every_command, main
from qsframework.experiment import load_experiment, read_plan

SMALL = Path(__file__).parent / "small"
CAMPAIGN = {
    "robot": "small",
    "load": {"point_mm": [150, 0, 200]},
    "markers": {"m1": {"xyz_mm": [100, 20, 30]}, "m2": {"xyz_mm": [30, -120, 10]}, "m3": {"xyz_mm": [-30, 20, 140]}},
    "noise": {"sigma_mm": 0.002},
    "loads": [{"name": "weight", "fz_N": -150}, {"name": "pull", "fz_N": -80, "fy_N": 60}],
    "fit": ["joint_compliance"],
    "data": "readings.csv",
}
TASK = """title: a line
tool_mm: 50
approach: [0, 0, -1]
path:
  - {xyz_mm: [600, -200, 500], fz_N: -50}
  - {xyz_mm: [600, 200, 500], fz_N: -50}
map: {x_mm: [400, 700], z_mm: [300, 600], steps: 2, fz_N: -50}
campaign:
  poses: 4
  sigma_mm: 0.03
  lever_mm: 100
  candidates: 20
  loads: [{name: weight, fz_N: -50}]
"""
TARGETS = "target,q1_deg,q2_deg,fx_N,fy_N,fz_N\na,10,-20,0,0,-100\nb,-30,-50,0,20,-80\n"
PLAN = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N\n" + "".join(
    f"p{k},{10 * k - 30},{k - 80},{70 + 2 * k},{5 * k - 20},{60 + 5 * k},{9 * k},0,40,-80\n" for k in range(7)
)
DH = "a_mm,alpha_deg,d_mm,theta_deg\n0,90,400,0\n500,0,0,0\n300,0,0,0\n"
META = "remarks: none\n"
MAPPING = "columns: {x: x, y: y, z: z}\nunits: [mm]\n"
UR10 = {
    "experiment.yaml": "ur10.yaml",
    "plan.csv": "ur10_plan.csv",
    "small": "ur10",
    "10,-20": "0,-90,90,0,90,0",
    "0,-20": "0,-90,90,0,90,0",
    "0,0": "10,-80,70,20,60,0",
    "readings.csv": "ur10_readings.csv",
    "fit.json": "ur10_fit.json",
    "targets.csv": "ur10_targets.csv",
    "csv": "urscript",
    "joint_compliance[shoulder]": "joint_compliance[joint_2]",
    "joint_compliance[elbow]": "joint_compliance[joint_3]",
}
"""The same of another arm, of six joints: one line in five is about it."""
QUICK: dict[str, tuple[str, ...]] = {
    "design": ("-n", "4", "--candidates", "40", "--no-polish"),
    "day": ("--watch", "exports", "--once", "--cycles", "1", "--no-half", "--repeat-share", "0"),
    "show": ("--html", "shown.html"),
    "certificate": ("--halves", "2"),
    "import": ("--plan", "plan.csv", "--unit", "mm"),
    "new": ("--urdf", "small/small.urdf"),
    "export": ("--to", "csv"),
    "diagnose": ("--count", "4"),
}
"""What keeps a command short; options that come later on the line take their place."""
OWN: dict[tuple[str, str], tuple[str, ...]] = {
    ("identify", "fit"): ("joint_compliance", "joint_compliance[elbow]"),
    ("compare", "fit"): ("small=fit.json",),
    ("identify", "urdf"): (),
    ("kinematics", "urdf"): (),
    ("kinematics", "dh"): (),
    ("certificate", "halves"): ("1", "2"),
    ("protocol", "readings"): (),
}
"""Where an option's name means something else for a command; nothing: it is an output."""
GOOD: dict[str, tuple[str, ...]] = {
    "experiment": ("experiment.yaml",),
    "plan": ("plan.csv",),
    "fit": ("fit.json",),
    "beside": ("fit.json",),
    "data": ("readings.csv",),
    "readings": ("readings.csv",),
    "task": ("task.yaml",),
    "meta": ("meta.yaml",),
    "mapping": ("mapping.yaml",),
    "urdf": ("small/small.urdf",),
    "dh": ("dh.csv",),
    "watch": ("exports",),
    "test_poses": ("plan.csv",),
    "taken": ("plan.csv", "readings.csv"),
    "robot": ("small",),
    "subject": ("small", "experiment.yaml"),
    "name": ("arm",),
    "pose": ("10,-20", "0,0"),
    "load": ("0,0,-100", "10,20,-50,1,2,3"),
    "point": ("0,0,0", "100,0,50"),
    "criterion": ("I", "D", "A", "O3", "Ds", "L"),
    "interest": ("joint_compliance[shoulder]",),
    "candidates": ("12", "30", "grid:4", "plan.csv"),
    "solver": ("columns", "cvxpy"),
    "truth": ("nominal", "drawn"),
    "method": ("one-step", "two-step"),
    "loss": ("linear", "huber", "soft_l1"),
    "fixed": ("joint_compliance[elbow]",),
    "tied": ("joint_compliance[shoulder],joint_compliance[elbow]",),
    "profile": ("joint_compliance[elbow]",),
    "states": ("differences", "positions"),
    "reference": ("commanded", "unloaded"),
    "to": ("csv", "csv", "fanuc-ls", "krl", "rapid", "urscript"),
    "order": ("shortest", "random", "plan"),
    "home": ("0,-20",),
    "start": ("0,-20",),
    "drive": ("servo", "brake"),
    "match": ("names", "order", "nearest"),
    "join": ("names", "order", "time"),
    "state": ("loaded", "unloaded"),
    "align": ("unloaded", "points.csv"),
    "columns": ("x=x", "x=1"),
    "unit": ("mm", "in"),
    "word": ("a=m1",),
    "separator": (",", "tab"),
    "decimal": (".", ","),
    "base": ("base",),
    "flange": ("tip",),
    "package": ("a=small",),
    "arg": ("a=1",),
    "command": ("design",),
    "tool": ("1", "1=0,0,100,0,0,0"),
    "frame": ("0", "0=0,0,0,0,0,0"),
    "keep": ("P[1]",),
    "sheet": ("1",),
    "series": ("S1",),
    "ignore": ("B*",),
    "poses": ("1", "2", "5"),
    "count": ("1", "2", "4"),
    "halves": ("0", "1", "2"),
    "samples": ("1", "2"),
    "budget": ("3", "6"),
    "efficiency": ("0.9", "1"),
    "level": ("0.02", "0.1"),
    "seed": ("0", "1", "7"),
    "cycles": ("1", "2"),
    "reflectors": ("0", "3"),
    "repeat_share": ("0", "0.5", "1"),
    "speed": ("1", "10", "100"),
    "payload": ("20",),
}
LISTS: dict[str, tuple[tuple[str, ...], ...]] = {
    "check": (("experiment.yaml",), ("small",), ("small/robot.yaml", "experiment.yaml"), ("ur10",)),
    "show": ((), ("plan.csv",), ("fit.json",), ("plan.csv", "fit.json", "readings.csv")),
    "identify": (("readings.csv",), ("readings.csv",), ("positions.csv",), ("readings.csv", "gauges.csv")),
    "validate": (("fit.json", "readings.csv"), ("fit.json",)),
    "diagnose": (("readings.csv",), ("readings.csv",), ("plan.csv",)),
    "compensate": (("fit.json", "targets.csv"), ("fit.json", "targets.csv"), ("fit.json", "arm.script")),
    "certificate": (("fit.json", "readings.csv"), ("fit.json", "other.csv")),
    "export": (("experiment.yaml", "plan.csv"),),
    "import": (("points.csv",), ("points.csv", "log.csv")),
    "compare": (("small", "small2"), ("small", "ur10")),
}
"""What the arguments of a command that takes several files may be."""
BORDERS = (
    "0",
    "-1",
    "1",
    "1e-300",
    "1e300",
    "nan",
    "inf",
    "-inf",
    "1e9",
    "100000000000000000000",
    "",
    " ",
    "-",
    "１",
    "0x1",
)
FOLDERS, ENDINGS = ("", "", "sub/deep/"), (".json", ".csv", ".html", ".yaml", "")
WRONG_OUTPUTS = (
    "",
    ".",
    "experiment.yaml",
    "plan.csv",
    "readings.csv",
    "small",
    "small/robot.yaml",
    "small/small.urdf",
    "fit.json/x",
    "/proc/x",
    "x" * 300,
    "é.json",
)
NEVER: dict[str, tuple[str, ...]] = {
    "show": ("--port",),
    "day": ("--port",),
    "check": ("--conformance",),
}
"""A server would wait for somebody; the conformance tests have tests of their own."""
_LONG = {"jobs": ("1", "-1", "x"), "dask": ("", "nowhere", "x:y:z")}
"""Processes and clusters have tests of their own, and each costs seconds."""


class _Hang(BaseException):
    """No `except Exception` may swallow it."""


def _too_long(*_: Any) -> None:
    raise _Hang


@dataclass(frozen=True)
class Line:
    """A command line, the files spoiled for it, and those that it only reads."""

    words: tuple[str, ...]
    spoiled: tuple[tuple[str, bytes], ...]
    reads: tuple[str, ...]

    def __str__(self) -> str:
        said = " ".join(repr(w) if not re.fullmatch(r"[\w./=,:\[\]-]+", w) else w for w in self.words)
        return f"qsf {said}" + "".join(f" [{name} spoiled]" for name, _ in self.spoiled)


@functools.cache
def parser() -> Any:
    """The parser, made once: a tenth of a second that each case would pay."""
    return typer.main.get_command(app)


def commands() -> dict[str, Any]:
    """The commands of the parser itself."""
    return every_command()


def prepared(folder: Path) -> Path:
    """Good files of every kind on an arm of two joints, made by the commands themselves."""
    place = folder / "bench"
    place.mkdir(parents=True)
    shutil.copytree(SMALL, place / "small")
    shutil.copytree(SMALL, place / "small2")
    text = (place / "small2" / "robot.yaml").read_text().replace("name: small", "name: small2")
    (place / "small2" / "robot.yaml").write_text(text)
    ur10 = CAMPAIGN | {"robot": "ur10", "loads": [{"name": "pull", "fz_N": -80, "fy_N": 40}]}
    ur10 |= {"data": "ur10_readings.csv", "fit": [f"joint_compliance[joint_{k}]" for k in (2, 3)]}
    for name, campaign in (("experiment.yaml", CAMPAIGN), ("ur10.yaml", ur10)):
        (place / name).write_text(yaml.safe_dump(campaign, sort_keys=False))
    texts = {"task.yaml": TASK, "targets.csv": TARGETS, "dh.csv": DH, "mapping.yaml": MAPPING, "meta.yaml": META}
    texts |= {"ur10_plan.csv": PLAN, "ur10_targets.csv": PLAN.replace("pose", "target")}
    for name, content in texts.items():
        (place / name).write_text(content)
    made = (
        "design experiment.yaml -n 5 --candidates 40 --no-polish -o plan.csv",
        "simulate experiment.yaml plan.csv -o readings.csv --truth drawn",
        "simulate experiment.yaml plan.csv -o other.csv --truth drawn --seed 5",
        "simulate ur10.yaml ur10_plan.csv -o ur10_readings.csv --truth drawn",
        "identify ur10.yaml ur10_readings.csv --json ur10_fit.json",
        "identify experiment.yaml readings.csv --json fit.json",
        "export ur10.yaml ur10_plan.csv --to urscript -o arm.script",
    )
    for line in made:
        code, said, error = run(place, tuple(line.split()))
        assert code == 0, (line, said, error)
    _more_tables(place)
    return place


def _more_tables(place: Path) -> None:
    """Positions, gauges, a joint log and a day's exports of the same plan."""
    experiment = load_experiment(place / "experiment.yaml")
    plan = read_plan(place / "plan.csv", experiment)
    model = experiment.model()
    where = [1e3 * model.positions(plan.poses, 1.5 * model.nominal, loaded) for loaded in (False, True)]
    angles = [[f"{x:.6f}" for x in row] for row in np.degrees(plan.pendant)]
    forces = [[f"{x:.3f}" for x in row[:3]] for row in plan.poses.wrench]
    start = "pose,q1_deg,q2_deg,fx_N,fy_N,fz_N,marker"
    points, states, gauges = "name,x,y,z\n", f"{start},state,x_mm,y_mm,z_mm\n", f"{start},gauge_mm,ux,uy,uz\n"
    for i, pose in enumerate(plan.pose):
        for k, marker in enumerate(m.name for m in experiment.markers):
            row = [pose, *angles[i]]
            for state, at, force in zip(("unloaded", "loaded"), where, (["", "", ""], forces[i]), strict=True):
                xyz = [f"{x:.4f}" for x in at[i, k]]
                states += ",".join([*row, *force, marker, state, *xyz]) + "\n"
                points += ",".join([f"{pose} {marker} {state}", *xyz]) + "\n"
            moved = f"{where[1][i, k, 2] - where[0][i, k, 2]:.4f}"
            gauges += ",".join([*row, *forces[i], marker, moved, "0", "0", "1"]) + "\n"
    (place / "positions.csv").write_text(states)
    (place / "gauges.csv").write_text(gauges)
    (place / "points.csv").write_text(points)
    log = "".join(f"{pose},{','.join(q)},{k}\n" for k, (pose, q) in enumerate(zip(plan.pose, angles, strict=True)))
    (place / "log.csv").write_text("name,q1_deg,q2_deg,count\n" + log)
    (place / "exports").mkdir()
    lines = points.splitlines()[1:]
    for k in range(2):
        (place / "exports" / f"visit_{k}.csv").write_text("name,x,y,z\n" + "\n".join(lines[6 * k : 6 * k + 6]) + "\n")


def run(place: Path, words: tuple[str, ...]) -> tuple[int | str, str, str]:
    """Exit code, or the words of a fault, and what was printed."""
    import os

    before, where, made, own = sys.argv, Path.cwd(), typer.main.get_command, parser()
    sys.argv = ["qsf", *words]
    out, err = io.StringIO(), io.StringIO()
    alarm = signal.signal(signal.SIGPROF, _too_long)
    signal.setitimer(signal.ITIMER_PROF, TIME_LIMIT)
    code: int | str = 0
    try:
        os.chdir(place)
        with warnings.catch_warnings(), redirect_stdout(out), redirect_stderr(err):
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", category=ResourceWarning)
            typer.main.get_command = lambda asked: own if asked is app else made(asked)  # type: ignore[assignment]
            main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except _Hang:
        code = f"more than {TIME_LIMIT:g} s\n" + traceback.format_exc(limit=-8)
    except BaseException:
        code = traceback.format_exc(limit=-8)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, alarm)
        sys.argv, typer.main.get_command = before, made
        os.chdir(where)
    return code, out.getvalue(), err.getvalue()


@dataclass(frozen=True)
class Commands:
    """The bench of one command: `try_seed` runs the line of a seed."""

    name: str
    bench: Path
    scratch: Path

    def line(self, seed: int) -> Line:
        """The line of a seed."""
        rng = random.Random(f"{self.name} {seed}")
        spoil = rng.choice((0.0, 0.0, 0.0, 0.1, 0.3))
        """Of the values on this line, how many are of another kind or beyond a border."""
        given: list[str] = [self.name]
        reads: list[str] = []
        wanted = list(commands()[self.name].params)
        arguments = [p for p in wanted if p.param_type_name == "argument"]
        options = [
            p for p in wanted if p.param_type_name == "option" and not set(p.opts) & set(NEVER.get(self.name, ()))
        ]
        names = UR10 if rng.random() < 0.2 and self.name != "compare" else {}
        for p in arguments:
            values = [names.get(v, v) for v in self._argument(p, rng, spoil)]
            reads += values
            given += values
        given += QUICK.get(self.name, ())
        required = [p for p in options if p.required]
        often = [p for p in options if p.name in ("json", "report", "output") and rng.random() < 0.5]
        for p in [*required, *often, *rng.sample(options, min(len(options), rng.choice((0, 1, 1, 2, 4))))]:
            if p in required and rng.random() < 0.1 * (spoil > 0):
                continue
            words = [names.get(w, w) for w in self._option(p, rng, spoil)]
            reads += [w for w in words[1:] if OWN.get((self.name, p.name), GOOD.get(p.name))]
            given += words
        if spoil and rng.random() < 0.1:
            given.insert(
                rng.randrange(1, len(given) + 1), rng.choice((*BORDERS, *TEXTS, "--", "--no-such", "-x", "-h"))
            )
        given = [w.replace("\0", "") for w in given]  # no system hands one on
        return Line(tuple(given), tuple(self._spoiled(reads, rng)) if rng.random() < 0.35 else (), tuple(reads))

    def _argument(self, p: Any, rng: random.Random, spoil: float) -> list[str]:
        if p.nargs == -1:
            values = list(rng.choice(LISTS.get(self.name, ((), ("experiment.yaml",), ("plan.csv", "fit.json")))))
        else:
            values = [rng.choice(GOOD.get(p.name or "", ("experiment.yaml",)))]
        values = [self._wrong(rng) if rng.random() < spoil else v for v in values]
        if rng.random() < 0.2 * spoil:
            values = values[1:] if rng.random() < 0.5 else [*values, self._wrong(rng)]
        return values

    def _wrong(self, rng: random.Random) -> str:
        """A file of another kind, a file that is not there, or no name of a file."""
        files = _files(self.bench)
        return rng.choice(
            (rng.choice(files), rng.choice(files), "missing/none.csv", rng.choice(BORDERS), rng.choice(TEXTS))
        )

    def _option(self, p: Any, rng: random.Random, spoil: float) -> list[str]:
        name = rng.choice([*p.opts, *p.secondary_opts])
        if str(p.bare_type()) == "bool":
            return [name]
        out = [name]
        for _ in range(p.nargs):
            known, kind = OWN.get((self.name, p.name), GOOD.get(p.name, ())), str(p.bare_type())
            wrong = rng.random() < spoil
            if p.name in _LONG:
                out.append(rng.choice(_LONG[p.name]))
            elif wrong and known:
                out.append(rng.choice((rng.choice(BORDERS), rng.choice(NUMBERS)[:40], self._wrong(rng))))
            elif known:
                out.append(rng.choice(known))
            elif "Path" in kind:
                good = rng.choice(FOLDERS) + p.name + rng.choice(ENDINGS)
                out.append(rng.choice(WRONG_OUTPUTS) if wrong else good)
            elif kind in ("int", "float"):
                whole = kind == "int"
                out.append(rng.choice(BORDERS) if wrong else str(rng.randrange(12) if whole else rng.uniform(0, 50)))
            else:
                out.append(rng.choice((*BORDERS, *TEXTS)))
        return out

    def _spoiled(self, reads: list[str], rng: random.Random) -> Iterator[tuple[str, bytes]]:
        """One of the files on the line, or one that these name, spoiled."""
        here = [n for n in reads if n and "\0" not in n and not n.startswith("/") and ".." not in Path(n).parts]
        named = [n for n in here if (self.bench / n[:200]).is_file()]
        named += (
            ["small/robot.yaml", "small/nominal.yaml", "small/small.urdf"] if not named or rng.random() < 0.2 else []
        )
        name = rng.choice(named)
        kinds = {".yaml": "yaml", ".json": "json", ".csv": "csv", ".urdf": "xml"}
        yield name, mutated((self.bench / name).read_bytes(), kinds.get(Path(name).suffix, "lines"), rng)

    def try_seed(self, seed: int) -> Found:
        """What became of the line of a seed."""
        line = self.line(seed)
        place = self.scratch / "place"
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(self.bench, place)
        for name, content in line.spoiled:
            assert (place / name).resolve().is_relative_to(place.resolve()), name
            (place / name).write_bytes(content)
        before = {p.relative_to(place).as_posix(): p.read_bytes() for p in place.rglob("*") if p.is_file()}
        started = time.process_time()
        code, said, error = run(place, line.words)
        seconds = time.process_time() - started
        words = self._fault(line, place, before, code, said, error)
        if words:
            return Found(Outcome.FAULT, f"{line}\n{words}", seconds)
        return Found(Outcome.VALUE if code == 0 else Outcome.REFUSED, "", seconds)

    def _fault(self, line: Line, place: Path, before: dict[str, bytes], code: int | str, said: str, error: str) -> str:
        if isinstance(code, str):
            return code
        if code not in ((0, 1, 2) if line.words[0] == "check" else (0, 2)):  # of check: something is to be looked at
            return f"exit code {code}\n{error}"
        if code == 2 and not self._names(line, error):
            return f"a refusal that names neither file nor option\n{error}"
        for path in sorted(p for p in place.rglob("*") if p.is_file()):
            name = path.relative_to(place).as_posix()
            if ".qsf-part" in name:
                return f"half a file is left: {name}"
            if before.get(name) == path.read_bytes():
                continue
            if name in before and (name in line.reads or name.split("/")[0] == "small"):
                return f"{name}, which it reads, was overwritten (exit code {code})"
            if words := _unsound(path):
                return f"{name}: {words}"
        return ""

    def _names(self, line: Line, error: str) -> bool:
        """Whether a refusal names an option, an argument, or a file of the line."""
        if error.startswith("Usage: "):  # the parser quotes what it does not take
            return True
        text = re.sub(r"\s+", "", error)
        known = [o for p in commands()[self.name].params for o in (*p.opts, *p.secondary_opts) if o.startswith("-")]
        known += [p.name.upper() for p in commands()[self.name].params] + [f"theargumentafter{self.name}:"]
        shown = ["".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in w) for w in line.words[1:]]
        known += [re.sub(r"\s+", "", w)[:90] for w in (*line.words[1:], *shown) if len(w.strip()) > 1]
        known += [f"'{w}'" for w in line.words[1:] if len(w.strip()) == 1]
        known += [f"error:{w}:" if w.strip() else "error:'':" for w in shown]
        known += [f"error:{Path(w)}:" for w in line.words[1:]] + [p for w in line.words for p in w.split(",") if p[3:]]
        named = {p.name.replace("_", " ") for p in commands()[self.name].params if p.name[3:]}
        if any(re.search(rf"\b{re.escape(name)}\b", error) for name in named):  # the option's word
            return True
        known += [Path(w).name for w in line.reads if len(w) > 2]
        known += [name for name, _ in line.spoiled]
        files = re.search(r"\w\.(yaml|json|csv|urdf|ls|html|xacro)", text)
        return bool(files) or any(k and k in text for k in known)


@functools.cache
def _files(bench: Path) -> tuple[str, ...]:
    return tuple(p.relative_to(bench).as_posix() for p in sorted(bench.rglob("*")))


_WORDS = ("pose", "marker", "series")
"""Columns of names: a series may be called inf."""


def _unsound(path: Path) -> str:
    """What is wrong with a JSON or a table that was written; nothing where it is sound, or something else."""
    if path.suffix == ".json":
        found: list[str] = []
        with suppress(ValueError):  # a name that ends in .json may be given for anything
            json.loads(path.read_text(), parse_constant=found.append)
        return f"a number {found[0]}" if found else ""
    if path.suffix == ".csv" and not (text := path.read_text()).lstrip().startswith("<"):
        head, *rows = [row.split(",") for row in text.splitlines() if row[:1] != "#"] or [[]]
        words = {k for k, column in enumerate(head) if column.strip() in _WORDS}
        cells = (c.strip() for row in (head, *rows) for k, c in enumerate(row) if k not in words)
        wrong = next((c for c in cells if c.lower().lstrip("+-") in ("nan", "inf", "infinity") or _huge(c)), None)
        return "" if wrong is None else f"a cell {wrong}"
    return ""


def _huge(cell: str) -> bool:
    try:
        return not math.isfinite(float(cell))
    except ValueError:
        return False


def benches(folder: Path, make: Callable[[Path], Path] = prepared) -> dict[str, Commands]:
    """A bench for every command, by `qsf NAME`."""
    bench = make(folder)
    scratch = folder / "scratch"
    scratch.mkdir()
    return {f"qsf {name}": Commands(name, bench, scratch) for name in commands()}
