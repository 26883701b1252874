"""How far a stranger's arm reaches within its limits, to compare with what its manual says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from qsf_onboarding.joints import slides, used_limits
from qsframework.plugin import Array
from qsframework.robot.kinematics import Chain, Element, frames
from qsframework.robot.urdf import Joint, Mimic

_TRIED, _ROUNDS = 4000, 12


def reaches(chain: Sequence[Joint], following: Mapping[str, Mimic]) -> tuple[float, float] | None:
    """How far (m) the origin of the last joint but one and the flange come from the first axis that turns.

    chain: all joints from base to flange. None where no two joints turn.
    """
    moving = [joint for joint in chain if joint.moves]
    if sum(not slides(joint) for joint in moving) < 2:
        return None
    return _farthest(chain, following, moving[-2].name), _farthest(chain, following, "")


def _farthest(chain: Sequence[Joint], following: Mapping[str, Mimic], end: str) -> float:
    """The largest distance, m, of a joint's origin ("": the flange) from the first axis that turns, by trial."""
    own = [joint for joint in chain if joint.moves and joint.name not in following]
    low, high = np.sort([(0.5 * sum(used_limits(j)),) * 2 if slides(j) else used_limits(j) for j in own]).T
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
    place, names, elements = np.eye(4), [joint.name for joint in chain if joint.moves], list[Element]()
    for joint in chain:
        place = place @ joint.origin.matrix()
        if not joint.moves:
            continue
        follows = following.get(joint.name)
        if follows is not None:
            values[joint.name] = follows.multiplier * values[follows.joint] + follows.offset
        elements.append(Element(place, joint.axis / np.linalg.norm(joint.axis), not slides(joint)))
        place = np.eye(4)
    count = len(elements)
    q = [values[name] for name in names]
    placed = frames(Chain(tuple(elements), tuple(range(count + 1))), q, len(q[0]))
    at = placed.origins[names.index(end)] if end else placed.point(count, place[:3, 3])
    first = next(e for e, element in enumerate(elements) if element.rotation)
    return np.asarray(np.linalg.norm(np.cross(placed.axes[first], at - placed.origins[first], axis=0), axis=0))
