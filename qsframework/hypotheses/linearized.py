"""Linear fits about the nominal arm: to try changes of the readings on, and without the rows that do not agree.

What disagrees are rows, or whole visits of the arm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from qsframework.elastostatics import Model
from qsframework.errors import NotIdentifiable
from qsframework.estimation import LinearFit, Noise, left, orthonormal, rank_test, rms, scales
from qsframework.estimation.linear_fit import Agreed, Beyond, Whitened, without_outliers
from qsframework.estimation.noise import Blocks, Independent
from qsframework.estimation.projection import Flags, least_squares
from qsframework.experiment import Experiment, Frame, ObservationModel, Readings, observation_model
from qsframework.experiment.frames import motion_count
from qsframework.experiment.observations import ReadingRows, start_values
from qsframework.plugin import Array, Conditions, Geometry, Indices, Poses, Sensor

_BELOW = 2.0
"""sds below its bound from which a compliance speaks against a convention."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimates:
    """Fitted parameters about their nominal values: x (p,) and covariance (p, p) in their scales, as no bound holds
    them; how many compliances are then below theirs; white (m,): whitened residuals of the fit within all bounds, with
    dof degrees of freedom; rms (m): of these residuals."""

    x: Array
    covariance: Array
    below: int
    white: Array
    dof: int
    rms: float

    @property
    def sd(self) -> Array:
        return np.sqrt(np.diag(self.covariance))

    @property
    def chi2(self) -> float:
        """Sum of squares that the fit within all bounds leaves."""
        return float(self.white @ self.white)


@dataclass(frozen=True, eq=False)
class Linearized:
    """m measured coordinates about the nominal arm in its best frames: scaled sensitivities `slopes` (m, p), of frames
    and of the fitted parameters, and `errors` (m,) m, measured less nominal.

    stated: whether the size of the noise is known
    """

    experiment: Experiment
    rows: ReadingRows
    slopes: Array
    errors: Array
    noise: Independent | Blocks
    stated: bool

    @property
    def readings(self) -> Readings:
        return self.rows.readings

    @property
    def keep(self) -> Indices:
        """Places (R,) of the rows in the readings."""
        return self.rows.keep

    @property
    def row(self) -> Indices:
        """The row (m,) of each coordinate."""
        return self.rows.row

    @cached_property
    def fit(self) -> LinearFit:
        """Of all columns, as no bound holds them."""
        return LinearFit.of(self.slopes, self.errors, self.noise, self.stated)

    @cached_property
    def estimates(self) -> Estimates:
        """The fitted parameters within their bounds; what the readings do not tell stays at its nominal value.

        Within bounds, since with the sign of all displacements reversed springs fit as well, but with negative
        compliances.
        """
        model, names = self.experiment.model(), self.experiment.fit_names()
        chosen = [model.parameters[i] for i in model.index(names)]
        size = scales(chosen)
        white = self.noise.whiten(self.slopes)
        frames = orthonormal(white[:, : -len(chosen)])  # displacements do not tell where the origin lies
        A, target = left(frames, white[:, -len(chosen) :]), left(frames, self.noise.whiten(self.errors))
        U, values, V = np.linalg.svd(A, full_matrices=False)
        told = values > 1e-9 * values[0]
        U, values, V = U[:, told], values[told], V[told]
        z = U.T @ target
        start = np.array([p.nominal for p in chosen]) / size
        low, high = (np.array([getattr(p, end) for p in chosen]) / size - start for end in ("lower", "upper"))
        free = V.T @ (z / values)
        rest = target - U @ (values * (V @ _within(values[:, None] * V, z, free, low, high)))
        dof = len(target) - len(values) - frames.shape[1]
        C = (V.T / values**2) @ V * np.square(left(U, target)).sum() / dof
        sd = np.sqrt(np.diag(C))
        return Estimates(
            x=start + free,
            covariance=C,
            below=int((~np.isclose(sd, 0.0) & (free < low - _BELOW * sd)).sum()),
            white=rest,
            dof=dof,
            rms=rms(self.noise.colour(rest)),
        )


def _within(R: Array, z: Array, free: Array, low: Array, high: Array) -> Array:
    """Least squares |R d - z| with low <= d <= high; `free` is the solution without the bounds."""
    if np.all((free >= low) & (free <= high)):
        return free
    from scipy.optimize import lsq_linear

    wide = np.where(high > low, high, low + 1e-12)
    return lsq_linear(R, z, (low, wide), method="bvls").x


def linear_model(experiment: Experiment, readings: Readings, rows: ReadingRows | None = None) -> ObservationModel:
    """The experiment's parameters at their nominal values, in frames that suit the readings."""
    return observation_model(experiment, readings, experiment.fit_names(), linear=True, rows=rows)


def linearized(experiment: Experiment, readings: Readings) -> Linearized:
    """The experiment's parameters about their nominal values. NotIdentifiable where the readings identify none, or are
    no more than what they identify: nothing contradicts them then."""
    fit = of_observations(experiment, linear_model(experiment, readings))
    if fit.fit.dof <= 0:
        raise NotIdentifiable(
            f"{len(fit.errors)} numbers were read for as many parameters and frames: measure more poses, or fit fewer"
        )
    return fit


