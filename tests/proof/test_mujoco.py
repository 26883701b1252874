"""The full equilibrium against MuJoCo, where the parallelogram is closed by a constraint."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path

import mujoco_m900ib as mj
import numpy as np
import pytest

from qsframework.elastostatics import Model, Site, equilibrium, make_model
from qsframework.plugin import Poses, build_effects
from qsframework.robot import Robot, load_robot

PAIRS = 40
MACHINES = Path(__file__).parents[1] / "robots" / "machines"
FORCE = 5e3
POINT = np.array([0.15, 0.0, 0.2])


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("fanuc_m900ib")


ROD, M1, TIE = 60.0, 200.0, mj.Rod(40.0, (0.0, 0.0, 0.56))
LOADED_LEVER = mj.Rod(ROD + M1, ((-ROD * 0.375 - M1 * 0.95) / (ROD + M1), 0.0, 0.0))
"""Lever with m1, and bar, as the shipped robot has them; m2 is in link 3's mass there as here."""


def model(robot: Robot, bar_compliance: float = 0.0) -> Model:
    effects = list(robot.effects)
    parameters = list(robot.parameters)
    if bar_compliance:
        (bar,) = build_effects({"effect": "bar_compliance", "driven": "joint_3"}, robot.facts)
        effects.append(bar)
        parameters += [dataclasses.replace(p, nominal=bar_compliance) for p in bar.parameters(robot.facts)]
    return make_model(robot.facts, effects, parameters, Site(6, POINT), [("tip", Site(6, POINT))], robot.gravity)


def pair(robot: Robot, rng: np.random.Generator, from_flat: float | None = None) -> Poses:
    """A random pose and a force of 5 kN; `from_flat` (rad) sets the angle between link 2 and the lever."""
    controller = robot.controller
    while True:
        pendant = rng.uniform(controller.lower, controller.upper)
        if from_flat is not None:
            pendant[2] = np.pi / 2 - from_flat - pendant[1]  # flat where J2 + J3 = 90 deg
        if not controller.outside(pendant).any():
            break
    force = rng.normal(size=3)
    wrench = np.append(FORCE * force / np.linalg.norm(force), np.zeros(3))
    return Poses(pendant[None], controller.to_joints(pendant[None]), wrench[None])


def test_a_really_closed_loop_gives_the_same_displacement(robot: Robot) -> None:
    """40 pose-load pairs above 15 deg of transmission angle, gravity on: within 1 um of 1 to 9 mm.

    The linear model is farther off than that, so the comparison tells the two apart.
    """
    rng, m = np.random.default_rng(5), model(robot)
    full, linear = [], []
    while len(full) < PAIRS:
        p = pair(robot, rng)
        if m.transmission_margin(p)[0] < 0:
            continue
        truth = mj.displacement(p.q[0], p.wrench[0, :3], POINT, lever=LOADED_LEVER, bar=TIE)
        full.append(np.linalg.norm(m.predict(p)[0, 0] - truth))
        linear.append(np.linalg.norm(m.predict(p, linear=True)[0, 0] - truth))
    assert max(full) < 1e-6
    assert np.median(full) < 0.1e-6
    assert np.median(linear) > 1e-6


@pytest.mark.parametrize("degrees", [3.0, 5.0, 8.0, 12.0])
def test_close_to_flat_the_bar_takes_over_and_the_model_follows(robot: Robot, degrees: float) -> None:
    """With the bar's spring in both they agree; without it the model misses most of the bar's part.

    The bar is the stiffer the flatter the loop, because its force grows as 1 / sin: a soft bar would
    let the loop snap through.
    """
    rng = np.random.default_rng(int(degrees))
    stiffness = 3e7 * (np.sin(np.deg2rad(10.0)) / np.sin(np.deg2rad(degrees))) ** 2
    stiff, soft = model(robot), model(robot, 1 / stiffness)
    for _ in range(4):
        p = pair(robot, rng, np.deg2rad(degrees))
        truth = mj.displacement(p.q[0], p.wrench[0, :3], POINT, stiffness, LOADED_LEVER, TIE)
        size = np.linalg.norm(truth)
        followed = np.linalg.norm(soft.predict(p)[0, 0] - truth)
        ignored = np.linalg.norm(stiff.predict(p)[0, 0] - truth)
        assert followed < 2e-3 * size + 1e-6
        assert ignored > 5 * followed


