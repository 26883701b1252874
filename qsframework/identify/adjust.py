"""Gauss-Newton for positions: parameters that the readings can tell, moved until they settle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.elastostatics import Model
from qsframework.errors import InputError, NotConverged
from qsframework.identify.choice import LeftAside, choose
from qsframework.identify.frames import Frame
from qsframework.identify.positions import Mask, Positions
from qsframework.plugin import Array, Parameter, Sensor

_STEPS = 30
_HALVINGS = 12
_SETTLED = 1e-3
"""Largest last step, in standard deviations."""
_NEAR = 0.5
"""Derivatives are not taken again after a step shorter than this, in standard deviations."""
BROAD = 20.0
"""Typical sizes of a marker's prior standard deviation: 40 mm."""
_ARM = 5.0
"""The same for all else: 2.5 mm and 2.5 mrad for a joint's placement, 5 mrad for its zero."""
_LEAST = 1e-3
"""Share of the nominal arm's error below which residuals count as no smaller."""
_TOLD = 10.0
"""Parameters that are told only to more than so many typical sizes are left aside; markers are never."""


@dataclass(frozen=True, eq=False)
class Solved:
    """Where the steps settled: all parameters x, frames, scaled triangular factor R, derivatives J (R, 3, p)."""

    problem: Problem
    x: Array
    frames: tuple[Frame, ...]
    J: Array
    R: Array
    predicted: Array

    @property
    def residuals(self) -> Array:
        """Measured minus predicted (R, 3) m."""
        return self.problem.positions.measured - self.predicted


