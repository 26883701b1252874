# ruff: noqa: E501 - templates of one line per element
"""The M-900iB in MuJoCo, with its parallelogram really closed. Shares no code with qsframework.

Bodies are placed at the commanded pose, so that every spring is at rest there: link 2 and the lever
turn on axis 2 with motor springs, the coupling bar hangs on the lever and is tied to link 3 by a
connect constraint, and the elbow has no spring at all. The balancer is a tendon.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

ORIGINS = np.array([(0, 0, 0.940), (0.410, 0, 0), (0, 0, 1.120), (0, 0, 0.250), (1.285, 0, 0), (0.300, 0, 0)])
AXES = np.array([(0, 0, 1), (0, 1, 0), (0, -1, 0), (-1, 0, 0), (0, -1, 0), (-1, 0, 0)], dtype=float)
MASSES = (900.0, 500.0, 700.0, 250.0, 120.0, 60.0)
CENTRES = np.array([(0.20, 0, -0.10), (0, 0, 0.55), (0.10, 0, 0.15), (0.60, 0, 0), (0.05, 0, 0), (-0.05, 0, 0)])
STIFFNESS = (6.0e6, 7.0e6, 5.0e6, 1.2e6, 1.0e6, 0.8e6)
LEVER, BALANCER, SPRING, FREE_LENGTH = 0.75, 0.235, 1.0e5, 0.70
STEP, SECONDS = 5e-4, 3.0


@dataclass(frozen=True)
class Rod:
    """Mass (kg) and its centre (m) of lever or bar, from its pivot, as it stands at zero joint angles."""

    mass: float = 1e-3
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)


LIGHT = Rod()


def rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix about a unit axis."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def frames(q: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """World origin and axis of each joint, and the rotation of the link after it, at URDF angles q (6,)."""
    R, o = np.eye(3), np.zeros(3)
    origins, axes, rotations = [], [], []
    for k in range(6):
        o = o + R @ ORIGINS[k]
        axes.append(R @ AXES[k])
        R = R @ rotation(AXES[k], q[k])
        origins.append(o)
        rotations.append(R)
    return origins, axes, rotations


def text(values: np.ndarray) -> str:
    return " ".join(f"{v:.15g}" for v in values)


def mjcf(
    q: np.ndarray, point: np.ndarray, bar_stiffness: float | None, lever_rod: Rod = LIGHT, bar_rod: Rod = LIGHT
) -> str:
    """The model at one commanded pose; `bar_stiffness` (N/m) makes the bar telescope on a spring."""
    o, a, R = frames(q)
    pivot = o[2] + R[2] @ np.array([-LEVER, 0.0, 0.0])
    lever_end = o[1] + pivot - o[2]
    along = (o[2] - o[1]) / np.linalg.norm(o[2] - o[1])

    def body(k: int, parent: np.ndarray, inner: str, passive: bool = False) -> str:
        stiff = 0.0 if passive else STIFFNESS[k]
        damping = 2e4 if passive else 0.02 * stiff
        centre = R[k] @ CENTRES[k]
        return (
            f'<body name="link{k + 1}" pos="{text(o[k] - parent)}">'
            f'<joint name="j{k + 1}" type="hinge" axis="{text(a[k])}" stiffness="{stiff}" damping="{damping}" armature="100"/>'
            f'<inertial pos="{text(centre)}" mass="{MASSES[k]}" diaginertia="5 5 5"/>{inner}</body>'
        )

    tip = f'<site name="tip" pos="{text(R[5] @ point)}"/>'
    wrist = body(3, o[2], body(4, o[3], body(5, o[4], tip)))
    forearm = body(2, o[1], wrist, passive=True)
    link2 = body(1, o[0], f'<site name="rod" pos="{text(o[2] - o[1])}"/>' + forearm)
    slide = (
        ""
        if bar_stiffness is None
        else f'<joint name="stretch" type="slide" axis="{text(along)}" stiffness="{bar_stiffness}" '
        f'damping="{0.02 * bar_stiffness}" armature="100"/>'
    )
    bar = (
        f'<body name="bar" pos="{text(lever_end - o[1])}">'
        f'<joint name="bar" type="hinge" axis="{text(a[1])}" damping="2e3" armature="50"/>{slide}'
        f'<inertial pos="{text(R[1] @ bar_rod.centre)}" mass="{bar_rod.mass}" diaginertia="1e-3 1e-3 1e-3"/></body>'
    )
    lever = (
        f'<body name="lever" pos="{text(o[1] - o[0])}">'
        f'<joint name="lever" type="hinge" axis="{text(a[1])}" stiffness="{STIFFNESS[2]}" '
        f'damping="{0.02 * STIFFNESS[2]}" armature="100"/>'
        f'<inertial pos="{text(R[2] @ lever_rod.centre)}" mass="{lever_rod.mass}" diaginertia="1e-3 1e-3 1e-3"/>'
        f"{bar}</body>"
    )
    base_pivot = f'<site name="base_pivot" pos="{text(o[1] - o[0] + R[0] @ np.array([0, 0, BALANCER]))}"/>'
    link1 = body(0, np.zeros(3), base_pivot + link2 + lever)
    return (
        f'<mujoco><option timestep="{STEP}" integrator="implicit" gravity="0 0 -9.81"><flag contact="disable"/></option>'
        f"<worldbody>{link1}</worldbody>"
        f'<equality><connect body1="bar" body2="link3" anchor="{text(pivot - lever_end)}" '
        'solref="0.002 1" solimp="0.99999 0.99999 0.001 0.5 2"/></equality>'
        f'<tendon><spatial stiffness="{SPRING}" springlength="{FREE_LENGTH}">'
        '<site site="base_pivot"/><site site="rod"/></spatial></tendon></mujoco>'
    )


def settle(model: mujoco.MjModel, force: np.ndarray, carrier: str = "link6") -> np.ndarray:
    """Position (3,) of the load point, on a carrier, after relaxation under gravity and a force fixed in the world."""
    data = mujoco.MjData(model)
    site = model.site("tip").id
    link = model.body(carrier).id
    for _ in range(round(SECONDS / STEP)):
        mujoco.mj_step1(model, data)
        data.qfrc_applied[:] = 0.0
        mujoco.mj_applyFT(model, data, force, np.zeros(3), data.site_xpos[site], link, data.qfrc_applied)
        mujoco.mj_step2(model, data)
    mujoco.mj_forward(model, data)
    if np.abs(data.qvel).max() > 1e-7:
        raise RuntimeError(f"not settled: {np.abs(data.qvel).max():.1e} rad/s or m/s")
    return data.site_xpos[site].copy()


def displacement(
    q: np.ndarray,
    force: np.ndarray,
    point: np.ndarray,
    bar_stiffness: float | None = None,
    lever: Rod = LIGHT,
    bar: Rod = LIGHT,
) -> np.ndarray:
    """Loaded minus unloaded position (3,) m of the load point at URDF angles q (6,)."""
    model = mujoco.MjModel.from_xml_string(mjcf(q, point, bar_stiffness, lever, bar))
    return settle(model, force) - settle(model, np.zeros(3))


def sag_by(q: np.ndarray, point: np.ndarray, bar_stiffness: float | None, lever: Rod, bar: Rod) -> np.ndarray:
    """By how much (3,) m the weight of lever and bar moves the load point of the unloaded arm."""
    heavy, light = (mjcf(q, point, bar_stiffness, *rods) for rods in ((lever, bar), (LIGHT, LIGHT)))
    return np.subtract(*(settle(mujoco.MjModel.from_xml_string(m), np.zeros(3)) for m in (heavy, light)))
