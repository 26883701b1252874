"""Absolute positions of one state: against Pinocchio, the full equilibrium, displacements and differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from test_chain_rule import (
    BALANCER,
    CASES,
    EQUIVALENT,
    JOINTS,
    MODELS,
    OFFAXIS,
    PARALLELOGRAM,
    bearable,
    differences,
    model,
    poses,
    scaled_point,
    steps,
)

from qsframework.elastostatics import Model, Site, equilibrium, make_model
from qsframework.plugin import Conditions, Poses, find
from qsframework.robot import Robot, load_robot

STATES = pytest.mark.parametrize("loaded", [False, True], ids=["unloaded", "loaded"])
MARKERS = (np.array([0.15, 0.1, 0.25]), np.array([-0.1, 0.2, 0.3]))


def arm(robot: Robot) -> Model:
    markers = [(f"m{i}", Site(6, xyz)) for i, xyz in enumerate(MARKERS)]
    return make_model(robot.facts, robot.effects, robot.parameters, Site(6, MARKERS[0]), markers, robot.gravity)


def rigid(m: Model) -> np.ndarray:
    """Nothing gives and nothing errs; the balancer's pivots stay where they are."""
    return np.array([p.nominal if p.by_name else 0.0 for p in m.parameters])


def arm_poses(robot: Robot, count: int) -> Poses:
    rng = np.random.default_rng(5)
    pendant = rng.uniform(robot.controller.lower, robot.controller.upper, (count, 6))
    wrench = rng.normal(0.0, 1.0, (count, 6)) * np.array([2e3] * 3 + [300.0] * 3)
    return Poses(pendant, robot.controller.to_joints(pendant), wrench)