@dataclass(frozen=True, eq=False)
class Problem:
    """Readings, the parameters to estimate, and where to start; `unit`: the nominal arm's error in sigmas."""

    positions: Positions
    frames: tuple[Frame, ...]
    x: Array
    names: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    sigma: Array
    unit: float
    nominal: Array
    at: Array
    first: Array

    @classmethod
    def chosen(
        cls, positions: Positions, frames: tuple[Frame, ...], x: Array, names: Sequence[str], sigma: Array
    ) -> tuple[Problem, tuple[LeftAside, ...]]:
        """Keep what the readings can tell, seen from the nominal arm in its best frames."""
        predicted, J = positions.rates(x, frames, names)
        white = (positions.measured - predicted) / sigma[:, None]
        unit = float(np.sqrt((white**2).sum() / max(white.size - 6 * len(frames), 1)))
        every = [p for f in frames for p in f.parameters()]
        motions = len(every)
        every += [positions.model.parameters[i] for i in positions.model.index(names)]
        limits = np.array([np.inf] * motions + limits_of(positions.model, names))
        scale = np.array([p.scale for p in every])
        rows = (J * scale / (unit * sigma)[:, None, None]).reshape(-1, len(every))
        taken, left = choose(rows, [p.name for p in every], limits)
        if 3 * len(sigma) <= len(taken) or (len(rows) <= rows.shape[1] and len(taken) >= len(rows)):
            raise InputError(
                f"{len(sigma)} readings give {3 * len(sigma)} numbers: too few for {len(taken)} parameters "
                "(six of them each tracker's frame); measure more poses, or fit fewer parameters (--fit)"
            )
        kept = [names[c - motions] for c in taken if c >= motions]
        parameters = tuple(every[:motions]) + tuple(every[c] for c in taken if c >= motions)
        whole = list(range(motions)) + [c for c in taken if c >= motions]
        problem = cls(positions, frames, x, tuple(kept), parameters, sigma, unit, predicted, predicted, J[:, :, whole])
        return problem, left

    def without(self, wrong: Mask, solved: Solved) -> Problem:
        """The same parameters without some rows, from the solution that was found with them."""
        return replace(
            self, positions=self.positions.take(~wrong), sigma=self.sigma[~wrong], nominal=self.nominal[~wrong],
            x=solved.x, frames=solved.frames, at=solved.predicted[~wrong], first=solved.J[~wrong],
        )  # fmt: skip

    @property
    def scale(self) -> Array:
        """Typical sizes (p,) of the parameters."""
        return np.array([p.scale for p in self.parameters])

    def solve(self) -> Solved:
        """Gauss-Newton with halved steps; NotConverged where it does not settle."""
        model, positions = self.positions.model, self.positions
        index = model.index(self.names)
        start = np.array([model.parameters[i].nominal for i in index])
        sensors, scale = _sensors(model), self.scale
        loose = np.array([np.inf] * 6 * len(self.frames) + [BROAD if n in sensors else _ARM for n in self.names])
        x, frames, predicted, J = self.x, self.frames, self.at, self.first
        size = last = np.inf
        for _ in range(_STEPS):
            offset = np.concatenate([np.zeros(6 * len(frames)), x[index] - start]) / scale
            r = ((positions.measured - predicted) / self.sigma[:, None]).ravel()
            rows = (J * (scale / self.sigma[:, None, None])).reshape(len(r), -1)
            unit = max(float(np.sqrt(np.mean(r**2))), _LEAST * self.unit)
            held = unit / loose
            R, target = _triangle(rows, r, held, -held * offset)
            step: Array = np.asarray(np.linalg.solve(R, target), dtype=np.float64)
            cost = r @ r + ((held * offset) ** 2).sum()
            size = float(np.abs(R @ step).max()) / unit
            if size < _SETTLED:  # a step so short needs no look at where it leads
                x, frames = self._moved(x, frames, step * scale, index)
                return Solved(self, x, frames, J, R, predicted + J @ (step * scale))
            fresh = size > _NEAR or size > 0.05 * last  # otherwise derivatives from that near serve once more
            x, frames, predicted, found = self._advance(x, frames, step, cost, held, offset, index, fresh)
            J, last = J if found is None else found, size
        raise NotConverged(
            f"the fit of {len(self.names)} parameters did not settle in {_STEPS} steps (last step {size:.1g} "
            "standard deviations); fit fewer parameters, or look for readings with wrong angles or markers"
        )

    def _advance(
        self, x: Array, frames: tuple[Frame, ...], step: Array, cost: float, held: Array, offset: Array,
        index: list[int], fresh: bool,
    ) -> tuple[Array, tuple[Frame, ...], Array, Array | None]:  # fmt: skip
        """The longest of the steps 1, 1/2, ... that does not raise the cost; with derivatives there if `fresh`."""
        for halving in range(_HALVINGS):
            values, moved = self._moved(x, frames, step * self.scale * 0.5**halving, index)
            if fresh:
                predicted, J = self.positions.rates(values, moved, self.names)
            else:
                predicted, J = self.positions.predict(values, moved), None
            r = (self.positions.measured - predicted) / self.sigma[:, None]
            later = (r**2).sum() + ((held * (offset + step * 0.5**halving)) ** 2).sum()
            if later <= cost * (1.0 + 1e-9):
                return values, moved, predicted, J
        raise NotConverged("no step lowers the error: the readings or a convention do not fit this robot")

    def _moved(
        self, x: Array, frames: tuple[Frame, ...], z: Array, index: list[int]
    ) -> tuple[Array, tuple[Frame, ...]]:
        """Parameters and frames after a step z (p,)."""
        values = x.copy()
        values[index] += z[6 * len(frames) :]
        return values, tuple(f.moved(z[6 * i : 6 * i + 6]) for i, f in enumerate(frames))


def limits_of(model: Model, names: Sequence[str]) -> list[float]:
    """How many typical sizes a parameter may be uncertain by: markers are never left aside for it."""
    sensors = _sensors(model)
    return [np.inf if n in sensors else _TOLD for n in names]


def _sensors(model: Model) -> set[str]:
    """The parameters of the instrument's side."""
    effects = zip(model.effects, model.slices, strict=True)
    return {n for e, part in effects if isinstance(e, Sensor) for n in model.names[part]}


def _triangle(rows: Array, r: Array, held: Array, wish: Array) -> tuple[Array, Array]:
    """R and Q' r of the rows with the priors under them, from one triangular factor."""
    p = rows.shape[1]
    both = np.vstack([np.column_stack([rows, r]), np.column_stack([np.diag(held), wish])])
    R: Array = np.asarray(np.linalg.qr(both, mode="r"))
    return R[:p, :p], R[:p, p]
