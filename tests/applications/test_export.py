"""The plan on the robot: a short order, a way that is free, files that say what the plan says."""

from __future__ import annotations

import itertools
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from read_back import parse, read_export
from typer.testing import CliRunner

from qsf_controllers.export import export
from qsf_controllers.fanuc import write_fanuc
from qsf_controllers.krl import write_krl
from qsf_controllers.rapid import write_rapid
from qsf_controllers.urscript import write_urscript
from qsframework.cli.app import app
from qsframework.elastostatics import actuator_torques
from qsframework.errors import InputError
from qsframework.experiment import Constraints, Experiment, Plan, example, load_experiment, make_plan, write_plan
from qsframework.experiment.constraints import Sight
from qsframework.plans import path_check, programme as programme_module
from qsframework.plans.ordering import shortest_path, travel, visits, way_length
from qsframework.plans.path_check import Surroundings, find_way, stretch
from qsframework.plans.programme import Move, Programme, make_programme
from qsframework.plugin import Array, Poses
from qsframework.robot.collision import above_floor, make_collider
from qsframework.robot.kinematics import joint_frames
from qsframework.uses.inverse import rigid_tip

EVERY = ("fanuc-ls", "krl", "rapid", "urscript", "csv")

ENDING = {"fanuc-ls": ".ls", "krl": ".src", "rapid": ".mod", "urscript": ".script", "csv": ".csv"}
CHANGES = {
    "fanuc-ls": [("% FINE", "0% FINE"), ("WAIT  10.00", "WAIT  99.00")],
    "krl": [("]=10", "]=11"), ("SEC 10", "SEC 99")],
    "rapid": [("VelSet 10,", "VelSet 11,"), ("InPos,10", "InPos,99")],
    "urscript": [("v=0.2", "v=0.3"), ("sleep(10", "sleep(99")],
    "csv": [(",10,", ",11,"), ("10.0,", "9.0,")],
}
"""Another speed, another wait."""
HOME = np.deg2rad([0.0, 0.0, 0.0, 0.0, -90.0, 0.0])
GOOD = np.deg2rad([[0.0, 20.0, -10.0, 0.0, -60.0, 0.0], [90.0, 20.0, -10.0, 0.0, -60.0, 0.0]])


def bounded(experiment: Experiment, **more: Any) -> Experiment:
    """The experiment without constraints but these."""
    return replace(experiment, constraints=replace(Constraints(), **more))


@pytest.fixture(scope="module")
def cell() -> Experiment:
    """The R-2000iC on a floor, with a tool."""
    experiment = load_experiment(example("r2000ic") / "design.yaml")
    return replace(experiment, constraints=replace(experiment.constraints, z_min=None, floor=0.0, tool_radius=0.3))


@pytest.fixture(scope="module")
def around(cell: Experiment) -> Surroundings:
    return Surroundings(cell)


def plan_of(experiment: Experiment, pendant: Array, repeats: list[int] | None = None, force: float = -1000.0) -> Plan:
    wrench = np.tile([0.0, 0.0, force, 0.0, 0.0, 0.0], (len(pendant), 1))
    return make_plan(
        Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench), ["w"] * len(pendant), repeats
    )


@pytest.fixture(scope="module")
def plan(cell: Experiment, around: Surroundings) -> Plan:
    """Poses with the tool near the floor, so that many straight ways are not free."""
    controller = cell.robot.controller
    pendant = np.random.default_rng(0).uniform(controller.lower, controller.upper, (600, 6))
    pendant = pendant[around.free(pendant)]
    height = rigid_tip(cell.robot, cell.load_site, controller.to_joints(pendant)).position[:, 2]
    return plan_of(cell, pendant[np.argsort(height)[8:22]], [2, 1] * 7)


@pytest.fixture(scope="module")
def programme(cell: Experiment, plan: Plan) -> Programme:
    return make_programme(cell, plan, home=HOME)


@pytest.mark.parametrize("begin", [False, True])
@pytest.mark.parametrize("count", [2, 3, 5, 7])
def test_the_order_is_the_shortest_of_all(count: int, begin: bool) -> None:
    """Against every order there is."""
    rng = np.random.default_rng(count)
    for _ in range(4):
        points, home = rng.uniform(-2, 2, (count, 6)), rng.uniform(-2, 2, 6) if begin else None
        start = None if home is None else travel(home[None], points)[0]
        found = shortest_path(travel(points, points), start, rng)
        assert sorted(found) == list(range(count))
        first = [] if home is None else [home]
        lengths = {
            order: way_length(np.array([*first, *points[list(order)]]), range(count + len(first)))
            for order in itertools.permutations(range(count))
        }
        assert lengths[tuple(found)] == pytest.approx(min(lengths.values()), rel=1e-9)


