"""What every state of the day should read, and whether a reading is as expected: four questions to the markers of a
state, each with its own yardstick.

- Shape: markers of one link keep their distances.
- Place: the first state of a visit is where the arm should be, in a frame that earlier visits give. The arm's own
  errors of geometry are unknown; they move all markers of a visit together, and how far is learned from the visits.
- Repeat: at a pose that was visited before, the markers are where they were, within what an arm repeats.
- Motion: a later state of a visit differs from the earlier ones by what the load should bend, within what is known of
  the springs, which each accepted state tells better.

Everything is linear and Gaussian about the nominal arm: a level of 1e-5 leaves clean readings alone, and a mistake of
the table is many times larger.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from qsf_day.protocol import Protocol
from qsf_day.record import Slot
from qsframework.elastostatics import Model
from qsframework.estimation.linear_fit import Whitened
from qsframework.estimation.tails import chi2_sf, f_sf, normal_sf
from qsframework.experiment import Experiment, Frame, motion_rows, procrustes
from qsframework.plugin import Array, Poses
from qsframework.robot.kinematics import joint_frames
from qsframework.uses.inverse import poses_at

_SIGMA = 5e-5
"""m: noise of a coordinate where the experiment states none."""
_UNKNOWN = 0.5
"""Share of its nominal value by which a spring may be off where no sd is stated."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Expected:
    """The M markers of one link, that which carries most, at the N states of a day, base frame, m.

    names: of these markers; those of other links are stored and not judged; at: place of each state; poses: of the N
    states under their loads; place (N, M, 3): where the markers are; moved (N, M, 3): by how much the load moved them
    there; slope (N, M, 3, p): its rates by the springs, whose sds are spread (p,); rotation (N, 3, 3): of the markers'
    link; sigma, m: of a coordinate of a position; frames: series whose frame is known
    """

    experiment: Experiment
    model: Model
    protocol: Protocol
    names: tuple[str, ...]
    at: Mapping[Slot, int]
    poses: Poses
    place: Array
    moved: Array
    slope: Array
    spread: Array
    rotation: Array
    sigma: float
    frames: Mapping[str, Frame]

    @property
    def stated(self) -> Array:
        """The markers (M, 3) m in their link's frame, as the experiment states them."""
        return np.array([m.xyz for m in self.experiment.markers if m.name in self.names])

    def standing(self, pendant: Array) -> Array:
        """Where the markers are (N, M, 3) m at other angles (N, n) rad, without a load."""
        all_ = self.model.positions(poses_at(self.experiment.robot, pendant, np.zeros((len(pendant), 6))))
        return all_[:, [i for i, m in enumerate(self.experiment.markers) if m.name in self.names]]


def expected(experiment: Experiment, protocol: Protocol) -> Expected:
    """What the nominal arm would read at every state of a protocol."""
    model = experiment.model()
    slots = [Slot(v, k) for v, visit in enumerate(protocol.visits) for k in range(len(visit.states))]
    pendant = np.stack([protocol.visits[s.visit].pendant for s in slots])
    wrench = np.stack([protocol.visits[s.visit].states[s.state].wrench for s in slots])
    _, one, where = np.unique(np.round(np.hstack([pendant, wrench]), 9), axis=0, return_index=True, return_inverse=True)
    where = where.ravel()
    poses = poses_at(experiment.robot, pendant[one], wrench[one])
    names = experiment.spring_names()
    place = model.positions(poses, loaded=True)
    moved = place - model.positions(replace(poses, wrench=np.zeros_like(poses.wrench)))
    slope = model.sensitivity(poses, None, names) if names else np.zeros((*place.shape, 0))
    parameters = [model.parameters[i] for i in model.index(names)]
    spread = np.array([p.sd or _UNKNOWN * abs(p.nominal) or p.typical for p in parameters])
    links = [m.link for m in experiment.markers]
    carrier = max(dict.fromkeys(links), key=links.count)
    own = [i for i, name in enumerate(links) if name == carrier]
    link = experiment.site(carrier, np.zeros(3)).link
    rotation = joint_frames(model.facts, poses.q).matrix(link)
    return Expected(
        experiment=experiment,
        model=model,
        protocol=protocol,
        names=tuple(experiment.markers[i].name for i in own),
        at={s: i for i, s in enumerate(slots)},
        poses=poses_at(experiment.robot, pendant, wrench),
        place=place[where][:, own],
        moved=moved[where][:, own],
        slope=slope[where][:, own],
        spread=spread,
        rotation=np.asarray(rotation)[where],
        sigma=experiment.noise.position or experiment.noise.sigma or _SIGMA,
        frames={f.series: f for f in experiment.frames},
    )