def test_the_bar_s_share_grows_as_the_loop_flattens(robot: Robot) -> None:
    """The same pose at 40, 20, 10 and 5 deg: the bar's part of the vertical sag grows like 1 / sin^2."""
    shares = []
    for degrees in (40.0, 20.0, 10.0, 5.0):
        pendant = np.deg2rad([0.0, 60.0, 30.0 - degrees, 0.0, 40.0, 0.0])
        q = robot.controller.to_joints(pendant[None])[0]
        force = np.array([0.0, 0.0, -FORCE])
        sag = [mj.displacement(q, force, POINT, bar)[2] for bar in (2e7, None)]
        shares.append((sag[0] - sag[1]) / sag[1])
    assert all(b > a for a, b in itertools.pairwise(shares))
    assert shares[-1] > 10 * shares[0]


LEVER, BAR = mj.Rod(780.0, ((-180 * 0.3 - 600 * 1.1) / 780, 0.0, 0.0)), mj.Rod(90.0, (0.0, 0.0, 0.5))
"""As the machine `counterweight_arm` has them, the mass on the lever included."""


@pytest.fixture(scope="module")
def heavy() -> Robot:
    return load_robot(MACHINES / "counterweight_arm")


def massive(robot: Robot, rods: float = 1.0, bar_compliance: float = 0.0, bar: float = 90.0) -> Model:
    """The machine with MuJoCo's stiffnesses, its balancer's housing weightless; rods: a factor of all on the lever."""
    weights = {"housing": 0.0, "lever": 180.0 * rods, "bar": bar * rods}
    branches = tuple(dataclasses.replace(b, mass=weights[b.link]) for b in robot.facts.branches)
    facts = dataclasses.replace(robot.facts, branches=branches)
    effects = (*robot.effects, *build_effects({"effect": "bar_compliance", "driven": "joint_3"}, facts))
    values = {f"joint_compliance[joint_{k + 1}]": 1 / K for k, K in enumerate(mj.STIFFNESS)}
    values |= {"bar_compliance[joint_3]": bar_compliance, "counterweight[lever]": 600.0 * rods}
    every = {p.name: p for e in effects for p in e.parameters(facts)} | {p.name: p for p in robot.parameters}
    parameters = [dataclasses.replace(p, nominal=values.get(name, p.nominal)) for name, p in every.items()]
    return make_model(facts, effects, parameters, Site(6, POINT), [("tip", Site(6, POINT))], robot.gravity)


def test_massive_bars_and_a_lever_counterweight_give_the_same_displacement(heavy: Robot) -> None:
    """Within 1 um, and so does the sag by their weight, which is a hundred times that."""
    rng, m, light = np.random.default_rng(6), massive(heavy), massive(heavy, 0.0)
    sags: list[float] = []
    while len(sags) < 8:
        p = pair(heavy, rng)
        if m.transmission_margin(p)[0] < 0:
            continue
        truth = mj.displacement(p.q[0], p.wrench[0, :3], POINT, lever=LEVER, bar=BAR)
        assert np.linalg.norm(m.predict(p)[0, 0] - truth) < 1e-6
        sag = (equilibrium(m, p, loaded=False).tip - equilibrium(light, p, loaded=False).tip)[0]
        assert np.linalg.norm(sag - mj.sag_by(p.q[0], POINT, None, LEVER, BAR)) < 1e-6
        sags.append(float(np.linalg.norm(sag)))
    assert np.median(sags) > 1e-4


def test_the_counterweight_on_the_lever_does_not_stretch_a_soft_bar(heavy: Robot) -> None:
    """The bar's force is the arm's alone; hung on the driven link, the same mass would stretch it."""
    rng, stiffness, light = np.random.default_rng(7), 3e7, mj.LIGHT
    for _ in range(3):
        p = pair(heavy, rng, np.deg2rad(40.0))
        with_mass, without = (massive(heavy, rods, 1 / stiffness, bar=0.0) for rods in (1.0, 0.0))
        sag = (equilibrium(with_mass, p, loaded=False).tip - equilibrium(without, p, loaded=False).tip)[0]
        assert np.linalg.norm(sag - mj.sag_by(p.q[0], POINT, stiffness, LEVER, light)) < 1e-6