def test_many_poses_take_a_much_shorter_way() -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(-2, 2, (40, 6))
    found = shortest_path(travel(points, points), None, rng)
    assert sorted(found) == list(range(40))
    assert way_length(points, found) < 0.65 * way_length(points, range(40))


@pytest.mark.parametrize("order", ["shortest", "random", "plan"])
def test_repeats_stand_apart(cell: Experiment, plan: Plan, order: str) -> None:
    for seed in range(10):
        sequence = visits(plan, order, seed)
        assert sorted(sequence) == sorted(np.repeat(np.arange(14), plan.repeats).tolist())
        assert all(i != j for i, j in itertools.pairwise(sequence))
    assert visits(plan, order, 1) == visits(plan, order, 1)
    if order == "random":
        assert visits(plan, order, 1) != visits(plan, order, 2)


def test_loads_stay_together(cell: Experiment, plan: Plan) -> None:
    """A load is changed by hand, so poses under one load come one after the other."""
    mixed = replace(plan, load=tuple("ab"[i % 2] for i in range(14)))
    loads = [mixed.load[i] for i in visits(mixed)]
    assert sum(a != b for a, b in itertools.pairwise(loads)) == 1


def test_the_way_is_free(cell: Experiment, programme: Programme) -> None:
    """Every half degree of the way, asked of the collision checker itself; some straight ways were not free."""
    unmeasured = [m.pendant for m in programme.moves if not m.measured]
    assert programme.vias == sum(not np.array_equal(q, HOME) for q in unmeasured) > 0
    collider = make_collider(cell.robot, 0.0)
    points = [m.pendant for m in programme.moves]
    fine = []
    for first, second in itertools.pairwise(points):
        count = int(np.abs(second - first).max() / np.deg2rad(0.5)) + 2
        fine.append(first + np.linspace(0, 1, count)[:, None] * (second - first))
    pendant = np.concatenate(fine)
    placed = joint_frames(cell.robot.facts, cell.robot.controller.to_joints(pendant))
    assert collider.collides(placed).mean() < 0.002, "between two checked poses a corner may be cut by a hair"
    assert above_floor(cell.robot.shapes, placed, -0.01).all()
    assert not cell.robot.controller.outside(pendant).any()
    assert np.allclose(points[0], HOME)
    assert np.allclose(points[-1], HOME)


def test_a_way_around(cell: Experiment, around: Surroundings, plan: Plan) -> None:
    """Of all pairs some are not free; around them a way is found, and it is free."""
    blocked = [(a, b) for a, b in itertools.combinations(plan.pendant, 2) if not around.way_is_free(a, b)]
    assert blocked
    for first, second in blocked[:2]:
        between = find_way(around, first, second, np.random.default_rng(0))
        assert between
        for a, b in itertools.pairwise([first, *between, second]):
            assert around.free(stretch(a, b)).all()


