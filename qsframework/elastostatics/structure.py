"""What a model is made of: effects, parameters, the chain, the load point and the markers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from qsframework.elastostatics.layout import Layout, mixes
from qsframework.elastostatics.state import Site
from qsframework.errors import InputError, Problem
from qsframework.plugin import Array, Effect, Geometry, Loop, Parameter, Poses, RobotFacts, Sensor, Spring
from qsframework.plugin.registry import suggestion

CHUNK = 4096
"""Poses worked on at a time, so that a batch stays in the processor's cache."""
# Of what is freed, the C library keeps twice the largest array that was ever freed, of at most 32 MiB. The rest the
# system takes back and clears page by page when it is asked for again, which took batches longer than their arithmetic.
# So one large array is freed at once; none of its pages is touched.
np.empty(31 << 20, dtype=np.uint8)
K = TypeVar("K", bound=Effect)


@dataclass(frozen=True, eq=False, kw_only=True)
class Structure:
    """The parts of a model. Frozen; parameter values are passed as `x` (p,), in SI.

    effects are ordered by stage; `slices[i]` are the positions of effect i's parameters in x; compliance_rows (ne,):
    the position in x of each elastic coordinate's compliance; law_rows: the coordinates of each spring law
    """

    facts: RobotFacts
    effects: tuple[Effect, ...]
    parameters: tuple[Parameter, ...]
    slices: tuple[slice, ...]
    layout: Layout
    tip: Site
    markers: tuple[Site, ...]
    marker_names: tuple[str, ...]
    gravity: Array
    law_rows: tuple[tuple[int, ...], ...]
    compliance_rows: tuple[int, ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters, in the order of x."""
        return tuple(p.name for p in self.parameters)

    @property
    def nominal(self) -> Array:
        """Nominal values (p,), SI."""
        return np.array([p.nominal for p in self.parameters])

    def index(self, names: Sequence[str]) -> list[int]:
        """Positions of parameters in x; an InputError offers the nearest name."""
        for name in names:
            if name not in self.names:
                message, hint = f"the model has no parameter {name!r}", suggestion(name, self.names)
                raise InputError(Problem(message, allowed=", ".join(self.names), hint=hint))
        return [self.names.index(name) for name in names]

    def names_of(self, kind: type) -> set[str]:
        """Names of the parameters of all effects of a kind."""
        effects = zip(self.effects, self.slices, strict=True)
        return {n for e, part in effects if isinstance(e, kind) for n in self.names[part]}

    @cached_property
    def by_state(self) -> tuple[int, ...]:
        """Positions in x of the effects by which an arm is not the same in both states of a pose, but for its load."""
        return self._positions(lambda e: (e.by_state or bool(e.needs)) and not isinstance(e, Sensor))

    def differs(self, x: Array) -> bool:
        """Whether the arm is not the same in both states at x: an effect that makes it so does not vanish there."""
        return any(self.parameters[i].null is not None and x[i] != self.parameters[i].null for i in self.by_state)

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Positions in x of the effects that move the commanded arm, or say which coordinates give."""
        moved = self._positions(lambda e: isinstance(e, Geometry | Loop) or (isinstance(e, Spring) and mixes(e)))
        return tuple(i for i in moved if i not in self.compliance_rows)

    def _positions(self, wanted: Callable[[Effect], bool]) -> tuple[int, ...]:
        """Positions in x of the parameters of some effects."""
        pairs = zip(self.effects, self.slices, strict=True)
        return tuple(i for effect, part in pairs if wanted(effect) for i in range(part.start, part.stop))

    def compliance(self, x: Array) -> Array:
        """Compliance (ne,) of each elastic coordinate."""
        return x[list(self.compliance_rows)]

    def of_role(self, *roles: str) -> tuple[str, ...]:
        """Names of the parameters of the effects that have one of these roles."""
        pairs = zip(self.effects, self.slices, strict=True)
        return tuple(name for effect, part in pairs if effect.role in roles for name in self.names[part])

    def of_kind(self, kind: type[K], x: Array) -> list[tuple[K, Array]]:
        """The effects of one kind with their parameter values."""
        return [(e, x[s]) for e, s in zip(self.effects, self.slices, strict=True) if isinstance(e, kind)]

    def checked(self, x: Array) -> Array:
        """x as an array, or an InputError if it does not hold one finite number per parameter."""
        x = np.asarray(x, dtype=float)
        if x.shape != (len(self.parameters),) or not np.isfinite(x).all():
            raise InputError(f"x must hold {len(self.parameters)} finite numbers, found shape {x.shape}")
        return x


def chunks(poses: Poses) -> Iterator[tuple[slice, Poses]]:
    """The poses, CHUNK at a time."""
    if len(poses) <= CHUNK:  # the batch itself, which `commanded_actuators` knows again
        yield slice(0, len(poses)), poses
        return
    for start in range(0, len(poses), CHUNK):
        part = slice(start, min(start + CHUNK, len(poses)))
        yield part, poses.take(part)
