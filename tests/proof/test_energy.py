"""The equilibrium of random arms against the root of an energy's gradient, written without the model.

The energy is a plain function of the springs' deflections; its gradient comes from complex steps, to
the last digit. Nothing of the model is used but the numbers that describe the arm.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from hypothesis import HealthCheck, given, settings, strategies as st
from scipy.optimize import root

from qsframework.elastostatics import Site, make_model
from qsframework.plugin import Effect, Poses, RobotFacts, build_effects
from qsframework.plugin.facts import frozen

AIR = 101325.0
GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class Gas:
    """A gas balancer at a joint: triangle, signed area, gauge pressure and volume at a length, exponent."""

    joint: int
    lc: float
    l2: float
    zero: float
    area: float
    pressure: float
    volume: float
    length: float
    exponent: float

    def energy(self, q: np.ndarray) -> np.ndarray:
        """Of the gas and of the air: the antiderivative of -(p - p_a) dV, p V^n constant."""
        n, V0 = self.exponent, self.volume
        s = np.sqrt(self.lc**2 + self.l2**2 - 2.0 * self.lc * self.l2 * np.cos(q + self.zero))
        V = V0 - self.area * (s - self.length)
        return (self.pressure + AIR) * V0**n / (n - 1.0) * (V ** (1.0 - n) - V0 ** (1.0 - n)) + AIR * (V - V0)


@dataclass(frozen=True)
class Arm:
    """A random arm: everything as plain numbers."""

    placements: np.ndarray
    axes: np.ndarray
    masses: np.ndarray
    centres: np.ndarray
    compliance: np.ndarray
    offaxis: tuple[tuple[int, int, float], ...]
    base: float | None
    loop: bool
    sign: float
    spring: tuple[int, int, np.ndarray, np.ndarray, float, float] | None
    hardening: tuple[int, float] | None
    gas: Gas | None
    q: np.ndarray
    force: np.ndarray
    tip: np.ndarray


def turn(axis: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """Rodrigues' rotations (..., 3, 3), analytic in the angle (...)."""
    angle = np.asarray(angle)[..., None, None]
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def random_arm(
    seed: int, joints: int, loop: bool, offaxis: int, base: bool, spring: bool, hardening: bool, gas: bool
) -> Arm:
    """An arm of random placements, axes and springs; joints 2 and 3 are parallel where there is a loop."""
    rng = np.random.default_rng(seed)

    def unit() -> np.ndarray:
        v = rng.normal(size=3)
        return v / np.linalg.norm(v)

    axes = np.array([unit() for _ in range(joints)])
    placements = np.tile(np.eye(4), (joints, 1, 1))
    for k in range(joints):
        placements[k, :3, :3] = turn(unit(), rng.uniform(-3, 3)).real
        placements[k, :3, 3] = rng.uniform(-1, 1, 3)
    sign = float(rng.choice([-1.0, 1.0]))
    if loop:
        placements[2, :3, :3] = np.eye(3)
        axes[2] = sign * axes[1]
    springs = tuple((int(rng.integers(0, joints)), i, 10 ** rng.uniform(-8.5, -7)) for i in range(offaxis))
    ends = sorted(rng.choice(joints + 1, 2, replace=False))
    pull = (int(ends[0]), int(ends[1]), rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3), 10 ** rng.uniform(3, 5), 0.4)
    arm = Arm(
        placements,
        axes,
        rng.uniform(10, 300, joints + 1),
        rng.uniform(-0.4, 0.4, (joints + 1, 3)),
        10 ** rng.uniform(-8, -6.3, joints),
        tuple({(j, a): (j, a, c) for j, a, c in springs}.values()),
        10 ** rng.uniform(-9, -7.5) if base else None,
        loop,
        sign,
        pull if spring else None,
        (int(rng.integers(0, joints)), 10 ** rng.uniform(-17, -16)) if hardening else None,
        None,
        rng.uniform(-3, 3, joints),
        rng.normal(size=3) * 2e3,
        rng.uniform(-0.5, 0.5, 3),
    )
    lc, l2, area = rng.uniform(0.1, 0.4), rng.uniform(0.5, 1.2), rng.uniform(2e-3, 8e-3) * rng.choice([-1.0, 1.0])
    balancer = Gas(
        int(rng.integers(0, joints)),
        lc,
        l2,
        rng.uniform(-1, 1),
        area,
        10 ** rng.uniform(6, 7),
        2.5 * abs(area) * lc * rng.uniform(1.0, 4.0),
        l2,
        rng.uniform(1.05, 1.4),
    )
    return dataclasses.replace(arm, gas=balancer) if gas else arm