def test_no_way_is_told(cell: Experiment, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the search switched off, the straight ways that are not free are named with what they hit."""
    monkeypatch.setattr(path_check, "_GROWTHS", 0)
    with pytest.raises(InputError, match=r"plan.csv: no free way found from p\d+ to p\d+: it breaks .*Leave one"):
        make_programme(cell, plan, "plan", file="plan.csv")


@pytest.mark.parametrize("to", EVERY)
@pytest.mark.parametrize("pause", [12.5, None])
def test_round_trip(programme: Programme, plan: Plan, tmp_path: Path, to: str, pause: float | None) -> None:
    made = replace(programme, pause=pause, speed=15, title="an arm")
    files = export(made, to, tmp_path / f"way{ENDING[to]}")
    assert len(files) == (2 if to == "krl" else 1)
    read = read_export(files[0])
    assert read.differences(made) == []
    assert read.plan_differences(plan) == []
    assert [s.pose for s in read.stops if s.pose] == [m.pose for m in made.moves if m.measured]
    assert {s.pause for s in read.stops if s.pose} == {pause}
    back = {s.pose: s.pendant for s in read.stops}
    assert np.allclose([back[p] for p in plan.pose], plan.pendant, atol=np.deg2rad(1e-4), rtol=0.0)


@pytest.mark.parametrize("to", EVERY)
def test_a_changed_file_is_seen(cell: Experiment, plan: Plan, programme: Programme, tmp_path: Path, to: str) -> None:
    """One digit of an angle, a missing stop, another robot, another speed: the reader tells each."""
    files = export(replace(programme, title=""), to, tmp_path / f"way{ENDING[to]}")
    text = {f: f.read_text() for f in files}
    angle = f"{np.rad2deg(plan.pendant[0, 1]):.4f}"
    other = f"{float(angle) + 0.001:.4f}"
    if to == "urscript":
        angle, other = f"{plan.pendant[0, 1]:.7f}", f"{plan.pendant[0, 1] + 1e-5:.7f}"
    changes = [(angle, other), ("fanuc_r2000ic", "ur10"), *CHANGES[to]]
    for old, new in changes:
        assert any(old in t for t in text.values())
        for file, content in text.items():
            file.write_text(content.replace(old, new))
        assert read_export(files[0]).differences(programme), f"{old} -> {new}"
    for file, content in text.items():
        file.write_text(content)
    assert not read_export(files[0]).differences(programme)


def two_loads(experiment: Experiment, names: list[str]) -> Plan:
    """Two poses under each of two loads."""
    pendant = np.vstack([GOOD, GOOD + np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])])
    wrench = np.tile([0.0, 0.0, -1000.0, 0.0, 0.0, 0.0], (4, 1))
    return make_plan(Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench), names)


MOTION = {"fanuc-ls": r"^ *\d+:J P\[", "krl": r"^PTP XP", "rapid": r"^ *MoveAbsJ", "urscript": r"^ *movej"}
WAITS = {
    "fanuc-ls": r"^ *\d+:  (?:PAUSE|WAIT)",
    "krl": r"^(?:HALT|WAIT)",
    "rapid": r"^ *(?:Stop;|WaitTime)",
    "urscript": r"^ *(?:popup\(.*|sleep)",
}


@pytest.mark.parametrize("to", EVERY)
@pytest.mark.parametrize("pause", [10.0, None])
def test_a_load_is_named_once_the_arm_has_stopped(
    m900ib: Experiment, tmp_path: Path, to: str, pause: float | None
) -> None:
    """Between each move and its wait, never before a move; read back, and a file with another load is another."""
    long = "weight and a long side pull of 1500 N"
    plan = two_loads(m900ib, ["w", "w", long, long])
    made = make_programme(bounded(m900ib), plan, order="random", seed=3, pause=pause, home=GOOD[0])
    made = replace(made, title="an arm")
    file = export(made, to, tmp_path / f"way{ENDING[to]}")[0]
    text = file.read_text()
    read = read_export(file)
    assert not read.differences(made)
    assert not read.plan_differences(plan)
    loads = dict(zip(plan.pose, plan.load, strict=True))
    assert all(stop.holds(loads.get(stop.pose, "")) for stop in read.stops)
    assert any("without a pause it waits" in note for note in made.notes) == (pause is not None)
    if to == "csv":
        assert "# load: hang it after the arm has stopped, take it off again before the arm starts\n" in text
    else:
        moves = re.split(MOTION[to], text, flags=re.MULTILINE)
        assert not re.search("hang|load (w|weight)", moves[0])
        for move, part in zip(made.moves, moves[1:], strict=True):
            asked, *after = re.split(WAITS[to], part.partition("/POS")[0], flags=re.MULTILINE)
            kind = "load" if pause is not None else "now hang"
            assert re.findall(rf"[!;#] ?{kind} (\S+)", asked) == ([_shown(move.load, to)] if move.measured else [])
            assert not re.search("hang|load", "".join(after)), "nothing is named before the next move"
            assert ("take it off before the start" in asked) == (move.measured and pause is None)
    changed = text.replace(f"{'hang' if pause is None else 'load'} w", f"{'hang' if pause is None else 'load'} u")
    changed = text.replace(",w,", ",u,") if to == "csv" else changed
    assert changed != text
    file.write_text(changed)
    assert read_export(file).differences(made)
    assert any("another load" in d for d in read_export(file).plan_differences(plan))


def _shown(load: str, to: str) -> str:
    return re.sub(r"\W", "_", load)[: 22 if to == "fanuc-ls" else None]


def test_loads_that_a_remark_cannot_tell_apart(m900ib: Experiment, tmp_path: Path) -> None:
    names = [f"weight and a side pull of {n} N" for n in (500, 500, 1500, 1500)]
    plan = two_loads(m900ib, names)
    made = make_programme(bounded(m900ib), plan, order="plan")
    with pytest.raises(
        InputError, match=r"found 'weight .* 1500 N'; allowed: .*'weight .* 500 N' in its first 22 char"
    ):
        export(made, "fanuc-ls", tmp_path / "way.ls")
    assert export(made, "csv", tmp_path / "way.csv")


WRITERS: dict[str, Any] = {
    "fanuc-ls": (lambda p: (write_fanuc(p, "WAY"),), ".ls"),
    "krl": (lambda p: write_krl(p, "way"), ".src"),
    "rapid": (lambda p: (write_rapid(p, "way"),), ".mod"),
}
"""Formats that hold external axes: what they write, and how it is read."""


def beside(programme: Programme, to: str, count: int, external: tuple[int, ...]) -> Programme:
    """Two moves of an arm with more axes."""
    angles = np.random.default_rng(count).uniform(-3.0, 3.0, (2, count))
    moves = (Move(angles[0]), Move(angles[1], "p01", 1, "w"))
    tool, frame = ("grip", "table") if to == "rapid" else ("3", "2")
    return replace(programme, moves=moves, external=external, tool=tool, frame=frame)


@pytest.mark.parametrize("to", WRITERS)
@pytest.mark.parametrize(("count", "external"), [(7, (0,)), (7, (6,)), (7, (2,)), (8, (0, 7)), (6, ())])
def test_external_axes_come_back_in_their_places(
    programme: Programme, to: str, count: int, external: tuple[int, ...]
) -> None:
    """A turntable below the arm or beside it, and the third axis of an arm with seven; tool and frame as asked for."""
    write, ending = WRITERS[to]
    made = beside(programme, to, count, external)
    texts = write(made)
    read = parse(ending, *texts)
    assert read.differences(made) == []
    assert (read.tool, read.frame) == (made.tool, made.frame)
    found = np.array([s.pendant for s in read.stops])
    assert np.allclose(found, [m.pendant for m in made.moves], rtol=0.0, atol=np.deg2rad(1e-4))
    assert read.differences(replace(made, tool="9")) == [f"tool {made.tool}, not 9"]
    if external:
        degrees = np.rad2deg(made.moves[0].pendant[external[0]])
        stated = {"fanuc-ls": rf"E1= *{degrees:.4f} deg", "krl": rf"E1 {degrees:.4f}", "rapid": rf"\],\[{degrees:.4f}"}
        assert re.search(stated[to], "".join(texts))


LINK = """<link name="l{k}"><inertial><mass value="{m}"/><origin xyz="0 0 0.1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{n}"/><origin xyz="{xyz}"/>
<axis xyz="{axis}"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>"""
CHAIN = [
    ("0 0 0.3", "0 0 1"),
    ("1.2 0 0.4", "0 0 1"),
    ("0.3 0 0.4", "0 1 0"),
    ("0 0 1.1", "0 1 0"),
    ("0.2 0 0.2", "1 0 0"),
    ("1.0 0 0", "0 1 0"),
    ("0.2 0 0", "1 0 0"),
]
"""A turntable, and an arm with six axes on it."""


def turntable(folder: Path, external: str) -> Path:
    """The folder's experiment.yaml of that arm; what robot.yaml says of the turntable's joint."""
    links = "".join(LINK.format(k=k, m=100.0 - 10.0 * k) for k in range(8))
    joints = "".join(JOINT.format(k=k, n=k + 1, xyz=xyz, axis=axis) for k, (xyz, axis) in enumerate(CHAIN))
    (folder / "arm.urdf").write_text(f'<robot name="arm">{links}{joints}</robot>')
    rows = [f"  j{k}: {{limits_deg: [-170, 170]{external if k == 0 else ''}}}" for k in range(7)]
    head = [
        "name: table_arm",
        "title: an arm on a turntable",
        "urdf: arm.urdf",
        "base: l0",
        "flange: l7",
        "controller:",
    ]
    effects = ["effects:", "  - {effect: joint_compliance, joints: all}"]
    (folder / "robot.yaml").write_text("\n".join([*head, *rows, *effects]) + "\n")
    lines = [
        "robot: .",
        "load: {point_mm: [0, 0, 100]}",
        "markers: {m: {xyz_mm: [0, 0, 100]}}",
        "noise: {sigma_mm: 0.03}",
    ]
    (folder / "experiment.yaml").write_text("\n".join(lines) + "\n")
    return folder / "experiment.yaml"


@pytest.mark.parametrize("to", WRITERS)
def test_an_arm_on_a_turntable(tmp_path: Path, to: str) -> None:
    """From robot.yaml to the controller's file: the turntable is E1, the arm keeps its six axes."""
    experiment = load_experiment(turntable(tmp_path, ", external: true"))
    pendant = np.random.default_rng(5).uniform(-0.8, 0.8, (4, 7))
    plan = plan_of(experiment, pendant, force=-100.0)
    write_plan(tmp_path / "plan.csv", plan, experiment)
    out = tmp_path / f"way{ENDING[to]}"
    line = ["export", str(experiment.path), str(tmp_path / "plan.csv"), "--to", to, "-o", str(out)]
    assert CliRunner().invoke(app, line, catch_exceptions=False).exit_code == 0
    read = read_export(out)
    assert read.plan_differences(plan) == []
    found = np.array([next(s.pendant for s in read.stops if s.pose == name) for name in plan.pose])
    assert np.abs(np.rad2deg(found - pendant)).max() < 1e-4
    stated = "".join(f.read_text() for f in tmp_path.glob("way.*"))
    letter = "A" if to == "krl" else "J"
    assert " ".join(["axes E1", *(f"{letter}{k}" for k in range(1, 7))]) in stated
    assert ("$VEL_EXTAX[1]=10" in stated) == (to == "krl")
    plain = load_experiment(turntable(tmp_path, ""))
    if to != "fanuc-ls":
        with pytest.raises(InputError, match="found 7 axes of the arm and 0 external ones"):
            export(make_programme(plain, plan), to, out)


def test_axes_that_nobody_calls_external_are_refused(programme: Programme) -> None:
    for to, most in (("krl", 6), ("rapid", 6), ("fanuc-ls", 9)):
        with pytest.raises(InputError, match=rf"allowed: up to {most} and 6. Say `external: true`"):
            WRITERS[to][0](beside(programme, to, most + 1, ()))
    for to in ("krl", "rapid"):
        with pytest.raises(InputError, match="found 5 joints; allowed: 6"):
            WRITERS[to][0](beside(programme, to, 5, ()))
    with pytest.raises(InputError, match="found 7 joints, 1 of them external"):
        write_urscript(beside(programme, "krl", 7, (0,)), "way")


def test_the_fanuc_listing(programme: Programme, plan: Plan, tmp_path: Path) -> None:
    """What the controller's loader insists on: numbered lines, remarks of 32 characters, joints in three columns."""
    text = export(programme, "fanuc-ls", tmp_path / "way.ls")[0].read_text()
    lines = re.findall(r"^ *(\d+):(.*);$", text, re.MULTILINE)
    assert [int(n) for n, _ in lines] == list(range(1, len(lines) + 1))
    assert f"LINE_COUNT\t= {len(lines)};" in text
    assert all(len(t.strip()) <= 33 for _, t in lines if t.strip().startswith("!"))
    block = re.findall(r"^P\[\d+.*?^};", text, re.MULTILINE | re.DOTALL)
    assert len(block) == len(programme.moves)
    shape = r'P\[\d+(:"\S{1,16}")?\]\{\n   GP1:\n\tUF : 0, UT : 1,\t\n(\t(J\d= *-?\d+\.\d{4} deg,?\t?){3}\n){2}\};'
    assert all(re.fullmatch(shape, b) for b in block)
    assert text.endswith("/END\n")


def test_wrong_plans(m900ib: Experiment, cell: Experiment, plan: Plan, programme: Programme, tmp_path: Path) -> None:
    good = np.deg2rad([[0.0, 20.0, -10.0, 0.0, 60.0, 0.0], [10.0, 20.0, -10.0, 0.0, 60.0, 0.0]])
    heavy = np.array([[0.0, 0.0, -1000.0, 0.0, 0.0, 0.0], [0.0, 0.0, -7000.0, 0.0, 0.0, 0.0]])
    with pytest.raises(InputError, match=r"F: pose 'p02': the load is above .*found 7000 N; allowed: 700 kg, 6867 N"):
        make_programme(m900ib, replace(plan_of(m900ib, good), wrench=heavy), file="F")
    with pytest.raises(
        InputError, match=r"pose 'p01': joint_2 is outside its limits; found 95 deg; allowed: -64 to 90"
    ):
        make_programme(m900ib, plan_of(m900ib, good + np.deg2rad([0, 75, 0, 0, 0, 0])))
    down = np.random.default_rng(1).uniform(cell.robot.controller.lower, cell.robot.controller.upper, (300, 6))
    hit = Surroundings(cell).broken(down)
    with pytest.raises(InputError, match=r"pose 'p01': breaks 'floor'"):
        make_programme(cell, plan_of(cell, down[hit["floor"] & ~hit["collision"]][:1]))
    with pytest.raises(InputError, match=r"fanuc-ls is for controllers by FANUC; found KUKA KR500. Use krl"):
        export(replace(programme, title="KUKA KR500"), "fanuc-ls", tmp_path / "x.ls")
    with pytest.raises(InputError, match="unknown format 'karel'"):
        export(programme, "karel", tmp_path / "x.kl")
    with pytest.raises(InputError, match=r"rapid is for controllers by ABB; found KUKA KR500. Use krl"):
        export(replace(programme, title="KUKA KR500"), "rapid", tmp_path / "x.mod")
    with pytest.raises(InputError, match=r"the tool of the controller; found 'gripper'; allowed: a number"):
        export(replace(programme, title="", tool="gripper"), "krl", tmp_path / "x.src")
    with pytest.raises(InputError, match=r"urscript states joint angles, .*found 1 0. Leave them out"):
        export(replace(programme, title="", tool="1", frame="0"), "urscript", tmp_path / "x.script")
    named = replace(programme, moves=tuple(replace(m, pose="a b") if m.measured else m for m in programme.moves))
    with pytest.raises(InputError, match="pose 'a b': the controller cannot hold this name"):
        export(named, "csv", tmp_path / "x.csv")
    with pytest.raises(InputError, match="found '1plan'; allowed: a letter"):
        export(replace(programme, title=""), "krl", tmp_path / "1plan.src")
    with pytest.raises(InputError, match=r"found 0 s; allowed: 0\.01"):
        make_programme(cell, plan, pause=0.0)
    assert list(tmp_path.iterdir()) == []
    assert programme_module.check_plan(m900ib, plan_of(m900ib, good)) is None


def test_the_command(m900ib: Experiment, tmp_path: Path) -> None:
    pendant = np.deg2rad([[0, 20, -10, 0, 60, 0], [90, 20, -10, 0, 60, 0], [10, 20, -10, 10, 60, 0]])
    write_plan(tmp_path / "plan.csv", plan_of(m900ib, pendant), m900ib)
    out, told = tmp_path / "way.ls", tmp_path / "way.json"
    arguments = ["export", str(m900ib.path), str(tmp_path / "plan.csv"), "--to", "fanuc-ls"]
    run = CliRunner().invoke(app, [*arguments, "-o", str(out), "--json", str(told)], catch_exceptions=False)
    assert run.exit_code == 0
    assert "3 stops to measure" in run.output
    assert "not checked against a floor" in run.output
    assert "the plan's own order asks 170 deg" in run.output
    content = json.loads(told.read_text())
    assert [s["pose"] for s in content["stops"]] in (["p01", "p03", "p02"], ["p02", "p03", "p01"])
    assert content["way_deg"] == pytest.approx(90.0)
    assert [s.pose for s in read_export(out).stops] == [s["pose"] for s in content["stops"]]
    more = ["--order", "random", "--repeat-share", "0.34", "--hold"]
    again = CliRunner().invoke(app, [*arguments, "-o", str(out), *more], catch_exceptions=False)
    assert "5 stops to measure" in again.output, "a third of three poses, rounded up, a second time"
    assert {s.pause for s in read_export(out).stops} == {None}
    for more, words in (
        (["--to", "fanuc"], "unknown format 'fanuc'"),
        (["--home", "0,0"], "--home: found 2 numbers"),
        (["--home", "0,95,0,0,0,0"], "--home: joint_2 is outside"),
        (["--order", "tsp"], "unknown order 'tsp'"),
    ):
        wrong = CliRunner().invoke(app, [*arguments, "-o", str(out), *more])
        assert isinstance(wrong.exception, InputError)
        assert words in str(wrong.exception)


@pytest.mark.parametrize("home", [None, "0,0,0,0,60,0"])
def test_both_lengths_are_of_the_same_way(m900ib: Experiment, tmp_path: Path, home: str | None) -> None:
    """In the plan's own order without a detour they agree, from home and back; the shortest is no longer than that."""
    pendant = np.deg2rad([[0, 20, -10, 0, 60, 0], [90, 20, -10, 0, 60, 0], [10, 20, -10, 10, 60, 0]])
    write_plan(tmp_path / "plan.csv", plan_of(m900ib, pendant), m900ib)
    told = tmp_path / "way.json"
    arguments = ["export", str(m900ib.path), str(tmp_path / "plan.csv"), "--to", "csv", "-o"]
    arguments += [str(tmp_path / "w.csv"), "--json", str(told), *(["--home", home] if home else [])]
    lengths: dict[str, float] = {}
    for order in ("plan", "shortest"):
        run = CliRunner().invoke(app, [*arguments, "--order", order], catch_exceptions=False)
        assert "3 stops to measure, 0 via points" in run.output, "home is no detour"
        assert ("from home and back" in run.output) == bool(home)
        content = json.loads(told.read_text())
        lengths[order] = content["way_deg"]
        assert content["way_as_planned_deg"] == pytest.approx(210.0 if home else 170.0)
    assert lengths["plan"] == pytest.approx(210.0 if home else 170.0)
    assert lengths["shortest"] == pytest.approx(200.0 if home else 90.0)


def test_a_plan_of_another_robot(m900ib: Experiment, cell: Experiment, tmp_path: Path) -> None:
    both = plan_of(cell, np.deg2rad([[0, 20, -10, 0, 60, 0], [90, 20, -10, 0, 60, 0]]))
    write_plan(tmp_path / "plan.csv", both, cell)
    arguments = [
        "export",
        str(m900ib.path),
        str(tmp_path / "plan.csv"),
        "--to",
        "csv",
        "-o",
        str(tmp_path / "o.csv"),
    ]
    run = CliRunner().invoke(app, arguments)
    assert isinstance(run.exception, InputError)
    assert "fanuc_r2000ic" in str(run.exception)
    assert not (tmp_path / "o.csv").exists()
    text = (tmp_path / "plan.csv").read_text()
    (tmp_path / "plan.csv").write_text("\n".join(line for line in text.splitlines() if not line.startswith("#")))
    again = CliRunner().invoke(app, arguments)
    assert isinstance(again.exception, InputError)
    words = "plan.json: the plan is of another robot; found fanuc_r2000ic; allowed: fanuc_m900ib"
    assert words in str(again.exception)


def test_a_torque_above_the_motors_is_refused(m900ib: Experiment) -> None:
    torque = np.abs(actuator_torques(m900ib.model(), plan_of(m900ib, GOOD).poses))
    limits = torque.max(axis=0) * 1.01
    strong = replace(m900ib, robot=replace(m900ib.robot, torque_limits=limits), constraints=Constraints())
    make_programme(strong, plan_of(strong, GOOD), order="plan")
    limits[1] = 0.5 * torque[:, 1].max()
    weak = replace(strong, robot=replace(strong.robot, torque_limits=limits))
    with pytest.raises(
        InputError, match=r"pose 'p0.': joint_2 cannot hold the load; found \d+ N m; allowed: up to \d+ N m"
    ):
        make_programme(weak, plan_of(weak, GOOD))


def test_poses_keep_the_constraints_of_their_experiment(m900ib: Experiment) -> None:
    narrow = bounded(m900ib, joint_limits={"joint_1": (-1.0, 1.0)})
    with pytest.raises(InputError, match=r"P: pose 'p02': breaks 'joint limits'"):
        make_programme(narrow, plan_of(narrow, GOOD), file="P")
    straight = np.array([*GOOD, GOOD[0] * [1, 1, 1, 1, 0, 1]])
    rigid = bounded(m900ib, singularity_margin=0.01)
    notes = make_programme(rigid, plan_of(rigid, straight)).notes
    assert any("p03 break the constraint 'singularity_margin'" in note for note in notes)


def test_poses_in_between_keep_narrower_limits_and_the_distance_from_axis_1(cell: Experiment, plan: Plan) -> None:
    highest = plan.pendant.max(axis=0)[0] + 0.02, plan.pendant.min(axis=0)[0] - 0.02
    narrow = replace(cell, constraints=replace(cell.constraints, joint_limits={"joint_1": highest[::-1]}))
    made = make_programme(narrow, plan)
    assert made.vias > 0
    first = np.array([m.pendant[0] for m in made.moves])
    assert first.min() >= highest[1]
    assert first.max() <= highest[0]
    far = replace(cell, constraints=replace(cell.constraints, axis1_distance_min=0.9, of="wrist_centre"))
    q = far.robot.controller.to_joints(plan.pendant)
    centre = joint_frames(far.robot.facts, q).positions[far.robot.facts.n - 1]
    near = np.hypot(centre[0], centre[1]) < 0.9
    assert np.array_equal(Surroundings(far).broken(plan.pendant)["axis1_distance_min"], near)


def test_where_the_tracker_loses_a_marker(m900ib: Experiment) -> None:
    """Behind the column the arm hides the tool, in front it does not."""
    station = Sight(np.array([6.0, 0.0, 1.5]), None, 0.05, None)
    seen = bounded(m900ib, sight=station)
    turned = GOOD[0] + np.deg2rad([[-20, 0, 0, 0, 0, 0], [20, 0, 0, 0, 0, 0], [179, 0, 0, 0, 0, 0]])
    made = make_programme(seen, plan_of(seen, turned[:2]), order="plan")
    assert not any("tracker loses" in note for note in made.notes)
    notes = make_programme(seen, plan_of(seen, turned), order="plan").notes
    assert any("p03 break the constraint 'sight'" in note for note in notes)
    assert any("loses a marker on the way p02 to p03" in note for note in notes)


def test_two_loads_take_hardly_more_than_the_best_of_all_ways(m900ib: Experiment) -> None:
    """All orders of four poses under each of two loads, either load first, against the way that is found."""
    ratios: list[float] = []
    orders = list(itertools.permutations(range(4)))
    for seed in range(12):
        pendant = np.random.default_rng(seed).uniform(-2, 2, (8, 6))
        plan = replace(plan_of(m900ib, pendant), load=("a",) * 4 + ("b",) * 4)
        d = travel(pendant, pendant)
        inner = {o: sum(d[a, b] for a, b in itertools.pairwise(o)) for o in orders}
        other = {o: sum(d[a + 4, b + 4] for a, b in itertools.pairwise(o)) for o in orders}
        best = min(inner[p] + other[q] + d[p[-1], q[0] + 4] for p in orders for q in orders)
        ratios.append(way_length(pendant, visits(plan), None) / best)
    assert min(ratios) >= 1.0 - 1e-9
    assert np.mean(ratios) < 1.06
    assert max(ratios) < 1.25


def test_another_maker_is_refused_before_the_way_is_sought(
    m900ib: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_plan(tmp_path / "plan.csv", plan_of(m900ib, GOOD), m900ib)
    monkeypatch.setattr(programme_module, "Surroundings", lambda experiment: pytest.fail("work before the refusal"))
    for to, ending, words in (
        ("krl", ".src", "krl is for controllers by KUKA"),
        ("fanuc-ls", ".ls", "the tool of the controller"),
    ):
        arguments = ["export", str(m900ib.path), str(tmp_path / "plan.csv"), "--to", to, "--tool", "spindle"]
        run = CliRunner().invoke(app, [*arguments, "-o", str(tmp_path / f"way{ending}")])
        assert isinstance(run.exception, InputError)
        assert words in str(run.exception)


def positions_plan(plan: Plan) -> Plan:
    """The plan read without loads, its second half from another station."""
    stands = tuple("east" if i < 7 else "west" for i in range(14))
    return replace(plan, wrench=np.zeros_like(plan.wrench), load=("",) * 14, repeats=(1,) * 14, station=stands)


@pytest.mark.parametrize("to", EVERY)
def test_a_plan_of_positions_says_where_the_tracker_moves_and_nothing_of_weights(
    cell: Experiment, plan: Plan, tmp_path: Path, to: str
) -> None:
    own = positions_plan(plan)
    made = make_programme(cell, own, pause=None)
    assert not any("weight: a run" in note or "without the weight" in note for note in made.notes)
    files = export(replace(made, title="an arm"), to, tmp_path / f"way{ENDING[to]}")
    read = read_export(files[0])
    assert read.differences(made) == []
    assert read.plan_differences(own) == []
    text = files[0].read_text()
    assert "weight" not in text.lower()
    where = [text.index(f"tracker at {s}" if to != "csv" else f",{s}\n") for s in ("east", "west")]
    assert where == sorted(where)
    for station in ("east", "west"):
        assert text.count(station) == (2 if to == "urscript" else 1)


def test_nothing_drives_on_while_the_tracker_moves(cell: Experiment, plan: Plan) -> None:
    with pytest.raises(InputError, match=r"the tracker moves between east and west.*waits at each pose"):
        make_programme(cell, positions_plan(plan))
