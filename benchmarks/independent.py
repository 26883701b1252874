"""A second generator of campaigns: arms, equilibria and readings by numpy alone. It imports nothing of qsframework.

An arm is a chain of joints with links of given mass; springs turn about axes that are written out; the equilibrium is
the fixed point of angles and moments, the moments by lever arms. What it writes are the files that a user has: a
URDF, a robot.yaml, nominal values, an experiment and a table of readings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class Link:
    """A joint and the link that it turns: origin (3,) m in the link before, axis (3,), mass kg, centre (3,) m."""

    origin: tuple[float, float, float]
    axis: tuple[float, float, float]
    mass: float
    centre: tuple[float, float, float]
    limits: tuple[float, float]


@dataclass(frozen=True)
class Arm:
    """Links from the base on; tool: where loads act, flange frame, m; compliance of the gears, rad/(N m)."""

    name: str
    links: tuple[Link, ...]
    tool: tuple[float, float, float]
    markers: tuple[tuple[float, float, float], ...]
    compliance: tuple[float, ...]
    payload: float


HEAVY = Arm(
    "heavy",
    (
        Link((0, 0, 0.4), (0, 0, 1), 700.0, (0.1, 0.0, 0.2), (-150, 150)),
        Link((0.45, 0, 0.5), (0, 1, 0), 520.0, (0.02, 0.15, 0.6), (-40, 60)),
        Link((0, 0, 1.25), (0, 1, 0), 430.0, (0.25, -0.05, 0.12), (-60, 60)),
        Link((0.3, 0, 0.15), (1, 0, 0), 120.0, (0.5, 0.0, 0.0), (-170, 170)),
        Link((1.2, 0, 0), (0, 1, 0), 70.0, (0.05, 0.0, 0.0), (-100, 100)),
        Link((0.2, 0, 0), (1, 0, 0), 30.0, (0.05, 0.0, 0.0), (-170, 170)),
    ),
    (0.15, 0.0, 0.2),
    ((0.25, 0.2, -0.1), (0.05, -0.2, 0.3), (0.3, -0.1, 0.2)),
    (1.5e-7, 1.6e-7, 3.0e-7, 1.2e-6, 1.2e-6, 1.5e-6),
    450.0,
)
SMALL = Arm(
    "small",
    (
        Link((0, 0, 0.2), (0, 0, 1), 60.0, (0.02, 0.0, 0.1), (-150, 150)),
        Link((0.1, 0, 0.2), (0, 1, 0), 40.0, (0.0, 0.05, 0.3), (-60, 70)),
        Link((0, 0, 0.6), (0, 1, 0), 30.0, (0.1, -0.02, 0.05), (-60, 60)),
        Link((0.15, 0, 0.05), (1, 0, 0), 12.0, (0.2, 0.0, 0.0), (-170, 170)),
        Link((0.5, 0, 0), (0, 1, 0), 6.0, (0.02, 0.0, 0.0), (-100, 100)),
        Link((0.09, 0, 0), (1, 0, 0), 3.0, (0.02, 0.0, 0.0), (-170, 170)),
    ),
    (0.1, 0.0, 0.1),
    ((0.12, 0.1, -0.05), (0.02, -0.1, 0.12), (0.15, -0.05, 0.1)),
    (3e-6, 3e-6, 5e-6, 1.5e-5, 1.5e-5, 2e-5),
    40.0,
)


@dataclass(frozen=True)
class Turn:
    """An elastic rotation before joint k: axis (3,) in the link before it, at the joint; k = 0 is the base's foot."""

    k: int
    axis: tuple[float, float, float]
    compliance: float
    foot: bool = False


Law = Callable[[Array, Array], Array]
"""Extra angles (n,) of the gears by their torques (n,) and the angles of the joints (n,)."""


@dataclass(frozen=True)
class Hidden:
    """What an arm has and its files do not say: springs, laws of gears, an error of the angles, masses to add."""

    turns: tuple[Turn, ...] = ()
    law: Law | None = None
    angles: Callable[[Array], Array] | None = None
    masses: tuple[float, ...] = field(default=(0.0,) * 6)


def _about(axis: Sequence[float], angle: float) -> Array:
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=np.float64)
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def stand(arm: Arm, hidden: Hidden, q: Array, gears: Array, turned: Array) -> tuple[list[Array], ...]:
    """Axes and points of the joints, axes and points of the hidden turns, centres of mass, and the flange (R, p)."""
    R, p = np.eye(3), np.zeros(3)
    joints: list[Array] = []
    turns: list[Array] = [np.zeros(6)] * len(hidden.turns)
    centres: list[Array] = []
    for k, link in enumerate(arm.links):
        for i, t in enumerate(hidden.turns):
            if t.foot and k == 0:
                turns[i] = np.concatenate([R @ t.axis, p])
                R = R @ _about(t.axis, turned[i])
        p = p + R @ link.origin
        for i, t in enumerate(hidden.turns):
            if t.k == k and not t.foot:
                turns[i] = np.concatenate([R @ t.axis, p])
                R = R @ _about(t.axis, turned[i])
        joints.append(np.concatenate([R @ link.axis, p]))
        R = R @ _about(link.axis, q[k] + gears[k])
        centres.append(p + R @ link.centre)
    return joints, turns, centres, [R, p]


