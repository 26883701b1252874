"""Meshes of a URDF: drawn where their file is the robot's own and not too large, otherwise said and done without."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from chromium import Browser
from headless import browser

from qsframework.errors import InputError
from qsframework.robot import load_robot, mesh
from qsframework.robot.search import find_robot
from qsframework.viz import Scene, meshes, show_scene
from qsframework.viz.subject import one_pose, robot_alone

DRUM = '<xacro:drum xyz="0 0 0.019" radius="0.095" length="0.038" colour="dark"/>'
SIZE = np.array([400.0, 300.0, 200.0])
"""Of the box in the files, in millimetres."""


def with_mesh(folder: Path, name: str, content: bytes | None, scale: str = "0.001 0.001 0.001") -> Path:
    """The UR10 with a red mesh of this name, instead of a cylinder, as the visual of its base."""
    robot = folder / "robot"
    shutil.copytree(find_robot("ur10").parent, robot)
    urdf = robot / "ur10.urdf.xacro"
    mesh = (
        f'<visual><origin xyz="0 0 0.1" rpy="0 0 0"/><geometry><mesh filename="{name}" scale="{scale}"/></geometry>'
        '<material name="red"><color rgba="0.9 0.1 0.1 1"/></material></visual>'
    )
    text = urdf.read_text()
    assert DRUM in text
    urdf.write_text(text.replace(DRUM, mesh))
    if content is not None:
        file = robot / name.rpartition("//")[2].removeprefix("arm/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    return robot


def box(kind: str) -> bytes:
    import trimesh

    made = trimesh.creation.box(extents=SIZE).export(file_type=kind)
    return made.encode() if isinstance(made, str) else made


def scene_of(folder: Path) -> Scene:
    experiment = robot_alone(load_robot(folder), np.zeros(3))
    return show_scene(experiment, one_pose(experiment, None, None))


def drawn(scene: Scene) -> list[str]:
    return [path for path in scene.drawn if "mesh_" in path]


@pytest.mark.parametrize("kind", ["stl", "obj", "dae"])
def test_a_mesh_of_the_robots_folder_is_drawn(kind: str, tmp_path: Path) -> None:
    robot = with_mesh(tmp_path, f"meshes/base.{kind}", box(kind))
    (shape,) = load_robot(robot).meshes
    assert shape.link == 0
    assert np.allclose(shape.placement[:3, 3], [0, 0, 0.1])
    scene = scene_of(robot)
    assert drawn(scene) == ["poses/0/robot/link_0/mesh_0"]
    assert not [note for note in scene.notes if "esh" in note]
    found = meshes.Meshes(load_robot(robot))
    ((_, (vertices, faces)),) = found.drawn
    assert len(faces) == 12
    assert np.allclose(np.ptp(vertices * shape.scale, axis=0), 1e-3 * SIZE)
    assert shape.rgba == (0.9, 0.1, 0.1, 1.0)


def test_a_package_is_the_robots_own_folder(tmp_path: Path) -> None:
    robot = with_mesh(tmp_path, "package://arm/base.stl", box("stl"))
    assert len(drawn(scene_of(robot))) == 1


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("../base.stl", b"solid", "outside the robot's folder"),
        ("/etc/hostname", None, "outside the robot's folder"),
        ("base.stl", b"this is no mesh", "cannot be read"),
        ("base.dae", b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "b">]><COLLADA/>', "cannot be read"),
        ("base.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "cannot be read"),
    ],
)
def test_bad_ones_are_refused_with_the_line(name: str, content: bytes | None, why: str, tmp_path: Path) -> None:
    robot = with_mesh(tmp_path, name, content)
    with pytest.raises(InputError, match=f"{name}.*{why}") as refused:
        load_robot(robot)
    (problem,) = refused.value.problems
    assert problem.line is not None
    assert name in (robot / "ur10.urdf.xacro").read_text().splitlines()[problem.line - 1]


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("package://elsewhere/base.stl", None, "its file is not in the robot's folder"),
        ("base.ply", b"ply", "only .stl, .obj, .dae are read"),
    ],
)
def test_others_are_said_and_done_without(name: str, content: bytes | None, why: str, tmp_path: Path) -> None:
    scene = scene_of(with_mesh(tmp_path, name, content))
    assert drawn(scene) == []
    assert any(name in note and why in note for note in scene.notes), scene.notes
    assert "poses/0/robot/link_0/bone" in scene.drawn  # no link is invisible


def test_a_large_file_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh, "LARGEST", 100)
    with pytest.raises(InputError, match="MB, more than"):
        load_robot(with_mesh(tmp_path, "base.stl", box("stl")))


def test_too_many_triangles_are_not_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load_robot(with_mesh(tmp_path, "base.stl", box("stl")))
    monkeypatch.setattr(meshes, "MOST", 12)
    assert len(meshes.Meshes(robot).drawn) == 1
    monkeypatch.setattr(meshes, "MOST", 11)
    over = meshes.Meshes(robot)
    assert over.drawn == []
    assert "ur10 has 12 triangles, more than 11" in over.notes[0]


def test_fine_meshes_are_drawn_coarser(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=5, radius=200.0)
    robot = load_robot(with_mesh(tmp_path, "base.stl", ball.export(file_type="stl")))
    monkeypatch.setattr(meshes, "MOST", 1333)
    ((_, (vertices, faces)),) = (few := meshes.Meshes(robot)).drawn
    assert 600 < len(faces) <= 1333
    assert np.allclose(np.linalg.norm(vertices, axis=1), 200.0, rtol=0.1)
    assert "20480 triangles" in few.notes[0]


@browser
def test_the_mesh_is_to_be_seen(tmp_path: Path) -> None:
    from test_browser import PIXELS, answer

    (tmp_path / "page.html").write_text(scene_of(with_mesh(tmp_path, "base.stl", box("stl"))).html())
    script = """
    const red = () => {
      const [pixels] = read();
      let count = 0;
      for (let i = 0; i < pixels.length; i += 4)
        if (pixels[i] - pixels[i + 1] > 60 && pixels[i] - pixels[i + 2] > 60) count += 1;
      return count;
    };
    found.push(red());
    find("poses/0/robot/link_0/mesh_0").visible = false;
    found.push(red());
    """
    with Browser(tmp_path / "profile", "about:blank", own="file://") as chromium:
        chromium.size(800, 600)
        with_it, without = answer(tmp_path / "page.html", PIXELS + script, chromium)
    assert with_it > without + 1500
