"""What the names leave: the test for remaining signal, where it may be, and what may stand in the place of a name."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from qsframework.diagnose.baseline import Baseline, fits_beside
from qsframework.diagnose.learn import LawTrial, foretold, law_trials
from qsframework.diagnose.named_causes import FoundCauses, SearchOptions
from qsframework.diagnose.remaining_signal import (
    BEATS,
    Likely,
    finest,
    named_in,
    on_one_axis,
    open_alternative,
    remaining_signal,
)
from qsframework.diagnose.result import Leftover, NamedCause
from qsframework.estimation import orthonormal
from qsframework.estimation.linear_fit import winsorised
from qsframework.hypotheses.catalogue.causes import Cause
from qsframework.hypotheses.catalogue.generic_laws import Block, generic_blocks, motions
from qsframework.hypotheses.catalogue.law import LikelyPlace
from qsframework.hypotheses.exact_refit import SettledFit
from qsframework.hypotheses.search.places import Competition, compete
from qsframework.plugin import Array

_ROUNDED = 0.5
"""Share of the noise below which what is left is rounding: the noise is never found below that."""
_AHEAD = 2.2
"""Nats by which the causes of the library must be likelier than places that follow no law of it, for a name to be
certain."""
_LIKELY = 60
"""Laws over which each fold averages anew, to say whether what is learned predicts."""
_SPEAKS, _BESIDE = 1.5, 4.0
"""Nats for some part of the arm that moves from which on it is said: where nothing is named, and beside names."""


@dataclass(frozen=True, kw_only=True)
class Remaining:
    """What the names leave and where it may be, by name the law that stands in its place as well, those that cannot
    stand beside theirs, what can be learned and how well a choice among laws foretells, and how places compete."""

    leftovers: tuple[Leftover, ...] = ()
    places: tuple[LikelyPlace, ...] = ()
    alternatives: Mapping[str, Leftover]
    beaten: Collection[str]
    law_trials: Sequence[LawTrial] = ()
    anew: float = 0.0
    race: Competition | None = None


NOTHING = Remaining(alternatives={}, beaten=())
"""Where nothing may be said of what is left."""


@dataclass(frozen=True, kw_only=True)
class _Left:
    """What a fit leaves: significant laws, the likeliest by their axes, the evidence of all blocks, places and race."""

    leftovers: tuple[Leftover, ...] = ()
    likely: tuple[Likely, ...] = ()
    evidence: tuple[float, ...] = ()
    places: tuple[LikelyPlace, ...] = ()
    race: Competition | None = None


def remaining_beside(base: Baseline, causes: Sequence[Cause], fit: SettledFit, options: SearchOptions) -> Remaining:
    """The generic blocks against what an exact fit with causes leaves, and in the place of each of these."""
    moved = motions(fit.model, base.rows, fit.x, fit.frames)
    blocks = list(generic_blocks(moved))
    noise = base.rows.padded_noise
    columns = noise.colour(fit.jacobian)
    values = noise.colour(winsorised(fit.white, orthonormal(fit.jacobian)))
    fits = fits_beside(base.rows, columns)
    found = _Left()
    if fits.unit(int(fits.choose(values[:, None])[0]), values) > _ROUNDED:
        left, e = remaining_signal(blocks, fits, values, options.of_remaining, options.seed + 1, base.rows.mask.ravel())
        likely = on_one_axis(blocks, e, fits, values, fit.model.facts)
        race = compete(moved, fits, values, {} if causes else base.visible_causes())
        left = finest(left, likely)
        acts = bool(left) or race.margin > (_BESIDE if causes else _SPEAKS)
        places = race.likely([(x.whole, x.evidence) for x in likely]) if acts else ()
        found = _Left(leftovers=left, likely=tuple(likely), evidence=tuple(e.tolist()), places=places, race=race)
    here = tuple(x for x in found.leftovers if found.places and x.law.where in found.places[0].wheres)
    strong = sorted(zip(found.evidence, blocks, strict=False), key=lambda x: -x[0])[:_LIKELY]
    among = [*((x.evidence, x.block) for x in found.likely), *strong]
    trials = law_trials(fit.model, among, here, len(blocks), fits, values)
    leftovers, places = _by_place(found, here)
    alternatives, beaten = _in_place_of(base, causes, fit, blocks, values)
    return Remaining(
        leftovers=leftovers,
        places=places,
        alternatives=alternatives,
        beaten=beaten,
        law_trials=trials,
        anew=foretold([b.columns for _, b in among], fits, values, np.repeat(base.rows.pose, 3)) if trials else 0.0,
        race=found.race,
    )


def _by_place(found: _Left, here: Sequence[Leftover]) -> tuple[tuple[Leftover, ...], tuple[LikelyPlace, ...]]:
    """What is left, that of the likeliest place first, and the places: a block `here` that passed its own test says by
    which variable the first moves."""
    left, places = found.leftovers, found.places
    if here:
        law = here[0].law
        same = (replace(places[0].law, by=()), *places[0].equivalent)
        first = replace(places[0], law=law, equivalent=tuple(x for x in same if x.where != law.where))
        return (*here, *(x for x in left if x not in here)), (first, *places[1:])
    if found.race is not None and places:
        p = left[0].p_value if left else float(np.exp(-found.race.margin))
        left = (Leftover(places[0].law, p, found.race.margin), *left)
    return left, places


def _in_place_of(
    base: Baseline, causes: Sequence[Cause], fit: SettledFit, blocks: Sequence[Block], values: Array
) -> tuple[dict[str, Leftover], set[str]]:
    """By cause the law that stands in its place as well, and the causes that cannot stand beside theirs."""
    columns = base.rows.padded_noise.colour(fit.jacobian)
    names = {c.name: c.names for c in causes}
    alternatives: dict[str, Leftover] = {}
    beaten: set[str] = set()
    for name in named_in(fit, names, columns):
        own = [columns.shape[1] - len(fit.names) + fit.names.index(p) for p in names[name.name]]
        found = open_alternative(blocks, fits_beside(base.rows, np.delete(columns, own, axis=1)), values, name)
        if found is not None:
            alternatives[name.name] = found[0]
            beaten |= {name.name} if found[1] else set()
    return alternatives, beaten


@dataclass(frozen=True, eq=False)
class GivenCauses:
    """Causes that are given, the exact fit with them, and how places and the other causes compete beside them."""

    causes: tuple[Cause, ...]
    fit: SettledFit
    run: Callable[[], Competition]

    @cached_property
    def race(self) -> Competition:
        """Run where somebody asks."""
        return self.run()


Beside = Callable[[frozenset[str]], GivenCauses]


def races_of(found: FoundCauses) -> Beside:
    """The race beside some of the names that were found, each made once; beside none where no fit with them leads
    anywhere."""
    base, others = found.base, cache(found.base.visible_causes)
    noise = base.rows.padded_noise

    @cache
    def beside(names: frozenset[str]) -> GivenCauses:
        causes = tuple(c for c in found.causes if c.name in names)
        fit = base.refit(causes)
        if fit is None:
            return beside(frozenset[str]())

        def run() -> Competition:
            columns = noise.colour(fit.jacobian if causes else base.case.A)
            # what was drawn in of the readings at the last model is no effect here either
            values = base.values + (fit.residuals - base.fit.residuals).ravel()
            moved = motions(fit.model, base.rows, fit.x, fit.frames)
            rest = {name: own for name, own in others().items() if name not in names}
            return compete(moved, fits_beside(base.rows, columns), values, rest)

        return GivenCauses(causes, fit, run)

    return beside


def likelier_place(name: str, others: Collection[str], beside: Beside) -> Leftover | None:
    """The likeliest law of the likeliest place beside the other names, with the nats by which it is ahead of a name;
    None where the causes are plainly ahead of all places."""
    race = beside(frozenset(others)).race
    if not race.parts or race.causes_ahead > _AHEAD:
        return None
    first = race.parts[0]
    return Leftover(first.told(1.0).law, float("nan"), first.evidence - race.causes.get(name, 0.0))


def beaten_names(causes: Sequence[Cause], beside: Beside) -> set[str]:
    """The causes that some place is far ahead of, whatever law makes it move."""
    names = {c.name for c in causes}
    law = {name: likelier_place(name, names - {name}, beside) for name in names}
    return {name for name, x in law.items() if x is not None and x.evidence > BEATS}


def with_alternatives(findings: Sequence[NamedCause], remaining: Remaining, beside: Beside) -> tuple[NamedCause, ...]:
    """The names, each with the law that stands in its place as well: by the test for remaining signal, or else by the
    places that compete beside the other names."""
    names = [f.name for f in findings]
    law = {n: remaining.alternatives.get(n) or likelier_place(n, {*names} - {n}, beside) for n in names}
    return tuple(replace(f, instead=law[f.name]) for f in findings)