def compliances(arm: Arm) -> np.ndarray:
    """In the order of the unknowns: joints, off-axis springs, base."""
    return np.array([*arm.compliance, *(c for _, _, c in arm.offaxis), *([] if arm.base is None else [arm.base])])


def angles(arm: Arm, eps: np.ndarray) -> np.ndarray:
    """Joint angles (..., n) at deflections eps: the motor of joint 3 turns the lever, its joint takes up joint 2's."""
    q = arm.q + eps[..., : len(arm.axes)]
    if arm.loop:
        q[..., 2] -= arm.sign * eps[..., 1]
    return q


def place(arm: Arm, eps: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Rotation and origin of the base and of every link at deflections eps (..., m), complex allowed."""
    n, q = len(arm.axes), angles(arm, eps)
    R = turn(np.array([0.0, 1.0, 0.0]), eps[..., -1]) if arm.base is not None else np.eye(3)
    o = np.zeros(3)
    rotations, origins = [R], [o]
    for k in range(n):
        o = o + R @ arm.placements[k, :3, 3]
        R = R @ arm.placements[k, :3, :3]
        for i, (joint, axis, _) in enumerate(arm.offaxis):
            if joint == k:
                R = R @ turn(np.eye(3)[axis], eps[..., n + i])
        R = R @ turn(arm.axes[k], q[..., k])
        rotations.append(R)
        origins.append(o)
    return rotations, origins


def energy(arm: Arm, eps: np.ndarray, loaded: bool) -> np.ndarray:
    """Potential (...) of masses, balancer and load at deflections (..., m); the springs' own is added by `settle`."""
    rotations, origins = place(arm, eps)
    total = np.zeros(eps.shape[:-1]) if arm.gas is None else arm.gas.energy(angles(arm, eps)[..., arm.gas.joint])
    for R, o, m, c in zip(rotations, origins, arm.masses, arm.centres, strict=True):
        total = total - m * ((o + R @ c) @ GRAVITY)
    if arm.spring is not None:
        first, second, a, b, stiffness, free = arm.spring
        apart = origins[second] + rotations[second] @ b - origins[first] - rotations[first] @ a
        total = total + 0.5 * stiffness * (np.sqrt((apart * apart).sum(axis=-1)) - free) ** 2
    if loaded:
        total = total - (origins[-1] + rotations[-1] @ arm.tip) @ arm.force
    return total


def settle(arm: Arm, loaded: bool) -> np.ndarray:
    """Position of the tip where every spring carries the torque of the potential: eps = c T + f(T)."""
    c = compliances(arm)
    scale, units = c * 1e3, np.eye(len(c))

    def torque(eps: np.ndarray) -> np.ndarray:
        step = 1e-30
        return -energy(arm, eps[..., None, :] + 1j * step * units, loaded).imag / step

    def residual(y: np.ndarray) -> np.ndarray:
        T = torque(y * scale)
        given = c * T
        if arm.hardening is not None:
            joint, c3 = arm.hardening
            given[..., joint] += c3 * T[..., joint] ** 3
        return y - given / scale

    found = root(residual, residual(np.zeros(len(c))) * -1.0, tol=1e-13)
    y = found.x
    for _ in range(3):  # Newton polish with a difference Jacobian of an exact residual
        J = ((residual(y + 1e-4 * units) - residual(y - 1e-4 * units)) / 2e-4).T
        y = y - np.linalg.solve(J, residual(y))
    assert np.abs(residual(y)).max() < 1e-9 * max(np.abs(y).max(), 1.0)
    rotations, origins = place(arm, y * scale)
    return origins[-1] + rotations[-1] @ arm.tip


def modelled(arm: Arm) -> np.ndarray:
    """The same arm through effects and the model."""
    n = len(arm.axes)
    facts = RobotFacts(
        name="random",
        joints=tuple(f"joint_{k + 1}" for k in range(n)),
        links=("base", *(f"link_{k + 1}" for k in range(n))),
        axes=frozen(arm.axes),
        placements=frozen(arm.placements),
        masses=frozen(arm.masses),
        centres=frozen(arm.centres),
    )
    values: dict[str, float] = {f"joint_compliance[joint_{k + 1}]": c for k, c in enumerate(arm.compliance)}
    entries: list[dict[str, object]] = [{"effect": "joint_compliance", "joints": "all"}]
    for joint, axis, c in arm.offaxis:
        entries.append({"effect": "offaxis_compliance", "joint": f"joint_{joint + 1}", "axis": "xyz"[axis]})
        values[f"offaxis_compliance[joint_{joint + 1}/{'xyz'[axis]}]"] = c
    if arm.base is not None:
        entries.append({"effect": "base_compliance", "direction": "ry"})
        values["base_compliance[ry]"] = arm.base
    if arm.loop:
        entries.append({"effect": "parallelogram", "driver": "joint_2", "driven": "joint_3", "lever_m": 0.5})
    if arm.spring is not None:
        first, second, a, b, stiffness, free = arm.spring
        points = {
            f"{end}_{axis}_m": float(v)
            for end, xyz in (("first", a), ("second", b))
            for axis, v in zip("xyz", xyz, strict=True)
        }
        entries.append({"effect": "point_spring", "first": facts.links[first], "second": facts.links[second], **points})
        name = f"point_spring[{facts.links[first]}/{facts.links[second]}]"
        values |= {f"{name}.stiffness": stiffness, f"{name}.free_length": free}
    if arm.gas is not None:
        g = arm.gas
        given_gas = {
            "lc_m": g.lc,
            "l2_m": g.l2,
            "zero_rad": g.zero,
            "pressure_Pa": g.pressure,
            "volume_m^3": g.volume,
            "length_m": g.length,
            "exponent": g.exponent,
            "piston_area_m^2": abs(g.area),
            "gas": "rod side" if g.area > 0.0 else "piston side",
        }
        entries.append({"effect": "gas_balancer", "joint": f"joint_{g.joint + 1}", **given_gas})
    if arm.hardening is not None:
        entries.append({"effect": "joint_hardening", "joint": f"joint_{arm.hardening[0] + 1}"})
        values[f"joint_hardening[joint_{arm.hardening[0] + 1}]"] = arm.hardening[1]
    effects: list[Effect] = [e for entry in entries for e in build_effects(entry, facts)]
    parameters = [p for e in effects for p in e.parameters(facts)]
    parameters = [dataclasses.replace(p, nominal=values.get(p.name, p.nominal)) for p in parameters]
    tip = Site(n, arm.tip)
    model = make_model(facts, effects, parameters, tip, [("tip", tip)], GRAVITY)
    wrench = np.append(arm.force, np.zeros(3))
    return model.predict(Poses(arm.q[None], arm.q[None], wrench[None]))[0, 0]


@settings(max_examples=250, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    seed=st.integers(0, 2**32 - 1),
    joints=st.integers(3, 7),
    loop=st.booleans(),
    offaxis=st.integers(0, 3),
    base=st.booleans(),
    spring=st.booleans(),
    hardening=st.booleans(),
    gas=st.booleans(),
)
def test_random_arms(
    seed: int, joints: int, loop: bool, offaxis: int, base: bool, spring: bool, hardening: bool, gas: bool
) -> None:
    """At least 200 random arms, poses and loads with random effects: 1e-8 of the displacement."""
    arm = random_arm(seed, joints, loop, offaxis, base, spring, hardening, gas)
    truth = settle(arm, True) - settle(arm, False)
    assert np.linalg.norm(modelled(arm) - truth) < 1e-8 * np.linalg.norm(truth) + 1e-14
