"""A small arm in tmp_path that tests spoil: two joints, one fixed flange, plain URDF."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from qsframework.errors import InputError, Problem
from qsframework.robot import load_robot

URDF = """<?xml version="1.0"?>
<robot name="small">
  <link name="base"/>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 0.5"/>
      <mass value="10"/>
      <inertia ixx="1" iyy="1.5" izz="0.8" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual><geometry><box size="0.1 0.2 1.0"/></geometry></visual>
  </link>
  <link name="fore">
    <inertial>
      <origin xyz="0.4 0 0"/>
      <mass value="5"/>
      <inertia ixx="0.2" iyy="0.6" izz="0.6" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <link name="tip"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0 0 0.5"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="0" velocity="0"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/>
    <child link="fore"/>
    <origin xyz="0 0 1.0"/>
    <axis xyz="0 -1 0"/>
    <limit lower="-3" upper="3" effort="0" velocity="0"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="fore"/>
    <child link="tip"/>
    <origin xyz="0.8 0 0"/>
  </joint>
</robot>
"""

ROBOT = """name: small
title: A small arm
urdf: small.urdf
base: base
flange: tip
controller:
  shoulder: {limits_deg: [-90, 90]}
  elbow: {equals: J2 + J1, limits_deg: [-120, 30]}
effects:
  - {effect: joint_compliance, joints: all}
nominal: nominal.yaml
"""

NOMINAL = """joint_compliance[shoulder]:
  value_urad/(N m): 0.2
  sd_percent: 30
  source: made up
joint_compliance[elbow]:
  value_rad/(N m): 3.0e-7
  sd_urad/(N m): 0.1
"""


class Small:
    """The folder of the small arm; `edit` replaces text in one of its files."""

    def __init__(self, folder: Path):
        self.folder = folder
        folder.mkdir()
        self.write("small.urdf", URDF)
        self.write("robot.yaml", ROBOT)
        self.write("nominal.yaml", NOMINAL)

    def write(self, name: str, text: str) -> None:
        (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (self.folder / name).write_text(text, encoding="utf-8")

    def edit(self, name: str, *changes: tuple[str, str]) -> None:
        text = (self.folder / name).read_text(encoding="utf-8")
        for old, new in changes:
            assert old in text, f"{old!r} is not in {name}"
            text = text.replace(old, new, 1)
        self.write(name, text)

    def line(self, name: str, text: str) -> int:
        """The first line of a file that holds the text."""
        lines = (self.folder / name).read_text(encoding="utf-8").splitlines()
        return next(k for k, line in enumerate(lines, start=1) if text in line)

    def load(self):
        return load_robot(self.folder)

    def problems(self) -> tuple[Problem, ...]:
        with pytest.raises(InputError) as caught:
            self.load()
        return caught.value.problems

    def problem(self) -> Problem:
        """The one problem of the folder."""
        problems = self.problems()
        assert len(problems) == 1, "\n".join(map(str, problems))
        return problems[0]


@pytest.fixture
def small(tmp_path: Path) -> Small:
    return Small(tmp_path / "small")


@pytest.fixture
def told() -> Callable[..., None]:
    """Check a problem's file, line and words."""

    def check(problem: Problem, file: str, line: int | None, *words: str) -> None:
        assert problem.file is not None
        assert problem.file.endswith(file), problem
        assert problem.line == line, problem
        for word in words:
            assert word in str(problem), problem

    return check
