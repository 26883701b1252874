"""Designs: certified, exact plans close to the bound, and the certificate tells a wrong design."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from qsframework.errors import InputError, NotIdentifiable
from qsframework.experiment import Constraints, Experiment, read_plan, write_plan
from qsframework.information import (
    Allowed,
    information,
    predicted_sd,
)
from qsframework.plans import CRITERIA, broken_constraints, check_poses, design, find_criterion, generate_candidates
from qsframework.plans.exact import Quotas, exchange


@pytest.mark.parametrize("name", CRITERIA)
def test_gradients_agree_with_differences(name: str) -> None:
    criterion = find_criterion(name)
    rng = np.random.default_rng(1)
    root = rng.normal(size=(5, 5))
    M = root @ root.T + np.eye(5)
    G = criterion.expansion(M).slope * criterion.value(M)
    for _ in range(5):
        d = rng.normal(size=(5, 5))
        d = d + d.T
        slope = (criterion.value(M + 1e-6 * d) - criterion.value(M - 1e-6 * d)) / 2e-6
        assert np.isclose(-np.trace(G @ d), slope, rtol=1e-6)
    assert np.isclose(np.trace(G @ M), criterion.value(M), rtol=1e-12)  # Euler: homogeneous of degree -1
    assert np.isclose(criterion.value(3 * M), criterion.value(M) / 3)


def test_groups_and_caps_are_linear_programmes() -> None:
    import scipy.optimize

    rng = np.random.default_rng(4)
    for _ in range(30):
        scores = rng.random(12)
        groups = (np.arange(5), np.arange(5, 12))
        allowed = Allowed(groups, (0.4, 0.6), cap=0.15)
        A = np.zeros((2, 12))
        A[0, :5] = A[1, 5:] = 1
        lp = scipy.optimize.linprog(-scores, A_eq=A, b_eq=[0.4, 0.6], bounds=(0, 0.15))
        assert np.isclose(allowed.best(scores), -lp.fun)


def test_exchange_finds_the_best_plan_of_a_small_problem() -> None:
    rows = np.random.default_rng(5).normal(size=(14, 2, 3))
    criterion = find_criterion("A")
    M = information(rows)
    best = min(float(criterion.value(M[list(c)].sum(0))) for c in itertools.combinations(range(14), 4))
    quotas = Quotas((np.arange(14),), (4,), np.arange(14))
    chosen = exchange(rows, criterion, quotas, None, 20, np.random.default_rng(0))
    assert np.isclose(float(criterion.value(M[chosen].sum(0))), best)


@pytest.fixture(scope="module")
def plan(m900ib: Experiment):  # type: ignore[no-untyped-def]
    return design(m900ib, 12, "D", 1000, seed=0)


def test_the_m900ib_plan_is_close_to_the_best(m900ib: Experiment, plan) -> None:  # type: ignore[no-untyped-def]
    assert plan.certificate.relaxed_efficiency >= 0.9999
    assert plan.certificate.efficiency >= 0.95
    assert list(plan.load).count("weight_and_side_pull") == 3
    assert len(plan.pose) == 12
    for name, allowed in check_poses(m900ib, m900ib.model(), plan.pendant).items():
        assert allowed.all(), name


def test_the_plan_beats_table_5(m900ib: Experiment, plan) -> None:  # type: ignore[no-untyped-def]
    from qsframework.experiment import example

    paper = read_plan(example("m900ib") / "table5.csv", m900ib)
    ours, theirs = predicted_sd(m900ib, plan), predicted_sd(m900ib, paper)
    assert np.isinf(theirs[0])  # nothing loads joint 1
    assert np.isfinite(ours).all()
    assert np.all(ours[1:] < 1.1 * theirs[1:])


def test_a_seed_gives_one_plan(m900ib: Experiment) -> None:
    first, second = (design(m900ib, 8, "A", 200, seed=7) for _ in range(2))
    assert np.array_equal(first.pendant, second.pendant)


def test_plans_survive_their_files(m900ib: Experiment, plan, tmp_path) -> None:  # type: ignore[no-untyped-def]
    write_plan(tmp_path / "plan.csv", plan, m900ib)
    again = read_plan(tmp_path / "plan.csv", m900ib)
    assert np.allclose(again.pendant, plan.pendant, rtol=1e-15, atol=1e-15)
    assert again.certificate == plan.certificate
    assert again.load == plan.load
    text = (tmp_path / "plan.csv").read_text()
    (tmp_path / "plan.csv").write_text(text.replace("p01", "q01"))
    assert read_plan(tmp_path / "plan.csv", m900ib).certificate is None  # the proof is of another file


def test_constraints_are_kept_and_explained(m900ib: Experiment) -> None:
    tight = m900ib.with_(
        constraints=Constraints(z_min=2.0, axis1_distance_min=1.5, joint_limits={"joint_2": (0.0, 0.5)})
    )
    found = generate_candidates(tight, 50, seed=1)
    assert found.pendant[:, 1].min() >= 0.0
    assert found.pendant[:, 1].max() <= 0.5
    assert set(found.removed) >= {"z_min", "axis1_distance_min", "transmission angle"}
    with pytest.raises(InputError, match=r"z_min excludes \d+"):
        generate_candidates(m900ib.with_(constraints=Constraints(z_min=9.0)), 10)


def test_table_5_breaks_two_of_its_own_limits(m900ib: Experiment) -> None:
    """Rows 7 and 8 are 5 deg from a flat loop, rows 11 and 12 are 0.84 m from axis 1; the paper keeps no margin."""
    from qsframework.experiment import example

    paper = read_plan(example("m900ib") / "table5.csv", m900ib)
    bare = m900ib.with_(constraints=replace(m900ib.constraints, joint_margin=0.0))
    assert broken_constraints(bare, paper) == {
        "transmission angle": ("row07", "row08"),
        "axis1_distance_min": ("row11", "row12"),
    }


def test_weight_alone_cannot_tell_joint_1(m900ib: Experiment) -> None:
    with pytest.raises(NotIdentifiable, match=r"joint_compliance\[joint_1\]: no reading depends on it"):
        design(m900ib.with_(loads=m900ib.loads[:1]), 8, "D", 100)


@pytest.mark.parametrize(
    ("poses", "criterion", "words"),
    [(2, "D", "the loads ask for 3 poses in all, the plan has 2"), (12, "Q", "unknown criterion 'Q'")],
)
def test_impossible_plans(m900ib: Experiment, poses: int, criterion: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        design(m900ib, poses, criterion, 50)


def test_no_noise_no_loads(m900ib: Experiment, r2000ic: Experiment) -> None:
    with pytest.raises(InputError, match="a design needs `loads`"):
        design(r2000ic, 5)
    with pytest.raises(InputError, match="a design needs the noise"):
        design(r2000ic.with_(loads=m900ib.loads), 5)


def test_too_few_poses_for_the_parameters(m900ib: Experiment) -> None:
    one = m900ib.with_(loads=m900ib.loads[1:], markers=m900ib.markers[:1])
    with pytest.raises((NotIdentifiable, InputError)):
        design(one, 1, "D", 30)
