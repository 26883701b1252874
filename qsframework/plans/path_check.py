"""Is the way from pose to pose free? Joint motion in small steps, and poses in between where it is not.

The controller moves all joints at once along a straight line in its angles. On that line is asked what a designed pose
is asked, `check_way`: the pendant's limits, the angle that every loop needs between its bars, the arm's solids against
each other, the floor and the obstacles, and the box and the distance from axis 1 of the constraints. Where the straight
line is not free, poses in between are sought by two random trees that grow towards each other (RRT-Connect).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.experiment import Constraints, Experiment
from qsframework.plans.constraints import Flags, check_poses, check_way, touching
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen

_STEP = np.deg2rad(2.0)
_REACH = np.deg2rad(20.0)
"""How far a tree grows at once."""
_SPREAD = np.deg2rad(30.0)
_GROWTHS = 500
_SHORTCUTS = 60


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What a way must keep: the constraints of an experiment that hold between its poses too."""

    experiment: Experiment

    def broken(self, pendant: Array) -> dict[str, Flags]:
        """For each thing to keep, which of N pendant poses break it."""
        return {name: ~kept for name, kept in check_way(self.experiment, self.experiment.model(), pendant).items()}

    def named(self, pendant: Array) -> tuple[tuple[str, ...], ...]:
        """Of each of N pendant poses what it breaks: 'floor', 'collision' (link_2 and link_5)."""
        broken, solid = self.broken(pendant), touching(self.experiment, pendant)
        return tuple(
            tuple(
                f"{name!r} ({solid[name][i]})" if name in solid else repr(name)
                for name, hit in broken.items()
                if hit[i]
            )
            for i in range(len(pendant))
        )

    def free(self, pendant: Array) -> Flags:
        """Which of N pendant poses break nothing."""
        return ~np.logical_or.reduce(list(self.broken(pendant).values()))

    def way_is_free(self, first: Array, second: Array) -> bool:
        """Whether the joint motion from one pose to another breaks nothing."""
        return bool(self.free(stretch(first, second)).all())

    def loses_sight(self, first: Array, second: Array) -> bool:
        """Whether the tracker loses a marker on the straight way between two poses at which it sees all."""
        sight = self.experiment.constraints.sight
        if sight is None:
            return False
        alone = self.experiment.with_(constraints=Constraints(sight=sight, load_capacity=False))
        return not bool(check_poses(alone, alone.model(), stretch(first, second))["sight"].all())

    def range(self) -> tuple[Array, Array]:
        """Pendant angles (n,) between which poses in between may lie: the experiment's narrower limits count too."""
        controller, own = self.experiment.robot.controller, self.experiment.constraints.joint_limits
        joints = self.experiment.robot.facts.driven
        ends = [own.get(j, (-np.inf, np.inf)) for j in joints]
        low, high = np.array(ends).T
        return np.maximum(controller.lower, low), np.minimum(controller.upper, high)

    def in_the_way(self, first: Array, second: Array) -> str:
        """What the joint motion from one pose to another breaks."""
        return ", ".join(dict.fromkeys(word for words in self.named(stretch(first, second)) for word in words))


def stretch(first: Array, second: Array) -> Array:
    """Poses (N, n) on the straight line from one pose to another, no joint farther than two degrees apart."""
    count = max(2, int(np.ceil(np.abs(second - first).max() / _STEP)) + 1)
    return first + np.linspace(0.0, 1.0, count)[:, None] * (second - first)


def find_way(around: Surroundings, first: Array, second: Array, rng: np.random.Generator) -> tuple[Array, ...] | None:
    """Poses in between, none if the straight line is free; None where no way was found."""
    if around.way_is_free(first, second):
        return ()
    trees = [_Tree(first), _Tree(second)]
    lowest, highest = around.range()
    lowest, highest = np.minimum(lowest, np.minimum(first, second)), np.maximum(highest, np.maximum(first, second))
    lower, upper = np.minimum(first, second) - _SPREAD, np.maximum(first, second) + _SPREAD
    for k in range(_GROWTHS):
        wide = k >= _GROWTHS // 3
        low = lowest if wide else np.maximum(lower, lowest)
        high = highest if wide else np.minimum(upper, highest)
        grown, other = trees[k % 2], trees[1 - k % 2]
        new = grown.grow(rng.uniform(low, high), around)
        if new is None:
            continue
        met = other.reach(grown.points[new], around)
        if met is not None:
            ends = (grown.back(new), other.back(met))
            path = [*ends[0][::-1], *ends[1][1:]] if k % 2 == 0 else [*ends[1][::-1], *ends[0][1:]]
            return tuple(frozen(p) for p in _shortened(path, around, rng)[1:-1])
    return None


class _Tree:
    """Poses that a free way joins to a root."""

    def __init__(self, root: Array) -> None:
        self.points, self.parent = [root], [-1]

    def grow(self, towards: Array, around: Surroundings) -> int | None:
        """Go from the nearest pose towards another, as far as the reach; None where that is not free."""
        distance = np.abs(np.array(self.points) - towards).max(axis=1)
        near = int(np.argmin(distance))
        for reach in (_REACH, _REACH / 4.0):
            share = min(1.0, reach / max(float(distance[near]), 1e-12))
            new = towards if share == 1.0 else self.points[near] + share * (towards - self.points[near])
            if around.way_is_free(self.points[near], new):
                self.points.append(new)
                self.parent.append(near)
                return len(self.points) - 1
        return None

    def reach(self, towards: Array, around: Surroundings) -> int | None:
        """Grow until the pose is reached; None where something stands in the way."""
        while True:
            new = self.grow(towards, around)
            if new is None or np.array_equal(self.points[new], towards):
                return new

    def back(self, index: int) -> list[Array]:
        """From a pose back to the root."""
        out: list[Array] = []
        while index >= 0:
            out.append(self.points[index])
            index = self.parent[index]
        return out


def _shortened(path: list[Array], around: Surroundings, rng: np.random.Generator) -> list[Array]:
    """Leave out poses that the way does not need."""
    for _ in range(_SHORTCUTS):
        if len(path) < 3:
            break
        i, j = sorted(map(int, rng.choice(len(path), 2, replace=False)))
        if j - i > 1 and around.way_is_free(path[i], path[j]):
            path = path[: i + 1] + path[j:]
    return path
