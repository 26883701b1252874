"""Poses that the experiment allows: Sobol points, a grid or a file, filtered by its constraints.

Sobol points fill the unit cube evenly, and go on where they stopped. Point n is the exclusive or of the direction
numbers that the bits of n ^ (n >> 1) name, with a random shift; the numbers' bits are mixed by a random lower triangle
(Matousek 1998). They are SciPy's points, without the second that importing scipy.stats takes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import islice, product
from pathlib import Path

import numpy as np

from qsframework.errors import InputError
from qsframework.experiment import Experiment, read_poses
from qsframework.information import information, information_rows
from qsframework.plans.constraints import (
    broken_constraints,
    check_contact,
    check_poses,
    count_removed,
    joint_range,
    reference_point,
)
from qsframework.plans.symmetry import canonical, fold
from qsframework.plugin import Array, Indices, Poses
from qsframework.work import HERE, Work, run

_BLOCK = 4096
_LEAST_TRIED = 200
_MOST_GRID = 20_000_000
_CONTACT = {"collision", "obstacles"}
"""Constraints that take longest to tell: they are asked of the poses that keep all others."""
Progress = Callable[[int, int], None]
__all__ = [
    "Candidates",
    "broken_constraints",
    "check_poses",
    "filter_candidates",
    "generate_candidates",
    "grid_candidates",
    "joint_range",
    "read_candidates",
    "reference_point",
]
_BITS = 30
_DIRECTIONS = (
    (3, (1,)),
    (7, (1, 3)),
    (11, (1, 3, 1)),
    (13, (1, 1, 1)),
    (19, (1, 1, 3, 3)),
    (25, (1, 3, 5, 13)),
    (37, (1, 1, 5, 5, 17)),
    (41, (1, 1, 5, 5, 5)),
    (47, (1, 1, 7, 11, 19)),
    (55, (1, 1, 5, 1, 1)),
    (59, (1, 1, 1, 3, 11)),
    (61, (1, 3, 5, 5, 31)),
    (67, (1, 3, 3, 9, 7, 49)),
    (91, (1, 1, 1, 15, 21, 21)),
    (97, (1, 3, 1, 13, 27, 49)),
)
"""Primitive polynomials, as bits, and first numbers of the axes from the second on: Joe and Kuo, 2008."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """N allowed poses, and how many of the tried points each constraint removed after those before it.

    alone: how many each constraint would have removed by itself; only: those that break nothing else. Contact is asked
    last, of the poses that keep all else
    """

    pendant: Array
    tried: int
    removed: dict[str, int]
    alone: dict[str, int]
    only: dict[str, int]

    def __len__(self) -> int:
        return len(self.pendant)

    @property
    def summary(self) -> str:
        """How many poses were tried, and how many keep the constraints."""
        return f"{self.tried} poses tried, {len(self)} allowed"

    def words(self) -> str:
        """The summary, and which constraint excludes how many poses."""
        others = "all others but contact" if _CONTACT & self.removed.keys() else "all others"
        parts = [
            f"{name}, asked last, excludes {self.alone[name]}"
            if name in _CONTACT
            else f"{name} excludes {self.alone[name]}, {self.only[name]} of which keep {others}"
            for name in self.removed
            if self.alone[name]
        ]
        return "; ".join([self.summary, *parts])


def generate_candidates(
    experiment: Experiment, count: int, seed: int = 0, progress: Progress | None = None, work: Work = HERE
) -> Candidates:
    """`count` allowed poses of a Sobol sequence, pendant angles (N, n) rad, the same for a seed.

    Poses that the wrist's flip makes equal are folded into one. InputError, naming what each constraint
    removed, if the experiment allows too few.
    """
    lower, upper = joint_range(experiment)
    most = max(_LEAST_TRIED, 100 * count // _BLOCK)
    blocks = islice(sobol_blocks(len(lower), _BLOCK, seed), most)
    points = (snapped(experiment, lower + (upper - lower) * block) for block in blocks)
    result = _collect(experiment, points, count, progress, folds(experiment), work)
    if len(result) < count:
        raise InputError(f"the experiment allows too few poses for {count} candidates: {result.words()}")
    return result


def snapped(experiment: Experiment, pendant: Array) -> Array:
    """Poses (N, n) with the joints of `joint_values` at the nearest of their stated angles."""
    out = pendant.copy()
    for joint, values in experiment.constraints.joint_values.items():
        k = experiment.robot.facts.joint_index(joint)
        stated = np.array(sorted(values))
        low, high = joint_range(experiment)
        share = (out[:, k] - low[k]) / (high[k] - low[k])
        out[:, k] = stated[np.minimum((share * len(stated)).astype(int), len(stated) - 1)]
    return out


def grid_candidates(
    experiment: Experiment, levels: int, progress: Progress | None = None, work: Work = HERE
) -> Candidates:
    """The allowed poses of a full grid with `levels` angles of each joint between its limits."""
    lower, upper = joint_range(experiment)
    total = levels ** len(lower)
    if levels < 2 or total > _MOST_GRID:
        raise InputError(f"a grid needs 2 or more levels and at most {_MOST_GRID:,} poses; {levels} give {total:,}")
    axes = [np.linspace(float(low), float(high), levels) for low, high in zip(lower, upper, strict=True)]
    inner = np.array(list(product(*axes[-3:])))
    outer = list(product(*axes[:-3]))
    step = max(1, _BLOCK // len(inner))
    blocks = (
        np.concatenate([np.hstack([np.tile(first, (len(inner), 1)), inner]) for first in outer[i : i + step]])
        for i in range(0, len(outer), step)
    )
    points = (snapped(experiment, block) for block in blocks)
    result = _collect(experiment, points, total, progress, folds(experiment), work)
    first = np.sort(np.unique(np.round(result.pendant, 9), axis=0, return_index=True)[1])
    return filled(experiment, replace(result, pendant=result.pendant[first]))


def read_candidates(experiment: Experiment, path: str | Path) -> Candidates:
    """The allowed poses of a file with columns pose, q1_deg, ...: InputError if none is allowed."""
    return filter_candidates(experiment, read_poses(path, experiment).pendant)


def filter_candidates(experiment: Experiment, pendant: Array) -> Candidates:
    """Those of the poses (N, n) that the experiment allows, unchanged and in their order."""
    blocks = (pendant[i : i + _BLOCK] for i in range(0, len(pendant), _BLOCK))
    return filled(experiment, _collect(experiment, blocks, len(pendant), None, False))


def filled(experiment: Experiment, result: Candidates) -> Candidates:
    """The candidates, or an InputError where nothing is allowed."""
    if not len(result):
        raise InputError(f"{experiment.path}: no pose keeps the constraints: {result.words()}")
    return result


def folds(experiment: Experiment) -> bool:
    """Whether a pose and its canonical form tell the same, asked of the model at a sample of poses and every load;
    never of positions, where the flip of a wrist tells its zeros."""
    if experiment.plans_positions:
        return False
    lower, upper = joint_range(experiment)
    pendant = lower + (upper - lower) * np.random.default_rng(0).random((16, len(lower)))
    other, model, names = canonical(experiment, pendant), experiment.model(), experiment.fit_names()
    both = np.concatenate([pendant, other])
    q = experiment.robot.controller.to_joints(both)
    for load in experiment.loads:
        rows = information_rows(model, Poses(both, q, np.tile(load.wrench, (len(both), 1))), names, 1.0)
        for pair in information(rows).reshape(2, len(pendant), len(names), len(names)).swapaxes(0, 1):
            if len(fold(pair, 1e-7)[0]) > 1:
                return False
    return bool(experiment.loads)


def _checked(shared: tuple[Experiment, Experiment, bool], points: Array) -> tuple[int, Array, dict[str, Indices]]:
    """How many poses a block has, those that are allowed, and how many each constraint removed: as in `Removal`.

    Contact is asked of those that keep all else. shared: the experiment without what may touch, and with it; whether
    to fold
    """
    bare, experiment, folded = shared
    pendant = canonical(experiment, points) if folded else points
    allowed = check_poses(bare, bare.model(), pendant)
    rest = np.logical_and.reduce(list(allowed.values()))
    asked = np.flatnonzero(rest) if rest.any() else np.zeros(1, dtype=np.intp)
    for name, clear in check_contact(experiment, pendant[asked]).items():
        allowed[name] = np.ones(len(pendant), dtype=bool)
        allowed[name][asked] = clear | ~rest[asked]
    removed = {name: np.array(counts) for name, counts in count_removed(allowed).items()}
    return len(points), pendant[np.logical_and.reduce(list(allowed.values()))], removed


def _collect(
    experiment: Experiment,
    blocks: Iterable[Array],
    count: int,
    progress: Progress | None,
    folded: bool,
    work: Work = HERE,
) -> Candidates:
    kept: list[Array] = [np.zeros((0, experiment.robot.controller.axes))]
    total: dict[str, Indices] = {}
    tried = allowed = 0
    bare = experiment.with_(constraints=replace(experiment.constraints, collision=False, obstacles=()))
    with closing(run(_checked, (bare, experiment, folded), blocks, work)) as results:
        for asked, part, removed in results:
            total |= {name: total.get(name, 0) + counts for name, counts in removed.items()}
            kept.append(part)
            tried, allowed = tried + asked, allowed + len(part)
            if progress is not None:
                progress(min(allowed, count), count)
            if allowed >= count:
                break
    in_order, alone, only = ({name: int(counts[k]) for name, counts in total.items()} for k in range(3))
    return Candidates(np.concatenate(kept)[:count], tried, in_order, alone, only)


def sobol_blocks(axes: int, block: int, seed: int) -> Iterator[Array]:
    """Blocks (block, axes) of the sequence of a seed, without an end. InputError for more axes than the table has."""
    if axes > 1 + len(_DIRECTIONS):
        raise InputError(f"candidates are drawn for at most {1 + len(_DIRECTIONS)} joints, found {axes}; give poses")
    (rng,), powers = np.random.default_rng(seed).spawn(1), 2 ** np.arange(_BITS)
    shift = rng.integers(2, size=(axes, _BITS), dtype=np.uint32) @ powers
    triangle = np.tril(rng.integers(2, size=(axes, _BITS, _BITS), dtype=np.uint32), -1) + np.eye(_BITS, dtype=np.uint32)
    bits = _numbers(axes)[:, :, None] >> np.arange(_BITS)[::-1] & 1
    mixed = np.einsum("dpk,djk->djp", triangle, bits) % 2 @ powers[::-1]
    first = 0
    while True:
        n = np.arange(first, first + block)
        named = (n ^ n >> 1)[:, None] >> np.arange(_BITS) & 1
        points = np.bitwise_xor.reduce(np.where(named[:, None], mixed, 0), axis=2) ^ shift
        yield points / 2.0**_BITS
        first += block


def _numbers(axes: int) -> Indices:
    """Direction numbers (axes, _BITS), the highest bit that of a half."""
    rows = [[1] * _BITS]
    for polynomial, start in _DIRECTIONS[: axes - 1]:
        degree, row = len(start), list(start)
        for j in range(degree, _BITS):
            number = row[j - degree]
            for k in range(degree):
                number ^= row[j - k - 1] << k + 1 if polynomial >> degree - 1 - k & 1 else 0
            row.append(number)
        rows.append(row)
    return np.array(rows) << np.arange(_BITS)[::-1]
