"""What a reader makes of a spoiled file: a sound value, a refusal, or a fault of ours.

A value is sound if every number in it is finite and a second read gives the same. A refusal is an `InputError` whose
problems all say something. Everything else, a warning of numpy and a read that takes too long included, is a fault.
"""

from __future__ import annotations

import dataclasses
import enum
import json
import math
import random
import shutil
import signal
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mutate import mutated

from qsf_controllers.export import write_csv
from qsf_controllers.fanuc import write_fanuc
from qsf_controllers.krl import write_krl
from qsf_controllers.rapid import write_rapid
from qsf_controllers.urscript import write_urscript
from qsf_onboarding.folder import new
from qsframework.errors import InputError, QsfError
from qsframework.experiment import (
    Experiment,
    Readings,
    example,
    load_experiment,
    read_plan,
    read_poses,
    read_readings,
)
from qsframework.files import sha256
from qsframework.fits import identify, read_fit, write_fit
from qsframework.plans.programme import Move, Programme
from qsframework.plugin import Poses
from qsframework.plugin.language import endings, read_source
from qsframework.robot import Robot, load_robot
from qsframework.uses.stiffness import stiffness_at
from qsframework.uses.targets import read_targets
from qsframework.uses.task import load_task

ROOT = Path(__file__).resolve().parents[2]
ROBOTS = ("ur10", "fanuc_m900ib", "kuka_kr270")
TIME_LIMIT = 10.0
"""Seconds of CPU for one read: a hundred times what a good file takes. A busy machine is no fault."""
_MAY_BE_OPEN = {
    "domain",
    "free_sd",
    "readings_sd",
    "held_out_error",
    "held_out_largest",
    "held_out_nominal",
    "lower",
    "upper",
    "torque_limits",
    "sd",
    "value",
    "minus_sigma",
    "time",
    "temperature",
    "rms",
    "largest",
}
"""Fields with a documented infinity or NaN: no bound, no limit stated, no sd quoted, an axis that was not measured,
nothing recorded of a state, a series that no frame was found of, no pose that can be left out."""


class Outcome(enum.Enum):
    """What became of one input."""

    VALUE = "value"
    REFUSED = "refused"
    FAULT = "fault"


@dataclass(frozen=True)
class Found:
    """The outcome of one input, with the words of a fault, and the CPU seconds of the slowest read."""

    outcome: Outcome
    words: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Good:
    """A good file to spoil: in a folder of its own with what it needs; `read` reads it again."""

    label: str
    path: Path
    kind: str
    read: Callable[[], Any]
    content: bytes


class _Hang(BaseException):
    """No `except Exception` of a reader may swallow it."""


def _too_long(*_: Any) -> None:
    raise _Hang


def try_file(good: Good, content: bytes) -> Found:
    """Put the content in the place of the good file and read it, twice if it is taken. A new file each time: what is
    written into an old one waits for the disk."""
    good.path.unlink(missing_ok=True)
    good.path.write_bytes(content)
    started = time.process_time()
    before = signal.signal(signal.SIGPROF, _too_long)
    signal.setitimer(signal.ITIMER_PROF, TIME_LIMIT)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            value = good.read()
            first = time.process_time() - started
            words = _unsound(value, good)
    except InputError as error:
        first = time.process_time() - started
        words = "" if error.problems and all(p.message.strip() for p in error.problems) else "a refusal without words"
        return Found(Outcome.FAULT if words else Outcome.REFUSED, words, first)
    except _Hang:
        return Found(Outcome.FAULT, "a hang\n" + traceback.format_exc(limit=-12), TIME_LIMIT)
    except Exception:
        return Found(Outcome.FAULT, traceback.format_exc(limit=-12), time.process_time() - started)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
        good.path.unlink()
        good.path.write_bytes(good.content)
    return Found(Outcome.FAULT if words else Outcome.VALUE, words, first)


