"""What the names leave: the test for remaining signal, where it may be, and what may stand in the place of a name.

With all names fitted, a generic block that is still significant says that they are not the whole truth. And a name
stands only where no generic block explains the readings nearly as well in its place, the other names given: of blocks
that cannot do what the name does, the odds together must be small; of those that can, none may beat it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import chain

import numpy as np

from qsframework.diagnoses.baseline import Baseline, fits_beside
from qsframework.diagnoses.learn import LawTrial, foretold, law_trials
from qsframework.diagnoses.named_causes import FoundCauses, SearchOptions
from qsframework.diagnoses.result import Leftover, NamedCause
from qsframework.estimation.linear_fit import winsorised
from qsframework.estimation.projection import Flags
from qsframework.estimation.visit_noise import Reml
from qsframework.hypotheses.catalogue.causes import Cause
from qsframework.hypotheses.catalogue.generic_laws import Block, generic_blocks, motions, single_axes
from qsframework.hypotheses.catalogue.law import Law, LikelyPlace
from qsframework.hypotheses.exact_refit import SettledFit
from qsframework.hypotheses.search.evidence import DRAWS, evidence
from qsframework.hypotheses.search.places import Competition, compete
from qsframework.plugin import Array, RobotFacts

_ROUNDED = 0.5
"""Share of the noise below which what is left is rounding: the noise is never found below that."""
_AHEAD = 2.2
"""Nats by which the causes of the library must be likelier than places that follow no law of it, for a name to be
certain."""
_LIKELY = 60
"""Laws over which each fold averages anew, to say whether what is learned predicts."""
_SPEAKS, _BESIDE = 1.5, 4.0
"""Nats for some part of the arm that moves from which on it is said: where nothing is named, and beside names."""
_LEADS = 1.0
"""Nats by which one part must lead for the places to be ranked where nothing is certain: a hint, no finding. In 12
clean campaigns none led."""
_OUT_OF_SIZE = 10.0
"""Prior sds beyond which the laws at a name's place are asked with the odds of such a size, by Student's t with 4
degrees of freedom: a zero after a crash, 8 sds off, is no question; one of 24 is worth 12 nats less."""
_HOLDS = 0.9
"""Share of a name's effect that a block must be able to do to count as one that holds it."""
_ODDS = 0.1
"""Of all blocks that do not hold a name together, against it."""
_LEAST = 6.2
"""Nats from which on something is left, whatever the draws of plain noise say: real noise has tails and grows."""
BEATS = 3.0
"""Nats by which a block that holds a name may be better; beyond them any block may stand in its place."""
_NEAR = 6.0
"""Nats below the likeliest law within which one axis of a place may be likelier still."""


@dataclass(frozen=True, kw_only=True)
class Remaining:
    """What the names leave and where it may be, by name the law that stands in its place as well, those that cannot
    stand beside theirs, what can be learned and how well a choice among laws predicts, and how places compete."""

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
    columns = noise.colour(basis := fit.basis())
    values = noise.colour(winsorised(fit.white, basis))
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


def ranked_places(remaining: Remaining, findings: Sequence[NamedCause], race: Competition) -> tuple[LikelyPlace, ...]:
    """Where what is left may be; else what may act in the place of an open name, by the race beside the others; where
    nothing is certain, as the race ranks the places, of which one must lead."""
    if remaining.places or any(f.instead for f in findings):
        return remaining.places or race.likely()
    return race.likely() if not findings and remaining.race is race and race.lead > _LEADS else ()


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
    noise = base.rows.padded_noise
    columns = noise.colour(fit.jacobian)
    names = {c.name: c.names for c in causes}
    alternatives: dict[str, Leftover] = {}
    beaten: set[str] = set()
    for name in named_in(fit, names, columns):
        fits = fits_beside(base.rows, noise.colour(fit.basis(names[name.name])))
        found = open_alternative(blocks, fits, values, name)
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
            columns = noise.colour(fit.basis() if causes else base.case.fit.Q)
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


def with_alternatives(
    findings: Sequence[NamedCause], causes: Sequence[Cause], remaining: Remaining, beside: Beside
) -> tuple[NamedCause, ...]:
    """The names, each with the law that stands in its place as well: by the test for remaining signal, or else by the
    places that compete beside the other names, or, for a size that its prior hardly knows, by what moves its place."""
    names, cause = [f.name for f in findings], {c.name: c for c in causes}
    law = {n: remaining.alternatives.get(n) or likelier_place(n, {*names} - {n}, beside) for n in names}
    return tuple(
        replace(
            f,
            instead=law[f.name] or _alternative_of_size(f, cause[f.name], beside(frozenset({*names} - {f.name})).race),
        )
        for f in findings
    )


