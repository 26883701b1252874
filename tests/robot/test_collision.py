"""Collisions and sight against computations of their own: all pairs by coal, separating planes, sampled lines."""

from __future__ import annotations

import itertools

import coal
import numpy as np
import pinocchio as pin
import pytest
import scipy.optimize

from qsframework.experiment import Experiment
from qsframework.robot import Robot, Shape, load_robot
from qsframework.robot.collision import Collider, above_floor, lowest_point, make_collider
from qsframework.robot.kinematics import Frames, joint_chain, joint_frames
from qsframework.robot.mesh import convex_hull
from qsframework.robot.sight import depth, visible

GREY = (0.5, 0.5, 0.5, 1.0)
KINDS = ("box", "cylinder", "sphere")


def random_shape(rng: np.random.Generator, link: int, kind: str) -> Shape:
    placement = np.eye(4)
    placement[:3, :3] = pin.Quaternion(*(v := rng.normal(size=4)) / np.linalg.norm(v)).matrix()
    placement[:3, 3] = rng.normal(size=3) * 0.1
    return Shape(
        link, placement, kind, tuple(rng.uniform(0.3, 1.0, {"box": 3, "cylinder": 2, "sphere": 1}[kind])), GREY
    )


def loose_links(experiment: Experiment, rng: np.random.Generator, count: int, spread: float) -> Frames:
    """Frames of seven links that stand anywhere, as if there were no joints."""
    rotations = np.empty((7, 3, 3, count))
    for link, k in itertools.product(range(7), range(count)):
        rotations[link, :, :, k] = pin.Quaternion(*(v := rng.normal(size=4)) / np.linalg.norm(v)).matrix().T
    none = np.zeros((0, 3, count))
    chain = joint_chain(experiment.robot.facts)
    return Frames(chain, none, none, rotations, rng.normal(size=(7, 3, count)) * spread)


def world(shape: Shape, placed: Frames, k: int) -> np.ndarray:
    link = np.eye(4)
    link[:3, :3], link[:3, 3] = placed.rotations[shape.link, :, :, k].T, placed.positions[shape.link, :, k]
    return link @ shape.placement


def corners(shape: Shape, around: bool) -> np.ndarray:
    """Corners (m, 3) of a box, or of a prism inside a cylinder or around it."""
    if shape.kind == "box":
        return np.array(list(itertools.product(*[(-s / 2, s / 2) for s in shape.size])))
    count = 48
    radius = shape.size[0] / (np.cos(np.pi / count) if around else 1.0)
    angles = np.arange(count) * 2 * np.pi / count
    ring = np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)
    return np.concatenate([np.column_stack([ring, np.full(count, z)]) for z in (-shape.size[1] / 2, shape.size[1] / 2)])


