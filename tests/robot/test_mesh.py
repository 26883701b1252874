"""Convex hulls of meshes: the same solids as boxes are, for collisions, floor and sight; and coarser meshes."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from qsframework.plugin import Array, RobotFacts
from qsframework.robot.collision import Collider, _capsule, lowest_point
from qsframework.robot.kinematics import Frames, joint_frames
from qsframework.robot.mesh import coarser, convex_hull, solid_of
from qsframework.robot.robot import Shape
from qsframework.robot.sight import crosses, depth, visible

GREY = (0.5, 0.5, 0.5, 1.0)
COUNT = 400


def rng(seed: int) -> np.random.Generator:
    """Numbers of a test's own, whatever tests ran before it."""
    return np.random.default_rng([8, seed])


def frames() -> Frames:
    """Two links that lie anywhere within a metre."""
    facts = RobotFacts(
        name="two",
        joints=("a", "b"),
        links=("base", "one", "two"),
        axes=np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0]]),
        placements=np.stack([np.eye(4), np.eye(4)]),
        masses=np.zeros(3),
        centres=np.zeros((3, 3)),
        gravity=np.array([0.0, 0.0, -9.81]),
    )
    return joint_frames(facts, rng(1).uniform(-3, 3, (COUNT, 2)))


def turned(shift: Array, seed: int) -> Array:
    q, _ = np.linalg.qr(rng(seed).normal(size=(3, 3)))
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = q * np.sign(np.linalg.det(q)), shift
    return out


def box(size: tuple[float, float, float], link: int, shift: Array) -> Shape:
    return Shape(link, turned(shift, 10 + link), "box", size, GREY)


def as_hull(shape: Shape) -> Shape:
    """The box as a mesh with points inside it too, in a frame beside its middle."""
    signs = np.array(list(product((-0.5, 0.5), repeat=3)))
    points = np.concatenate([signs, rng(2).uniform(-0.5, 0.5, (50, 3))]) * shape.size
    aside = np.array([0.1, -0.2, 0.05])
    placement = shape.placement.copy()
    placement[:3, 3] -= placement[:3, :3] @ aside
    return replace(shape, kind="hull", size=(), hull=convex_hull(points + aside), placement=placement)


@pytest.fixture(scope="module")
def pair() -> tuple[Shape, Shape]:
    return box((0.4, 0.2, 0.9), 1, np.array([0.3, 0.1, 0.0])), box((0.3, 0.5, 0.2), 2, np.array([0.5, 0.0, 0.3]))


@pytest.mark.parametrize("clearance", [0.0, 0.05])
def test_hulls_collide_as_boxes_do(pair: tuple[Shape, Shape], clearance: float) -> None:
    placed, pairs = frames(), np.array([[0, 1]])
    wanted = Collider(pair, pairs, clearance, ()).collides(placed)
    assert 0 < wanted.sum() < COUNT
    for shapes in (tuple(map(as_hull, pair)), (pair[0], as_hull(pair[1]))):
        np.testing.assert_array_equal(Collider(shapes, pairs, clearance, ()).collides(placed), wanted)


def test_hulls_stand_on_the_floor_as_boxes_do(pair: tuple[Shape, Shape]) -> None:
    placed = frames()
    for shape in pair:
        np.testing.assert_allclose(lowest_point(as_hull(shape), placed), lowest_point(shape, placed), atol=1e-9)


def test_hulls_hide_as_boxes_do(pair: tuple[Shape, Shape]) -> None:
    placed, station, point = frames(), np.array([2.0, 0.3, 0.4]), np.array([0.4, 0.1, 0.2])
    start, end = rng(3).normal(size=(2, 3, COUNT))
    aside = np.array([0.1, -0.2, 0.05])[:, None]
    for shape in pair:
        hull, wanted = as_hull(shape), visible([shape], placed, station, 2, point, 0.01)
        np.testing.assert_array_equal(visible([hull], placed, station, 2, point, 0.01), wanted)
        assert depth(hull, point) == pytest.approx(depth(shape, point))
        crossed = crosses(shape, start, end)
        assert 0 < crossed.sum() < COUNT
        np.testing.assert_array_equal(crosses(hull, start + aside, end + aside), crossed)


def test_the_capsules_hold_a_hull_and_lie_in_it() -> None:
    draws = rng(4)
    for _ in range(20):
        hull = convex_hull(draws.normal(size=(40, 3)) * draws.uniform(0.05, 1.0, 3))
        middle, way, outer, (half, radius) = _capsule(Shape(0, np.eye(4), "hull", (), GREY, hull=hull))
        along = np.clip((hull.corners - middle) @ way, -outer[0], outer[0])
        aside = np.linalg.norm(hull.corners - middle - along[:, None] * way, axis=1)
        assert aside.max() <= outer[1] + 1e-9
        assert radius > 0.0
        for end in (-half, half):
            assert (hull.normals @ (middle + end * way) + radius <= hull.offsets + 1e-9).all()


def test_a_fine_and_a_flat_mesh() -> None:
    """A ball of many corners keeps its size to 1 %; a sheet is a solid of 0.2 mm."""
    points = rng(5).normal(size=(20_000, 3))
    ball = convex_hull(points / np.linalg.norm(points, axis=1)[:, None])
    assert len(ball.corners) <= 400
    assert ball.offsets.min() > 0.985
    centre = ball.corners[ball.faces].mean(axis=1)
    normal = np.cross(*(ball.corners[ball.faces[:, k]] - ball.corners[ball.faces[:, 0]] for k in (1, 2)))
    assert (np.einsum("fi,fi->f", normal, centre) > 0.0).all()  # seen from outside
    sheet = convex_hull(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))
    assert np.ptp(sheet.corners[:, 2]) == pytest.approx(2e-4)


