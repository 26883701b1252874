"""Obstacles: read from the experiment or a file, kept by every link, the load and the way, drawn, refused in words."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
import trimesh

from qsframework.errors import InputError
from qsframework.experiment import Experiment, load_experiment
from qsframework.plans import broken_constraints, design
from qsframework.plans.constraints import check_poses, touching
from qsframework.plans.path_check import Surroundings, find_way, stretch
from qsframework.plans.programme import make_programme
from qsframework.plugin import Array
from qsframework.robot.kinematics import joint_frames
from qsframework.viz.show_scene import show_scene

HEAD = """robot: fanuc_r2000ic
load: {point_mm: [150, 0, 200]}
markers: {m1: {xyz_mm: [150, 250, 250]}, m2: {xyz_mm: [400, -150, 150]}, m3: {xyz_mm: [150, -150, -250]}}
noise: {sigma_mm: 0.03}
loads: [{name: weight, fz_N: -1300}, {name: pull, fz_N: -1300, fy_N: 700}]
"""
CELL = """obstacles:
  table: {box_m: [1.0, 1.4, 0.8], at_m: [1.8, 0, 0.4]}
  fence: {plane: [0, 1, 0], at_m: [0, -1.6, 0]}
  pillar: {cylinder_m: [0.15, 2.5], at_m: [-0.6, 1.6, 1.25]}
  nest: {mesh: nest.stl, scale: 0.001, at_m: [1.8, 0, 0.8], turned_deg: [0, 0, 30]}