Flags = npt.NDArray[np.bool_]
LEVEL = 1e-5
"""Chance below which a reading is not as expected."""
_TOOL = np.array([3e-3] * 3 + [5e-3] * 3)
"""m, rad: how far the markers' carrier may sit from where the experiment says."""
_ARM = np.array([2e-3] * 3 + [1.5e-3] * 3)
"""m, rad: how far the arm may stand from where its nominal geometry puts it; learned from the visits."""
_ARM_WEIGHT = 12.0
"""Degrees of freedom of this first guess."""
_STATED = 3e-3
"""m: how well the experiment knows the markers' places on their carrier."""
_KNOWN = np.array([1e-4] * 3 + [5e-5] * 3)
"""m, rad: how well a stated frame is known."""
_WANDER = 3e-5
"""m: what a state may drift, or not come back, beside the noise."""
_AGAIN = np.array([1.5e-4] * 3 + [1e-4] * 3)
"""m, rad: how far a heavy arm may stand from where it stood at the same pose before, warmer than it was."""
_LAW = 0.08
"""Share of a deflection by which a linear spring may be wrong about it."""
_FEW = 0.25
"""Share of a deflection below which it is asked whether that is too little."""
_FLAT = 0.02
"""m: markers nearer to a line than this hold no frame."""


@dataclass(frozen=True)
class Check:
    """One question: kind "shape", "place", "repeat" or "motion", the chance of so much, and how far off (m)."""

    kind: str
    p: float
    off: float


@dataclass(frozen=True)
class StateVerdict:
    """What the questions say of a state."""

    checks: tuple[Check, ...]

    @property
    def p(self) -> float:
        """The least chance; 1 where nothing could be asked."""
        return min((c.p for c in self.checks), default=1.0)

    @property
    def fine(self) -> bool:
        return self.p >= LEVEL


@dataclass(frozen=True, eq=False)
class StateReading:
    """A state as it was read: readings (M, 3) m of the markers, NaN where not read, in the frame `series`."""

    slot: Slot
    xyz: Array
    series: str

    @property
    def read(self) -> Flags:
        """Which markers (M,) were read."""
        return np.asarray(np.isfinite(self.xyz).all(axis=1), dtype=np.bool_)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Placed:
    """The frame of a series from the visits, and how far a new visit may be from it.

    mean (12,), cov (12, 12): motion of the frame and of the carrier; scale: of the arm's own errors, with its freedom
    """

    frame: Frame
    mean: Array
    cov: Array
    scale: float
    freedom: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Known:
    """What the accepted states tell: the carrier's shape (M, 3), how many gave it, frames, and the springs."""

    expected: Expected
    states: tuple[StateReading, ...]
    shape: Array
    shapes: int
    placed: dict[str, _Placed]
    springs: Array
    spring_cov: Array

    def place(self, slot: Slot) -> Array:
        """Where the markers should be (M, 3), base frame, their carrier's shape as it was seen."""
        P = self.expected.place[self.expected.at[slot]]
        return _laid(P, self.shape) if self.shapes else P


def known(expected: Expected, states: Sequence[StateReading]) -> Known:
    """What accepted states tell, in the order in which they were read."""
    stated = expected.stated
    complete = [_laid(stated, s.xyz) for s in states if s.read.all() and _spread(stated)]
    start = Known(
        expected=expected,
        states=tuple(states),
        shape=np.mean(complete, axis=0) if complete else stated,
        shapes=len(complete),
        placed={},
        springs=np.zeros(len(expected.spread)),
        spring_cov=np.diag(expected.spread**2),
    )
    # a frame that the experiment states holds before anything was read in it
    cov = np.diag(np.concatenate([_KNOWN, _TOOL]) ** 2)
    placed = {
        name: _Placed(frame=frame, mean=np.zeros(12), cov=cov, scale=1.0, freedom=_ARM_WEIGHT)
        for name, frame in expected.frames.items()
    }
    frames = {series: _frame(start, series) for series in dict.fromkeys(s.series for s in states)}
    placed |= {name: frame for name, frame in frames.items() if frame is not None}
    return _springs(replace(start, placed=placed))