def _unsound(value: Any, good: Good) -> str:
    first = dict(leaves(value))
    for place, leaf in first.items():
        if isinstance(leaf, float) and not math.isfinite(leaf) and not any(p in _MAY_BE_OPEN for p in place):
            return f"a value with {'.'.join(map(str, place))} = {leaf}"
    second = dict(leaves(good.read()))
    same = first.keys() == second.keys() and all(_same(v, second[k]) for k, v in first.items())
    return "" if same else "a second read gives another value"


def _same(a: Any, b: Any) -> bool:
    return a == b or (isinstance(a, float) and isinstance(b, float) and math.isnan(a) and math.isnan(b))


def leaves(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Every number and text in a value, with where it is; Pinocchio's model is read by its numbers."""
    if isinstance(value, np.ndarray):
        for i, one in enumerate(value.ravel().tolist()):
            yield (*place, i), one
    elif isinstance(value, np.generic):
        yield place, value.item()
    elif isinstance(value, bool | int | float | str) or value is None:
        yield place, value
    elif isinstance(value, Mapping):
        for key, one in value.items():
            yield from leaves(one, (*place, key))
    elif isinstance(value, list | tuple):
        for i, one in enumerate(value):
            yield from leaves(one, (*place, i))
    elif dataclasses.is_dataclass(value):
        yield (*place, "type"), type(value).__name__
        for field in dataclasses.fields(value):
            yield from leaves(getattr(value, field.name), (*place, field.name))
    elif type(value).__module__.startswith("pinocchio"):
        for i, inertia in enumerate(value.inertias):
            yield from leaves([inertia.mass, inertia.lever, inertia.inertia], (*place, "inertia", i))
        for i, placement in enumerate(value.jointPlacements):
            yield from leaves(placement.homogeneous, (*place, "placement", i))
    elif hasattr(value, "model_dump"):
        yield from leaves(value.model_dump(), place)
    else:
        yield place, str(value)


def corpus(folder: Path) -> dict[str, list[Good]]:
    """Good files of every format, each in a folder of its own."""
    return {
        **_robot_files(folder),
        **_strangers(folder),
        "experiment.yaml": _experiments(folder),
        **_tables(folder),
        "fit.json": [_fit(folder)],
        "task.yaml": [_task(folder)],
        "controller programmes": _programmes(folder),
    }


def used_robot(robot: Robot) -> tuple[Any, ...]:
    """The robot, and what it does under a load at one pose: an answer in finite numbers, or words."""
    pendant = 0.5 * (robot.controller.lower + robot.controller.upper) + 0.1
    try:
        return robot, stiffness_at(robot, pendant, np.array([10.0, 20.0, -100.0, 0.0, 0.0, 0.0]), np.zeros(3))
    except QsfError as error:
        return robot, str(error) or "no words"


def used_experiment(experiment: Experiment) -> tuple[Any, ...]:
    """The campaign, and its displacements at two poses: finite numbers, or words."""
    controller = experiment.robot.controller
    pendant = np.linspace(0.4, 0.6, 2)[:, None] * (controller.upper - controller.lower) + controller.lower
    wrench = experiment.loads[0].wrench if experiment.loads else np.array([10.0, 20.0, -100.0, 0.0, 0.0, 0.0])
    try:
        poses = Poses(pendant, controller.to_joints(pendant), np.tile(wrench, (2, 1)))
        return experiment, experiment.model().predict(poses)
    except QsfError as error:
        return experiment, str(error) or "no words"


def _good(label: str, path: Path, kind: str, read: Callable[[], Any]) -> Good:
    read()
    return Good(label, path, kind, read, path.read_bytes())


def _robot_files(folder: Path) -> dict[str, list[Good]]:
    out: dict[str, list[Good]] = {"robot.yaml": [], "nominal.yaml": [], "URDF": [], "xacro": []}
    small = copy_small(folder / "small")
    for name, own in {**{n: _copied_robot(folder, n) for n in ROBOTS}, "small": small}.items():
        read = lambda own=own: used_robot(load_robot(own))  # noqa: E731
        for file in ("robot.yaml", "nominal.yaml"):
            out[file].append(_good(name, own / file, "yaml", read))
        for path in (*own.glob("*.xacro"), *own.glob("*.urdf")):
            kind = "xacro" if path.suffix == ".xacro" else "URDF"
            out[kind].append(_good(name, path, "xml", read))
    # the small arm is read ten times as fast, so that more of the time goes to different files
    return {key: [*goods[:-1], *[goods[-1]] * 12] if key != "xacro" else goods for key, goods in out.items()}


def _strangers(folder: Path) -> dict[str, list[Good]]:
    """URDFs, xacros and tables that `qsf new` is given."""
    out: dict[str, list[Good]] = {"a stranger's URDF": [], "a stranger's table": []}
    made = folder / "made"

    def robot(**description: Path) -> Any:
        shutil.rmtree(made, ignore_errors=True)
        new("arm", folder=made, **description)
        return used_robot(load_robot(made))

    for name in (*ROBOTS, "small"):
        given = folder / "given" / name
        shutil.copytree(Path(__file__).parent / "small" if name == "small" else ROOT / "robots" / name, given)
        for file in (*given.glob("*.xacro"), *given.glob("*.urdf")):
            out["a stranger's URDF"].append(_good(name, file, "xml", lambda file=file: robot(urdf=file)))
    for name, text in TABLES.items():
        file = folder / f"{name}.csv"
        file.write_text(text)
        out["a stranger's table"].append(_good(name, file, "csv", lambda file=file: robot(dh=file)))
    return out


TABLES = {
    "limits": "joint,a_mm,alpha_deg,d_mm,theta_deg,min_deg,max_deg\n"
    "A1,350,-90,815,0,-185,185\nA2,1200,0,0,0,-130,20\nA3,145,-90,0,3,-100,144\nA4,0,90,1545,180,,\n",
    "far": "a_m\talpha_rad\td_m\ttheta_rad\n0\t1.5711\t0.18\t0\n-0.3\t0.0007\t593.2\t0.02\n-0.4\t0.0002\t-597.6\t0.01\n"
    "0\t1.5709\t4.5743\t0\n",
}


def _copied_robot(folder: Path, name: str) -> Path:
    own = folder / "robots" / name
    shutil.copytree(ROOT / "robots" / name, own)
    return own


def copy_small(folder: Path) -> Path:
    """A robot of two joints with a plain URDF."""
    shutil.copytree(Path(__file__).parent / "small", folder)
    return folder


EVERY_KEY = {
    "robot": "../small",
    "data": ["readings.csv", "states.csv"],
    "states": "positions",
    "frames": {"S1": {"xyz_mm": [100, 0, 0], "quat_wxyz": [0.8, 0, 0, 0.6]}},
    "load": {"point_mm": [150, 0, 200]},
    "markers": {"m1": {"xyz_mm": [1, 2, 3], "normal": [0, 0, 1]}, "m2": {"xyz_mm": [3, 2, 1], "link": "tip"}},
    "noise": {
        "position_sigma_mm": 0.05,
        "displacement_sigma_mm": 0.03,
        "gauge_sigma_mm": 0.01,
        "repeatability_mm": 0.01,
    },
    "load_uncertainty": {"scale_percent": 1, "direction_deg": 0.5},
    "loads": [
        {"name": "weight", "fz_N": -100, "poses": 3, "cost": 2.0},
        {"name": "pull", "fy_N": 50, "mx_Nm": 1, "poses_min": 1},
    ],
    "constraints": {
        "x_min_m": -9,
        "x_max_m": 9,
        "z_min_m": -5,
        "axis1_distance_min_m": 0.1,
        "of": "load_point",
        "joint_limits_deg": {"shoulder": [-80, 80]},
        "joint_values_deg": {"elbow": [0, 10, 20]},
        "collision": True,
        "clearance_mm": 5,
        "tool_radius_mm": 10,
        "floor_m": -5.0,
        "singularity_margin": 0.01,
        "sight": {"station_m": [5, 0, 1], "markers": ["m1"], "incidence_max_deg": 45, "clearance_mm": 5},
    },
    "effects": [
        {"effect": "offaxis_compliance", "joint": "elbow", "axis": "x"},
        {"effect": "tracker_frame"},
        {"effect": "load_scale"},
    ],
    "nominal": "nominal.yaml",
    "fit": ["joint_compliance", "load_scale"],
}


def _experiments(folder: Path) -> list[Good]:
    """A campaign with every key on the small arm, and two of the examples, whose robots take longer to read."""
    own = folder / "campaign"
    own.mkdir()
    (own / "nominal.yaml").write_text("offaxis_compliance[elbow/x]:\n  value_urad/(N m): 0.5\n  sd_percent: 50\n")
    text = yaml.safe_dump(EVERY_KEY, sort_keys=False)
    plain = yaml.safe_dump({k: EVERY_KEY[k] for k in ("robot", "load", "markers", "noise")}, sort_keys=False)
    for name, content in (("every.yaml", text), ("plain.yaml", plain)):
        (own / name).write_text(content)
    for name in ("m900ib", "r2000ic"):
        (own / f"{name}.yaml").write_bytes((example(name) / "experiment.yaml").read_bytes())
    names = ("every", "every", "every", "every", "plain", "plain", "m900ib", "r2000ic")
    paths = [own / f"{name}.yaml" for name in names]
    return [_good(p.stem, p, "yaml", lambda p=p: used_experiment(load_experiment(p))) for p in paths]


def _tables(folder: Path) -> dict[str, list[Good]]:
    m900ib, r2000ic, ur10 = (load_experiment(example(n) / "experiment.yaml") for n in ("m900ib", "r2000ic", "ur10"))
    own = folder / "tables"
    own.mkdir()

    def table(name: str, text: str, read: Callable[[Path], Any]) -> Good:
        path = own / name
        path.write_text(text)
        return _good(name, path, "csv", lambda: read(path))

    def head(path: Path, rows: int) -> str:
        return "\n".join(path.read_text().splitlines()[:rows]) + "\n"

    full = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N,mx_Nm,my_Nm,mz_Nm,marker,dx_mm,dy_mm,dz_mm,"
    full += "repeat,cycle,sigma_mm,time_s,time_unloaded_s,temperature_degC,temperature_unloaded_degC,approach,"
    full += "drive_state,use,reference\n" + "".join(
        f"p{i},{i},90,-30,-45,30,35,0,0,-{4000 + i},0,0,0,m{k},0.{i}{k},0.1,-0.{k},"
        f"1,1,0.03,{i},{i},20.5,20,1,on,1,r{i}\n"
        for i in range(1, 6)
        for k in (1, 2, 3)
    )
    gauges = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N,marker,dx_mm,dy_mm,dz_mm,gauge_mm,ux,uy,uz,"
    gauges += "to_marker,sigma_mm,series\n" + "".join(
        f"p{i},{i},90,-30,-45,30,35,0,0,-4000,m1,{cells}\n"
        for i in range(1, 4)
        for cells in ("0.1,,-0.2,,,,,,0.03,t", ",,,0.5,0,1,2,,0.01,", ",,,0.5,,,,m2,0.01,")
    )
    pairs = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N,marker,state,x_mm,y_mm,z_mm,load_id,series,"
    pairs += "repeat,cycle,time_s,gauge_mm,ux,uy,uz,sigma_mm\n" + "".join(
        f"p{i},{i},90,-30,-45,30,35,{force},m1,{state},{xyz},a,,1,1,{i},{gauge},0.02\n"
        for i in range(1, 4)
        for state, force in (("unloaded", ",,"), ("loaded", "0,0,-4000"))
        for xyz, gauge in ((f"1900,{i},1200", ",,,"), (",,", "1.5,0,0,1"))
    )
    plan, readings = example("m900ib") / "table5.csv", example("r2000ic") / "readings.csv"
    states = example("ur10") / "series_d.csv"
    targets = "target,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg,fx_N,fy_N,fz_N\na,1900,0,1200,180,0,0,0,0,-1000\n"
    joints = "target,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N\na,0,90,0,0,-30,0,0,0,-1000\n"
    proof = own / "proof.csv"
    proof.write_text(plan.read_text())
    certificate = {
        "criterion": "D",
        "value": 1.0,
        "relaxed_value": 1.0,
        "relaxed_efficiency": 0.99,
        "efficiency": 0.98,
        "candidates": 10,
        "poses": 3,
        "parameters": ["a"],
        "solver": "s",
        "notes": [],
    }
    (own / "proof.json").write_text(
        json.dumps(
            {
                "criterion": "D",
                "certificate": certificate,
                "seed": 1,
                "robot": "fanuc_m900ib",
                "experiment_sha256": "0",
                "plan_sha256": sha256(proof),
            }
        )
    )
    return {
        "plan.csv": [
            table("plan.csv", plan.read_text(), lambda p: read_plan(p, m900ib)),
            table("poses.csv", head(plan, 6), lambda p: read_poses(p, m900ib)),
        ],
        "plan.json": [_good("proof", own / "proof.json", "json", lambda: read_plan(proof, m900ib))],
        "readings.csv": [
            table("readings.csv", head(readings, 12), lambda p: _used(read_readings(p, r2000ic))),
            table("full.csv", full, lambda p: _used(read_readings(p, m900ib))),
            table("gauges.csv", gauges, lambda p: _used(read_readings(p, m900ib))),
        ],
        "states.csv": [
            table("states.csv", head(states, 14), lambda p: _used(read_readings(p, ur10))),
            table("pairs.csv", pairs, lambda p: _used(read_readings(p, m900ib, "differences"))),
        ],
        "targets.csv": [
            table("joints.csv", joints, lambda p: read_targets(p, m900ib)),
            table("targets.csv", targets, lambda p: read_targets(p, m900ib)),
        ],
    }


def _used(readings: Readings) -> Readings:
    """Without the numbers of masked rows, which may be anything; an axis that was not measured is NaN."""
    value = np.where(readings.use[:, None], readings.value, 0.0)
    assert not np.isinf(value).any()
    assert np.isfinite(value).any(axis=1).all()
    return dataclasses.replace(readings, value=value)


def _fit(folder: Path) -> Good:
    experiment = load_experiment(example("r2000ic") / "experiment.yaml")
    path = write_fit(identify(experiment, read_readings(experiment.data, experiment)), folder / "fit.json")
    return _good("fit", path, "json", lambda: read_fit(path))


def _task(folder: Path) -> Good:
    path = folder / "task.yaml"
    shutil.copy(ROOT / "examples" / "compare" / "task.yaml", path)
    return _good("task", path, "yaml", lambda: load_task(path))


def _programmes(folder: Path) -> list[Good]:
    experiment = load_experiment(example("m900ib") / "experiment.yaml")
    plan = read_plan(example("m900ib") / "table5.csv", experiment)
    moves = tuple(Move(q, name, 1) for q, name in zip(plan.pendant, plan.pose, strict=True))
    programme = Programme(
        robot="fanuc_m900ib",
        title="FANUC",
        payload=700.0,
        moves=moves,
        units=experiment.robot.controller.units,
        speed=10,
        pause=5.0,
        tool="1",
        frame="0",
    )
    src, dat = write_krl(programme, "plan")
    texts = {
        "plan.ls": write_fanuc(programme, "PLAN"),
        "plan.src": src,
        "plan.dat": dat,
        "plan.mod": write_rapid(replace(programme, tool="tool0", frame="wobj0"), "plan"),
        "plan.script": write_urscript(programme, "plan"),
        "plan.csv": write_csv(programme),
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    return [
        _good(f"points of {n}", folder / n, "lines", lambda n=n: read_source(folder / n))
        for n in texts
        if n[4:] in endings()
    ]


def spoiled(goods: list[Good], seed: int) -> tuple[Good, bytes]:
    """The seed's input: which good file, and what became of it."""
    rng = random.Random(seed)
    good = goods[rng.randrange(len(goods))]
    return good, mutated(good.content, good.kind, rng)


def try_seed(goods: list[Good], seed: int) -> Found:
    """The outcome of the seed's input."""
    return try_file(*spoiled(goods, seed))
