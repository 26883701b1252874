"""What a design refuses, and in which words; small corners of how plans are said and solved."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from qsframework.errors import InputError, NotCertified, NotIdentifiable
from qsframework.experiment import Experiment
from qsframework.experiment.noise import NoiseModel
from qsframework.plans import DesignOptions, design, generate_candidates
from qsframework.plans.catalogue import find_criterion
from qsframework.plans.certified import _fill  # pyright: ignore[reportPrivateUsage]
from qsframework.plans.constraints import joint_range
from qsframework.plans.criteria import Determinant
from qsframework.plans.symmetry import flips_wrist
from qsframework.plans.task import white_basis
from qsframework.plugin import Array, Poses
from qsframework.plugin.facts import frozen


@pytest.fixture(scope="module")
def few() -> Array:
    from qsframework.experiment import example, load_experiment

    return generate_candidates(load_experiment(example("m900ib") / "experiment.yaml"), 40, seed=1).pendant


def with_loads(experiment: Experiment, **change: object) -> Experiment:
    first = replace(experiment.loads[0], **change)  # pyright: ignore[reportArgumentType]
    return experiment.with_(loads=(first, *experiment.loads[1:]))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"solver": "simplex"}, "unknown solver 'simplex'; allowed: columns, cvxpy"),
        ({"criterion": "Q"}, "unknown criterion 'Q'; allowed: I, D"),
        ({"efficiency": 1.01}, "efficiency; found 1.01; allowed: 0 to 1"),
        ({"samples": 0}, "samples; found 0; allowed: 1 to 1000"),
    ],
)
def test_options_that_are_none(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as refused:
        DesignOptions(**wrong)
    (problem,) = refused.value.problems
    assert problem.argument == (*wrong, "")


@pytest.mark.parametrize("rows", [None, np.zeros((0, 3, 6))])
def test_a_criterion_of_the_tip_needs_test_poses(rows: Array | None) -> None:
    with pytest.raises(InputError, match="criterion I needs test poses"):
        find_criterion("I", (), 6, rows)


@pytest.mark.parametrize(
    ("options", "poses", "words"),
    [
        (DesignOptions(criterion="Ds"), 8, "needs the parameters of interest"),
        (DesignOptions(criterion="D", interest=("nothing",)), 8, "no parameter 'nothing'"),
        (
            DesignOptions(criterion="Ds", interest=("compensator_stiffness[joint_2].stiffness",)),
            8,
            "that are not fitted",
        ),
        (DesignOptions(criterion="D"), 2, "the loads ask for 3 poses in all, the plan has 2"),
        (DesignOptions(criterion="D"), 60, "too few candidates"),
        (DesignOptions(criterion="D", budget=9.0), 8, "with a budget the loads say poses_min"),
    ],
)
def test_wishes_that_cannot_be_met(
    m900ib: Experiment, few: Array, options: DesignOptions, poses: int, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        design(m900ib, poses, candidates=few, options=options)


def test_test_poses_without_a_load_are_refused_as_in_a_file(m900ib: Experiment, few: Array) -> None:
    """The tip's error under no load is nothing, whatever the plan."""
    idle = Poses(few, m900ib.robot.controller.to_joints(few), np.zeros((len(few), 6)))
    with pytest.raises(InputError, match="every force is zero; nothing bends the arm"):
        design(m900ib, 8, candidates=few, test_poses=idle)


def test_a_budget_with_costs_is_for_the_solver_columns(m900ib: Experiment, few: Array) -> None:
    dear = m900ib.with_(loads=tuple(replace(load, poses=None, cost=2.0) for load in m900ib.loads))
    with pytest.raises(InputError, match="a budget with costs needs the solver columns"):
        design(dear, 8, candidates=few, options=DesignOptions(criterion="D", budget=16.0, solver="cvxpy"))