@MODELS
def test_a_batch_that_is_known_moves_with_every_parameter_that_moves_the_arm(linear: bool) -> None:
    """The commanded motion is kept for the steps of a fit: back and forth between values, and in both states, it is
    that of a model that has seen nothing."""
    robot = load_robot("fanuc_m900ib")
    more = [
        e for kind in ("joint_offset", "joint_placement", "thermal_expansion") for e in find(kind).places(robot.facts)
    ]
    own = (*robot.parameters, *(p for e in more for p in e.parameters(robot.facts)))

    def fresh() -> Model:
        site = Site(6, MARKERS[0])
        return make_model(robot.facts, [*robot.effects, *more], own, site, [("m", site)], robot.gravity)

    rng = np.random.default_rng(0)
    there = arm_poses(robot, 7)
    warm = [Conditions(temperature=rng.uniform(15.0, 30.0, 7)) for _ in range(2)]
    batch = replace(there, unloaded=warm[0], loaded=warm[1])
    model = fresh()
    x = model.nominal
    stiff, offset, hot, long = x.copy(), x.copy(), x.copy(), x.copy()
    for values, start, by in (
        (stiff, "joint_compliance", 1e-7),
        (offset, "joint_offset", 1e-3),
        (hot, "thermal_expansion", 1e-5),
        (long, "parallelogram", 1e-4),
    ):
        values[[i for i, n in enumerate(model.names) if n.startswith(start)]] += by
    found: list[np.ndarray] = []
    for values in (x, stiff, offset, x, hot, long, offset, x):
        for loaded in (False, True):
            found.append(model.positions(batch, values, loaded, linear))
            np.testing.assert_array_equal(found[-1], fresh().positions(batch, values, loaded, linear))
            assert np.isfinite(found[-1]).all()
    changed = {i: np.abs(found[i] - found[i % 2]).max() for i in range(2, len(found))}
    assert all((changed[i] > 1e-6) == (i // 2 not in (3, 7)) for i in changed), changed


@MODELS
@STATES
@pytest.mark.parametrize("name", ["fanuc_m900ib", "ur10"])
def test_a_rigid_arm_stands_where_pinocchio_puts_it(name: str, loaded: bool, linear: bool) -> None:
    """No compliance, no bar errors, no offsets: both states are plain forward kinematics."""
    robot = load_robot(name)
    m, batch = arm(robot), arm_poses(robot, 50)
    found = m.positions(batch, rigid(m), loaded, linear)
    data = robot.model.createData()
    for i, q in enumerate(batch.q):
        pin.forwardKinematics(robot.model, data, q)
        plain = np.stack([data.oMi[6].act(xyz) for xyz in MARKERS])
        assert np.abs(found[i] - plain).max() < 1e-12


@STATES
def test_a_soft_arm_sags_by_compliance_times_the_torque_of_its_masses(loaded: bool) -> None:
    """UR10, serial, the linear model: FK + J diag(c) (J' w - g(q)) with Pinocchio's Jacobian and gravity."""
    robot = load_robot("ur10")
    m, batch = arm(robot), arm_poses(robot, 30)
    c = np.array([2.0, 3.0, 5.0, 20.0, 25.0, 30.0]) * 1e-5
    x = m.nominal
    x[m.index([f"joint_compliance[{j}]" for j in robot.facts.joints])] = c
    found = m.positions(batch, x, loaded, linear=True)
    data = robot.model.createData()
    for i, q in enumerate(batch.q):
        pin.computeJointJacobians(robot.model, data, q)
        J = pin.getJointJacobian(robot.model, data, 6, pin.LOCAL_WORLD_ALIGNED)
        torque = -pin.computeGeneralizedGravity(robot.model, data, q)
        frame = data.oMi[6]
        columns = [J[:3] + np.cross(J[3:].T, frame.rotation @ xyz).T for xyz in MARKERS]
        if loaded:
            torque = torque + columns[0].T @ batch.wrench[i, :3] + J[3:].T @ batch.wrench[i, 3:]
        for k, xyz in enumerate(MARKERS):
            assert np.abs(found[i, k] - frame.act(xyz) - columns[k] @ (c * torque)).max() < 1e-12


@STATES
def test_small_deflections_agree_with_the_full_equilibrium(loaded: bool) -> None:
    """The linear model, within 1 % of the deflection: what is left is of second order in it."""
    m = model([*JOINTS, *OFFAXIS, *PARALLELOGRAM, *BALANCER, *EQUIVALENT])
    p, x = poses(40), m.nominal
    stiff = m.positions(p, rigid(m), loaded)
    linear, full = m.positions(p, x, loaded, linear=True), equilibrium(m, p, x, loaded).markers
    bend = np.linalg.norm(full - stiff, axis=2)
    assert np.median(bend) > 1e-4, "there is something to agree on"
    error = np.linalg.norm(linear - full, axis=2).max(axis=1) / bend.max(axis=1)
    assert np.median(error) < 0.002
    assert error.max() < 0.01
    small = x.copy()
    soft = [i for i, name in enumerate(m.names) if name.startswith(("joint_comp", "offaxis_comp"))]
    small[soft] *= 0.1
    less = np.linalg.norm(m.positions(p, small, loaded, linear=True) - equilibrium(m, p, small, loaded).markers, axis=2)
    more = np.linalg.norm(linear - full, axis=2)
    assert np.median(more / less) > 50.0, "ten times stiffer leaves a hundredth: second order"


def still(p: Poses) -> Poses:
    """The same poses, all read at one time in both states."""
    return replace(p, unloaded=replace(p.loaded, time=p.unloaded.time))


@MODELS
@pytest.mark.parametrize("case", [c for c in CASES if c != "sensors"])
def test_loaded_minus_unloaded_is_the_displacement(case: str, linear: bool) -> None:
    """With the same arm in both states; a marker offset under linear laws alone differs in second order.

    The loaded state settles from the unloaded one, or from rest: to 1e-10 of some millimetres.
    """
    m, x = model(CASES[case]), bearable(case, linear)
    p = still(poses())
    moved = m.positions(p, x, True, linear) - m.positions(p, x, False, linear)
    assert np.abs(moved).max() > 1e-5
    assert np.abs(moved - m.predict(p, x, linear)).max() < (1e-12 if linear else 3e-12)
    after, before = (m.position_sensitivity(p, x, loaded=loaded, linear=linear) for loaded in (True, False))
    slope, plain = after - before, m.sensitivity(p, x, linear=linear)
    size = np.abs(before).max(axis=(0, 1, 2)) + np.abs(plain).max(axis=(0, 1, 2))
    error = np.abs(slope - plain).max(axis=(0, 1, 2))
    assert (error / np.maximum(size, 1e-30)).max() < 1e-9, sorted(zip(error / size, m.names, strict=True))[-4:]


def otherwise(c: Conditions) -> Conditions:
    """Later, warmer, from the other side."""
    assert c.time is not None
    assert c.temperature is not None
    assert c.approach is not None
    return Conditions(c.time + 1e5, c.temperature + 20.0, -c.approach)


@MODELS
@STATES
@pytest.mark.parametrize("case", CASES)
def test_sensitivities_agree_with_differences(case: str, loaded: bool, linear: bool) -> None:
    """On a tilted base, so that gravity loads joint 1 as well."""
    m, x = replace(model(CASES[case]), gravity=np.array([3.0, -2.0, -9.0])), bearable(case, linear)
    p = replace(poses(), unloaded=otherwise(poses().unloaded))
    analytic = m.position_sensitivity(p, x, loaded=loaded, linear=linear)
    numeric = differences(lambda at: m.positions(p, at, loaded, linear), x, analytic)
    size = np.abs(numeric).max(axis=(0, 1, 2))
    rounding = 6e-15 / steps(x)  # of positions of metres
    error = np.maximum(np.abs(analytic - numeric).max(axis=(0, 1, 2)) - rounding, 0.0) / np.maximum(size, 1e-30)
    assert np.median(rounding / np.maximum(size, 1e-30)) < 1e-6, "the differences themselves are good enough"
    unloaded = (
        "load_scale",
        "load_direction",
        "load_point_offset",
        "hook.scale",
        "hook.offset",
        "flange_compliance[rz]",
    )  # the last link's centre is on its z axis
    mute = {n for n, s in zip(m.names, size, strict=True) if s == 0}
    assert mute == (set() if loaded else {n for n in m.names if n.startswith(unloaded)})
    assert error.max() < 1e-6, sorted(zip(error, m.names, strict=True))[-4:]


def test_each_state_is_read_under_its_own_conditions() -> None:
    """A warm arm is longer, a late reading has drifted, a balancer's friction remembers its side."""
    m = model(CASES["all built-in effects"])
    x, p = scaled_point(CASES["all built-in effects"]), poses()
    other = otherwise(p.loaded)
    for field in ("time", "temperature", "approach"):
        changed = replace(p.loaded, **{field: getattr(other, field)})
        assert np.abs(m.positions(replace(p, loaded=changed), x, True) - m.positions(p, x, True)).max() > 1e-6
        assert np.array_equal(m.positions(replace(p, loaded=changed), x, False), m.positions(p, x, False))
        there = replace(p, unloaded=changed, loaded=p.unloaded)
        assert np.array_equal(m.positions(there, x, False), m.positions(replace(p, unloaded=changed), x, False))


@MODELS
@STATES
def test_names_choose_columns_and_batches_are_seamless(loaded: bool, linear: bool) -> None:
    m = model(CASES["balancer"])
    p, x = poses(4100), scaled_point(CASES["balancer"])
    names = [m.names[3], m.names[0]]
    chosen = m.position_sensitivity(p, x, names, loaded, linear)
    part = p.take(slice(4090, 4100))
    assert chosen.shape == (4100, 2, 3, 2)
    alone = m.position_sensitivity(part, x, loaded=loaded, linear=linear)[..., [3, 0]]
    assert np.allclose(chosen[4090:], alone, rtol=1e-12, atol=0)
    whole = m.positions(p, x, loaded, linear)[4090:]
    assert np.allclose(whole, m.positions(part, x, loaded, linear), rtol=0, atol=1e-14)
