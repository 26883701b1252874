"""Equations (17) and (18): the equilibrium, its derivative, and the properties that statics must have."""

from __future__ import annotations

import dataclasses
import itertools
import sys

import numpy as np
import pytest
from made_up_effects import BentLoop, Cubic, Hook, Links

from qsframework.elastostatics import (
    Model,
    Site,
    cartesian_compliance,
    cartesian_stiffness,
    equilibrium,
    make_model,
    spring_stiffness,
)
from qsframework.elastostatics.loads import apply_loads
from qsframework.errors import InputError, NotConverged
from qsframework.plugin import Context, Load, Poses, build_effects
from qsframework.robot import Robot, load_robot

TIP = Site(6, np.array([0.15, 0.0, 0.2]))


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("fanuc_m900ib")


@pytest.fixture(scope="module")
def model(robot: Robot) -> Model:
    return make_model(robot.facts, robot.effects, robot.parameters, TIP, [("tip", TIP)], robot.gravity)


def poses(robot: Robot, count: int, seed: int = 0, moment: float = 300.0) -> Poses:
    rng = np.random.default_rng(seed)
    pendant = rng.uniform(robot.controller.lower, robot.controller.upper, (count, 6))
    wrench = rng.normal(size=(count, 6)) * np.array([3e3] * 3 + [moment] * 3)
    return Poses(pendant, robot.controller.to_joints(pendant), wrench)


def pushed(p: Poses, wrench: np.ndarray) -> Poses:
    return Poses(p.pendant, p.q, p.wrench + wrench)


def odd(model: Model) -> Model:
    """The same arm with a curved loop, bar and link springs, a cubic law, and a load that turns with the flange."""
    effects = [e for e in model.effects if e.effect_name() != "parallelogram"]
    extra = [BentLoop(), Links(), Cubic(), Hook()]
    parameters = [*model.parameters, *(p for e in extra for p in e.parameters(model.facts))]
    small = {"cubic": 1e-17, "hook.scale": 0.01, "hook.offset": 0.05, "hook.mass": 20.0}
    parameters = [dataclasses.replace(p, nominal=small.get(p.name, p.nominal)) for p in parameters]
    soft = [dataclasses.replace(p, nominal=2e-8) if p.name.startswith("links") else p for p in parameters]
    return make_model(model.facts, [*effects, *extra], soft, TIP, [("tip", TIP)], model.gravity)


def numeric_compliance(model: Model, p: Poses, h: float = 20.0) -> np.ndarray:
    """Tip twist per unit wrench by fourth-order differences of the equilibrium."""
    rotation = equilibrium(model, p).tip_rotation

    def twist(wrench: np.ndarray) -> np.ndarray:
        e = equilibrium(model, pushed(p, wrench))
        turn = e.tip_rotation @ rotation.transpose(0, 2, 1)
        angle = 0.5 * np.stack(
            [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], 1
        )
        return np.concatenate([e.tip, angle], axis=1)

    columns = []
    for unit in np.eye(6):
        near = twist(h * unit) - twist(-h * unit)
        far = twist(2 * h * unit) - twist(-2 * h * unit)
        columns.append((8 * near - far) / (12 * h))
    return np.stack(columns, axis=2)


@pytest.mark.parametrize("variant", ["robot", "odd"])
def test_compliance_is_the_derivative_of_the_equilibrium(variant: str, robot: Robot, model: Model) -> None:
    """With the whole Hessian to 5e-10; with the compensators' part alone it is off by 1e-5 and more."""
    m, p = (model if variant == "robot" else odd(model)), poses(robot, 30, moment=150.0)
    numeric = numeric_compliance(m, p)
    size = np.abs(numeric).max()
    # what the hook makes of a wrench passes through its own slope first
    rotation = equilibrium(m, p).tip_rotation
    passed = apply_loads(m.of_kind(Load, m.nominal), rotation, Context(m.facts, p)).terms
    slope = passed[0].d_wrench if passed else np.eye(6)
    assert np.abs(cartesian_compliance(m, p) @ slope - numeric).max() < 5e-10 * size
    assert np.abs(cartesian_compliance(m, p, hessian=False) - numeric).max() > 1e-5 * size


def test_stiffness_inverts_the_compliance(robot: Robot, model: Model) -> None:
    p = poses(robot, 20)
    product = cartesian_stiffness(model, p) @ cartesian_compliance(model, p)
    assert np.allclose(product, np.eye(6), atol=1e-7)


def test_stiffness_is_symmetric_without_moments(robot: Robot, model: Model) -> None:
    """A force and gravity have a potential; a moment fixed in the world has none."""
    C = cartesian_compliance(model, poses(robot, 30, moment=0.0))
    assert np.abs(C - C.transpose(0, 2, 1)).max() < 1e-12 * np.abs(C).max()
    C = cartesian_compliance(model, poses(robot, 30, moment=3000.0))
    assert np.abs(C - C.transpose(0, 2, 1)).max() > 1e-6 * np.abs(C).max()