def test_experiments_that_cannot_be_designed_for(m900ib: Experiment, few: Array) -> None:
    with pytest.raises(InputError, match="a design needs `loads`"):
        design(m900ib.with_(loads=()), 8, candidates=few)
    with pytest.raises(InputError, match="a design needs the noise"):
        design(m900ib.with_(noise=NoiseModel(None)), 8, candidates=few)
    broken = np.array(few)
    broken[[2, 5], 1] = np.nan
    with pytest.raises(InputError, match="angles that are not numbers: rows 2, 5"):
        design(m900ib, 8, candidates=broken)


def test_loads_that_tell_too_little_are_named_before_any_optimisation(m900ib: Experiment, few: Array) -> None:
    upright = with_loads(m900ib, wrench=frozen([0, 0, -4000.0, 0, 0, 0])).with_(loads=m900ib.loads[:1])
    with pytest.raises(NotIdentifiable, match=r"joint_compliance\[joint_1\]: no reading depends on it"):
        design(upright, 8, candidates=few)


def test_an_efficiency_beyond_all_is_not_certified(m900ib: Experiment, few: Array) -> None:
    with pytest.raises(NotCertified, match="asked for"):
        design(
            m900ib,
            8,
            candidates=few,
            options=DesignOptions(criterion="D", efficiency=1.0, polish=False, solver="cvxpy"),
        )


def test_limits_that_exclude_each_other(m900ib: Experiment) -> None:
    limits = replace(m900ib.constraints, joint_limits={"joint_2": (2.0, 3.0)})
    with pytest.raises(InputError, match="no range for joint_2"):
        joint_range(m900ib.with_(constraints=limits))


def test_filling_takes_the_best_first_and_all_the_room_at_most() -> None:
    room = np.array([0.5, 0.5, 0.5])
    assert _fill(np.array([1.0, 3.0, 2.0]), room, 0.75) == pytest.approx(0.5 * 3.0 + 0.25 * 2.0)
    assert room.tolist() == [0.5, 0.0, 0.25]
    assert _fill(np.array([1.0, 3.0, 2.0]), room, 9.0) == pytest.approx(0.5 * 1.0 + 0.25 * 2.0)
    assert not room.any()


def test_a_basis_of_rows_that_tell_too_little_only_scales() -> None:
    block = np.zeros((5, 1, 1, 2))
    block[..., 0] = 4.0
    T = white_basis(block, np.zeros((1, 2, 2)))
    np.testing.assert_allclose(T, np.diag([1.0 / 4.0, 1.0]))


def test_an_arm_of_three_joints_has_no_wrist_to_flip(m900ib: Experiment) -> None:
    facts = m900ib.robot.facts
    short = replace(
        facts,
        joints=facts.joints[:3],
        links=facts.links[:4],
        axes=facts.axes[:3],
        placements=facts.placements[:3],
        masses=facts.masses[:4],
        centres=facts.centres[:4],
    )
    assert not flips_wrist(short)
    assert flips_wrist(facts)


@pytest.mark.parametrize("k", [1, 3, 6, 9])
def test_one_more_pose_by_the_determinant_lemma(k: int) -> None:
    """Fewer rows than parameters go by the lemma, more by the matrix itself: the same value."""
    rng = np.random.default_rng(k)
    A, block = rng.standard_normal((20, 6)), rng.standard_normal((4, k, 6))
    rule, M = Determinant(), A.T @ A
    wanted = [float(rule.value(M + b.T @ b)) for b in block]
    np.testing.assert_allclose(rule.with_one(M, block), wanted, rtol=1e-10)


def test_progress_is_told_step_by_step(m900ib: Experiment, few: Array) -> None:
    told: list[tuple[str, int, int]] = []
    design(
        m900ib,
        8,
        "D",
        candidates=few,
        progress=lambda *what: told.append(what),
        options=DesignOptions(criterion="D", starts=2),
    )
    steps = list(dict.fromkeys(step for step, _, _ in told))
    assert steps[0] == "sensitivities"
    assert steps[-1] == "polish"
    assert all(0 <= done <= total for _, done, total in told)