def cup(link: int, seed: int, size: float = 1.0) -> Shape:
    """A cup with thick walls, open at the top: its hull is far larger than itself."""
    import trimesh

    outside = trimesh.creation.box(extents=(0.8, 0.8, 0.8))
    inside = trimesh.creation.box(extents=(0.6, 0.6, 0.8))
    inside.apply_translation((0.0, 0.0, 0.1))
    made = outside.difference(inside)
    hull = solid_of(size * np.asarray(made.vertices), np.asarray(made.faces))
    assert hull.surface is not None
    return Shape(link, turned(np.zeros(3), seed), "hull", (), GREY, hull=hull)


def walls(link: int, shape: Shape, scale: float = 1.0) -> list[Shape]:
    """The same cup of five boxes."""
    sizes = ((0.8, 0.8, 0.1), (0.1, 0.8, 0.8), (0.1, 0.8, 0.8), (0.8, 0.1, 0.8), (0.8, 0.1, 0.8))
    middles = ((0.0, 0.0, -0.35), (-0.35, 0.0, 0.0), (0.35, 0.0, 0.0), (0.0, -0.35, 0.0), (0.0, 0.35, 0.0))
    out = []
    for size, middle in zip(sizes, middles, strict=True):
        placement = shape.placement.copy()
        placement[:3, 3] += placement[:3, :3] @ (scale * np.array(middle))
        out.append(Shape(link, placement, "box", tuple(scale * s for s in size), GREY))
    return out


@pytest.mark.parametrize("clearance", [0.0, 0.05])
@pytest.mark.parametrize("other", ["ball", "cup", "box", "cylinder"])
def test_near_contact_the_mesh_decides(other: str, clearance: float) -> None:
    """A cup meets what its five walls meet, not what its hull does; a part inside a wall touches, too."""
    placed, one = frames(), cup(1, 30)
    its = walls(1, one)
    sizes = {"ball": (0.15,), "box": (0.04, 0.04, 0.05), "cylinder": (0.1, 0.3)}
    theirs = [cup(2, 31, 0.25)] if other == "cup" else []
    if other == "cup":
        parts = walls(2, theirs[0], 0.25)
    else:
        kind = "sphere" if other == "ball" else other
        theirs = parts = [Shape(2, turned(np.array([0.2, 0.0, 0.1]), 32), kind, sizes[other], GREY)]
    positions = placed.positions.copy()
    positions[2] += rng(33).uniform(-0.5, 0.5, positions[2].shape)
    placed = replace(placed, positions=positions)
    found = Collider((one, *theirs), np.array([[0, 1]]), clearance, ()).collides(placed)
    pairs = [(i, len(its) + j) for i in range(len(its)) for j in range(len(parts))]
    true = Collider((*its, *parts), np.array(pairs), clearance, ()).collides(placed)
    by_hull = Collider(
        (replace(one, hull=replace(one.hull, surface=None)), *theirs), np.array([[0, 1]]), clearance, ()
    ).collides(placed)
    assert np.array_equal(found, true)
    assert (by_hull & ~true).sum() > 5
    assert true.sum() > 20


def test_what_lies_inside_a_mesh_touches_it() -> None:
    """No surface crosses another where a small part has gone into a casting."""
    import trimesh

    ring = trimesh.creation.annulus(0.2, 1.0, 1.0)
    hull = solid_of(np.asarray(ring.vertices), np.asarray(ring.faces))
    assert hull.surface is not None
    where = np.array([[0.6, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, -0.7, 0.1], [2.0, 0.0, 0.0]])
    assert [hull.surface.holds(point) for point in where] == [True, False, True, False]
    placed = frames()
    positions, rotations = placed.positions.copy(), placed.rotations.copy()
    positions[:], rotations[:] = 0.0, np.eye(3)[None, :, :, None]
    positions[2, :, :4] = where.T
    placed = replace(placed, positions=positions[:, :, :4], rotations=rotations[:, :, :, :4])
    shapes = (
        Shape(1, np.eye(4), "hull", (), GREY, hull=hull),
        Shape(2, np.eye(4), "sphere", (0.05,), GREY),
    )
    assert Collider(shapes, np.array([[0, 1]]), 0.0, ()).collides(placed).tolist() == [True, False, True, False]


def test_a_plane_holds_what_is_below_it() -> None:
    placed, plane = frames(), Shape(0, turned(np.array([0.1, 0.0, -0.2]), 40), "plane", (), GREY)
    positions = placed.positions.copy()
    positions[2] += rng(41).uniform(-1.0, 1.0, positions[2].shape)
    placed = replace(placed, positions=positions)
    part = box((0.3, 0.2, 0.5), 2, np.array([0.1, 0.0, 0.0]))
    corners = np.array(list(product((-0.5, 0.5), repeat=3))) * part.size @ part.placement[:3, :3].T
    height = []
    for corner in corners + part.placement[:3, 3]:
        point = placed.point(2, corner) - plane.placement[:3, 3:]
        height.append(plane.placement[:3, 2] @ point)
    collider = Collider((part, plane), np.array([[0, 1]]), 0.03, ())
    assert np.array_equal(collider.collides(placed), np.min(height, axis=0) < 0.03)
    assert 50 < collider.collides(placed).sum() < COUNT - 50


def test_a_coarser_mesh_keeps_its_place() -> None:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=5)
    vertices, faces = coarser(np.asarray(ball.vertices), np.asarray(ball.faces), 1000)
    assert 400 < len(faces) <= 1000
    assert len({*faces.ravel()}) == len(vertices)
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 1.0, atol=0.05)
    assert coarser(vertices, faces, 1000)[1] is faces
