"""The files that strangers bring: each becomes a robot whose statics hold, or is refused with advice that fits it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from strangers_chain import COMMANDS, EVERY, chain, new

from qsframework.robot import load_robot
from qsframework.robot.reference import reference_flange

BY_NAME = {s.name: s for s in EVERY}


@pytest.mark.parametrize("name", BY_NAME)
def test_a_strangers_file_becomes_a_robot(name: str, tmp_path: Path) -> None:
    stranger = BY_NAME[name]
    step = new(stranger, tmp_path)
    if step.refusal or stranger.refused:
        assert re.search(stranger.refused or "nothing", step.refusal), step.refusal
        assert not (tmp_path / "arm").exists()
        return
    assert "NO" not in step.output
    robot = load_robot(tmp_path / "arm")
    assert robot.controller.axes == stranger.axes
    assert ("controller: turn J" in step.output) == (name not in WITHOUT_ELBOW)


WITHOUT_ELBOW = (
    *("ur_like", "iiwa_like", "fr_like", "tm_like", "scara", "scara_fixed", "gantry", "g6_like"),
    *("gen3_like", "sawyer_like", "i10_like", "ec_like", "rizon_like"),
)


@pytest.mark.parametrize("name", ["scara_fixed", "palletizer"])
def test_a_strangers_file_goes_all_the_way(name: str, tmp_path: Path) -> None:
    steps = list(chain(BY_NAME[name], tmp_path))
    assert [(s.name, s.refusal) for s in steps] == [(n, "") for n in ("new", *COMMANDS)]


def placed(name: str, folder: Path, pendant: np.ndarray) -> np.ndarray:
    """The flange (4, 4) of a new robot at pendant angles, deg."""
    new(BY_NAME[name], folder)
    robot = load_robot(folder / "arm")
    return reference_flange(robot, robot.controller.to_joints(np.deg2rad(pendant)[None]))[0]


def test_tables_of_yaml_give_the_arm_its_lengths(tmp_path: Path) -> None:
    """Stretched along -x, by hand: 0.61 + 0.57 m out, the wrist's offsets down and aside."""
    new(BY_NAME["ur_like"], tmp_path)
    robot = load_robot(tmp_path / "arm")
    assert np.rad2deg(robot.controller.upper).tolist() == pytest.approx([360, 360, 180, 360, 360, 360])
    place = placed("ur_like", tmp_path / "again", np.zeros(6))
    np.testing.assert_allclose(place[:3, 3], [1.18, 0.29, 0.06], atol=1e-9)


def test_joints_that_follow_stand_where_they_should(tmp_path: Path) -> None:
    """The palletizer's head keeps level whatever axes 2 and 3 do, by 0.1 rad of the mimic and of the origin."""
    for pendant in ([0.0, 20.0, 30.0, 0.0], [0.0, 60.0, 80.0, 0.0]):
        place = placed("palletizer", tmp_path / str(pendant[1]), np.array(pendant))
        np.testing.assert_allclose(place[:3, :3], np.eye(3), atol=1e-9)
        lean, rise = np.deg2rad(pendant[1]), np.deg2rad(pendant[2])
        away = 0.26 + 1.2 * np.sin(lean) + 1.5 * np.cos(rise) + 0.25
        np.testing.assert_allclose(
            place[:3, 3], [away, 0, 0.8 + 1.2 * np.cos(lean) - 1.5 * np.sin(rise) - 0.2], atol=1e-9
        )


def test_meshes_of_a_stranger_are_its_solids(tmp_path: Path) -> None:
    new(BY_NAME["m7_like"], tmp_path)
    robot = load_robot(tmp_path / "arm")
    assert {shape.link for shape in robot.shapes} == set(range(7))
    assert {shape.kind for shape in robot.shapes} == {"hull"}
    assert all(mesh.path is not None for mesh in robot.meshes)
    new(BY_NAME["rs_like"], tmp_path / "rs")
    assert {shape.kind for shape in load_robot(tmp_path / "rs" / "arm").shapes} == {"cylinder"}