def test_the_balancer_stiffens_joint_2_with_the_pose(robot: Robot, model: Model) -> None:
    """Equation (10): K_theta2 = K2 + (K_c + K_eq) lc l2 eta(q2), all other springs constant."""
    x = model.nominal
    x[model.index(["compensator_stiffness[joint_2].stiffness"])] = 6.9e6
    p = poses(robot, 15)
    K = spring_stiffness(model, p, x)
    b, lc, l2, s0 = p.q[:, 1], 0.235, 1.12, 0.70
    s = np.sqrt(lc**2 + l2**2 - 2 * lc * l2 * np.cos(b))
    eta = np.cos(b) + s0 * lc * l2 / s**3 * np.sin(b) ** 2 - s0 / s * np.cos(b)
    assert np.allclose(K[:, 1, 1], 7.0e6 + (6.9e6 + 1e5) * lc * l2 * eta, rtol=1e-12)
    assert np.allclose(K[:, 0, 0], 6.0e6)
    assert np.allclose(K - np.einsum("nii->ni", K)[:, :, None] * np.eye(6), 0.0)
    x[model.index(["joint_compliance[joint_1]"])] = 0.0
    assert np.isinf(spring_stiffness(model, p, x)[:, 0, 0]).all()


def test_no_load_no_displacement(robot: Robot, model: Model) -> None:
    p = poses(robot, 10)
    nothing = Poses(p.pendant, p.q, np.zeros_like(p.wrench))
    assert np.abs(model.predict(nothing)).max() < 1e-14
    assert np.abs(model.predict(nothing)).max() < 1e-14
    assert np.abs(model.predict(nothing, linear=True)).max() == 0.0


def test_twice_the_load_twice_the_displacement_in_the_linear_model(robot: Robot, model: Model) -> None:
    p = poses(robot, 10)
    twice, once = (model.predict(load, linear=True) for load in (pushed(p, p.wrench), p))
    assert np.allclose(twice, 2 * once, rtol=1e-14, atol=0)


def test_the_linear_model_errs_by_little(robot: Robot, model: Model) -> None:
    """Median 0.2 % of the deflection at 5 kN."""
    p = poses(robot, 60, moment=0.0)
    p = Poses(p.pendant, p.q, p.wrench * (5e3 / np.linalg.norm(p.wrench, axis=1))[:, None])
    full, linear = model.predict(p)[:, 0], model.predict(p, linear=True)[:, 0]
    error = np.linalg.norm(full - linear, axis=1) / np.linalg.norm(full, axis=1)
    assert 0.0005 < np.median(error) < 0.004
    assert np.linalg.norm(full - linear, axis=1).max() < 30e-6


def test_turning_axis_1_turns_everything(robot: Robot, model: Model) -> None:
    p = poses(robot, 8)
    angle = 0.7
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    q, wrench = p.q.copy(), p.wrench.copy()
    q[:, 0] += angle
    wrench = np.concatenate([wrench[:, :3] @ R.T, wrench[:, 3:] @ R.T], axis=1)
    turned = Poses(p.pendant, q, wrench)
    for predict in (model.predict, lambda poses: model.predict(poses, linear=True)):
        assert np.allclose(predict(turned)[:, 0], predict(p)[:, 0] @ R.T, atol=1e-13)


def test_no_energy_is_gained_around_a_closed_path_of_loads(robot: Robot, model: Model) -> None:
    """The work of a force along a closed path in load space vanishes when every law has a potential."""
    p = poses(robot, 3, seed=4, moment=0.0)
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(2, 3)) * 4e3
    nodes, weights = np.polynomial.legendre.leggauss(24)
    corners = [np.zeros(3), a, b, np.zeros(3)]
    work, size = np.zeros(3), np.zeros(3)
    for start, end in itertools.pairwise(corners):
        for node, weight in zip(nodes, weights, strict=True):
            force = start + 0.5 * (node + 1) * (end - start)
            at = Poses(p.pendant, p.q, np.tile(np.append(force, np.zeros(3)), (3, 1)))
            move = model.predict(at)[:, 0]
            step = 0.5 * weight * (move @ (end - start))  # the complementary energy, u . dF
            work += step
            size += np.abs(step)
    assert np.abs(work).max() < 1e-8 * size.max()


def test_a_load_beyond_stability_is_an_error(robot: Robot, model: Model) -> None:
    p = poses(robot, 2)
    with pytest.raises(NotConverged, match="does not settle"):
        equilibrium(model, Poses(p.pendant, p.q, p.wrench * 1e5))


def test_a_rigid_direction_has_no_stiffness(robot: Robot) -> None:
    springs = build_effects({"effect": "joint_compliance", "joints": ["joint_1", "joint_2"]}, robot.facts)
    parameters = [p for p in robot.parameters if "compliance" in p.name]
    stiff = make_model(robot.facts, springs, parameters, TIP, [], robot.gravity)
    p = poses(robot, 3)
    assert np.isfinite(cartesian_compliance(stiff, p)).all()
    with pytest.raises(InputError, match="the tip is rigid"):
        cartesian_stiffness(stiff, p)


def test_chunks_do_not_show(robot: Robot, model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    p = poses(robot, 50)
    whole = model.predict(p)
    monkeypatch.setattr(sys.modules["qsframework.elastostatics.structure"], "CHUNK", 7)
    assert np.allclose(model.predict(p), whole, rtol=1e-9, atol=1e-16)