def judge(known: Known, state: StateReading, share: float = 1.0, shift: Array | None = None) -> StateVerdict:
    """The questions to the readings of a state.

    share: of the load that hangs there; shift (M, 3) m, base frame: what else moved the markers
    """
    checks = [_check_shape(known, state)]
    before = [s for s in known.states if s.slot.visit == state.slot.visit and s.series == state.series]
    before = [s for s in before if s.slot != state.slot and (s.read & state.read).any()]
    if before:
        checks.append(_check_motion(known, state, before, share, shift))
    else:
        checks += [_check_place(known, state, share, shift), _check_repeat(known, state, shift)]
    return StateVerdict(tuple(c for c in checks if c is not None))


def _laid(onto: Array, points: Array) -> Array:
    """Points (M, 3) moved rigidly onto others; as they are where they are too few to say how."""
    return procrustes(points, onto).apply(points) if _spread(points) else onto


def _spread(points: Array) -> bool:
    """Whether points (M, 3) hold a frame."""
    return len(points) >= 3 and float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1]) > _FLAT


def _rows(known: Known, state: StateReading, frame: Frame, place: Array) -> tuple[Array, Array]:
    """Columns (3 m, 12) of frame and carrier, and of the visit's own motion (3 m, 6), of the markers that were read."""
    e, i = known.expected, known.expected.at[state.slot]
    there, centre = frame.apply(place), frame.apply(place.mean(axis=0)[None])[0]
    own = motion_rows(there - centre)
    turned = frame.rotation @ e.rotation[i]
    carrier = np.concatenate([own[:, :3] @ turned, own[:, 3:] @ turned], axis=1)
    rows = np.repeat(state.read, 3)
    return np.concatenate([motion_rows(there - frame.origin), carrier], axis=1)[rows], own[rows]


def _frame(known: Known, series: str) -> _Placed | None:
    """The frame by the first accepted state of every visit, generalised least squares; None where it cannot be told."""
    e = known.expected
    first: dict[int, StateReading] = {}
    for s in known.states:
        if s.series == series and s.read.any():
            first.setdefault(s.slot.visit, s)
    places = [known.place(s.slot) for s in first.values()]
    points = np.concatenate([p[s.read] for p, s in zip(places, first.values(), strict=True)])
    readings = np.concatenate([s.xyz[s.read] for s in first.values()])
    if not _spread(points) or not _spread(readings):
        return None
    stated = e.frames.get(series)
    frame = stated or procrustes(points, readings, series)
    weight = np.concatenate([np.zeros(6) if stated is None else 1.0 / _KNOWN**2, 1.0 / _TOOL**2])
    blocks: list[tuple[Array, Array, Array]] = []
    for s, place in zip(first.values(), places, strict=True):
        H, own = _rows(known, s, frame, place)
        blocks.append((H, own, (s.xyz - frame.apply(place))[s.read].ravel()))
    more = max(6.0 * len(blocks) - 12.0, 0.0)
    mean, cov, square = _solved(e.sigma, known.shapes, blocks, weight, 1.0)
    scale = float(np.sqrt((_ARM_WEIGHT + square) / (_ARM_WEIGHT + more)))
    mean, cov, square = _solved(e.sigma, known.shapes, blocks, weight, scale)
    scale = float(np.sqrt((_ARM_WEIGHT + square) / (_ARM_WEIGHT + more)))
    return _Placed(frame=frame, mean=mean, cov=cov, scale=scale, freedom=_ARM_WEIGHT + more)


