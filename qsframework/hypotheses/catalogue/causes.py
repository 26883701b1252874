"""The candidate causes: every effect of the registry at every place where it can act on this robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from qsframework.elastostatics import Model, make_model
from qsframework.experiment import Experiment
from qsframework.experiment.observations import ReadingRows
from qsframework.experiment.readings import moving
from qsframework.plugin import (
    Conditions,
    Effect,
    InputError,
    Parameter,
    Poses,
    RobotFacts,
    Spring,
    SpringLaw,
    registry,
)
from qsframework.plugin.laws import given
from qsframework.plugin.settings import axis_fields, place_fields
from qsframework.plugin.trusted import file_of

REACH = 10.0
"""How many times its typical size an effect may have; what is not seen even then is invisible in this protocol."""
_SHARE = 0.1


@dataclass(frozen=True)
class Cause:
    """An effect at one place, or all axes of one place, with the parameters that the baseline fit leaves at their
    nominal values.

    present: the robot or the campaign has the effect already, and its nominal values may be wrong; prior: sd of the
    parameters about their nominal values; None: they are held only where no reading shows them
    """

    name: str
    effects: tuple[Effect, ...]
    parameters: tuple[Parameter, ...]
    present: bool
    prior: float | None = None

    @property
    def kind(self) -> type[Effect]:
        """What its effects are, of which there may be one for each axis."""
        return type(self.effects[0])

    @property
    def needs(self) -> tuple[str, ...]:
        """Columns that the readings must have."""
        return self.effects[0].needs

    @property
    def group(self) -> bool:
        """Whether it is all axes of one place together."""
        return len(self.effects) > 1

    def shares(self, other: Cause) -> bool:
        """Whether one is an axis of the other one's place."""
        return not set(self.names).isdisjoint(other.names)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    @property
    def sizes(self) -> tuple[float, ...]:
        """A realistic size of each parameter's deviation from its nominal value, SI."""
        return tuple(_size(p, self.present) for p in self.parameters)

    def one_sided(self) -> bool:
        """Whether its only parameter stands at its lower bound, so that it can only grow."""
        return len(self.parameters) == 1 and self.parameters[0].nominal <= self.parameters[0].lower


def _size(p: Parameter, present: bool) -> float:
    return p.sd or (_SHARE * abs(p.nominal) if present and p.nominal else p.typical)


@dataclass(frozen=True)
class Untested:
    """A cause that these readings cannot test, and the columns that they would need for it."""

    name: str
    needs: tuple[str, ...]


def find_causes(
    experiment: Experiment, fitted: Sequence[str], seen: ReadingRows | Poses
) -> tuple[tuple[Cause, ...], tuple[Untested, ...]]:
    """All causes beyond the fitted parameters, and those that need something that was not recorded; none of how a joint
    is shown that stands still.

    seen: the rows of readings, or poses that are still to be measured
    """
    facts, model = experiment.robot.facts, experiment.model()
    causes = [_present(e, fitted, model) for e in model.effects]
    have = {e.name for e in model.effects}
    untested: list[Untested] = []
    springs = {(e.role, e.where) for e in model.effects if isinstance(e, Spring)}
    for effect in proposed(model):
        if effect.name in have or (isinstance(effect, SpringLaw) and not springs.issuperset(effect.springs(facts))):
            continue
        have.add(effect.name)
        missing = _missing(effect, seen)
        if missing:
            untested.append(Untested(effect.name, missing))
        else:
            # what no reading can show without the effect stays as it is known
            parameters = tuple(p for p in given(effect, "parameters", facts) if not p.modifies)
            causes.append(Cause(effect.name, (effect,), parameters, False))
    return tuple(c for c in causes if c.parameters and not _of_still(c, facts, seen)), tuple(untested)


def _of_still(cause: Cause, facts: RobotFacts, seen: ReadingRows | Poses) -> bool:
    """Whether it is how a joint is shown that stands still."""
    if cause.kind.role != "shown angle":
        return False
    moves = moving(seen.pendant) if isinstance(seen, Poses) else seen.readings.moves
    return not moves[facts.driven.index(cause.effects[0].where)]


