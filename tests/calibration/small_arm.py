"""A three-joint arm whose campaigns fit in milliseconds, and its experiment's text."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from qsframework.elastostatics.so3 import exponential
from qsframework.experiment import Experiment, Frame, Plan, Readings, load_experiment, make_plan
from qsframework.plugin import Array, Poses
from tests.identify.arm import position_readings

_JOINTS = (("turn", "base", "column", "0 0 0", "0 0 1"), ("shoulder", "column", "upper", "0.3 0 0.6", "0 1 0"))
_JOINTS += (("elbow", "upper", "fore", "0 0 1.0", "0 1 0"),)
_MASS = (
    '<inertial><origin xyz="0.2 0 0.2"/><mass value="60"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
)
_URDF = (
    "<robot name='small'><link name='base'/><link name='tip'/>"
    + "".join(f"<link name='{child}'>{_MASS}</inertial></link>" for _, _, child, _, _ in _JOINTS)
    + "".join(
        f"<joint name='{name}' type='revolute'><parent link='{parent}'/><child link='{child}'/><origin xyz='{place}'/>"
        f"<axis xyz='{axis}'/><limit lower='-3' upper='3' effort='0' velocity='0'/></joint>"
        for name, parent, child, place, axis in _JOINTS
    )
    + "<joint name='mount' type='fixed'><parent link='fore'/><child link='tip'/><origin xyz='1.1 0 0'/></joint></robot>"
)
_ROBOT = """name: small
title: A small arm
urdf: small.urdf
base: base
flange: tip
controller:
  turn: {limits_deg: [-170, 170]}
  shoulder: {limits_deg: [-90, 90]}
  elbow: {limits_deg: [-120, 120]}
effects:
  - {effect: joint_compliance, joints: all}
nominal: nominal.yaml
payload_kg: 300
limits_tolerance_deg: 0.01
gravity_m/s^2: [0, 0, -9.81]
"""
_NOMINAL = "".join(
    f"joint_compliance[{name}]: {{value_urad/(N m): {value}, sd_percent: 30, source: made up}}\n"
    for (name, *_), value in zip(_JOINTS, (0.5, 0.4, 0.8), strict=True)
)
SPRINGS = tuple(f"joint_compliance[{name}]" for name, *_ in _JOINTS)
_EXPERIMENT = """robot: {robot}
load: {{point_mm: [150, 0, 100]}}
markers:
  m1: {{xyz_mm: [150, 200, 200]}}
  m2: {{xyz_mm: [300, -150, 100]}}
  m3: {{xyz_mm: [100, -150, -200]}}
loads: {loads}
noise: {noise}
{more}
"""
WEIGHT = "[{name: down, fz_N: -2000}]"
LOADS = "[{name: down, fz_N: -2000}, {name: side, fz_N: -1200, fy_N: 900}]"


def small_arm(folder: Path, noise: str = "{sigma_mm: 0.03}", more: str = "", loads: str = LOADS) -> Experiment:
    """The campaign in a folder of its own; noise, loads and further lines as experiment.yaml has them."""
    robot = folder / "arm"
    robot.mkdir(parents=True, exist_ok=True)
    for name, text in (("small.urdf", _URDF), ("robot.yaml", _ROBOT), ("nominal.yaml", _NOMINAL)):
        (robot / name).write_text(text)
    file = folder / "experiment.yaml"
    file.write_text(_EXPERIMENT.format(robot="./arm", loads=loads, noise=noise, more=more))
    return load_experiment(file)


def small_plan(experiment: Experiment, count: int, seed: int = 0, repeats: int = 1) -> Plan:
    """Random poses, each under one of the campaign's loads in turn."""
    controller = experiment.robot.controller
    pendant = np.random.default_rng(seed).uniform(controller.lower, controller.upper, (count, 3)) * 0.7
    cases = [experiment.loads[i % len(experiment.loads)] for i in range(count)]
    poses = Poses(pendant, controller.to_joints(pendant), np.array([case.wrench for case in cases]))
    return make_plan(poses, [case.name for case in cases], repeats=[repeats] * count)


SIGMA = 3e-5
"""sd of a coordinate, m."""
TRACKER = Frame("", exponential(np.array([0.3, -1.2, 2.0])), np.array([1.0, -2.0, 0.5]))


def acting(poses: Poses, k: float, r: Array) -> Poses:
    """The same poses with the load that really acts."""
    halves = poses.wrench.reshape(-1, 2, 3)
    return replace(poses, wrench=((1.0 + k) * (halves + np.cross(r, halves))).reshape(-1, 6))


def positions(arm: Experiment, plan: Plan, load: Array) -> Readings:
    """Each pose unloaded and loaded in the frame of a tracker that nobody knows."""
    poses, model, count = plan.poses, arm.model(), len(plan.pose)
    two = [model.positions(acting(poses, load[0], load[1:]), None, state, True) for state in (False, True)]
    seen = TRACKER.apply(np.stack(two, axis=1).reshape(2 * count, -1, 3))
    names = [f"p{i // 2}" for i in range(2 * count)]
    both = poses.take(np.repeat(np.arange(count), 2))
    return position_readings(both, np.tile([False, True], count), seen, SIGMA, pose=names)
