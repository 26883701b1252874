"""Poses that tell the same: found by their information, named by the symmetry that joins them.

Nothing is assumed about the arm or the sensors. Poses are equivalent if their information about
the parameters is equal; a symmetry is the arm's if it gives the same flange pose.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsframework.experiment import Experiment, Plan
from qsframework.information import information, information_rows
from qsframework.plans.constraints import joint_range
from qsframework.plugin import Array, Indices, RobotFacts
from qsframework.robot.kinematics import joint_frames

_RTOL = 1e-9
_SAME = 1e-9
_TURN = 2.0 * np.pi
Flags = npt.NDArray[np.bool_]


def fold(matrices: Array, rtol: float = _RTOL) -> tuple[Indices, Indices]:
    """Which of N information matrices (N, p, p) are equal: `(first, inverse)`.

    first (u,) are the positions of the first of each kind, in order; inverse (N,) is the position
    in `first` of each matrix's kind. Equal means within rtol of the larger one's size, entry by entry
    on the scale of the parameters, so that units do not count.
    """
    count = len(matrices)
    flat = matrices.reshape(count, matrices.shape[1] * matrices.shape[2])
    size = np.sqrt(np.abs(np.diagonal(matrices, axis1=1, axis2=2)).max(axis=0, initial=0.0))
    scale = np.outer(size, size).ravel()
    flat = flat / np.where(scale > 0, scale, 1.0)
    key = _key(flat)
    order = np.argsort(key, kind="stable")
    kind, done = np.arange(count), np.zeros(count, dtype=bool)
    largest = np.abs(flat).max(axis=1, initial=0.0)
    reach = 2.0 * rtol * largest * np.sqrt(max(flat.shape[1], 1))
    for position, i in enumerate(order):
        if done[i]:
            continue
        like = [i]
        for j in order[position + 1 :]:
            if key[j] - key[i] > reach[i]:
                break
            if not done[j] and np.abs(flat[i] - flat[j]).max() <= rtol * max(largest[i], largest[j]):
                like.append(j)
        done[like] = True
        kind[like] = min(like)
    first, inverse = np.unique(kind, return_inverse=True)
    return first, inverse


def _key(flat: Array) -> Array:
    """One number (N,) per row, close for close rows: a projection on a fixed direction of unit length."""
    direction: Array = np.random.default_rng(0).normal(size=int(flat.shape[1]))
    return flat @ (direction / (float(np.linalg.norm(direction)) or 1.0))


def equivalent_poses(experiment: Experiment, plan: Plan) -> list[tuple[str, str, str]]:
    """Pairs of poses of a plan with equal information on the experiment's parameters, and the symmetry that joins them.

    Repeats of a pose are not counted; a pair that no known symmetry joins is named "equal information".
    """
    if plan.of_positions.any():  # the flip of a wrist changes what its zeros do
        return []
    rows = information_rows(experiment.model(), plan.poses, experiment.fit_names(), experiment.noise.sigma or 1.0)
    first, inverse = fold(information(rows))
    out: list[tuple[str, str, str]] = []
    for i, kind in enumerate(inverse):
        j = int(first[kind])
        if i != j:
            same_load = bool(np.allclose(plan.wrench[i], plan.wrench[j], rtol=1e-9, atol=1e-9))
            name = symmetry_name(experiment, plan.pendant[j], plan.pendant[i]) if same_load else "equal information"
            out.append((plan.pose[j], plan.pose[i], name))
    return out


def symmetry_name(experiment: Experiment, one: Array, other: Array) -> str:
    """What joins two poses (n,) of the pendant: the named transformations, tried in turn."""
    facts, controller = experiment.robot.facts, experiment.robot.controller
    q, p = controller.to_joints(np.stack([one, other]))
    if np.allclose(q, p, atol=_SAME):
        return "same pose"
    turns = _whole_turns(facts, p - q)
    if turns.all():
        moved = [str(k + 1) for k in range(facts.n) if abs(p[k] - q[k]) > _SAME]
        return f"turn of joint{'s' if len(moved) > 1 else ''} {', '.join(moved)}"
    if flips_wrist(facts) and _whole_turns(facts, p - wrist_flip(q[None])[0]).all():
        return "wrist flip"
    if _same_flange(facts, np.stack([q, p]))[0]:
        return "another way to the same flange pose"
    first = 1 + next((k for k in range(facts.n) if not facts.sliding[k]), 0)
    if turns[first:].all():
        return f"axis {first}"
    flipped = flips_wrist(facts) and _whole_turns(facts, p - wrist_flip(q[None])[0])[first:].all()
    return f"axis {first} and wrist flip" if flipped else "equal information"


def wrist_flip(q: Array) -> Array:
    """The other way (N, n) of a spherical wrist of the last three joints: +180, minus, +180 degrees."""
    out = q.copy()
    out[:, -3] += np.pi
    out[:, -2] *= -1.0
    out[:, -1] += np.pi
    return out


def flips_wrist(facts: RobotFacts) -> bool:
    """Whether the flip leaves the flange where it is: asked of the kinematics at a fixed sample of poses."""
    if facts.n < 4 or facts.passive or any(facts.sliding[-3:]):
        return False
    q = np.random.default_rng(0).uniform(-3.0, 3.0, (8, facts.n))
    return bool(_same_flange(facts, np.concatenate([q, wrist_flip(q)])).all())


def canonical(experiment: Experiment, pendant: Array) -> Array:
    """Poses (N, n) rad of the same flange poses: the one representative of each inside the limits.

    Whole turns of a joint go to the angle nearest to zero, and a wrist that can be flipped is
    flipped to the last joint but one >= 0, each only where the limits allow the result.
    """
    out = _unwound(experiment, pendant)
    if not flips_wrist(experiment.robot.facts):
        return out
    controller = experiment.robot.controller
    q = controller.to_joints(out)
    flipped = _unwound(experiment, controller.to_pendant(wrist_flip(q)))
    take = (q[:, -2] < 0.0) & _inside(experiment, flipped).all(axis=1)
    return np.where(take[:, None], flipped, out)


def _unwound(experiment: Experiment, pendant: Array) -> Array:
    """Each angle less its whole turns, where the limits allow it and no other joint depends on it; no travel."""
    matrix = experiment.robot.controller.matrix
    whole = np.isclose(np.abs(matrix), 1.0) & (np.count_nonzero(matrix, axis=1) == 1)[:, None]
    alone = (np.count_nonzero(matrix, axis=0) == 1) & whole.any(axis=0)
    near = pendant - _TURN * np.ceil((pendant - np.pi - _SAME) / _TURN)
    alone &= ~np.array(experiment.robot.controller.units.sliding)
    return np.where(alone & _inside(experiment, near), near, pendant)


def _inside(experiment: Experiment, pendant: Array) -> Flags:
    """Which angles (N, n) the controller's limits and the experiment's allow."""
    lower, upper = joint_range(experiment)
    tolerance = experiment.robot.controller.tolerance
    return (pendant >= lower - tolerance) & (pendant <= upper + tolerance)


def _whole_turns(facts: RobotFacts, moved: Array) -> Flags:
    """Which joints (n,) stand alike after they moved: by whole turns, one that slides by nothing."""
    return np.abs(moved - np.where(facts.sliding, 0.0, _TURN * np.round(moved / _TURN))) < _SAME


def _same_flange(facts: RobotFacts, q: Array) -> Flags:
    """Whether the first and the second half of the poses (2 N, n) put the last link at the same place, (N,)."""
    placed = joint_frames(facts, q)
    half = len(q) // 2
    turned = np.abs(placed.rotations[-1][..., :half] - placed.rotations[-1][..., half:]).max(axis=(0, 1))
    moved = np.abs(placed.positions[-1][:, :half] - placed.positions[-1][:, half:]).max(axis=0)
    return (turned < _SAME) & (moved < _SAME)
