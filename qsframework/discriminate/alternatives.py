"""Measure something different: other loads, a marker on the elbow or the base, absolute positions.

What more poses of one kind cannot separate, another kind of reading often can. Each offer is designed and judged like
the poses themselves: by the s and the angle that as many poses of it would reach.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.diagnose.linearization.candidates import REACH, Cause
from qsframework.discriminate.t_optimal import Question, Taken, ask, choose, told
from qsframework.errors import InputError, NotIdentifiable
from qsframework.estimation import scales
from qsframework.experiment import Experiment, LoadCase, Marker
from qsframework.experiment.setup import GEOMETRY, expand_name
from qsframework.plugin import Array, Indices, Poses
from qsframework.plugin.facts import frozen

OFFSET = 0.2
"""m: how far a proposed marker sits from the origin of its link, so that it sees the link turn."""
SEEN = 0.5
"""s below which an offer shows nothing worth saying."""
_STARTS = 2
Progress = Callable[[str, int, int], None]
Draw = Callable[[str, Experiment, int], Array]
"""Candidate poses (P, n), pendant angles, of a kind of reading: its name, its experiment, how many."""


@dataclass(frozen=True)
class Offer:
    """Another kind of reading, and the s and angle (rad) that as many poses of it would reach.

    other: the load or the marker that it takes, None for absolute positions
    """

    name: str
    other: LoadCase | Marker | None
    s: float
    angle: float


@dataclass(frozen=True, eq=False)
class Kind:
    """One kind of reading: the other load or marker (None: absolute positions), and the experiment that takes it."""

    name: str
    other: LoadCase | Marker | None
    experiment: Experiment


def batch(experiment: Experiment, pendant: Array) -> tuple[Poses, Indices, tuple[str, ...]]:
    """Every pose (P, n) under every load: the poses, the place of each, and the name of its load."""
    loads, count = experiment.loads, len(pendant)
    every = np.tile(pendant, (len(loads), 1))
    wrench = np.repeat(np.stack([load.wrench for load in loads]), count, axis=0)
    names = tuple(load.name for load in loads for _ in range(count))
    poses = Poses(every, experiment.robot.controller.to_joints(every), wrench)
    return poses, np.tile(np.arange(count), len(loads)), names


def kinds(experiment: Experiment) -> Iterator[Kind]:
    """What else this robot could be asked."""
    for load in _directions(experiment):
        yield Kind(f"load {load.name}", load, experiment.with_(loads=(load,)))
    middle = (experiment.robot.facts.n + 1) // 2
    for name, link in (("elbow", middle), ("base", 0)):
        marker = _marker(experiment, name, link)
        if marker is not None:
            yield Kind(f"{name} marker", marker, experiment.with_(markers=(*experiment.markers, marker)))
    yield Kind("absolute positions", None, experiment)


def _directions(experiment: Experiment) -> list[LoadCase]:
    """Six loads along the axes of the base, as large as the largest one of the experiment; none that is there."""
    have = np.stack([load.wrench for load in experiment.loads])
    part, unit = (slice(0, 3), "f") if have[:, :3].any() else (slice(3, 6), "m")
    size = float(np.linalg.norm(have[:, part], axis=1).max())
    out: list[LoadCase] = []
    for sign, word in ((1.0, "+"), (-1.0, "-")):
        for k, axis in enumerate("xyz"):
            wrench = np.zeros(6)
            wrench[part][k] = sign * size
            if not np.any(np.linalg.norm(have - wrench, axis=1) < 1e-6 * size):
                name = f"{size:.0f} N along {word}{axis}" if unit == "f" else f"{size:.0f} N m about {word}{axis}"
                out.append(LoadCase(name, frozen(wrench), None))
    return out


def _marker(experiment: Experiment, name: str, link: int) -> Marker | None:
    """A marker OFFSET away from the origin of a link of the chain; None where no URDF link rides on it."""
    frames = experiment.robot.frames
    own = experiment.robot.facts.links[link]
    carried = own if own in frames else next((n for n, f in frames.items() if f.link == link), None)
    taken = {m.name for m in experiment.markers}
    if carried is None or name in taken:
        return None
    return Marker(name, carried, frozen(np.full(3, OFFSET / np.sqrt(3.0))))


def offers(
    question: Question,
    experiment: Experiment,
    taken: Sequence[Taken],
    count: int,
    candidates: int,
    seed: int,
    others: Sequence[Cause],
    progress: Progress,
    draw: Draw,
) -> tuple[Offer, ...]:
    """Every other kind of reading with what it would reach, the best first."""
    found: list[Offer] = []
    every = list(kinds(experiment))
    there = question.taken(taken)
    for done, kind in enumerate(every):
        progress("something different", done, len(every))
        try:
            pendant = draw(kind.name, kind.experiment, candidates)
            found.append(_judged(kind, question, experiment, taken, there, count, pendant, seed, others))
        except (InputError, NotIdentifiable):
            continue  # the constraints leave too few poses, or the model has no geometry to fit
    progress("something different", len(every), len(every))
    return tuple(sorted(found, key=lambda o: -o.s))


def _judged(
    kind: Kind,
    question: Question,
    experiment: Experiment,
    taken: Sequence[Taken],
    there: Array,
    count: int,
    pendant: Array,
    seed: int,
    others: Sequence[Cause],
) -> Offer:
    poses, place, _ = batch(kind.experiment, pendant)
    if kind.other is None:
        rows, before, width = _absolute(question, experiment, taken, poses, others)
    else:
        known = dict(zip(question.model.names, question.x.tolist(), strict=True))
        asked = ask(
            kind.experiment,
            question.first,
            question.second,
            question.sigma,
            values=question.values,
            others=others,
            x=known,
        )
        rows, before, width = asked.rows(poses), there, question.width
    rows = rows.reshape(len(rows), -1, rows.shape[-1])
    s, angle = told(np.concatenate([before, rows.reshape(-1, rows.shape[-1])]), width)
    if s < SEEN:  # all of them together show nothing, so no choice does
        return Offer(kind.name, kind.other, s, angle)
    chosen = choose([rows], [before], count, place, seed, _STARTS)
    s, angle = told(np.concatenate([before, rows[chosen.index].reshape(-1, rows.shape[-1])]), width)
    return Offer(kind.name, kind.other, s, angle)


def _absolute(
    question: Question, experiment: Experiment, taken: Sequence[Taken], poses: Poses, others: Sequence[Cause]
) -> tuple[Array, Array, tuple[int, int]]:
    """Rows of positions in both states, with the geometry and a tracker's frame fitted, and those taken before.

    The geometry is known to REACH typical sizes beforehand. A displacement is the difference of two positions, whose
    noise is smaller by the square root of two.
    """
    wide = experiment.with_(fit=(*experiment.fit_names(), GEOMETRY))
    known = dict(zip(question.model.names, question.x.tolist(), strict=True))
    own = {e.name for e in wide.model().effects}
    first, second, *rest = (
        replace(c, present=c.present or c.name in own) for c in (question.first, question.second, *others)
    )
    asked = ask(wide, first, second, question.sigma, values=question.values, others=rest, x=known)
    geometry = set(expand_name(GEOMETRY, wide.model())).intersection(asked.known)
    sizes = asked.sizes.copy()
    at = [i for i, name in enumerate(asked.known) if name in geometry]
    sizes[at] = scales([asked.model.parameters[i] for i in asked.model.index([asked.known[i] for i in at])])
    asked = replace(asked, sizes=sizes)
    wanted = [*asked.known, *second.names, *first.names]
    parts: list[Array] = []
    for loaded in (False, True):
        slopes = asked.model.position_sensitivity(poses, asked.x, wanted, loaded)
        points = asked.model.positions(poses, asked.x, loaded)
        columns = asked.assembled(slopes)
        parts.append(np.concatenate([_frame(points), columns], axis=-1))
    rows = np.concatenate(parts, axis=1) * (np.sqrt(2.0) / question.sigma)
    before = np.pad(asked.taken(taken), ((0, 0), (6, 0)))
    stated = np.zeros((len(at), rows.shape[-1]))
    stated[np.arange(len(at)), 6 + np.array(at, dtype=int)] = 1.0 / REACH
    return rows, np.concatenate([before, stated]), (6 + len(asked.known), len(second.names))


def _frame(points: Array) -> Array:
    """Columns (N, K, 3, 6) of a small motion of the tracker's frame, for points (N, K, 3) m."""
    out = np.zeros((*points.shape, 6))
    out[..., :3] = np.eye(3)
    for k in range(3):
        out[..., 3 + k] = np.cross(np.eye(3)[k], points)
    return out
