"""Corners of robot files: limits of expressions, what a copy of a robot needs, effects named by a file, kinematics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qsframework.errors import InputError
from qsframework.experiment import Experiment
from qsframework.robot.corrected import _tree  # pyright: ignore[reportPrivateUsage]
from qsframework.robot.expand import read_tree
from qsframework.robot.kinematics import joint_frames
from qsframework.robot.loader import robot_files
from qsframework.robot.named_files import entry_effects, named_file
from qsframework.robot.packages import Sources
from qsframework.robot.reference import reference_flange, reference_gravity
from qsframework.robot.xacro_math import evaluate

XACRO = '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">{}</robot>'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 + " * 3000 + "1", "the expression is too long"),
        ("_hidden", "the name '_hidden' is not allowed"),
        ("sin", "'sin' is a function; call it"),
        ("a.b", "'b' is not the name of a value"),
        ("[" + "[1, 1, 1, 1, 1, 1, 1, 1, 1, 1]," * 150 + "]", "a list of more than 1000 numbers"),
        ("(-1)**0.5", "not a real number"),
        ("text + text", "the text is too long"),
        ("unknown", "name 'unknown' is not defined"),
    ],
)
def test_an_expression_has_limits(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        evaluate(text, {"a": 3, "sin": np.sin, "text": "x" * 9000})


@pytest.mark.parametrize(
    ("inside", "words"),
    [
        ('<link name="$(env HOME)"/>', "is not allowed; a robot file may use"),
        ('<link name="$(arg size)"/>', "argument 'size' has no default"),
        ('<xacro:include filename="$(find nothing)/a.xacro"/>', r"no folder or package of this name"),
        ('<link name="${1}' + "x" * 200_000 + '"/>', "more than|too long"),
    ],
)
def test_a_xacro_has_limits(tmp_path: Path, inside: str, words: str) -> None:
    (tmp_path / "a.urdf.xacro").write_text(XACRO.format(inside))
    with pytest.raises(InputError, match=words):
        read_tree(tmp_path / "a.urdf.xacro", tmp_path)


def test_arguments_folders_and_packages_of_a_xacro(tmp_path: Path) -> None:
    robot, other = tmp_path / "robot", tmp_path / "other"
    for folder in (robot, other):
        folder.mkdir()
    (other / "b.xacro").write_text(XACRO.format('<link name="from_b"/>'))
    (robot / "a.urdf.xacro").write_text(
        XACRO.format(
            '<xacro:arg name="n" default="x"/><xacro:include filename="$(find other)/b.xacro"/><link name="$(arg n)"/>'
        )
    )
    with pytest.raises(InputError, match="no folder or package of this name"):
        read_tree(robot / "a.urdf.xacro", robot)
    given = Sources(packages={"other": other}, arguments={"n": "mine"})
    assert [node.get("name") for node in read_tree(robot / "a.urdf.xacro", robot, given).all("link")] == [
        "from_b",
        "mine",
    ]
    with pytest.raises(InputError, match="no folder or package of this name"):  # a folder beside one is no package
        read_tree(robot / "a.urdf.xacro", robot, Sources(nearby=True))
    for folder in (robot, other):
        (folder / "package.xml").write_text("<package/>")
    found = read_tree(robot / "a.urdf.xacro", robot, Sources(nearby=True))
    assert [node.get("name") for node in found.all("link")] == ["from_b", "x"]
    assert Sources(nearby=True).find("nowhere_at_all", robot) is None


def test_a_copy_needs_the_meshes_and_licences_of_its_folder(tmp_path: Path) -> None:
    for name in ("a.stl", "inner/b.stl", "LICENSE-meshes"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("solid x")
    mesh = '<link name="l{}"><visual><geometry><mesh filename="{}"/></geometry></visual></link>'
    names = ("a.stl", "package://my_robot/inner/b.stl", "package://inner/b.stl", "missing.stl")
    links = "".join(mesh.format(i, name) for i, name in enumerate(names))
    (tmp_path / "a.urdf").write_text(f'<robot name="a">{links}</robot>')
    (tmp_path / "robot.yaml").write_text("urdf: a.urdf\n")
    found = [str(path) for path in robot_files(tmp_path / "robot.yaml")]
    assert found == ["a.urdf", "a.stl", "inner/b.stl", "LICENSE-meshes"]
    (tmp_path / "a.urdf").write_text(f'<robot name="a">{mesh.format(0, "/etc/passwd")}</robot>')
    with pytest.raises(InputError, match="lies outside the robot's folder"):
        robot_files(tmp_path / "robot.yaml")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (3, "must name a Python file"),
        ("effect.txt", "must name a Python file"),
        ("a" * 300 + ".py", "must name"),
        ("../effect.py", "is outside the folder"),
        ("effect.py", "does not exist in"),
    ],
)
def test_a_file_of_effects_lies_in_the_folder(tmp_path: Path, name: object, words: str) -> None:
    (tmp_path.parent / "effect.py").write_text("raise SystemExit('must not run')")
    with pytest.raises(InputError, match=words):
        named_file({"file": name}, tmp_path)


def test_a_file_of_effects_is_not_run_without_trust(m900ib: Experiment, tmp_path: Path) -> None:
    facts = m900ib.robot.facts
    (tmp_path / "mine.py").write_text("raise SystemExit('must not run')")
    with pytest.raises(InputError, match="trust"):
        entry_effects({"file": "mine.py"}, tmp_path, facts)
    (tmp_path / "mine.py").write_text(
        "from dataclasses import dataclass\nfrom qsframework.plugin import *\n\n\n@dataclass(frozen=True)\n"
        "class Mine(Spring):\n    joint: str = place()\n\n    def parameters(self, robot):\n"
        "        return (Parameter(self.name, 'rad/(N m)', typical=1e-7),)\n\n"
        "    def virtual_joints(self, robot):\n        return (Actuator(self.joint),)\n"
    )
    found = entry_effects({"file": "mine.py", "joint": "joint_2"}, tmp_path, facts, trust=True)
    assert [e.name for e in found] == ["mine[joint_2]"]
    with pytest.raises(InputError, match="effect must be the name"):
        entry_effects({"file": "mine.py", "effect": ["a"]}, tmp_path, facts, trust=True)
    plain = entry_effects({"effect": "joint_compliance", "joint": "joint_2"}, tmp_path, facts)
    assert [e.name for e in plain] == ["joint_compliance[joint_2]"]


def test_a_corrected_urdf_needs_the_robots_file(m900ib: Experiment, tmp_path: Path) -> None:
    from dataclasses import replace

    assert _tree(m900ib.robot).tag == "robot"
    with pytest.raises(InputError, match=r"not named robot\.yaml"):
        _tree(replace(m900ib.robot, folder=tmp_path))


def test_pinocchio_says_the_same(m900ib: Experiment) -> None:
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 6))
    placed = reference_flange(m900ib.robot, q)
    np.testing.assert_allclose(placed[:, 3], np.tile([0.0, 0.0, 0.0, 1.0], (5, 1)))
    frame = m900ib.robot.flange
    point = joint_frames(m900ib.robot.facts, q).point(frame.link, frame.placement[:3, 3])
    np.testing.assert_allclose(placed[:, :3, 3], point.T, atol=1e-12)
    torque = reference_gravity(m900ib.robot, q)
    assert torque.shape == (5, 6)
    np.testing.assert_allclose(torque[:, 0], 0.0, atol=1e-9)  # axis 1 is upright