def equilibrium(arm: Arm, hidden: Hidden, compliance: Array, q: Array, force: Array) -> Array:
    """Positions (markers, 3) m of the arm at rest under its weight and a force at its tool."""
    true = q + (hidden.angles(q) if hidden.angles else 0.0)
    gears, turned = np.zeros(6), np.zeros(len(hidden.turns))
    for _ in range(200):
        joints, turns, centres, (R, p) = stand(arm, hidden, true, gears, turned)
        tool = p + R @ arm.tool

        def moment(place: Array, first: int, tool: Array = tool, centres: list[Array] = centres) -> float:
            axis, at = place[:3], place[3:]
            weights = [link.mass + more for link, more in zip(arm.links, hidden.masses, strict=True)]
            lever = np.cross(tool - at, force)
            lever += sum(np.cross(c - at, m * GRAVITY) for c, m in [*zip(centres, weights, strict=True)][first:])
            return float(axis @ lever)

        torque = np.array([moment(joint, k) for k, joint in enumerate(joints)])
        new = compliance * torque + (hidden.law(torque, true) if hidden.law else 0.0)
        other = np.array([t.compliance * moment(turns[i], t.k) for i, t in enumerate(hidden.turns)])
        done = np.abs(new - gears).max() + np.abs(other - turned).max(initial=0.0) < 1e-13
        gears, turned = new, other
        if done:
            break
    else:
        raise RuntimeError("the arm does not come to rest")
    _, _, _, (R, p) = stand(arm, hidden, true, gears, turned)
    return np.array([p + R @ m for m in arm.markers])


def write_robot(arm: Arm, folder: Path) -> None:
    """URDF, robot.yaml and nominal.yaml of an arm as its maker describes it."""
    folder.mkdir(parents=True, exist_ok=True)
    text = [f'<robot name="{arm.name}"><link name="base"/>']
    for k, link in enumerate(arm.links, 1):
        i, (low, high) = 0.1 * link.mass, np.deg2rad(link.limits)
        xyz = " ".join(map(str, link.centre))
        text.append(
            f'<link name="l{k}"><inertial><origin xyz="{xyz}"/><mass value="{link.mass}"/>'
            f'<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{k}" type="revolute"><parent link="{"base" if k == 1 else f"l{k - 1}"}"/>'
            f'<child link="l{k}"/><origin xyz="{" ".join(map(str, link.origin))}"/>'
            f'<axis xyz="{" ".join(map(str, link.axis))}"/>'
            f'<limit lower="{low}" upper="{high}" effort="1e5" velocity="2"/></joint>'
        )
    (folder / "arm.urdf").write_text("\n".join([*text, "</robot>"]))
    limits = "".join(f"  j{k}: {{limits_deg: {list(link.limits)}}}\n" for k, link in enumerate(arm.links, 1))
    (folder / "robot.yaml").write_text(
        f"name: {arm.name}\ntitle: an arm of another code\nurdf: arm.urdf\nbase: base\nflange: l6\n"
        f"controller:\n{limits}"
        "effects:\n  - {effect: joint_compliance, joints: all}\n"
        f"nominal: nominal.yaml\npayload_kg: {arm.payload}\n"
    )
    values = "".join(
        f"joint_compliance[j{k}]: {{value_urad/(N m): {1e6 * c}, sd_percent: 30, source: maker}}\n"
        for k, c in enumerate(arm.compliance, 1)
    )
    (folder / "nominal.yaml").write_text(values)


def campaign(
    arm: Arm,
    hidden: Hidden,
    folder: Path,
    *,
    poses: int = 30,
    seed: int = 0,
    sigma: float = 3e-5,
    shared: float = 0.0,
    share_of_payload: float = 0.9,
) -> Path:
    """Write displacements of random poses under two loads; the experiment's file. shared: sd m of a visit's error."""
    rng = np.random.default_rng([seed, poses])
    write_robot(arm, folder / "robot")
    compliance = np.array(arm.compliance) * (1.0 + 0.2 * rng.standard_normal(6))
    weight = 9.81 * arm.payload * share_of_payload
    loads = (np.array([0.0, 0.0, -weight]), np.array([0.0, 0.4 * weight, -weight]))
    lines = ["pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N,marker,dx_mm,dy_mm,dz_mm"]
    low, high = (np.deg2rad([0.9 * link.limits[e] for link in arm.links]) for e in (0, 1))
    for i in range(poses):
        q, force = np.round(np.rad2deg(rng.uniform(low, high)), 3), loads[i % 2]
        moved = equilibrium(arm, hidden, compliance, np.deg2rad(q), force)
        moved -= equilibrium(arm, hidden, compliance, np.deg2rad(q), np.zeros(3))
        moved += sigma * rng.standard_normal(moved.shape) + shared * rng.standard_normal(3)
        for m, d in enumerate(moved, 1):
            head = [f"p{i + 1:02d}", *(f"{a:g}" for a in q), *(f"{f:.6g}" for f in force), f"m{m}"]
            lines.append(",".join([*head, *(f"{1e3 * x:.5f}" for x in d)]))
    (folder / "readings.csv").write_text("\n".join(lines) + "\n")
    markers = "".join(f"  m{m}: {{xyz_mm: {[1e3 * c for c in xyz]}}}\n" for m, xyz in enumerate(arm.markers, 1))
    (folder / "experiment.yaml").write_text(
        f"robot: robot\ndata: readings.csv\nload: {{point_mm: {[1e3 * c for c in arm.tool]}}}\n"
        f"markers:\n{markers}noise: {{sigma_mm: {1e3 * sigma}}}\n"
    )
    return folder / "experiment.yaml"
