"""What would help where readings do not tell a parameter: derived from what the readings load, not from names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qsframework.elastostatics import Model
from qsframework.elastostatics.evaluation import evaluate_stages
from qsframework.elastostatics.structure import chunks
from qsframework.estimation import RankTest
from qsframework.plugin import (
    Actuator,
    Array,
    Context,
    Geometry,
    Load,
    ParallelSpring,
    Poses,
    Sensor,
    Spring,
    laws,
)

_LITTLE = 0.05
"""Share of the largest possible torque below which a spring counts as not loaded."""
_MUCH = 0.9
"""Share from which more force along other directions would hardly load it more."""
_LEVER = 1e-3
"""m, of a force about an axis, below which no force turns it: what rounding leaves of none."""
_TURNED, _POSES = 1.0, 16
"""rad by which joints are turned, and how often, to see whether another pose gives a lever."""
_FACES = (laws.torque, laws.stiffness)


def what_would_help(model: Model, name: str, poses: Poses) -> str:
    """One sentence on what to measure so that a parameter is told; poses are those of the readings."""
    (position,) = model.index([name])
    effect = next(e for e, s in zip(model.effects, model.slices, strict=True) if s.start <= position < s.stop)
    if isinstance(effect, Spring) and position in model.compliance_rows:
        return _spring(model, effect, model.compliance_rows.index(position), poses)
    if isinstance(effect, ParallelSpring):
        return _balancer(model, effect, name, poses)
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


def _spring(model: Model, effect: Spring, coordinate: int, poses: Poses) -> str:
    who = _who(effect, model)
    reach = np.abs(unit_torques(model, poses)[:, coordinate, :])
    share = load_share(model, poses, coordinate)
    if share is None and _always(model, poses, coordinate):
        return f"the load point lies on the axis of {who}, so that no force there turns it: move the load point off it"
    if share is None:
        return f"no force at the load point turns {who} in these poses: bend the wrist or move the load point"
    axis = int(reach[:, :3].max(axis=0).argmax())
    pull = "a vertical load" if axis == 2 else f"a side pull along the base's {'xy'[axis]}"
    what = "forces and moments" if np.any(poses.wrench[:, 3:]) else "forces"
    if share < _LITTLE:
        return f"no reading loads {who}; add {pull} with the arm stretched, so that its lever about {who} is long"
    if share > _MUCH:
        return f"the readings load {who} as much as their {what} can; repeat them, or measure more poses like the best"
    return (
        f"{who} reaches only {100 * share:.0f} % of the torque these {what} allow; repeat them, raise the "
        f"load, or add {pull} where its lever about {who} is longest"
    )


def _balancer(model: Model, effect: ParallelSpring, name: str, poses: Poses) -> str:
    silenced = _silenced_by(model, effect, name, poses)
    if silenced:
        return (
            f"it changes nothing while the nominal {' and '.join(silenced)} is 0: state a value other than 0, the "
            "experiment's own nominal file will do"
        )
    joints = effect.joints(model.facts)
    who = " and ".join(joints) or effect.name
    if _has_torque(model, effect, poses):
        return (
            f"a load hardly changes its torque on {who}: that shows in absolute positions (x_mm, y_mm, z_mm) of the "
            "unloaded arm, or in the motor torques, at several angles of this joint"
        )
    count = len(np.unique(np.round(poses.q[:, [model.facts.joint_index(j) for j in joints]], 3), axis=0))
    more = "three or more, far apart" if count < 3 else "more, farther apart"
    return f"the readings have {count} angle{'s' if count > 1 else ''} of {who}: measure at {more}, under a large load"


def _silenced_by(model: Model, effect: ParallelSpring, name: str, poses: Poses) -> list[str]:
    """The effect's parameters whose nominal value of 0 leaves this one, such as a free length, without effect."""
    parameters = effect.parameters(model.facts)
    places = [model.facts.joint_index(j) for j in effect.joints(model.facts)]
    if not places or effect.ends(model.facts) is not None:
        return []
    q, context = poses.q[:, places], Context(model.facts, poses)
    x = model.nominal[model.index([p.name for p in parameters])]
    step = np.array([p.typical * (p.name == name) for p in parameters])

    def silent(at: Array) -> bool:
        terms = [(law(effect, q, at, context), law(effect, q, at + step, context)) for law in _FACES]
        return all(a is None or b is None or np.array_equal(a.value, b.value) for a, b in terms)

    if not silent(x):
        return []
    woken = (np.where(np.arange(len(x)) == i, p.typical, x) for i, p in enumerate(parameters))
    return [p.name for p, v, at in zip(parameters, x, woken, strict=True) if v == 0.0 and not silent(at)]


def _has_torque(model: Model, effect: ParallelSpring, poses: Poses) -> bool:
    """Whether the effect pulls at the commanded pose, and does not only stiffen."""
    x = np.array([p.nominal or p.typical for p in effect.parameters(model.facts)])
    places = [model.facts.joint_index(j) for j in effect.joints(model.facts)]
    pulled = effect.ends(model.facts) is not None
    return pulled or effect.torque(poses.q[:, places], x, Context(model.facts, poses)) is not None


def _who(effect: Spring, model: Model) -> str:
    coordinates = effect.virtual_joints(model.facts)
    if len(coordinates) == 1 and isinstance(coordinates[0], Actuator):
        return coordinates[0].joint.replace("_", " ")
    return effect.name


def spring_torques(model: Model, poses: Poses) -> Array:
    """Torque (N, ne) that the loads of the readings put on each elastic coordinate, N m."""
    parts = [evaluate_stages(model, chunk, model.nominal, preload=False).tau.T for _, chunk in chunks(poses)]
    return np.concatenate(parts)


def load_share(model: Model, poses: Poses, coordinate: int) -> float | None:
    """Share, 0 to 1, of the largest torque on a coordinate that loads of these sizes could give, in any direction.

    A force F and a moment M give at most |F| times the coordinate's reach plus |M| times the share of a moment that it
    carries. None where neither these loads nor any force turn it.
    """
    reach = unit_torques(model, poses)[:, coordinate, :]
    possible = sum(
        np.linalg.norm(reach[:, part], axis=1) * np.linalg.norm(poses.wrench[:, part], axis=1)
        for part in (slice(0, 3), slice(3, 6))
    )
    most = float(np.max(possible))
    lever = float(np.linalg.norm(reach[:, :3], axis=1).max())
    if lever < _LEVER and not np.any(poses.wrench[:, 3:]):
        return None
    if most == 0.0:
        return 0.0
    return float(np.abs(spring_torques(model, poses)[:, coordinate]).max()) / most


def _always(model: Model, poses: Poses, coordinate: int) -> bool:
    """Whether no pose gives a force at the load point a lever about a coordinate."""
    rng = np.random.default_rng(0)
    turned = poses.q[:1] + rng.uniform(-_TURNED, _TURNED, (_POSES, poses.q.shape[1]))
    others = Poses(turned, turned, np.zeros((_POSES, 6)))
    return bool(np.abs(unit_torques(model, others)[:, coordinate, :3]).max() < _LEVER)


def unit_torques(model: Model, poses: Poses) -> Array:
    """Torque (N, ne, 6) per newton along the base's x, y and z at the load point, m, and per N m about them."""
    pushed = (replace(poses, wrench=np.tile(unit, (len(poses), 1))) for unit in np.eye(6))
    return np.stack([spring_torques(model, one) for one in pushed], axis=-1)
