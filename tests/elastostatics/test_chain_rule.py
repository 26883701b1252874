"""Every sensitivity of every stage against finite differences of the prediction."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from made_up_effects import ALL, BentLoop, CrookedTracker, Cubic, Hook, Links, Placements, TwoJointSpring

from qsframework.elastostatics import Model, Site, make_model
from qsframework.plugin import Conditions, Effect, Poses, build_effects, check_effect
from qsframework.plugin.check import sample_robot

ROBOT = sample_robot()
JOINTS = build_effects({"effect": "joint_compliance", "joints": "all"}, ROBOT)
OFFAXIS = build_effects({"effect": "offaxis_compliance", "joint": "joint_3", "axis": "x"}, ROBOT)
PARALLELOGRAM = build_effects(
    {"effect": "parallelogram", "driver": "joint_2", "driven": "joint_3", "lever_m": 0.75}, ROBOT
)
BALANCER = build_effects({"effect": "gravity_compensator", "joint": "joint_2", "lc_m": 0.235, "l2_m": 1.12}, ROBOT)
EQUIVALENT = build_effects({"effect": "compensator_stiffness", "joint": "joint_2", "lc_m": 0.2, "l2_m": 1.1}, ROBOT)
POINTS = build_effects(
    {"effect": "point_spring", "first": "link_1", "second": "link_4", "first_x_m": 0.3, "first_y_m": 0.1,
     "first_z_m": 0.2, "second_x_m": 0.2, "second_y_m": 0.3, "second_z_m": 0.1},
    ROBOT,
)  # fmt: skip
COUPLING = build_effects({"effect": "controller_coupling", "joint": "joint_3"}, ROBOT)
GRAVITY = np.array([0.0, 0.0, -9.81])


def model(effects: Sequence[Effect]) -> Model:
    parameters = [p for e in effects for p in e.parameters(ROBOT)]
    parameters = [
        dataclasses.replace(p, nominal=c)
        for p, c in zip(
            parameters, np.linspace(0.2, 1.5, len(parameters)) * [p.typical for p in parameters], strict=True
        )
    ]
    markers = [("m1", Site(6, np.array([0.15, 0.1, 0.2]))), ("elbow", Site(3, np.array([0.0, 0.2, 0.1])))]
    return make_model(ROBOT, effects, parameters, Site(6, np.array([0.15, 0.0, 0.2])), markers, GRAVITY)


def poses(count: int = 7, seed: int = 0) -> Poses:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.0, 1.0, (count, 6))
    wrench = rng.normal(0.0, 1.0, (count, 6)) * np.array([2e3] * 3 + [3e2] * 3)
    return Poses(q, q, wrench, Conditions(time=np.arange(count) * 10.0), Conditions(time=np.arange(count) * 10.0 + 300))


def scaled_point(effects: Sequence[Effect]) -> np.ndarray:
    """Parameter values at which every term matters and the laws still settle."""
    sizes = {"cubic": 3e-15, "bent_loop": 0.1, "two_joint_spring": 8e5}
    out = []
    for p in model(effects).parameters:
        size = sizes.get(p.name, p.nominal)
        if p.name.startswith(("placements", "hook.scale", "hook.offset", "crooked")):
            size = 0.02
        out.append(size)
    return np.array(out)


def differences(m: Model, p: Poses, x: np.ndarray) -> np.ndarray:
    columns = []
    for k in range(len(x)):
        h = np.zeros_like(x)
        h[k] = 1e-3 * max(abs(x[k]), 1e-3 if x[k] == 0 else abs(x[k]))
        near = m.predict(p, x + h) - m.predict(p, x - h)
        far = m.predict(p, x + 2 * h) - m.predict(p, x - 2 * h)
        columns.append((8 * near - far) / (12 * h[k]))
    return np.stack(columns, axis=-1)


CASES = {
    "joints": [*JOINTS],
    "off-axis": [*JOINTS, *OFFAXIS],
    "parallelogram": [*JOINTS, *PARALLELOGRAM],
    "balancer": [*JOINTS, *PARALLELOGRAM, *BALANCER, *EQUIVALENT],
    "point spring": [*JOINTS, *POINTS],
    "point spring with off-axis springs": [*JOINTS, *OFFAXIS, *POINTS, *BALANCER],
    "point spring with geometry": [*JOINTS, BentLoop(), Links(), *POINTS, Placements()],
    "point spring with laws": [*JOINTS, *PARALLELOGRAM, *POINTS, Cubic(), *COUPLING],
    "coupling": [*JOINTS, *PARALLELOGRAM, *BALANCER, *EQUIVALENT, *COUPLING],
    "bars": [*JOINTS, BentLoop(), Links()],
    "coupled springs": [*JOINTS, BentLoop(), Links(), TwoJointSpring()],
    "placements": [*JOINTS, *BALANCER, Placements()],
    "laws": [*JOINTS, *PARALLELOGRAM, *BALANCER, Cubic()],
    "laws with geometry": [*JOINTS, *BALANCER, BentLoop(), TwoJointSpring(), Placements(), Cubic()],
    "loads": [*JOINTS, Hook(), Placements()],
    "loads with laws": [*JOINTS, *BALANCER, Hook(), Cubic(), Placements()],
    "sensors": [*JOINTS, *OFFAXIS, CrookedTracker(), Placements()],
    "everything": [*JOINTS, *OFFAXIS, *BALANCER, *EQUIVALENT, *POINTS, *COUPLING, *ALL],
}


@pytest.mark.parametrize("case", CASES)
def test_sensitivities_agree_with_differences(case: str) -> None:
    m, p, x = model(CASES[case]), poses(), scaled_point(CASES[case])
    analytic = m.sensitivity(p, x)
    numeric = differences(m, p, x)
    size = np.abs(numeric).max(axis=(0, 1, 2))
    error = np.abs(analytic - numeric).max(axis=(0, 1, 2)) / np.maximum(size, 1e-30)
    mute = {n for n, s in zip(m.names, size, strict=True) if s == 0}
    assert mute == ({"hook.mass"} if case == "loads" else set())  # masses drop out where every law is linear
    assert error.max() < 1e-6, sorted(zip(error, m.names, strict=True))[-4:]


@pytest.mark.parametrize("effect", ALL, ids=lambda e: e.name)
def test_the_made_up_effects_keep_the_protocol(effect: Effect) -> None:
    check_effect(effect)
