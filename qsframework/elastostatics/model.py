"""The pipeline: all effects of a robot and a campaign, stage by stage.

    displacements = Model.predict(poses, x)       A = Model.sensitivity(poses, x)
    positions = Model.positions(poses, x)         A = Model.position_sensitivity(poses, x)

The linear model: eps = C tau at the commanded pose, C = (diag(1/c) + K_par)^-1, equations (1)-(5)
and (10) of the paper; laws, if there are any, are solved for the unloaded and the loaded state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics.displacements import displacement, evaluate, sensitivities
from qsframework.elastostatics.layout import make_layout
from qsframework.elastostatics.positions import evaluate_state, position, position_tangents
from qsframework.elastostatics.state import Site
from qsframework.elastostatics.structure import Structure, chunks
from qsframework.errors import InputError, Problem, nearest
from qsframework.plugin import Array, Effect, Parameter, Poses, RobotFacts, Spring, SpringLaw
from qsframework.plugin.facts import frozen
from qsframework.plugin.kinds import At
from qsframework.plugin.loops import follow, with_branches
from qsframework.plugin.settings import twice_hint


@dataclass(frozen=True, eq=False)
class Model(Structure):
    """The arm as it gives under load."""

    def predict(self, poses: Poses, x: Array | None = None) -> Array:
        """Displacement readings (N, K, 3) m of K markers: loaded minus unloaded, base frame."""
        x = self.nominal if x is None else self.checked(x)
        out = np.empty((len(poses), len(self.markers), 3))
        if self.differs(x):
            return self.positions(poses, x, loaded=True) - self.positions(poses, x)
        for part, chunk in chunks(poses):
            out[part] = displacement(evaluate(self, chunk, x)).transpose(2, 0, 1)
        return out

    def sensitivity(self, poses: Poses, x: Array | None = None, names: Sequence[str] | None = None) -> Array:
        """d readings / d parameters (N, K, 3, p): the observation matrix, equation (4)."""
        x = self.nominal if x is None else self.checked(x)
        return self.rates(poses, x, self.names if names is None else names)[1]

    def rates(self, poses: Poses, x: Array, names: Sequence[str]) -> tuple[Array, Array]:
        """`predict` and `sensitivity` together, cheaper than one after the other."""
        x, wanted = self.checked(x), self.index(names)
        if self.differs(x):
            (ends, after), (starts, before) = (self.position_rates(poses, x, names, on) for on in (True, False))
            return ends - starts, after - before
        value = np.empty((len(poses), len(self.markers), 3))
        slope = np.empty((*value.shape, len(wanted)))
        for part, chunk in chunks(poses):
            ev = evaluate(self, chunk, x)
            value[part] = displacement(ev).transpose(2, 0, 1)
            slope[part] = sensitivities(ev, wanted).transpose(3, 1, 2, 0)
        own = [row for row, position in enumerate(wanted) if position in self.by_state]
        if own:  # they do not move both states alike
            two = [self.position_sensitivity(poses, x, [names[row] for row in own], on) for on in (True, False)]
            slope[..., own] = two[0] - two[1]
        return value, slope

    def positions(self, poses: Poses, x: Array | None = None, loaded: bool = False) -> Array:
        """Position readings (N, K, 3) m of K markers in one state, base frame.

        The pose with the errors of its geometry, deflected by gravity and the compensators and, if
        `loaded`, by the wrench; linear in the deflection, which is taken at the commanded pose. The
        state's own time, temperature and approach count: `poses.unloaded` or `poses.loaded`.
        """
        x = self.nominal if x is None else self.checked(x)
        out = np.empty((len(poses), len(self.markers), 3))
        for part, chunk in chunks(poses):
            out[part] = position(evaluate_state(self, chunk, x, loaded)).transpose(2, 0, 1)
        return out

    def position_sensitivity(
        self, poses: Poses, x: Array | None = None, names: Sequence[str] | None = None, loaded: bool = False
    ) -> Array:
        """d position readings / d parameters (N, K, 3, p) of one state."""
        x = self.nominal if x is None else self.checked(x)
        wanted = list(range(len(self.parameters))) if names is None else self.index(names)
        out = np.empty((len(poses), len(self.markers), 3, len(wanted)))
        for part, chunk in chunks(poses):
            out[part] = position_tangents(evaluate_state(self, chunk, x, loaded), wanted).transpose(3, 1, 2, 0)
        return out

    def position_rates(self, poses: Poses, x: Array, names: Sequence[str], loaded: bool = False) -> tuple[Array, Array]:
        """`positions` and `position_sensitivity` of one state together, cheaper than one after the other."""
        x, wanted = self.checked(x), self.index(names)
        value = np.empty((len(poses), len(self.markers), 3))
        slope = np.empty((*value.shape, len(wanted)))
        for part, chunk in chunks(poses):
            ev = evaluate_state(self, chunk, x, loaded)
            value[part] = position(ev).transpose(2, 0, 1)
            slope[part] = position_tangents(ev, wanted).transpose(3, 1, 2, 0)
        return value, slope

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
