"""What designs do at the edges: rows that tell too little, accuracy beyond float64, rows too many to hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.errors import InputError, NotCertified, NotIdentifiable
from qsframework.experiment import Experiment
from qsframework.information import Allowed, as_rows, bound_of, everything, scores
from qsframework.plans import DesignOptions, design, generate_candidates, problem
from qsframework.plans.column_generation import solve_columns
from qsframework.plans.criteria import Criterion, Determinant, Expansion, Linear, Mean
from qsframework.plans.exact import Quotas, exchange
from qsframework.plans.interior import Small, solve_small
from qsframework.plans.relaxed import optimum
from qsframework.plans.task import make_task
from qsframework.plugin import Array, Indices

RNG = np.random.default_rng(11)
ROWS = RNG.normal(size=(150, 2, 3))


def blind() -> Array:
    """The third parameter does to every reading what the second does, twice."""
    rows = ROWS.copy()
    rows[..., 2] = 2.0 * rows[..., 1]
    return rows


def test_neither_solver_designs_for_parameters_that_are_one() -> None:
    for criterion in (Determinant(), Linear()):
        with pytest.raises(NotIdentifiable, match="do not identify all parameters"):
            solve_columns(make_task(as_rows(blind()), Mean(criterion), everything(150)), np.random.default_rng(0))
    with pytest.raises(NotIdentifiable, match="all candidates together do not identify"):
        optimum(blind()[:, None], Mean(Determinant()), everything(150))


class Own(Criterion):
    """A third party's criterion: the determinant under a name that cvxpy's reference has no form for."""

    name, title = "own", "own"

    def value(self, M: Array) -> Array:
        return Determinant().value(M)

    def expansion(self, M: Array) -> Expansion:
        return Determinant().expansion(M)

    def in_basis(self, T: Array) -> Criterion:
        return self


def test_a_criterion_of_ones_own_is_solved_but_has_no_reference() -> None:
    task = make_task(as_rows(ROWS), Mean(Own()), everything(150))
    assert solve_columns(task, np.random.default_rng(0)).efficiency >= 1 - 1e-6
    with pytest.raises(NotCertified, match="cvxpy has no form for the criterion own"):
        optimum(ROWS[:, None], Mean(Own()), everything(150))


@pytest.mark.parametrize("rule", [Mean(Determinant()), Mean(Linear())], ids=["D", "A"])
@pytest.mark.parametrize("cap", [np.inf, 1 / 12])
def test_asked_for_more_than_float64_holds_the_small_problem_gives_its_best(rule: Mean, cap: float) -> None:
    small = Small(ROWS[:, None], np.zeros(150, dtype=np.intp), np.ones(1), cap, np.zeros((1, 3, 3)))
    for gap in (0.0, -1.0):
        found = solve_small(small, rule, gap)
        assert found.weights.sum() == pytest.approx(1.0, abs=1e-9)
        assert found.weights.min() >= 0.0
        assert found.weights.max() <= min(cap, 1.0) + 1e-9
        allowed = Allowed((slice(None),), (1.0,), cap)
        assert bound_of(scores(ROWS, found.expansion.slope), allowed) > 1 - 1e-9


def test_nested_subsets_lead_to_the_same_design() -> None:
    """So many candidates that a sixteenth of them is solved in two stages first."""
    rng = np.random.default_rng(12)
    rows = rng.normal(size=(80_000, 1, 1, 2)) * np.exp(rng.normal(size=(80_000, 1, 1, 1)))
    best = solve_columns(make_task(as_rows(rows), Mean(Determinant()), everything(80_000)), rng)
    assert best.efficiency >= 1 - 1e-6
    flat = rows[:, 0, 0]
    slope = np.linalg.inv(best.information[0])
    top = np.einsum("ni,ij,nj->n", flat, slope, flat)
    assert top.max() / 2.0 == pytest.approx(1.0, abs=2e-6), "no candidate scores above p at the optimum"


def test_a_slot_with_thousands_of_candidates_takes_the_best_of_all() -> None:
    """Against trying all of them: what is looked at in parts is looked at whole."""
    rng = np.random.default_rng(13)
    rows = rng.normal(size=(9000, 2, 3))
    prior = np.eye(3)[None]
    found = exchange(rows, Determinant(), Quotas((np.arange(9000),), (1,), np.arange(9000)), None, 1, rng, prior=prior)
    M = prior[0] + np.swapaxes(rows, -1, -2) @ rows
    assert int(found[0]) == int(np.argmax(np.linalg.slogdet(M)[1]))


@pytest.fixture(scope="module")
def few(m900ib: Experiment) -> Array:
    return generate_candidates(m900ib, 60, seed=4).pendant


def test_rows_too_many_to_hold_are_made_again_for_the_same_plan(
    m900ib: Experiment, few: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = DesignOptions(criterion="D", polish=False, starts=3)
    held = design(m900ib, 10, candidates=few, options=options)
    made: list[int] = []
    rows_at = problem.DesignProblem.rows_at

    def counted(self: problem.DesignProblem, pendant: Array, index: Indices, linear: bool = False) -> Array:
        made.append(len(pendant))
        return rows_at(self, pendant, index, linear)

    monkeypatch.setattr(problem, "HELD_BYTES", 0)
    monkeypatch.setattr(problem.DesignProblem, "rows_at", counted)
    again = design(m900ib, 10, candidates=few, options=options)
    assert np.array_equal(held.pendant, again.pendant)
    assert sum(made) > 2 * len(few)


def test_a_parameter_that_few_candidates_tell_is_found(m900ib: Experiment) -> None:
    """5000 equal poses and eight others: a sample of the candidates tells too little, all of them enough."""
    rare = generate_candidates(m900ib, 8, seed=5).pendant
    many = np.concatenate([np.tile(rare[:1], (5000, 1)), rare])
    plan = design(
        m900ib,
        9,
        candidates=many,
        options=DesignOptions(criterion="D", repeats=True, polish=False, starts=3, efficiency=0.99),
    )
    assert len(np.unique(plan.pendant, axis=0)) > 2


def test_a_plan_of_too_few_poses_is_refused(m900ib: Experiment, few: Array) -> None:
    """One marker under one pull: three numbers for six springs."""
    one = m900ib.with_(loads=(replace(m900ib.loads[1], poses=None),), markers=m900ib.markers[:1])
    with pytest.raises(NotIdentifiable, match="no plan of 1 poses identifies all 6 parameters"):
        design(one, 1, candidates=few, options=DesignOptions(criterion="D"))


def test_a_budget_that_buys_nothing_is_refused(m900ib: Experiment, few: Array) -> None:
    dear = m900ib.with_(loads=tuple(replace(load, poses=None, poses_min=3, cost=2.0) for load in m900ib.loads))
    with pytest.raises(InputError, match="the poses_min of the loads cost 12 in all, the budget is 5"):
        design(dear, 8, candidates=few, options=DesignOptions(criterion="D", budget=5.0))
    free = m900ib.with_(loads=tuple(replace(load, poses=None, poses_min=None, cost=2.0) for load in m900ib.loads))
    with pytest.raises(InputError, match=r"a budget of 1\.5 buys no plan that the loads allow"):
        design(free, 8, candidates=few, options=DesignOptions(criterion="D", budget=1.5))