def _solved(
    sigma: float, shapes: int, blocks: Sequence[tuple[Array, Array, Array]], weight: Array, scale: float
) -> tuple[Array, Array, float]:
    """Motions of frame and carrier (12,) by generalised least squares over visits (columns, own motion, residual),
    their covariance, and the squares that the visits' own motions are left with."""
    told = [(r, H, _covariance(sigma, own, scale, shapes)) for H, own, r in blocks]
    mean, cov = _likeliest(told, np.sqrt(weight))
    square = 0.0
    for H, own, r in blocks:
        Q = np.linalg.qr(own)[0]
        left = Q.T @ (r - H @ mean)
        square += float(left @ np.linalg.solve(Q.T @ _covariance(sigma, own, 1.0, shapes) @ Q, left))
    return mean, cov, square


def _covariance(sigma: float, own: Array, scale: float, shapes: int) -> Array:
    """Of the markers of a visit (3 m, 3 m): the arm's own motion, the carrier's shape, the noise."""
    shape = sigma**2 / shapes if shapes else _STATED**2
    return (own * (scale * _ARM) ** 2) @ own.T + (sigma**2 + shape) * np.eye(len(own))


def _likeliest(told: Sequence[tuple[Array, Array, Array]], held: Array) -> tuple[Array, Array]:
    """Parameters (p,) by generalised least squares of blocks (residual, columns, covariance), each held to zero by
    1 / sd (p,), and their covariance."""
    back = [np.linalg.inv(np.linalg.cholesky(C)) for _, _, C in told]
    A = np.concatenate([B @ J for B, (_, J, _) in zip(back, told, strict=True)])
    y = np.concatenate([B @ r for B, (r, _, _) in zip(back, told, strict=True)])
    x, half = Whitened(A, y, held=held).solved(np.ones(len(y)))
    return x, half @ half.T


def _springs(known: Known) -> Known:
    """The springs after every accepted state that differs from an earlier one of its visit."""
    told: list[tuple[Array, Array, Array]] = []
    for i, s in enumerate(known.states):
        before = [b for b in known.states[:i] if b.slot.visit == s.slot.visit and b.series == s.series]
        made = _difference(known, s, before, 1.0, None)
        told += [] if made is None else [made[:3]]
    if not told or not len(known.springs):
        return known
    x, cov = _likeliest(told, 1.0 / known.expected.spread)
    return replace(known, springs=x, spring_cov=cov)


def _difference(
    known: Known, state: StateReading, before: Sequence[StateReading], share: float, shift: Array | None
) -> tuple[Array, Array, Array, Array] | None:
    """Residual (3 m,) of what a state differs by from earlier ones, its rates by the springs, its covariance without
    theirs, and what the springs as known would give; None where no frame is known."""
    e, i, placed = known.expected, known.expected.at[state.slot], known.placed.get(state.series)
    if not before or placed is None:
        return None
    still = [b for b in before if not e.moved[e.at[b.slot]].any()] or list(before)
    start = np.array([b.xyz for b in still])
    count = np.isfinite(start).all(axis=2).sum(axis=0)
    rows = (count > 0) & state.read
    if not rows.any():
        return None
    was = np.nansum(np.nan_to_num(start), axis=0)[rows] / count[rows, None]
    at = [e.at[b.slot] for b in still]
    R = placed.frame.rotation
    slope = share * e.slope[i] - e.slope[at].mean(axis=0)
    moved = share * e.moved[i] - e.moved[at].mean(axis=0)
    shift = np.zeros_like(moved) if shift is None else shift
    J = np.einsum("ab,mbp->map", R, slope[rows]).reshape(3 * int(rows.sum()), -1)
    D = (moved + shift)[rows] @ R.T
    bent = J @ known.springs
    r = (state.xyz[rows] - was - D).ravel() - bent
    law = _LAW * float(np.linalg.norm(moved[rows], axis=1).max(initial=0.0))
    common = np.tile(np.eye(3), (int(rows.sum()), 1))
    own = np.repeat(e.sigma**2 * (1.0 + 1.0 / count[rows]), 3)
    C = np.diag(own + 0.25 * law**2) + (_WANDER**2 + law**2) * common @ common.T
    return r, J, C, D.ravel() + bent


def _check_motion(
    known: Known, state: StateReading, before: Sequence[StateReading], share: float, shift: Array | None
) -> Check | None:
    made = _difference(known, state, before, share, shift)
    if made is None:
        return None
    r, J, C, D = made
    S = J @ known.spring_cov @ J.T + C
    square = float(r @ np.linalg.solve(S, r))
    p = min(float(chi2_sf(square, len(r))), _too_little(r, J, C, D, known.spring_cov))
    return Check("motion", p, float(np.sqrt(3.0 * np.mean(r**2))))