"""


def written(folder: Path, constraints: str, cell: str = CELL) -> Path:
    """An experiment with the constraints, a cell beside it and the mesh of a nest, mm."""
    walls = trimesh.creation.box(extents=(500, 500, 300)).difference(
        trimesh.creation.box(extents=(400, 400, 300)).apply_translation((0, 0, 50))
    )
    (folder / "nest.stl").write_bytes(walls.apply_translation((0, 0, 150)).export(file_type="stl"))
    (folder / "cell.yaml").write_text(cell)
    file = folder / "experiment.yaml"
    file.write_text(f"{HEAD}constraints: {constraints}\n")
    return file


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    folder = tmp_path_factory.mktemp("cell")
    return load_experiment(written(folder, "{floor_m: 0, tool_radius_mm: 250, obstacles: cell.yaml}"))


def poses(experiment: Experiment, count: int) -> Array:
    control = experiment.robot.controller
    return np.random.default_rng(3).uniform(control.lower, control.upper, (count, control.axes))


def test_the_file_and_the_experiment_say_the_same(cell: Experiment, tmp_path: Path) -> None:
    inside = ", ".join(line.strip() for line in CELL.splitlines()[1:])
    same = load_experiment(written(tmp_path, f"{{floor_m: 0, tool_radius_mm: 250, obstacles: {{{inside}}}}}"))
    names = ["table", "fence", "pillar", "nest"]
    for one, other in zip(same.constraints.obstacles, cell.constraints.obstacles, strict=True):
        np.testing.assert_array_equal(one.placement, other.placement)
        assert (one.kind, one.size) == (other.kind, other.size)
    assert [shape.name for shape in same.constraints.obstacles] == names
    pendant = poses(cell, 300)
    found = [check_poses(e, e.model(), pendant)["obstacles"] for e in (cell, same)]
    np.testing.assert_array_equal(*found)
    assert 50 < found[0].sum() < 280


def test_every_link_and_the_load_keep_away(cell: Experiment) -> None:
    """By hand: corners of solids beyond the fence, the ball of the load in the table or the pillar."""
    robot, pendant = cell.robot, poses(cell, 400)
    placed = joint_frames(robot.facts, robot.controller.to_joints(pendant))
    kept, words = check_poses(cell, cell.model(), pendant)["obstacles"], touching(cell, pendant)["obstacles"]
    np.testing.assert_array_equal(kept, [not said for said in words])
    load = placed.point(cell.load_site.link, cell.load_site.xyz)
    behind = load[1] - 0.25 < -1.6
    np.testing.assert_array_equal(behind, ["tool and fence" in said for said in words])
    away = load - np.array([[1.8], [0.0], [0.4]])
    gap = np.linalg.norm(np.maximum(np.abs(away) - np.array([[0.5], [0.7], [0.4]]), 0.0), axis=0)
    np.testing.assert_array_equal(gap < 0.25, ["tool and table" in said for said in words])
    others = {said.split(" and ")[0] for each in words for said in each.split(", ") if said}
    assert others >= {"tool", robot.facts.links[3], robot.facts.links[6]}
    assert robot.facts.links[0] not in others


def test_a_design_and_its_way_keep_clear(cell: Experiment) -> None:
    """What is designed is exported; the poses in between are asked the same."""
    found = design(cell, 6, candidates=150)
    assert broken_constraints(cell, found) == {}
    moves = make_programme(cell, found).moves
    around = Surroundings(cell)
    for a, b in itertools.pairwise(m.pendant for m in moves):
        assert around.free(stretch(a, b)).all()


def test_a_way_leads_around_a_pillar(cell: Experiment) -> None:
    """Straight through it a pillar stands; without it the straight way is free."""
    first, second = np.deg2rad([[95.0, 20, -10, 0, -60, 0], [140.0, 20, -10, 0, -60, 0]])
    alone = cell.with_(constraints=type(cell.constraints)())
    assert Surroundings(alone).way_is_free(first, second)
    around = Surroundings(cell)
    assert "pillar)" in around.in_the_way(first, second)
    between = find_way(around, first, second, np.random.default_rng(0))
    assert between


def test_a_pose_in_the_table_is_refused_by_name(cell: Experiment) -> None:
    found = design(cell, 4, candidates=60)
    angles = np.array(found.pendant)
    hit = poses(cell, 400)
    hit = hit[["and table" in said for said in touching(cell, hit)["obstacles"]]]
    angles[1] = hit[0]
    moved = type(found)(**{**found.__dict__, "pendant": angles, "q": cell.robot.controller.to_joints(angles)})
    with pytest.raises(InputError, match=r"pose 'p02': breaks .*'obstacles' \(.* and table.*design again with this"):
        make_programme(cell, moved)


def test_obstacles_are_drawn(cell: Experiment) -> None:
    plan = design(cell, 3, candidates=60)
    scene = show_scene(cell, plan)
    assert {f"obstacles/{k}" for k in range(4)} <= set(scene.drawn)
    assert "obstacles" in scene.layers
    assert "Brown: what stands around the arm: table, fence, pillar, nest." in scene.notes


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("{box_m: [1, 1]}", "box needs 3 numbers"),
        ("{box_m: [1, 1, 1], mesh: nest.stl}", "is one of box_m"),
        ("{at_m: [1, 1, 1]}", "is one of box_m"),
        ("{box: [1, 1, 1]}", "'box' does not say its unit"),
        ("{cylinder_m: [0, 1]}", "its sizes must be positive"),
        ("{plane: [0, 0, 0]}", "not all zero"),
        ("{mesh: lost.stl}", "obstacle 'it': there is no mesh 'lost.stl'"),
        ("{mesh: ../nest.stl}", "there is no mesh"),
        ("5", "must be a mapping"),
        ("{mesh: nest.stl, scale: 0}", "greater than 0"),
        (
            "{box_m: [5, 5, 5], at_m: [0, 0, 1]}",
            r"obstacle 'it': the arm touches it at every one of 64 poses\. Its place",
        ),
        ("{plane: [0, 0, -1], at_m: [0, 0, 0.2]}", "at every one of 64 poses"),
    ],
)
@pytest.mark.parametrize("own", [True, False])
def test_wrong_obstacles(entry: str, words: str, own: bool, tmp_path: Path) -> None:
    constraints = "{obstacles: cell.yaml}" if own else f"\n  obstacles:\n    it: {entry}"
    file = written(tmp_path, constraints, f"obstacles:\n  it: {entry}\n")
    with pytest.raises(InputError, match=words) as refused:
        load_experiment(file)
    problem = refused.value.problems[0]
    assert problem.file == str(tmp_path / ("cell.yaml" if own else "experiment.yaml"))
    assert problem.line == (2 if own else 8)


def test_obstacles_are_a_mapping_or_a_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"obstacles: must be a mapping, or the name of a file"):
        load_experiment(written(tmp_path, "{obstacles: [1]}"))


@pytest.mark.parametrize("name", ["lost.yaml", "../cell.yaml"])
def test_a_file_of_obstacles_lies_beside_the_experiment(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no such file|outside the experiment's folder"):
        load_experiment(written(tmp_path, f"{{obstacles: {name}}}"))


def test_a_closed_cell_around_the_arm_is_refused(tmp_path: Path) -> None:
    """A room drawn as one solid holds the arm; walls of their own do not."""
    trimesh.creation.box(extents=(8, 8, 8)).export(tmp_path / "room.stl")
    with pytest.raises(InputError, match=r"obstacle 'room': .*walls around the arm are planes or boxes each"):
        load_experiment(written(tmp_path, "{obstacles: {room: {mesh: room.stl}}}"))
    walls = "{obstacles: {left: {plane: [0, 1, 0], at_m: [0, -4, 0]}, right: {plane: [0, -1, 0], at_m: [0, 4, 0]}}}"
    assert len(load_experiment(written(tmp_path, walls)).constraints.obstacles) == 2
