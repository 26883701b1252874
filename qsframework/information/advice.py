"""What would help where readings do not tell a parameter: derived from what the readings load, not from names."""

from __future__ import annotations

import numpy as np

from qsframework.elastostatics import Model
from qsframework.elastostatics.evaluation import evaluate_stages
from qsframework.elastostatics.structure import chunks
from qsframework.information.rank import RankTest
from qsframework.plugin import Actuator, Array, Effect, Geometry, Load, ParallelSpring, Poses, Sensor, Spring

_LITTLE = 0.05
"""Share of the largest possible torque below which a spring counts as not loaded."""


def what_would_help(model: Model, name: str, poses: Poses) -> str:
    """One sentence on what to measure so that a parameter is told; poses are those of the readings."""
    effect = _effect_of(model, name)
    if isinstance(effect, Spring):
        return _spring(model, effect, name, poses)
    if isinstance(effect, ParallelSpring):
        return _balancer(model, effect, poses)
    if isinstance(effect, Geometry):
        return "it moves the unloaded and the loaded arm alike: measure absolute positions (x_mm, y_mm, z_mm)"
    if isinstance(effect, Load):
        return "the readings see the load's error as one of all compliances: weigh the load, or state its prior sd"
    if isinstance(effect, Sensor):
        return "measure more poses, spread over the workspace, with loads of different direction"
    return "measure more poses, with larger loads of different direction"


def loss_words(model: Model, test: RankTest, poses: Poses) -> str:
    """What a rank test says is lost, and what would help."""
    lost = dict.fromkeys((*test.unseen, *(group[0] for group in test.tied)))
    known = [name for name in lost if name in model.names]
    return "; ".join([test.words(), *(f"{name}: {what_would_help(model, name, poses)}" for name in known)])


def _spring(model: Model, effect: Spring, name: str, poses: Poses) -> str:
    coordinate, who = _coordinate(model, name), _who(effect, model)
    torque = np.abs(spring_torques(model, poses)[:, coordinate])
    reach = np.abs(unit_torques(model, poses)[:, coordinate, :])
    force = np.linalg.norm(poses.wrench[:, :3], axis=1)
    possible = float((np.linalg.norm(reach, axis=1) * force).max())
    if possible == 0.0:
        return f"no force at the load point turns {who} in these poses: bend the wrist or move the load point"
    share = float(torque.max()) / possible
    pull = _pull_words(int(reach.max(axis=0).argmax()))
    if share < _LITTLE:
        return f"no reading loads {who}; add {pull} with the arm stretched, so that its lever about {who} is long"
    return (
        f"the readings load {who} with at most {100 * share:.0f} % of what their forces could; repeat them, raise the "
        f"load, or add {pull} where its lever about {who} is longest"
    )


def _effect_of(model: Model, name: str) -> Effect:
    (position,) = model.index([name])
    return next(e for e, s in zip(model.effects, model.slices, strict=True) if s.start <= position < s.stop)


def _pull_words(axis: int) -> str:
    return "a vertical load" if axis == 2 else f"a side pull along the base's {'xy'[axis]}"


def _balancer(model: Model, effect: ParallelSpring, poses: Poses) -> str:
    joints = effect.joints(model.facts)
    who = " and ".join(joints) or effect.name
    if _has_torque(model, effect, poses):
        return (
            f"a load hardly changes its torque on {who}: that shows in absolute positions (x_mm, y_mm, z_mm) of the "
            "unloaded arm, or in the motor torques, at several angles of this joint"
        )
    count = len(np.unique(np.round(poses.q[:, [model.facts.joint_index(j) for j in joints]], 3), axis=0))
    return f"the readings have {count} angles of {who}: measure at three or more, far apart, under a large load"


def _has_torque(model: Model, effect: ParallelSpring, poses: Poses) -> bool:
    """Whether the effect pulls at the commanded pose, and does not only stiffen."""
    x = np.array([p.nominal or p.typical for p in effect.parameters(model.facts)])
    places = [model.facts.joint_index(j) for j in effect.joints(model.facts)]
    pulled = effect.ends(model.facts) is not None
    return pulled or effect.torque(poses.q[:, places], x, poses.loaded) is not None


def _who(effect: Spring, model: Model) -> str:
    coordinates = effect.virtual_joints(model.facts)
    if len(coordinates) == 1 and isinstance(coordinates[0], Actuator):
        return coordinates[0].joint.replace("_", " ")
    return effect.name


def _coordinate(model: Model, name: str) -> int:
    springs = [p.name for e in model.effects if isinstance(e, Spring) for p in e.parameters(model.facts)]
    return springs.index(name)


def spring_torques(model: Model, poses: Poses) -> Array:
    """Torque (N, ne) that the loads of the readings put on each elastic coordinate, N m."""
    parts = [evaluate_stages(model, chunk, model.nominal, preload=False).tau.T for _, chunk in chunks(poses)]
    return np.concatenate(parts)


def unit_torques(model: Model, poses: Poses) -> Array:
    """Torque (N, ne, 3) per newton along the base's x, y and z at the load point, m."""
    out: list[Array] = []
    for axis in range(3):
        wrench = np.zeros((len(poses), 6))
        wrench[:, axis] = 1.0
        pushed = Poses(poses.pendant, poses.q, wrench, poses.unloaded, poses.loaded)
        out.append(spring_torques(model, pushed))
    return np.stack(out, axis=-1)