def _too_little(r: Array, J: Array, C: Array, D: Array, cov: Array) -> float:
    """Chance of a share of the expected deflection D as small as was read; 1 where it is not small.

    A spring that is known to 30 % may as well be stiffer by a third as softer; it is hardly ten times as stiff, as a
    Gaussian would have it. So the share's logarithm is asked.
    """
    weight = np.linalg.solve(C, D)
    size = float(D @ weight)
    if size < (1.0 / _FEW) ** 2:
        return 1.0
    share = 1.0 + float(weight @ r) / size
    sd = float(np.sqrt(weight @ (J @ cov @ J.T) @ weight)) / size
    if share > _FEW:
        return 1.0
    noise = 2.0 / float(np.sqrt(size))
    least = -float(np.log(max(share, noise, 1e-3))) / float(np.hypot(sd, noise))
    return float(normal_sf(least))


def _check_place(known: Known, state: StateReading, share: float, shift: Array | None) -> Check | None:
    e, i, placed = known.expected, known.expected.at[state.slot], known.placed.get(state.series)
    read = state.read
    if placed is None or not read.any():
        return None
    place = known.place(state.slot) + (share - 1.0) * e.moved[i] + (0.0 if shift is None else shift)
    H, own = _rows(known, state, placed.frame, place)
    r = (state.xyz - placed.frame.apply(place))[read].ravel() - H @ placed.mean
    Q, R = np.linalg.qr(own)
    Q = Q[:, np.abs(np.diag(R)) > 1e-6]
    S = _covariance(e.sigma, own, placed.scale, known.shapes) + H @ placed.cov @ H.T
    left = Q.T @ r
    square = float(left @ np.linalg.solve(Q.T @ S @ Q, left))
    p = float(f_sf(square / len(left), len(left), placed.freedom))
    return Check("place", p, float(np.sqrt(3.0 * np.mean(r**2))))


def _check_repeat(known: Known, state: StateReading, shift: Array | None) -> Check | None:
    """A state against those of earlier visits of its pose under the same load."""
    e, visits = known.expected, known.expected.protocol.visits
    pose, wrench = visits[state.slot.visit].pose, e.poses.wrench[e.at[state.slot]]
    alike = [s for s in known.states if s.series == state.series and visits[s.slot.visit].pose == pose]
    before = [s for s in alike if np.array_equal(e.poses.wrench[e.at[s.slot]], wrench)]
    rows = state.read & np.any([s.read for s in before], axis=0)
    if not rows.any():
        return None
    there = state.xyz[rows]
    r: Array = there - np.asarray(np.nanmean([s.xyz[rows] for s in before], axis=0), dtype=np.float64)
    if shift is not None and state.series in known.placed:
        r = r - shift[rows] @ known.placed[state.series].frame.rotation.T
    own = motion_rows(there - there.mean(axis=0)) * _AGAIN
    S = own @ own.T + 2.0 * e.sigma**2 * np.eye(3 * len(there))
    square = float(r.ravel() @ np.linalg.solve(S, r.ravel()))
    return Check("repeat", float(chi2_sf(square, r.size)), float(np.sqrt(3.0 * np.mean(r**2))))


def _check_shape(known: Known, state: StateReading) -> Check | None:
    """The distances of the markers against those of the shape, the worst of them, counted as the best of many."""
    xyz, pairs = state.xyz, list(combinations(np.flatnonzero(state.read).tolist(), 2))
    if not pairs:
        return None
    sigma = known.expected.sigma
    sd = np.sqrt(2.0) * (np.hypot(sigma, sigma / np.sqrt(known.shapes)) if known.shapes else _STATED)
    off = [np.linalg.norm(xyz[a] - xyz[b]) - np.linalg.norm(known.shape[a] - known.shape[b]) for a, b in pairs]
    worst = float(np.abs(off).max())
    return Check("shape", min(1.0, 2.0 * len(pairs) * float(normal_sf(worst / float(sd)))), worst)
