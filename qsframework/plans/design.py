"""`design`: the poses that pin the parameters down best, with a proof of how close to the best they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, product

import numpy as np

from qsframework.arguments import checked
from qsframework.elastostatics import Site
from qsframework.errors import InputError, NotIdentifiable, some_of
from qsframework.estimation.statistics import identified_directions
from qsframework.experiment import Experiment, Plan, PlanCertificate, Readings, make_plan
from qsframework.experiment.observations import start_values
from qsframework.experiment.plan import nothing_bends
from qsframework.information.rows import as_rows, gathered_information
from qsframework.information.sensitivities import known_before
from qsframework.plans.candidates import Candidates, generate_candidates
from qsframework.plans.catalogue import find_criterion
from qsframework.plans.certified import relaxed_design, shares
from qsframework.plans.column_generation import Relaxed
from qsframework.plans.constraints import on_one_side
from qsframework.plans.criteria import Criterion, Mean, covariance
from qsframework.plans.exact import Quotas, exchange
from qsframework.plans.options import CriterionName, DesignOptions
from qsframework.plans.polish import polish
from qsframework.plans.problem import (
    DesignProblem,
    counted_once,
    draw_samples,
    make_problem,
    require_rank,
    taken_information,
)
from qsframework.plans.relaxed import SOLVER
from qsframework.plans.task import white_basis
from qsframework.plans.tip import tip_rows, unstated
from qsframework.plugin import Array, Indices, Poses
from qsframework.work import HERE, Work

_SHORTLIST = 2000
_NEAR, _SPLITS = 3, 12
"""How far from the relaxed shares, and how many ways to spend a budget are tried."""
_LOPSIDED = 0.9
_CHOICES = 4
"""Choices of loads and stations whose plans are made, the best by their bounds."""
_FIRST_STEP = (
    "the candidates are scored by the first step to their equilibrium, which a sample of them shows to rank alike; the "
    "bound over them is of that model, the values of the plan are of the equilibrium"
)
_NOTHING_MOVES = (
    "criterion I: none of the parameters of `fit` moves the tip at the test poses, after the frame and the tool that "
    "suit best where nobody states these. Ask for criterion D, or fit other parameters"
)
Progress = Callable[[str, int, int], None]


@checked
def design(
    experiment: Experiment,
    poses: int,
    criterion: CriterionName = "I",
    candidates: int | Candidates | Array = 1000,
    seed: int = 0,
    progress: Progress | None = None,
    *,
    options: DesignOptions | None = None,
    test_poses: Poses | None = None,
    tip: Site | None = None,
    taken: Sequence[Plan | Readings] = (),
    work: Work = HERE,
) -> Plan:
    """A plan of poses, certified against the best relaxed design over the same candidates.

    Args:
        experiment: the campaign.
        poses: how many poses.
        criterion: I, D, A, O3, Ds or L.
        candidates: how many to draw, or poses (N, n) rad.
        seed: random seed.
        progress: called with each step, how much is done and of how much.
        options: everything else; it replaces the criterion.
        test_poses: for I: where the tip is to be known best.
        tip: the load point if None.
        taken: plans or readings whose information is there already; a plan's pose that was read counts once.
        work: where the candidates and the exchange are computed.

    Returns:
        The plan with its certificate.

    Raises:
        InputError: where the experiment cannot give a plan.
        NotIdentifiable: before any optimisation, where its readings do not identify the parameters.
        NotCertified: where the certificate misses the required efficiency.
    """
    options = options or DesignOptions(criterion=criterion)
    if poses < 1 and options.budget is None:
        raise InputError(f"poses must be 1 or more, found {poses}")
    loaded = test_poses is None or np.any(test_poses.wrench) or experiment.plans_positions
    if not loaded and tip is None:  # a task has points of its own tip, which may bear no load
        raise InputError(replace(nothing_bends(), argument=("test-poses", "PLAN")))
    tell: Progress = progress or (lambda step, done, total: None)
    if isinstance(candidates, int):
        told = partial(tell, "candidate poses")
        candidates = generate_candidates(experiment, candidates, seed, told, work)
    given, (taken, again) = taken, counted_once(taken)
    names = experiment.fit_names()
    samples = np.stack(
        [start_values(experiment, names, x) for x in draw_samples(experiment.model(), options.samples, seed)]
    )

    def prior(of: Sequence[str]) -> Array:
        return _prior(experiment, options, taken, of, samples)

    total = poses if options.budget is None else options.budget
    problem = make_problem(
        experiment, candidates, total, samples, prior, options.budget is not None, partial(tell, "sensitivities"), work
    )
    require_rank(problem)
    of_tip = options.criterion == "I"
    beside = unstated(experiment, problem.names) if of_tip and not options.free else ()
    rule = Mean(_criterion(problem, options, test_poses, tip, beside))
    tries = [_relaxed(own, rule, options, seed, tell) for own in choices(problem, options)]
    tries.sort(key=lambda one: one.bound)
    best: _Tried | None = None
    for one in tries[:_CHOICES]:
        if best is None or one.bound < best.value:
            one = _chosen(one, rule, options, seed, tell, work)
            best = one if best is None or one.value < best.value else best
    assert best is not None
    once = (f"poses that stand twice in what was taken count once: {some_of(again)}",) if again else ()
    plan, M = _plan(best, rule, options, tries[0].bound, seed, tell, *once)
    if of_tip and not options.free:
        base = Mean(_criterion(problem, options, test_poses, tip, ())) if beside else None
        plan = _with_tip(plan, base and float(base.value(M)), float(rule.value(_as_known(problem))))
    if experiment.constraints.collision is False or on_one_side(experiment, plan.pendant).all():
        return plan
    every = problem.pendant
    kept = every[on_one_side(experiment, every)]
    anew = partial(design, experiment, poses, candidates=kept, seed=seed, progress=progress, options=options)
    left = f"{len(every) - len(kept)} of {len(every)} candidates are left out: a loop would pass flat on the way"
    return _noted(anew(test_poses=test_poses, tip=tip, taken=given, work=work), left)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Tried:
    """A problem with its relaxed design: no plan has a criterion below `bound`. fixed: poses of each load, where fixed;
    chosen (m,), counts (m,): the candidates of its plan, whose criterion is `value`"""

    problem: DesignProblem
    relaxed: Relaxed
    fixed: tuple[int | None, ...]
    bound: float
    chosen: Indices
    counts: Indices
    value: float = np.inf


def _relaxed(problem: DesignProblem, rule: Mean, options: DesignOptions, seed: int, tell: Progress) -> _Tried:
    relaxed, fixed = relaxed_design(problem, rule, options, seed, lambda b: tell("relaxed design", int(1e6 * b), 10**6))
    bound = relaxed.efficiency * _relaxed_value(problem, rule, relaxed)
    nothing = np.zeros(0, dtype=np.intp)
    return _Tried(problem=problem, relaxed=relaxed, fixed=fixed, bound=bound, chosen=nothing, counts=nothing)


def _relaxed_value(problem: DesignProblem, rule: Mean, relaxed: Relaxed) -> float:
    """The criterion of a relaxed design with as many poses as the plan, where they settle."""
    best = relaxed.information
    if problem.linear:
        best = problem.prior / problem.total + _settled_information(problem, relaxed.index, relaxed.weights)
    return float(rule.value(best)) / problem.total


def _chosen(one: _Tried, rule: Mean, options: DesignOptions, seed: int, tell: Progress, work: Work) -> _Tried:
    """With the candidates of its plan."""
    chosen, counts = _exact(one.problem, rule, options, one.relaxed, one.fixed, seed, tell, work)
    M = one.problem.prior + _settled_information(one.problem, chosen, counts.astype(float))
    return replace(one, chosen=chosen, counts=counts, value=float(rule.value(M)))


def choices(problem: DesignProblem, options: DesignOptions) -> list[DesignProblem]:
    """The problem with each choice of loads to bring and stations to set up, less what these cost by themselves; the
    problem as it is where nothing costs by itself. InputError where the budget pays for none."""
    loads = [g for g, load in enumerate(problem.loads) if load.change and options.budget is not None]
    stations = problem.stations
    paid = options.budget is not None and any(problem.reading.stations[s].cost for s in stations)
    if not loads and not paid:
        return [problem]
    out: list[DesignProblem] = []
    for kept, left in product(_subsets(stations)[1:] if paid else [stations], _subsets(loads)):
        fixed = sum(problem.reading.stations[s].cost for s in kept)
        fixed += sum(problem.loads[g].change for g in loads if g not in left)
        total = problem.total - fixed
        counts = tuple(0 if g in left else c for g, c in enumerate(problem.counts))
        enough = total >= max(float(problem.prices @ problem.least), float(problem.prices.min()))
        if enough and not any(problem.least[g] for g in left) and any(c != 0 for c in counts):
            out.append(replace(problem.of_stations(kept), total=total, counts=counts))
    if not out:
        raise InputError(f"a budget of {problem.total:g} does not pay for one station and one load with its poses")
    return [own for own in out if _has_rank(own)] or out


def _has_rank(problem: DesignProblem) -> bool:
    try:
        require_rank(problem)
    except NotIdentifiable:
        return False
    return True


def _subsets(of: Sequence[int]) -> list[tuple[int, ...]]:
    return [some for k in range(len(of) + 1) for some in combinations(of, k)]


def _prior(
    experiment: Experiment,
    options: DesignOptions,
    taken: Sequence[Plan | Readings],
    names: Sequence[str],
    samples: Array,
) -> Array:
    """Information (S, p, p) that is there before: what is known, readings and plans taken already."""
    before = known_before(experiment.model(), names, options.free)
    total = np.tile(np.diag(before**2), (len(samples), 1, 1))
    for one in taken:
        total = total + taken_information(experiment, one, names, samples)
    return total


def _criterion(
    problem: DesignProblem,
    options: DesignOptions,
    test_poses: Poses | None,
    site: Site | None,
    beside: Sequence[int],
) -> Criterion:
    experiment = problem.experiment
    experiment.model().index(options.interest)  # an InputError names the nearest
    strange = [name for name in options.interest if name not in experiment.fit_names()]
    if strange:
        raise InputError(f"parameters of interest that are not fitted: {', '.join(strange)}")
    held = {own.name: own for own in problem.held}
    if lost := [held[name].words() for name in options.interest if name in held]:
        raise NotIdentifiable(f"parameters of interest that no plan of these readings identifies: {'; '.join(lost)}")
    interest = [problem.names.index(name) for name in options.interest]
    tip, width = None, problem.reading.width
    if options.criterion == "I":
        tip = tip_rows(experiment, test_poses, problem.pendant, problem.names, site, beside)
        if not tip.any():
            raise InputError(f"{experiment.path}: {_NOTHING_MOVES}")
        tip = np.pad(tip, ((0, 0), (0, 0), (0, width - len(problem.names))))
    return find_criterion(options.criterion, interest, width, tip, problem.wanted.tolist())


def _exact(
    problem: DesignProblem,
    rule: Mean,
    options: DesignOptions,
    relaxed: Relaxed,
    fixed: tuple[int | None, ...],
    seed: int,
    tell: Progress,
    work: Work,
) -> tuple[Indices, Indices]:
    """The plan's candidates (m,) and how often each is measured (m,)."""
    short = _shortlist(problem, relaxed)
    rows, weights = problem.rows.take(short), relaxed.spread(len(problem.rows))[short]
    T = white_basis(rows, problem.prior)
    rows, white, prior = rows @ T, rule.in_basis(T), T.T @ problem.prior @ T
    best, best_value = np.zeros(0, dtype=np.intp), np.inf
    splits = _splits(problem, options, relaxed, fixed)
    for turn, counts in enumerate(splits):
        quotas = _quotas(problem, short, counts, options.repeats)

        def said(i: int, n: int, turn: int = turn) -> None:
            tell("exact plan (exchange)", turn * n + i, n * len(splits))

        rng = np.random.default_rng(seed)
        try:
            chosen = exchange(rows, white, quotas, weights, options.starts, rng, said, prior, work)
        except NotIdentifiable:
            if turn + 1 == len(splits) and not len(best):
                raise
            continue
        M = problem.prior + gathered_information(problem.rows, short[chosen], np.ones(len(chosen)))
        value = float(rule.value(M))
        if value < best_value:
            best, best_value = short[chosen], value
    return np.unique(best, return_counts=True)