def of_observations(experiment: Experiment, seen: ObservationModel) -> Linearized:
    """The same about the values and frames of a bridge."""
    rows = seen.rows
    rates = rows.rates(seen.model, seen.x, seen.frames, seen.names, linear=True)
    slopes, errors = _columns(rows, rates, scales(list(seen.parameters)))
    if not rank_test(rows.noise.whiten(slopes), [p.name for p in seen.parameters]).rank:
        raise NotIdentifiable(unseen=[p.name for p in seen.parameters])
    return Linearized(experiment, rows, slopes, errors, rows.noise, rows.stated)


def at_solution(experiment: Experiment, readings: Readings) -> float:
    """RMS (m) of what some steps of Gauss and Newton leave, each within bounds and shortened until it helps: at the
    solution, not at the guess; where readings hardly tell a direction nothing moves along it."""
    seen = linear_model(experiment, readings)
    rows, size = seen.rows, scales(list(seen.parameters))
    low, high = (np.array([getattr(p, end) for p in seen.parameters]) for end in ("lower", "upper"))
    least, z = np.inf, np.clip(seen.start, low, high)
    for _ in range(_STEPS):
        predicted, J = seen.rates(z)
        errors = rows.noise.whiten(rows.scalars - predicted)
        step = size * least_squares(rows.noise.whiten(J * size), errors, _WEAK)
        before = float(np.linalg.norm(errors))
        for share in _SHARES:
            there = np.clip(z + share * step, low, high)
            left_over = rows.scalars - seen.predict(there)
            if float(np.linalg.norm(rows.noise.whiten(left_over))) < before:
                break
        else:
            return min(least, rms(rows.scalars - predicted))
        z, least = there, rms(left_over)
    return least


_STEPS, _WEAK, _SHARES = 6, 1e-5, (1.0, 0.5, 0.2, 0.05)
"""Steps; share of the largest singular value below which a direction is not told; and shares of a step."""


def _columns(rows: ReadingRows, rates: tuple[Array, Array], scale: Array) -> tuple[Array, Array]:
    """Sensitivities (m, p) m to parameters of these scales, and errors (m,) m, from the `rates` of rows."""
    predicted, J = rates
    return rows.flat(J) * scale, rows.scalars - rows.flat(predicted)


def agreed(
    seen: ObservationModel, of: Indices, beyond: Beyond, noise: Noise, scale: Array, held: Array
) -> tuple[Agreed, tuple[Frame, ...]]:
    """The fit to the blocks of rows, by number (R,), that agree, and the frames about which its motions are counted:
    those that suit these blocks. beyond: as `without_outliers` asks it; scale, held (p,): of the parameters."""
    rows, frames, asked = seen.rows, seen.frames, (seen.model, seen.x)
    pairs = rows.pairs is not None
    # asked once: neither what pairs say nor where the markers stand depends on the frames
    known = rows.rates(*asked, (), seen.names, True) if pairs else rows.slopes(*asked, seen.names, True)

    def about(wrong: Flags) -> Whitened:
        nonlocal frames
        if wrong.any() and rows.estimated and wrong.mean() <= 0.5:
            frames = rows.nearest(known[0], ~wrong[of])
        columns, errors = _columns(rows, known if pairs else rows.of_states(*known, frames), scale)
        return Whitened(noise.whiten(columns), noise.whiten(errors), noise, held)

    return without_outliers(about, of[rows.row], int(of.max(initial=-1)) + 1, beyond), frames


def other_readings(given: Linearized, many: Sequence[Readings], far: float) -> list[Linearized | None]:
    """The fits to the same rows with other values or at other angles, or all of them under other loads; None for
    readings more than `far` times further from the nominal arm than as given where a frame is to be found.

    On loads the slopes hardly depend where geometry moves the markers: those stay.
    """
    experiment, names = given.experiment, given.experiment.fit_names()
    model, x = experiment.model(), start_values(experiment, names)
    parameters = [model.parameters[i] for i in model.index(names)]
    rows = [replace(given.rows, readings=readings) for readings in many]
    frames: list[tuple[Frame, ...]] = [() for _ in rows]
    out: list[Linearized | None] = [None] * len(rows)
    near = list(range(len(rows)))
    if given.rows.estimated:
        there = _positions_of(rows, model, x)
        frames = [r.nearest(positions) for r, positions in zip(rows, there, strict=True)]
        errors = [r.scalars - r.flat(r.seen(p, f)) for r, p, f in zip(rows, there, frames, strict=True)]
        near = [i for i in near if not rms(errors[i]) > far * rms(given.errors)]
        if not near:
            return out
    still: set[str] = set()
    before = given.readings
    if all(r.states is not before.states and np.array_equal(r.poses.q, before.poses.q) for r in many):
        still = {p.name for e in model.effects if isinstance(e, Geometry | Sensor) for p in e.parameters(model.facts)}
    at = [i for i, name in enumerate(names) if name not in still]
    motions = motion_count(frames[0])
    size = scales([p for f in frames[0] for p in f.parameters()] + [parameters[i] for i in at])
    columns = [*range(motions), *(motions + i for i in at)]
    found = _rates_of([rows[i] for i in near], model, x, [frames[i] for i in near], [names[i] for i in at])
    for i, (predicted, J) in zip(near, found, strict=True):
        slopes = given.slopes.copy()
        slopes[:, columns] = rows[i].flat(J) * size
        if np.any(slopes):
            out[i] = replace(given, rows=rows[i], slopes=slopes, errors=rows[i].scalars - rows[i].flat(predicted))
    return out


