"""Poses that the experiment allows: Sobol points in joint space, filtered by its constraints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from qsframework.design.constraints import broken_constraints, check_poses, joint_range, reference_point
from qsframework.errors import InputError
from qsframework.experiment import Experiment
from qsframework.plugin import Array

_BLOCK = 4096
_MOST = 200
Progress = Callable[[int, int], None]
__all__ = ["Candidates", "broken_constraints", "check_poses", "generate_candidates", "joint_range", "reference_point"]


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