def with_causes(experiment: Experiment, causes: Sequence[Cause], values: Mapping[str, float]) -> Experiment:
    """The experiment with causes among its effects, their parameters fitted too; values: by name, SI, that are nominal
    from now on."""
    wide = experiment.with_effects(e for c in causes for e in c.effects)

    def about(parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
        inside = {p.name: float(np.clip(values[p.name], p.lower, p.upper)) for p in parameters if p.name in values}
        return tuple(replace(p, nominal=inside.get(p.name, p.nominal)) for p in parameters)

    return wide.with_(
        robot=replace(wide.robot, parameters=about(wide.robot.parameters)),
        parameters=about(wide.parameters),
        fit=(*experiment.fit_names(), *(n for c in causes for n in c.names)),
    )


def groups_of(causes: Sequence[Cause]) -> list[Cause]:
    """All axes of one place, of those that are given, as one cause each."""
    places: dict[str, list[Cause]] = {}
    for cause in causes:
        axes = axis_fields(cause.kind)
        if axes and not cause.present:
            effect = cause.effects[0]
            rest = [str(getattr(effect, f)) for f in place_fields(cause.kind) if f not in axes]
            name = effect.effect_name() + (f"[{'/'.join(rest)}]" if rest else "")
            places.setdefault(name, []).append(cause)
    return [
        Cause(name, tuple(c.effects[0] for c in own), tuple(p for c in own for p in c.parameters), False)
        for name, own in places.items()
        if len(own) > 1
    ]


def _missing(effect: Effect, seen: ReadingRows | Poses) -> tuple[str, ...]:
    """Columns that an effect needs and the readings lack: of both states of a displacement."""
    missing = [(n, end) for n in effect.needs for end, state in _states(seen) if not _known(state, n)]
    # one side for both states; of the temperature that of the loaded one, where nobody recorded the other
    own = (n if n == "approach" else f"{n}{end}" for n, end in missing if (n, end) != ("temperature", "_unloaded"))
    return tuple(dict.fromkeys(own))


def _states(seen: ReadingRows | Poses) -> list[tuple[str, Conditions]]:
    """The conditions of the states that are measured, and of those that are taken off."""
    if isinstance(seen, Poses):
        return [("", seen.loaded), ("_unloaded", seen.unloaded)]
    conditions = seen.readings.poses.loaded
    before = seen.minus[seen.minus >= 0]
    return [("", conditions.take(seen.plus)), *([("_unloaded", conditions.take(before))] if len(before) else [])]


def _known(state: Conditions, name: str) -> bool:
    value = getattr(state, name, None)
    return value is not None and bool(np.isfinite(value).all())


def _present(effect: Effect, fitted: Sequence[str], model: Model) -> Cause:
    values = dict(zip(model.names, model.parameters, strict=True))
    own = tuple(values[p.name] for p in effect.parameters(model.facts) if p.name not in fitted)
    return Cause(effect.name, (effect,), own, True)


def proposed(model: Model) -> list[Effect]:
    """Every instance that the effects of the registry propose for this robot, its markers and its own effects.

    Effects from files, which are in no registry, propose instances where the model has one already.
    """
    out: list[Effect] = []
    from_files = [type(e) for e in model.effects if file_of(type(e)) is not None]
    for kind in dict.fromkeys([*registry().values(), *from_files]):
        own = given(kind, "places", model.facts, model.marker_names)
        for effect in (*own, *given(kind, "beside", model.effects, model.parameters)):
            with suppress(InputError):  # of a place that does not fit the robot
                effect.require_fit(model.facts)
                out.append(effect)
    return out


def widened(model: Model, causes: Sequence[Cause]) -> Model:
    """The model with the effects of the causes added, each at the value where it vanishes."""
    have = {e.name for e in model.effects}
    extra = {e.name: e for c in causes if not c.present for e in c.effects if e.name not in have}.values()
    new = [p for e in extra for p in e.parameters(model.facts)]
    nulled = [replace(p, nominal=p.nominal if p.null is None else p.null) for p in new]
    markers = list(zip(model.marker_names, model.markers, strict=True))
    return make_model(
        model.facts, (*model.effects, *extra), (*model.parameters, *nulled), model.tip, markers, model.gravity
    )
