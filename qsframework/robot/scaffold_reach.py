"""How far a stranger's arm reaches within its limits, to compare with what its manual says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from qsframework.plugin import Array
from qsframework.robot.scaffold_joints import slides, used_limits
from qsframework.robot.urdf import Joint, Mimic

_TRIED, _ROUNDS = 4000, 12


def reach_words(chain: Sequence[Joint], following: Mapping[str, Mimic]) -> str | None:
    """How far the origin of the last joint but one and the flange come from the first axis that turns, in words.

    chain: all joints from base to flange. None where no two joints turn.
    """
    turning = [joint for joint in chain if joint.moves and not slides(joint)]
    if len(turning) < 2:
        return None
    wrist = [joint for joint in chain if joint.moves][-2]
    far = [_farthest(chain, following, end) for end in (wrist.name, "")]
    said = f"the flange comes {far[1]:.3g} m from the first axis, the origin of {wrist.name} {far[0]:.3g} m"
    return said if far[0] > 0.05 else f"the flange comes {far[1]:.3g} m from the first axis"


def _farthest(chain: Sequence[Joint], following: Mapping[str, Mimic], end: str) -> float:
    """The largest distance, m, of a joint's origin ("": the flange) from the first axis that turns, by trial."""
    own = [joint for joint in chain if joint.moves and joint.name not in following]
    low, high = np.array([(0.5 * sum(used_limits(j)),) * 2 if slides(j) else used_limits(j) for j in own]).T
    rng = np.random.default_rng(0)
    tried = rng.uniform(low, high, (_TRIED, len(own)))
    best, at = 0.0, 0.5 * (low + high)
    for k in range(_ROUNDS):
        found = _distance(chain, following, dict(zip([j.name for j in own], tried.T, strict=True)), end)
        if found.max() > best:
            best, at = float(found.max()), tried[int(found.argmax())]
        tried = np.clip(at + 0.3 * 0.5**k * rng.normal(size=(200, len(own))), low, high)
    return best


def _distance(chain: Sequence[Joint], following: Mapping[str, Mimic], values: dict[str, Array], end: str) -> Array:
    """Distances (N,) m from the first axis that turns. values (N,): of the joints with a motor; the others follow."""
    count = len(next(iter(values.values())))
    turn, place = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    axis: tuple[Array, Array] | None = None
    for joint in chain:
        at = joint.origin.matrix()
        place = place + turn @ at[:3, 3]
        turn = turn @ at[:3, :3]
        if joint.name == end:
            break
        if not joint.moves:
            continue
        along = joint.axis / np.linalg.norm(joint.axis)
        follows = following.get(joint.name)
        if follows is not None:
            values[joint.name] = follows.multiplier * values[follows.joint] + follows.offset
        value = values[joint.name]
        if slides(joint):
            place = place + value[:, None] * (turn @ along)
            continue
        axis = (place, turn @ along) if axis is None else axis
        turn = turn @ _about(along, value)
    start, direction = axis if axis is not None else (place, place)
    return np.asarray(np.linalg.norm(np.cross(direction, place - start), axis=1), dtype=np.float64)


def _about(axis: Array, angle: Array) -> Array:
    """Rotations (N, 3, 3) about a unit axis (3,) by angles (N,) rad."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + s * cross + (1.0 - c) * (cross @ cross), dtype=np.float64)