def _alternative_of_size(f: NamedCause, cause: Cause, race: Competition) -> Leftover | None:
    """The likeliest law at the place of a name that is far larger than what is known before the readings, where it is
    as likely by these and by that; None where the size is no question."""
    known = {p.name: p.nominal_sd or np.inf for p in cause.parameters}
    size = max(abs(v.value - v.initial) / known[v.name] for v in f.values)
    where = f.name.partition("[")[2].removesuffix("]").partition("/")[0]
    laws = [e for part in race.parts for e in part.explanations if e.law.by and e.law.place == where]
    if size <= _OUT_OF_SIZE or not laws:
        return None
    likeliest = max(laws, key=lambda e: e.evidence)
    ahead = likeliest.evidence - race.causes.get(f.name, np.inf) + float(2.5 * np.log1p(size**2 / 4.0))
    return Leftover(likeliest.law, float("nan"), ahead) if ahead > 0.0 else None


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """A name in an exact fit: columns (m, k) m of its parameters, effect (m,) m: what they did as fitted."""

    name: str
    columns: Array
    effect: Array


@dataclass(frozen=True, eq=False)
class Likely:
    """A block, about one axis alone where that is likelier than `whole`, its law about all; evidence: nats."""

    whole: Law
    block: Block
    evidence: float


def named_in(fit: SettledFit, causes: Mapping[str, Sequence[str]], colour: Array) -> tuple[NamedEffect, ...]:
    """The causes, by the names of their parameters; colour (m, q): the fit's columns in m."""
    first = colour.shape[1] - len(fit.names)
    nominal = fit.model.nominal
    out: list[NamedEffect] = []
    for name, parameters in causes.items():
        at = [first + fit.names.index(p) for p in parameters]
        index = fit.model.index(list(parameters))
        out.append(NamedEffect(name, colour[:, at], colour[:, at] @ (fit.x[index] - nominal[index])))
    return tuple(out)


def remaining_signal(
    blocks: Sequence[Block], fits: Reml, values: Array, level: float, seed: int, measured: Flags
) -> tuple[tuple[Leftover, ...], Array]:
    """Blocks that are significant in readings (m,) m beside all that a model fits, the strongest first, and the
    evidence (G,) of all blocks.

    The noise is drawn where the strongest is neither too weak to count nor beyond what draws can tell.
    """
    found = evidence((b.columns for b in blocks), fits, values, draws=0)
    if (found.e >= _LEAST).any() and found.p_values.min() > 1.0 / DRAWS:
        found = evidence((b.columns for b in blocks), fits, values, seed=seed, measured=measured)
    p = found.p_values
    left = tuple(
        Leftover(blocks[i].law, float(p[i]), float(found.e[i]))
        for i in map(int, np.argsort(-found.e))
        if p[i] <= level and found.e[i] >= _LEAST
    )
    return left, found.e


def on_one_axis(blocks: Sequence[Block], e: Array, fits: Reml, values: Array, facts: RobotFacts) -> list[Likely]:
    """The blocks near the likeliest, each about one axis of its place alone where that is likelier; e (G,): of all.

    Most parts give about one axis, and a law of all three pays for those about which nothing moves. An axis is one of
    several, which its evidence pays for.
    """
    near = [i for i in range(len(blocks)) if e[i] > e.max() - _NEAR]
    single = {i: list(single_axes(blocks[i], facts)) for i in near}
    every = [b for some in single.values() for b in some]
    finer = iter(evidence((b.columns for b in every), fits, values, draws=0).e)
    out: list[Likely] = []
    for i in near:
        own = [Likely(blocks[i].law, b, float(next(finer) - np.log(len(single[i])))) for b in single[i]]
        out.append(max([Likely(blocks[i].law, blocks[i], float(e[i])), *own], key=lambda x: x.evidence))
    return out


def finest(left: Sequence[Leftover], likely: Sequence[Likely]) -> tuple[Leftover, ...]:
    """What is left, by the axes about which it moves, the likeliest first."""
    finer = {x.whole: x for x in likely}
    found = [Leftover(finer[x.law].block.law, x.p_value, finer[x.law].evidence) if x.law in finer else x for x in left]
    return tuple(sorted(found, key=lambda x: -x.evidence))


def open_alternative(
    blocks: Sequence[Block], fits: Reml, values: Array, name: NamedEffect
) -> tuple[Leftover, bool] | None:
    """The generic block that stands in the place of a name best, where one does, and whether it is so far ahead that
    the name cannot stand beside it; fits: of all but the name."""
    columns = chain([name.columns], (b.columns for b in blocks))
    found = evidence(columns, fits, values + name.effect, effects=name.effect[:, None], draws=0)
    ahead, holds = found.e[1:] - found.e[0], found.held[1:, 0] >= _HOLDS
    odds = np.where(holds, 0.0, np.exp(np.minimum(ahead, 50.0)))
    beaten = np.max(ahead, where=holds, initial=-np.inf) > BEATS
    if odds.sum() < _ODDS and not beaten:
        return None
    margin: Array = ahead - np.where(holds, BEATS, np.log(_ODDS))
    best = int(np.argmax(margin))
    return Leftover(blocks[best].law, float("nan"), float(ahead[best])), bool(ahead[best] > BEATS)
