"""The pipeline: all effects of a robot and a campaign, stage by stage.

displacements = Model.predict(poses, x)       A = Model.sensitivity(poses, x)
positions = Model.positions(poses, x)         A = Model.position_sensitivity(poses, x)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from qsframework.elastostatics.frozen import Frozen, frozen_states
from qsframework.elastostatics.layout import make_layout
from qsframework.elastostatics.settled import SettledState, one_state
from qsframework.elastostatics.state import Site
from qsframework.elastostatics.structure import Structure, chunks
from qsframework.errors import InputError, Problem, nearest
from qsframework.plugin import Array, Effect, Parameter, Poses, RobotFacts, Spring, SpringLaw
from qsframework.plugin.facts import frozen
from qsframework.plugin.kinds import At
from qsframework.plugin.loops import follow, with_branches
from qsframework.plugin.settings import twice_hint

_DIFFERENCE = (True, False)
"""The loaded state less the unloaded one."""


@dataclass(frozen=True, eq=False)
class Model(Structure):
    """The arm as it deflects under load: readings and their sensitivities, from poses and parameters.

    Each state is the settled equilibrium, and sensitivities are those there. With `linear` they are those of its first
    step from the commanded pose, eps = C tau with C = (diag(1/c) + K_par)^-1, equations (1)-(5) and (10) of the
    source paper; laws, if there are any, are then solved for the unloaded and the loaded state.
    """

    def predict(self, poses: Poses, x: Array | None = None, linear: bool = False) -> Array:
        """Displacement readings (N, K, 3) m of K markers: loaded minus unloaded, base frame.

        Raises NotConverged where a pose does not settle.
        """
        return self._read(poses, x, _DIFFERENCE, linear, ())[0]

    def sensitivity(
        self, poses: Poses, x: Array | None = None, names: Sequence[str] | None = None, linear: bool = False
    ) -> Array:
        """d readings / d parameters (N, K, 3, p): the observation matrix, equation (4)."""
        return self._read(poses, x, _DIFFERENCE, linear, names)[1]

    def rates(self, poses: Poses, x: Array, names: Sequence[str], linear: bool = False) -> tuple[Array, Array]:
        """`predict` and `sensitivity` together, cheaper than one after the other."""
        return self._read(poses, x, _DIFFERENCE, linear, names)

    def positions(self, poses: Poses, x: Array | None = None, loaded: bool = False, linear: bool = False) -> Array:
        """Position readings (N, K, 3) m of K markers in one state, base frame.

        The pose with the errors of its geometry, deflected by gravity and the compensators and, if `loaded`, by the
        wrench. The state's own time, temperature and approach count: `poses.unloaded` or `poses.loaded`. Raises
        NotConverged where a pose does not settle.
        """
        return self._read(poses, x, (loaded,), linear, ())[0]

    def position_sensitivity(
        self,
        poses: Poses,
        x: Array | None = None,
        names: Sequence[str] | None = None,
        loaded: bool = False,
        linear: bool = False,
    ) -> Array:
        """d position readings / d parameters (N, K, 3, p) of one state."""
        return self._read(poses, x, (loaded,), linear, names)[1]

    def position_rates(
        self, poses: Poses, x: Array, names: Sequence[str], loaded: bool = False, linear: bool = False
    ) -> tuple[Array, Array]:
        """`positions` and `position_sensitivity` of one state together, cheaper than one after the other."""
        return self._read(poses, x, (loaded,), linear, names)

    def _read(
        self, poses: Poses, x: Array | None, states: tuple[bool, ...], linear: bool, names: Sequence[str] | None
    ) -> tuple[Array, Array]:
        """The reading (N, K, 3) of a state, or of the first less the second, and its derivatives (N, K, 3, p) by some
        parameters, by all where names are None."""
        x = self.nominal if x is None else self.checked(x)
        wanted = self.index(self.names if names is None else names)
        value = np.empty((len(poses), len(self.markers), 3))
        slope = np.empty((*value.shape, len(wanted)))
        for part, chunk in chunks(poses):
            batches = self._batches(chunk, x, states, linear, wanted)
            value[part] = reduce(np.subtract, (batch.reading for batch in batches))
            if wanted:
                slope[part] = reduce(np.subtract, (batch.tangents(wanted) for batch in batches))
        return value, slope

    def _batches(
        self, poses: Poses, x: Array, states: tuple[bool, ...], linear: bool, wanted: Sequence[int]
    ) -> Sequence[Frozen | SettledState]:
        """What is read of a batch: each state by itself, or both at once where the arm is alike in both but for its
        load and nothing settles."""
        if linear and not self.differs(x) and set(self.by_state).isdisjoint(wanted):
            return [frozen_states(self, poses, x, states)]
        if linear:
            return [frozen_states(self, poses, x, (loaded,)) for loaded in states]
        last = one_state(self, poses, x, states[-1])
        return [one_state(self, poses, x, loaded, last) for loaded in states[:-1]] + [last]

    def transmission_margin(self, poses: Poses) -> Array:
        """Smallest margin (N,) rad over all loops: transmission angle less what the loop asks for."""
        margin, q = np.full(len(poses), np.inf), poses.q
        if self.facts.branches:
            q = follow([m.loop for place in self.layout.loops for m in place.members], q, self.facts)
        for place in self.layout.loops:
            for member in place.members:
                angle = member.loop.transmission_angle(q[:, place.of(member)], self.facts)
                margin = np.minimum(margin, angle - member.loop.smallest_transmission_angle)
        return margin


def make_model(
    facts: RobotFacts,
    effects: Sequence[Effect],
    parameters: Sequence[Parameter],
    tip: Site,
    markers: Sequence[tuple[str, Site]],
    gravity: Array,
) -> Model:
    """Join effects (any order) into a model. `parameters` gives nominal values for the effects' names."""
    ordered = tuple(sorted(effects, key=lambda e: (e.stage, e.order)))
    facts = with_branches(facts, ordered)
    values = {p.name: p for p in parameters}
    found: list[Parameter] = []
    slices: list[slice] = []
    for effect in ordered:
        own = [values.get(p.name, p) for p in effect.parameters(facts)]
        slices.append(slice(len(found), len(found) + len(own)))
        found.extend(own)
    _check_unique([e.name for e in ordered], "effect", ordered)
    _check_unique([p.name for p in found], "parameter")
    return Model(
        facts=facts,
        effects=ordered,
        parameters=tuple(found),
        slices=tuple(slices),
        layout=make_layout(facts, ordered),
        tip=tip,
        markers=tuple(site for _, site in markers),
        marker_names=tuple(name for name, _ in markers),
        gravity=frozen(gravity),
        law_rows=tuple(_law_rows(e, facts, ordered) for e in ordered if isinstance(e, SpringLaw)),
        compliance_rows=tuple(
            part.start + i
            for e, part in zip(ordered, slices, strict=True)
            if isinstance(e, Spring)
            for i in e.compliances(facts)
        ),
    )


def _check_unique(names: Sequence[str], what: str, effects: Sequence[Effect] = ()) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        hint = next((twice_hint(type(e)) for e in effects if e.name in twice), None)
        raise InputError(Problem(f"{what} listed twice: {', '.join(twice)}", hint=hint))


def _law_rows(law: SpringLaw, facts: RobotFacts, effects: Sequence[Effect]) -> tuple[int, ...]:
    """The elastic coordinates of the springs that a law bends."""
    rows: dict[At, range] = {}
    first = 0
    for spring in (e for e in effects if isinstance(e, Spring)):
        count = len(spring.compliances(facts))
        rows.setdefault((spring.role, spring.where), range(first, first + count))
        first += count
    for role, where in law.springs(facts):
        if (role, where) not in rows:
            found = [f"{own} {place}".strip() for own, place in rows if own]
            problem = f"{law.name} needs a spring with the role {role!r} at {where}"
            raise InputError(Problem(problem, allowed=", ".join(found), hint=nearest(f"{role} {where}", found)))
    return tuple(row for at in law.springs(facts) for row in rows[at])