# A batch of a few dozen poses mostly costs the way through the model's stages, which thousands go once.


def _positions_of(many: Sequence[ReadingRows], model: Model, x: Array) -> list[Array]:
    """`Rows.positions` of each, by the first step from rest."""
    return [
        found for (found,) in _of_states(many, lambda poses, loaded: (model.positions(poses, x, loaded, linear=True),))
    ]


def _rates_of(
    many: Sequence[ReadingRows], model: Model, x: Array, frames: Sequence[Sequence[Frame]], names: Sequence[str]
) -> list[tuple[Array, Array]]:
    """`Rows.rates` of each, by the first step from rest, in its own frames."""
    pairs = [rows.pairs[0] for rows in many if rows.pairs is not None]
    if len(pairs) == len(many):
        found = _apart(model.rates(_stacked(pairs), x, names, linear=True), pairs)
        return [rows.of_pairs(*one) for rows, one in zip(many, found, strict=True)]
    both = _of_states(many, lambda poses, loaded: model.position_rates(poses, x, names, loaded, linear=True))
    return [rows.of_states(one[0], one[1], own) for rows, one, own in zip(many, both, frames, strict=True)]


def _of_states(many: Sequence[ReadingRows], ask: Callable[[Poses, bool], tuple[Array, ...]]) -> list[list[Array]]:
    """What is asked of the states that each needs, (S, ...) in their order; of states that several share, once."""
    distinct = {id(rows.readings.states): rows.split() for rows in many}
    out: dict[int, list[Array]] = {own: [] for own in distinct}
    for same in zip(*distinct.values(), strict=True):
        poses = [own for _, _, own in same]
        found = _apart(ask(_stacked(poses), same[0][0]), poses)
        for (own, parts), (_, which, _), values in zip(distinct.items(), same, found, strict=True):
            if not out[own]:
                out[own] = [np.empty((sum(len(w) for _, w, _ in parts), *v.shape[1:])) for v in values]
            for whole, value in zip(out[own], values, strict=True):
                whole[which] = value
    return [out[id(rows.readings.states)] for rows in many]


def _apart(found: Sequence[Array], poses: Sequence[Poses]) -> list[list[Array]]:
    """What is known of the stacked poses, for each of their batches."""
    ends = np.cumsum([len(p) for p in poses])[:-1]
    return [list(own) for own in zip(*(np.split(v, ends) for v in found), strict=True)]


def _stacked(poses: Sequence[Poses]) -> Poses:
    """Batches after each other, the same recorded of all."""

    def conditions(many: Sequence[Conditions]) -> Conditions:
        return Conditions.each(
            lambda name: None if getattr(many[0], name) is None else np.concatenate([getattr(c, name) for c in many])
        )

    return Poses(
        np.concatenate([p.pendant for p in poses]),
        np.concatenate([p.q for p in poses]),
        np.concatenate([p.wrench for p in poses]),
        conditions([p.unloaded for p in poses]),
        conditions([p.loaded for p in poses]),
    )


@dataclass(frozen=True, eq=False)
class Visits:
    """The visits of the arm in the order of the file: the states of each, and the visit (R,) of each row of a fit."""

    states: tuple[tuple[int, ...], ...]
    of: Indices

    def __len__(self) -> int:
        return len(self.states)

    def reversed(self) -> Visits:
        """The same, the last one first."""
        return Visits(self.states[::-1], len(self) - 1 - self.of)


def visits_of(rows: ReadingRows) -> Visits:
    """Rows of one `plus` are one visit, with the unloaded states that no other visit shares."""
    order = list(dict.fromkeys(rows.plus.tolist()))
    before: dict[int, set[int]] = {s: set() for s in order}
    shared: dict[int, set[int]] = {}
    for s, m in zip(rows.plus.tolist(), rows.minus.tolist(), strict=True):
        if m >= 0:
            before[s].add(m)
            shared.setdefault(m, set()).add(s)
    states = tuple((s, *(m for m in sorted(before[s]) if len(shared[m]) == 1)) for s in order)
    number = {s: i for i, s in enumerate(order)}
    return Visits(states, np.array([number[s] for s in rows.plus.tolist()]))


def stops_of(rows: ReadingRows) -> Visits:
    """The same with all states of one pose after each other as one visit."""
    seen = visits_of(rows)
    names = [rows.readings.states.pose[s[0]] for s in seen.states]
    stop = np.cumsum([False, *(a != b for a, b in pairwise(names))])
    states = [tuple(s for v in np.flatnonzero(stop == k) for s in seen.states[v]) for k in range(int(stop[-1]) + 1)]
    return Visits(tuple(states), stop[seen.of])
