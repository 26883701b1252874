"""Poses that the experiment allows: Sobol points in joint space, filtered by its constraints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from qsframework.elastostatics import Model, Site, flip_margin
from qsframework.elastostatics.state import place
from qsframework.errors import InputError
from qsframework.experiment import Experiment, Plan
from qsframework.plugin import Array, Poses

_BLOCK = 4096
_MOST = 200
Progress = Callable[[int, int], None]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Candidates:
    """N allowed poses, and how many of the tried points each constraint removed."""

    pendant: Array
    tried: int
    removed: dict[str, int]

    def __len__(self) -> int:
        return len(self.pendant)

    def words(self) -> str:
        """Which constraint removed how many, in one sentence."""
        parts = [f"{name} removed {count}" for name, count in self.removed.items() if count]
        return f"{self.tried} poses tried, {len(self)} allowed" + (": " + ", ".join(parts) if parts else "")


def generate_candidates(
    experiment: Experiment, count: int, seed: int = 0, progress: Progress | None = None
) -> Candidates:
    """`count` allowed poses, pendant angles (N, n) rad, the same for a seed.

    InputError, naming what each constraint removed, if the experiment allows too few.
    """
    from scipy.stats import qmc

    model = experiment.model()
    lower, upper = joint_range(experiment)
    sampler = qmc.Sobol(len(lower), scramble=True, rng=np.random.default_rng(seed))
    kept: list[Array] = []
    removed: dict[str, int] = {}
    tried = found = 0
    for _ in range(_MOST):
        pendant = lower + (upper - lower) * sampler.random(_BLOCK)
        good = np.ones(_BLOCK, dtype=bool)
        for name, allowed in check_poses(experiment, model, pendant).items():
            removed[name] = removed.get(name, 0) + int((good & ~allowed).sum())
            good &= allowed
        kept.append(pendant[good])
        tried, found = tried + _BLOCK, found + int(good.sum())
        if progress is not None:
            progress(min(found, count), count)
        if found >= count:
            break
    result = Candidates(np.concatenate(kept)[:count], tried, removed)
    if found < count:
        raise InputError(f"the experiment allows too few poses for {count} candidates: {result.words()}")
    return result


def joint_range(experiment: Experiment) -> tuple[Array, Array]:
    """Pendant angles (n,) between which poses are planned: the controller's limits and the experiment's."""
    controller = experiment.robot.controller
    lower, upper = np.array(controller.lower), np.array(controller.upper)
    for joint, (low, high) in experiment.constraints.joint_limits.items():
        k = experiment.robot.facts.joint_index(joint)
        lower[k], upper[k] = max(lower[k], low), min(upper[k], high)
        if lower[k] >= upper[k]:
            raise InputError(
                f"constraints leave no range for {joint}: the controller's limits and joint_limits exclude each other"
            )
    return lower, upper


def check_poses(experiment: Experiment, model: Model, pendant: Array) -> dict[str, Flags]:
    """For each constraint of the experiment, which poses (N,) keep it."""
    robot, limits = experiment.robot, experiment.constraints
    q = robot.controller.to_joints(pendant)
    poses = Poses(pendant, q, np.zeros((len(q), 6)))
    lower, upper = joint_range(experiment)
    tolerance = robot.controller.tolerance
    allowed = {
        "joint limits": ((pendant >= lower - tolerance) & (pendant <= upper + tolerance)).all(axis=1),
        "transmission angle": model.transmission_margin(poses) >= 0.0,
    }
    point = reference_point(experiment, model, q)
    if limits.z_min is not None:
        allowed["z_min"] = point[:, 2] >= limits.z_min
    if limits.axis1_distance_min is not None:
        allowed["axis1_distance_min"] = np.hypot(point[:, 0], point[:, 1]) >= limits.axis1_distance_min
    if limits.flip_margin is not None:
        allowed["flip_margin"] = np.ones(len(q), dtype=bool)
        for load in experiment.loads:
            loaded = Poses(pendant, q, np.tile(load.wrench, (len(q), 1)))
            allowed["flip_margin"] &= flip_margin(model, loaded) >= limits.flip_margin
    return allowed


def broken_constraints(experiment: Experiment, plan: Plan) -> dict[str, tuple[str, ...]]:
    """The poses of a plan that break a constraint of the experiment, by the constraint's name."""
    found = check_poses(experiment, experiment.model(), plan.pendant)
    names = {c: tuple(p for p, ok in zip(plan.pose, allowed, strict=True) if not ok) for c, allowed in found.items()}
    return {constraint: poses for constraint, poses in names.items() if poses}


def reference_point(experiment: Experiment, model: Model, q: Array) -> Array:
    """Base-frame position (N, 3) of the point that the workspace constraints speak of."""
    from qsframework.elastostatics.motion import move, nominal_actuators

    site = _site(experiment)
    layout = model.layout
    out = np.empty((len(q), 3))
    for start in range(0, len(q), _BLOCK):
        block = np.ascontiguousarray(q[start : start + _BLOCK].T)
        motion = move(layout, nominal_actuators(layout, block), np.zeros((layout.bars, block.shape[1])))
        out[start : start + _BLOCK] = place(motion, site, ()).tip.position.T
    return out


def _site(experiment: Experiment) -> Site:
    robot, of = experiment.robot, experiment.constraints.of
    if of == "wrist_centre":
        return Site(robot.facts.n - 1, np.zeros(3))
    if of == "load_point":
        return experiment.load_site
    frame = robot.flange if of == "flange" else robot.frames[of]
    return Site(frame.link, frame.placement[:3, 3])