def _shortlist(problem: DesignProblem, relaxed: Relaxed) -> Indices:
    """The candidates that score best at the relaxed design, some of every load, and those that carry weight."""
    each = max(_SHORTLIST // len(problem.loads), 50)
    parts = [relaxed.index]
    for own in map(problem.indices, range(len(problem.loads))):
        parts.append(own[np.argpartition(-relaxed.scores[own], each - 1)[:each]] if each < len(own) else own)
    return np.unique(np.concatenate(parts))


def _splits(
    problem: DesignProblem, options: DesignOptions, relaxed: Relaxed, fixed: tuple[int | None, ...]
) -> list[tuple[tuple[tuple[int, ...], int], ...]]:
    """Ways to share the poses: pairs of loads that share a number of poses, and that number."""
    free = tuple(g for g, c in enumerate(fixed) if c is None)
    stated = tuple(((g,), c) for g, c in enumerate(fixed) if c)
    if options.budget is None:
        rest = round(problem.total) - sum(c for c in fixed if c is not None)
        return [(*stated, (free, rest)) if free and rest else stated]
    return [
        tuple(((g,), c) for g, c in enumerate(counts) if c) for counts in _affordable(problem, relaxed, problem.total)
    ]


def _affordable(problem: DesignProblem, relaxed: Relaxed, budget: float) -> list[tuple[int, ...]]:
    """Numbers of poses per load near the relaxed shares that cost at most the budget and waste little of it."""
    costs = problem.prices
    share = shares(problem, relaxed) * budget / costs
    least = [max(m, c or 0) for m, c in zip(problem.least, problem.counts, strict=True)]
    ranges = [
        range(1) if c == 0 else range(max(int(s) - _NEAR, m), int(s) + _NEAR + 2)
        for s, m, c in zip(share, least, problem.counts, strict=True)
    ]
    found = [c for c in product(*ranges) if np.dot(c, costs) <= budget + 1e-9 and sum(c) > 0]
    tight = [c for c in found if np.dot(c, costs) + costs.min() > budget + 1e-9]
    if not tight:
        raise InputError(f"a budget of {budget:g} buys no plan that the loads allow")
    return sorted(tight, key=lambda c: float(np.abs(np.array(c) - share).sum()))[:_SPLITS]


def _quotas(
    problem: DesignProblem, short: Indices, counts: tuple[tuple[tuple[int, ...], int], ...], repeats: bool
) -> Quotas:
    load = problem.load(short)
    groups = tuple(np.flatnonzero(np.isin(load, loads)) for loads, _ in counts)
    return Quotas(groups, tuple(count for _, count in counts), problem.place(short), repeats)


def _plan(
    one: _Tried, rule: Mean, options: DesignOptions, bound: float, seed: int, tell: Progress, *notes: str
) -> tuple[Plan, Array]:
    """Put the chosen candidates, polished, and the certificate into a Plan, with its information. bound: no plan has a
    criterion below it"""
    problem, relaxed, chosen, counts = one.problem, one.relaxed, one.chosen, one.counts
    total = int(counts.sum())
    M = problem.prior + _settled_information(problem, chosen, counts.astype(float))
    relaxed_value = _relaxed_value(problem, rule, relaxed)
    efficiency = relaxed.efficiency if bound >= one.bound else bound / relaxed_value
    before = efficiency * relaxed_value / float(rule.value(M))
    poses, polished = problem.batch(chosen), None
    if options.polish:
        pendant = polish(problem, rule, chosen, counts, lambda i, n: tell("polish", i, n))
        pendant, chosen, counts = _met(problem, pendant, chosen, counts)
        q = problem.experiment.robot.controller.to_joints(pendant)
        poses = replace(problem.batch(chosen), pendant=pendant, q=q)
        rows = problem.rows_at(pendant, chosen)
        M = problem.prior + sum(c * np.swapaxes(r, -1, -2) @ r for c, r in zip(counts, rows, strict=True))
        polished = before
    value = float(rule.value(M))
    certificate = PlanCertificate(
        criterion=rule.name,
        value=value,
        relaxed_value=relaxed_value,
        relaxed_efficiency=efficiency,
        efficiency=efficiency * relaxed_value / value,
        candidates=len(problem.rows),
        poses=total,
        parameters=problem.names,
        solver=SOLVER if options.solver == "cvxpy" else "column generation",
        polished_from=polished,
        notes=(
            *_notes(problem, rule, M[0], np.bincount(problem.load(chosen), minlength=len(problem.loads))),
            *_nothing_new(problem, options, M[0]),
            *((_FIRST_STEP,) if problem.linear else ()),
            *notes,
        ),
    )
    load, station = problem.load(chosen), problem.station(chosen)
    order = np.lexsort((*poses.pendant.T[::-1], load, station))
    names = tuple(problem.loads[int(g)].name for g in load[order])
    stations = tuple(problem.reading.stations[int(s)].name for s in station[order])
    plan = make_plan(
        poses.take(order),
        names,
        counts[order].tolist(),
        rule.name,
        certificate,
        seed,
        units=problem.experiment.robot.controller.units,
        station=stations,
        robot=problem.experiment.robot.name,
    )
    return plan, M


def _met(problem: DesignProblem, pendant: Array, chosen: Indices, counts: Indices) -> tuple[Array, Indices, Indices]:
    """Polished poses, with their candidates and counts: those that have come to the same are one, counted together."""
    own = np.column_stack([problem.station(chosen), problem.load(chosen), pendant])
    _, first, same = np.unique(own, axis=0, return_index=True, return_inverse=True)
    kept = np.sort(first)
    return pendant[kept], chosen[kept], np.bincount(first[same.ravel()], counts)[kept].astype(np.intp)


def _as_known(problem: DesignProblem) -> Array:
    """The information before the plan, springs of which nothing is known as far off as their stated, else their
    natural size."""
    model, names = problem.experiment.model(), problem.names
    sharp = [p.scale / (p.sd or p.scale) for p in (model.parameters[i] for i in model.index(names))]
    own = np.where(known_before(model, names), 0.0, sharp)
    return problem.prior + np.diag(np.pad(own**2, (0, problem.reading.width - len(names))))


def _with_tip(plan: Plan, base: float | None, before: float) -> Plan:
    """With what is known of the tip in the base frame, where that is not what the plan is for, and before the plan."""
    assert plan.certificate is not None
    return replace(plan, certificate=replace(plan.certificate, value_in_base=base, value_before=before))


def _noted(plan: Plan, note: str) -> Plan:
    assert plan.certificate is not None
    return replace(plan, certificate=replace(plan.certificate, notes=(*plan.certificate.notes, note)))


def _settled_information(problem: DesignProblem, index: Indices, weights: Array) -> Array:
    """M (S, p, p) of chosen candidates and their weights, where they settle."""
    if not problem.linear:
        return gathered_information(problem.rows, index, weights)
    return gathered_information(as_rows(problem.made(index)), np.arange(len(index)), weights)


def _nothing_new(problem: DesignProblem, options: DesignOptions, M: Array) -> tuple[str, ...]:
    """What is to be said of a plan whose parameters are all known better than its readings could tell them."""
    wanted = problem.wanted
    before = known_before(problem.experiment.model(), problem.names, options.free)[wanted]
    if not before.all() or identified_directions(covariance(M)[np.ix_(wanted, wanted)], 1.0 / before):
        return ()
    return (
        "these readings would identify none of the parameters better than they are known already: worth measuring is "
        "what nobody states, such as the springs of the joints under `loads`",
    )


def _notes(problem: DesignProblem, rule: Mean, M: Array, counts: Indices) -> tuple[str, ...]:
    """What a user should know: what is held, loads that nothing is planned under, and a criterion that depends on the
    parameters' scales. counts (loads,): poses under each"""
    notes: list[str] = []
    if problem.held:
        shown = some_of([own.name for own in problem.held], 6)
        notes.append(f"held at nominal, as no plan of these readings identifies them: {shown}")
    if any(load.of_positions for load in problem.loads):
        notes += [
            f"no pose is planned under {load.name or 'no load'}: leave it out, or state its poses_min"
            for load, count in zip(problem.loads, counts, strict=True)
            if not count
        ]
    if not rule.inner.depends_on_scale:
        return tuple(notes)
    wanted = problem.wanted
    variance = np.diag(np.linalg.inv(M))[wanted]
    share = variance / variance.sum()
    worst = int(np.argmax(share))
    if len(share) > 2 and share[worst] > _LOPSIDED:
        notes.append(
            f"criterion {rule.name} is all but decided by {problem.names[wanted[worst]]} ({100 * share[worst]:.0f} % "
            "of the scaled variances): it depends on the scale given to each parameter; D and I do not"
        )
    return tuple(notes)