def meet(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two convex hulls share a point: a linear programme in their weights."""
    a, b = len(one), len(other)
    A = np.zeros((5, a + b))
    A[:3, :a], A[:3, a:] = one.T, -other.T
    A[3, :a] = A[4, a:] = 1.0
    return scipy.optimize.linprog(np.zeros(a + b), A_eq=A, b_eq=[0, 0, 0, 1, 1], bounds=(0, None)).status == 0


@pytest.mark.parametrize("kinds", list(itertools.combinations_with_replacement(("box", "cylinder"), 2)))
def test_solids_meet_as_their_hulls_do(m900ib: Experiment, kinds: tuple[str, str]) -> None:
    rng = np.random.default_rng(0)
    decided = hits = 0
    for _ in range(6):
        shapes = (random_shape(rng, 0, kinds[0]), random_shape(rng, 2, kinds[1]))
        placed = loose_links(m900ib, rng, 15, 0.45)
        hit = Collider(shapes, np.array([[0, 1]]), 0.0, ()).collides(placed)
        for k in range(15):
            inner, outer = (
                meet(*(corners(s, around) @ (w := world(s, placed, k))[:3, :3].T + w[:3, 3] for s in shapes))
                for around in (False, True)
            )
            if inner == outer:
                decided += 1
                hits += inner
                assert hit[k] == inner
    assert decided > 80
    assert 15 < hits < decided - 15


def test_spheres_meet_by_their_distance(m900ib: Experiment) -> None:
    rng = np.random.default_rng(1)
    for clearance, kind in itertools.product((0.0, 0.2), KINDS):
        shapes = (random_shape(rng, 0, kind), random_shape(rng, 2, "sphere"))
        placed = loose_links(m900ib, rng, 300, 0.5)
        hit = Collider(shapes, np.array([[0, 1]]), clearance, ()).collides(placed)
        centre = np.stack(
            [(np.linalg.inv(world(shapes[0], placed, k)) @ world(shapes[1], placed, k))[:3, 3] for k in range(300)]
        )
        if kind == "sphere":
            gap = np.linalg.norm(centre, axis=1) - shapes[0].size[0]
        elif kind == "box":
            gap = np.linalg.norm(np.maximum(np.abs(centre) - np.array(shapes[0].size) / 2, 0), axis=1)
        else:
            radius, length = shapes[0].size
            aside = np.maximum(np.hypot(centre[:, 0], centre[:, 1]) - radius, 0)
            gap = np.hypot(aside, np.maximum(np.abs(centre[:, 2]) - length / 2, 0))
        assert np.array_equal(hit, gap < shapes[1].size[0] + clearance)
        assert 20 < hit.sum() < 280


def every_pair_by_coal(collider: Collider, robot: Robot, q: np.ndarray) -> bool:
    """No bounds, placements by Pinocchio."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    request = coal.CollisionRequest()
    request.security_margin = collider.clearance
    kinds = {"box": coal.Box, "cylinder": coal.Cylinder, "sphere": coal.Sphere}

    def solid(k: int):  # type: ignore[no-untyped-def]
        shape = collider.shapes[k]
        where = data.oMi[shape.link].homogeneous @ shape.placement
        return kinds[shape.kind](*shape.size), coal.Transform3s(where[:3, :3], where[:3, 3])

    return any(
        coal.collide(*solid(int(i)), *solid(int(j)), request, coal.CollisionResult()) > 0 for i, j in collider.pairs
    )


@pytest.mark.parametrize(("name", "clearance", "radius"), [("fanuc_m900ib", 0.0, None), ("ur10", 0.03, 0.1)])
def test_bounds_change_nothing(name: str, clearance: float, radius: float | None) -> None:
    robot = load_robot(name)
    tool = np.eye(4)
    tool[:3, 3] = 0.1
    more = () if radius is None else (Shape(robot.facts.n, tool, "sphere", (radius,), GREY),)
    collider = make_collider(robot, clearance, more)
    rng = np.random.default_rng(2)
    q = robot.controller.to_joints(rng.uniform(robot.controller.lower, robot.controller.upper, (150, robot.facts.n)))
    hit = collider.collides(joint_frames(robot.facts, q))
    assert hit.tolist() == [every_pair_by_coal(collider, robot, row) for row in q]
    assert 10 < hit.sum() < 140


@pytest.mark.parametrize("name", ["fanuc_m900ib", "fanuc_r2000ic", "ur10"])
def test_the_robots_are_free_at_zero(name: str) -> None:
    robot = load_robot(name)
    collider = make_collider(robot)
    assert {p.reason for p in collider.left_out} == {"on neighbouring links"}
    assert not collider.collides(joint_frames(robot.facts, robot.controller.to_joints(np.zeros((1, 6))))).any()


SOLID = "<visual><origin xyz='{}'/><geometry><sphere radius='{}'/></geometry></visual>"


@pytest.mark.parametrize(
    ("place", "radius", "reason"),
    [("0 0 0.5", 3.0, "overlap in 100 % of the sampled poses"), ("0.8 0 1.5", 0.05, "overlap at the zero pose")],
)
def test_solids_that_overlap_by_construction_are_left_out(small, place: str, radius: float, reason: str) -> None:  # type: ignore[no-untyped-def]
    small.edit("small.urdf", ('<link name="base"/>', f'<link name="base">{SOLID.format(place, radius)}</link>'))
    small.edit("small.urdf", ('<link name="fore">', f'<link name="fore">{SOLID.format("0.8 0 0", 0.05)}'))
    first, second = make_collider(small.load()), make_collider(small.load())
    assert [p.reason for p in first.left_out] == ["on neighbouring links"] * 2 + [reason]
    assert first.left_out == second.left_out
    assert len(first.pairs) == 0
    assert not first.collides(joint_frames(small.load().facts, np.zeros((3, 2)))).any()


@pytest.mark.parametrize("kind", KINDS)
def test_the_lowest_point_is_the_lowest_of_the_surface(m900ib: Experiment, kind: str) -> None:
    rng = np.random.default_rng(3)
    shape, placed = random_shape(rng, 3, kind), loose_links(m900ib, rng, 20, 1.0)
    low = lowest_point(shape, placed)
    angle, height = (g.ravel() for g in np.meshgrid(np.linspace(0, 2 * np.pi, 721), np.linspace(-1, 1, 361)))
    if kind == "box":
        surface = corners(shape, True)
    elif kind == "cylinder":
        surface = np.stack(
            [np.cos(angle) * shape.size[0], np.sin(angle) * shape.size[0], height * shape.size[1] / 2], 1
        )
    else:
        aside = np.sqrt(1 - height**2)
        surface = shape.size[0] * np.stack([np.cos(angle) * aside, np.sin(angle) * aside, height], 1)
    for k in range(20):
        where = world(shape, placed, k)
        assert np.isclose(low[k], (surface @ where[:3, :3].T + where[:3, 3])[:, 2].min(), atol=2e-4)
    assert np.array_equal(above_floor((shape,), placed, 0.1), low >= 0.1)
    at_base = Shape(0, shape.placement, kind, shape.size, GREY)
    assert above_floor((at_base,), placed, 100.0).all(), "the base stands on the floor"


def test_sight_agrees_with_points_along_the_line(m900ib: Experiment) -> None:
    robot, rng = m900ib.robot, np.random.default_rng(4)
    q = robot.controller.to_joints(rng.uniform(robot.controller.lower, robot.controller.upper, (120, 6)))
    station, clearance = np.array([3.5, 1.0, 1.2]), 0.005
    placed = joint_frames(robot.facts, q)
    share = np.linspace(0, 1, 4001)[:, None]
    agree = seen = 0
    for marker in m900ib.markers:
        free = visible(robot.shapes, placed, station, 6, marker.xyz, clearance)
        for k in range(len(q)):
            data = robot.model.createData()
            pin.forwardKinematics(robot.model, data, q[k])
            target = data.oMi[6].act(marker.xyz)
            way = target - station
            line = station + share * way * (1 - clearance / np.linalg.norm(way))
            deepest = max(depths(s, data.oMi[s.link].homogeneous @ s.placement, line).max() for s in robot.shapes)
            if abs(deepest) > 2e-3:
                agree += 1
                seen += bool(free[k])
                assert free[k] == (deepest < 0), (marker.name, k)
    assert agree > 300
    assert 60 < seen < agree - 60


def depths(shape: Shape, where: np.ndarray, points: np.ndarray) -> np.ndarray:
    local = np.abs((points - where[:3, 3]) @ where[:3, :3])
    if shape.kind == "box":
        return (np.array(shape.size) / 2 - local).min(axis=1)
    if shape.kind == "sphere":
        return shape.size[0] - np.linalg.norm(local, axis=1)
    return np.minimum(shape.size[0] - np.hypot(local[:, 0], local[:, 1]), shape.size[1] / 2 - local[:, 2])


@pytest.mark.parametrize("kind", KINDS)
def test_a_reflector_may_stand_on_its_solid(m900ib: Experiment, kind: str) -> None:
    """On the near side it is seen, behind the solid not, inside its own solid it is; another link's solid hides it."""
    size = {"box": (0.4, 0.4, 0.4), "cylinder": (0.2, 0.4), "sphere": (0.2,)}[kind]
    shape = Shape(0, np.eye(4), kind, size, GREY)
    placed = joint_frames(m900ib.robot.facts, np.zeros((1, 6)))
    station = np.array([5.0, 0.0, 0.0])

    def seen(x: float, link: int = 0) -> bool:
        here = np.array([x, 0.0, 0.0]) if link == 0 else np.array([x, 0.0, 0.0]) - placed.positions[1, :, 0]
        return bool(visible((shape,), placed, station, link, here, 0.005)[0])

    assert seen(0.2)
    assert seen(0.204)
    assert not seen(-0.2)
    assert not seen(-0.3)
    assert seen(0.0)
    assert not seen(0.0, link=1)
    assert seen(0.3, link=1)
    assert np.isclose(depth(shape, np.array([0.15, 0, 0])), 0.05)
    assert depth(shape, np.array([0.25, 0, 0])) < 0


def test_a_hull_with_a_flat_face_of_many_corners_is_one(m900ib: Experiment) -> None:
    """A round flange of a fine mesh: six hundred corners in one plane, one of which a fan of triangles gives
    as many neighbours."""
    turn = np.linspace(0.0, 2.0 * np.pi, 600, endpoint=False)
    rim = np.stack([0.3 * np.cos(turn), 0.3 * np.sin(turn)], axis=1)
    points = np.concatenate([np.pad(rim, ((0, 0), (0, 1)), constant_values=z) for z in (-0.1, 0.1)])
    ball = Shape(2, np.eye(4), "sphere", (0.05,), GREY)
    disc = Shape(0, np.eye(4), "hull", (), GREY, hull=convex_hull(points))
    placed = loose_links(m900ib, np.random.default_rng(3), 300, 0.15)
    hit = Collider((disc, ball), np.array([[0, 1]]), 0.0, ()).collides(placed)
    drum = Shape(0, np.eye(4), "cylinder", (0.3, 0.2), GREY)
    assert np.mean(hit == Collider((drum, ball), np.array([[0, 1]]), 0.0, ()).collides(placed)) > 0.99
    assert 20 < hit.sum() < 280
