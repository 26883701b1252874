"""Every sensitivity of every stage against finite differences of the prediction."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

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
    {
        "effect": "point_spring",
        "first": "link_1",
        "second": "link_4",
        "first_x_m": 0.3,
        "first_y_m": 0.1,
        "first_z_m": 0.2,
        "second_x_m": 0.2,
        "second_y_m": 0.3,
        "second_z_m": 0.1,
    },
    ROBOT,
)
GAS = build_effects(
    {
        "effect": "gas_balancer",
        "joint": "joint_2",
        "lc_m": 0.235,
        "l2_m": 1.12,
        "length_m": 0.9,
        "pressure_bar": 1e4,
        "volume_l": 12,
        "piston_area_cm^2": 60,
        "rod_area_cm^2": 12,
        "exponent": 1.2,
    },
    ROBOT,
)
COUPLING = build_effects({"effect": "controller_coupling", "joint": "joint_3"}, ROBOT)
GRAVITY = np.array([0.0, 0.0, -9.81])


def model(effects: Sequence[Effect]) -> Model:
    parameters = [p for e in effects for p in e.parameters(ROBOT)]
    sizes = np.linspace(0.2, 1.5, len(parameters)) * [p.typical for p in parameters]
    parameters = [
        dataclasses.replace(p, nominal=p.nominal + c if p.by_name or p.unit == "Pa" else c)
        for p, c in zip(parameters, sizes, strict=True)
    ]
    markers = [("m1", Site(6, np.array([0.15, 0.1, 0.2]))), ("elbow", Site(3, np.array([0.0, 0.2, 0.1])))]
    return make_model(ROBOT, effects, parameters, Site(6, np.array([0.15, 0.0, 0.2])), markers, GRAVITY)


def poses(count: int = 7, seed: int = 0) -> Poses:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.0, 1.0, (count, 6))
    wrench = rng.normal(0.0, 1.0, (count, 6)) * np.array([2e3] * 3 + [3e2] * 3)
    time, warm = np.arange(count) * 10.0, 293.0 + rng.uniform(-5, 10, count)
    side = rng.choice([-1.0, 1.0], count)
    return Poses(q, q, wrench, Conditions(time, warm, side), Conditions(time + 300, warm, side))


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


def steps(x: np.ndarray) -> np.ndarray:
    return 1e-3 * np.where(x == 0, 1e-3, np.abs(x))


def differences(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, analytic: np.ndarray) -> np.ndarray:
    """Of two values each; of four where what is expected is not that, ten times as near as it has to be."""
    columns = []
    for k in range(len(x)):
        h = np.zeros_like(x)
        h[k] = steps(x)[k]
        near = f(x + h) - f(x - h)
        column = near / (2 * h[k])
        if np.abs(column - analytic[..., k]).max() > 1e-7 * np.abs(column).max() + 3e-15 / h[k]:
            far = f(x + 2 * h) - f(x - 2 * h)
            column = (8 * near - far) / (12 * h[k])
        columns.append(column)
    return np.stack(columns, axis=-1)


BUILT_IN = [
    effect
    for entry in (
        {"effect": "link_compliance", "link": "link_3", "directions": ["rx", "z"]},
        {"effect": "base_compliance", "directions": ["ry", "x"]},
        {"effect": "flange_compliance", "directions": ["y", "rz"]},
        {"effect": "bar_compliance", "driven": "joint_3"},
        {"effect": "joint_hardening", "joint": "joint_2"},
        {"effect": "joint_hardening", "joint": "joint_3", "knee_Nm": 3000},
        {"effect": "joint_backlash", "joint": "joint_5", "width_Nm": 500},
        {"effect": "load_scale"},
        {"effect": "load_direction"},
        {"effect": "load_point_offset"},
        {"effect": "link_mass", "link": "link_3"},
        {"effect": "counterweight", "link": "link_2", "x_m": 0.1, "y_m": 0.0, "z_m": -0.5},
        {"effect": "marker_offset", "marker": "m1"},
        {"effect": "tracker_frame"},
        {"effect": "tracker_scale"},
        {"effect": "tracker_drift"},
        {"effect": "joint_offset", "joint": "joint_2"},
        {"effect": "joint_placement", "joint": "joint_4"},
        {"effect": "encoder_eccentricity", "joint": "joint_3"},
        {"effect": "thermal_expansion"},
        {"effect": "gravity_sag", "joint": "joint_2", "last": "link_4"},
        {
            "effect": "compensator_friction",
            "joint": "joint_2",
            "lc_m": 0.235,
            "l2_m": 1.12,
            "spring_stiffness_N/m": 1e5,
            "free_length_m": 0.7,
        },
    )
    for effect in build_effects(entry, ROBOT, ("m1", "elbow"))
]

CASES = {
    "all built-in effects": [*JOINTS, *OFFAXIS, *PARALLELOGRAM, *BALANCER, *EQUIVALENT, *POINTS, *COUPLING, *BUILT_IN],
    "joints": [*JOINTS],
    "off-axis": [*JOINTS, *OFFAXIS],
    "parallelogram": [*JOINTS, *PARALLELOGRAM],
    "balancer": [*JOINTS, *PARALLELOGRAM, *BALANCER, *EQUIVALENT],
    "point spring": [*JOINTS, *POINTS],
    "point spring with off-axis springs": [*JOINTS, *OFFAXIS, *POINTS, *BALANCER],
    "point spring with geometry": [*JOINTS, BentLoop(), Links(), *POINTS, Placements()],
    "point spring with laws": [*JOINTS, *PARALLELOGRAM, *POINTS, Cubic(), *COUPLING],
    "gas balancer": [*JOINTS, *PARALLELOGRAM, *GAS],
    "gas balancer with geometry and laws": [*JOINTS, *GAS, BentLoop(), Placements(), Cubic()],
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


MODELS = pytest.mark.parametrize("linear", [True, False], ids=["linear", "settled"])


def bearable(case: str, linear: bool) -> np.ndarray:
    """Parameter values of a case, at which each of its poses settles."""
    x = scaled_point(CASES[case])
    if case == "gas balancer with geometry and laws" and not linear:
        x[model(CASES[case]).index(["gas_balancer[joint_2].pressure"])] *= 0.03
    return x


@MODELS
@pytest.mark.parametrize("case", CASES)
def test_sensitivities_agree_with_differences(case: str, linear: bool) -> None:
    m, p, x = model(CASES[case]), poses(), bearable(case, linear)
    analytic = m.sensitivity(p, x, linear=linear)
    numeric = differences(lambda at: m.predict(p, at, linear), x, analytic)
    size = np.abs(numeric).max(axis=(0, 1, 2))
    # a reading through sensors is a difference of positions of metres, which has 4e-16 m of rounding each; what is
    # settled went there in steps that have it too
    rounding = (3e-15 if linear else 6e-15) / steps(x)
    error = np.maximum(np.abs(analytic - numeric).max(axis=(0, 1, 2)) - rounding, 0.0) / np.maximum(size, 1e-30)
    assert np.median(rounding / np.maximum(size, 1e-30)) < 1e-6, "the differences themselves are good enough"
    mute = {n for n, s in zip(m.names, size, strict=True) if s == 0}
    # masses drop out where everything is linear
    assert mute == ({"hook.mass"} if case == "loads" and linear else set())
    assert error.max() < 1e-6, sorted(zip(error, m.names, strict=True))[-4:]


@pytest.mark.parametrize("effect", ALL, ids=lambda e: e.name)
def test_the_made_up_effects_keep_the_protocol(effect: Effect) -> None:
    check_effect(effect)
