"""Meshes of somebody else's robot: drawn or said in words, in little memory and time, and nothing else is opened."""

from __future__ import annotations

import os
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from limited import limited

from qsframework.errors import InputError
from qsframework.robot import load_robot
from qsframework.robot.mesh import LARGEST
from qsframework.viz.meshes import Meshes

SMALL = Path(__file__).parent / "small"
DAE = """<?xml version="1.0" encoding="{code}"?>{doctype}
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><unit meter="1"/>{text}</asset>
<library_geometries/></COLLADA>"""


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    shutil.copytree(SMALL, tmp_path / "robot")
    return tmp_path / "robot"


def with_mesh(robot: Path, name: str, content: bytes | None = None) -> Callable[[], Meshes]:
    """The robot with a mesh of this name; what draws it."""
    visual = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
    urdf = (robot / "small.urdf").read_text()
    (robot / "small.urdf").write_text(urdf.replace('<link name="tip"/>', f'<link name="tip">{visual}</link>'))
    if content is not None:
        (robot / name).write_bytes(content)
    return lambda: Meshes(load_robot(robot))


def dae(doctype: str, text: str, code: str) -> bytes:
    return DAE.format(code=code, doctype=doctype, text=f"<title>{text}</title>").encode(code)


@pytest.mark.parametrize("code", ["utf-8", "utf-16"])
def test_a_mesh_fetches_no_other_file(robot: Path, code: str) -> None:
    """The entity leads to a FIFO: whoever opened it would wait for ever."""
    os.mkfifo(robot.parent / "fifo")
    for doctype in (
        f'<!DOCTYPE a [<!ENTITY x SYSTEM "file://{robot.parent}/fifo">]>',
        f'<!DOCTYPE a SYSTEM "{robot.parent}/fifo">',
    ):
        draw = with_mesh(robot, "part.dae", dae(doctype, "&x;" if "ENTITY" in doctype else "", code))
        assert "cannot be read" in limited(draw, seconds=10.0, megabytes=500)


@pytest.mark.parametrize("code", ["utf-8", "utf-16"])
def test_entities_of_a_mesh_do_not_multiply(robot: Path, code: str) -> None:
    more = "".join(f'<!ENTITY a{k + 1} "&a{k};&a{k};&a{k};&a{k};">' for k in range(30))
    draw = with_mesh(robot, "part.dae", dae(f'<!DOCTYPE a [<!ENTITY a0 "ha">{more}]>', "&a30;", code))
    assert "cannot be read" in limited(draw, seconds=15.0, megabytes=500)


SPOILT = {
    "zeros.stl": b"\0" * 5_000_000,
    "promise.stl": b"\0" * 80 + struct.pack("<I", 2**32 - 1) + b"\0" * 1000,
    "text.stl": b"solid a\n" + b"facet normal 0 0 1\nouter loop\nvertex 0 0\n" * 30_000,
    "nan.obj": b"v nan nan nan\n" * 3 + b"f 1 2 3\n",
    "far.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 999999999\n",
    "material.obj": b"mtllib /etc/passwd\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "bytes.dae": bytes(range(256)) * 100,
    "empty.stl": b"",
}


@pytest.mark.parametrize("name", SPOILT)
def test_a_spoilt_mesh_is_no_fault(robot: Path, name: str) -> None:
    draw = with_mesh(robot, name, SPOILT[name])
    said = limited(draw, seconds=30.0, megabytes=1000)
    assert said == "" if name == "material.obj" else f"mesh '{name}': it cannot be read" in said


def test_a_large_mesh_and_one_from_elsewhere_are_said_and_not_read(robot: Path) -> None:
    (robot / "big.stl").touch()
    os.truncate(robot / "big.stl", 100_000_000)
    assert LARGEST < 100_000_000
    draw = with_mesh(robot, "big.stl")
    assert "100 MB, more than 20" in limited(draw, megabytes=60)
    (robot.parent / "outside.stl").write_bytes(b"solid a")
    (robot / "a").mkdir()
    (robot / "linked.stl").symlink_to(robot.parent / "outside.stl")
    urdf = (robot / "small.urdf").read_text()
    for other in ("linked.stl", "../outside.stl", "/etc/passwd", "package://a/../../outside.stl", "file:///etc/passwd"):
        (robot / "small.urdf").write_text(urdf.replace("big.stl", other))
        with pytest.raises(InputError, match="outside the robot's folder and packages, and is not read"):
            draw()
