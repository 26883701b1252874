"""What can be asked of a design: groups, budgets, test poses, robustness, readings already taken, other candidates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.errors import InputError, NotCertified, NotIdentifiable
from qsframework.estimation import FitOptions, scales
from qsframework.experiment import Experiment, Plan, PlanCertificate, example, read_plan, simulate, write_plan
from qsframework.fits import identify
from qsframework.information import predicted_sd
from qsframework.plans import (
    DesignOptions,
    check_poses,
    design,
    filter_candidates,
    generate_candidates,
    grid_candidates,
    joint_sd,
    read_candidates,
)
from qsframework.plans.candidates import folds
from qsframework.plans.problem import counted_once, draw_samples, make_problem, sample_rows
from qsframework.plans.tip import tip_rows


def proof(plan: Plan) -> PlanCertificate:
    assert plan.certificate is not None
    return plan.certificate


def loads(experiment: Experiment, *changes: dict[str, object]) -> Experiment:
    return experiment.with_(
        loads=tuple(replace(load, **change) for load, change in zip(experiment.loads, changes, strict=True))  # type: ignore[arg-type]
    )


@pytest.mark.parametrize("criterion", ["I", "D", "A", "O3"])
def test_every_criterion_is_certified_and_kept_by_polish(m900ib: Experiment, criterion: str) -> None:
    options = DesignOptions(criterion=criterion, efficiency=0.999, starts=4)
    plan = design(m900ib, 12, candidates=150, options=options)
    c = proof(plan)
    assert c.relaxed_efficiency >= 0.999
    assert c.polished_from is not None
    assert 0.97 < c.polished_from <= 1.0
    assert c.efficiency >= c.polished_from - 1e-9
    assert np.isfinite(predicted_sd(m900ib, plan)).all()
    for name, allowed in check_poses(m900ib, m900ib.model(), plan.pendant).items():
        assert allowed.all(), name
    assert np.allclose(np.rad2deg(plan.pendant), np.round(np.rad2deg(plan.pendant), 6), atol=1e-9)


def test_each_criterion_is_best_at_what_it_says(m900ib: Experiment) -> None:
    """Every criterion's plan against the others', judged by the relaxed design's value."""
    from qsframework.information import information, information_rows
    from qsframework.plans.catalogue import find_criterion

    candidates = generate_candidates(m900ib, 150)
    tip = tip_rows(m900ib, None, candidates.pendant, m900ib.fit_names())
    plans = {
        c: design(m900ib, 12, candidates=candidates, options=DesignOptions(criterion=c, polish=False))
        for c in ("I", "D", "A")
    }
    for name, own in plans.items():
        rule = find_criterion(name, (), 6, tip)

        def value(plan: Plan, rule=rule) -> float:  # type: ignore[no-untyped-def]
            rows = information_rows(m900ib.model(), plan.poses, m900ib.fit_names(), 3e-5)
            return float(rule.value(np.tensordot(plan.repeats, information(rows), 1)))

        assert np.isclose(value(own), proof(own).value, rtol=1e-9)
        assert all(value(own) <= value(other) * 1.002 for other in plans.values())


def test_the_tips_error_is_what_simulation_shows(m900ib: Experiment) -> None:
    """sqrt of the I criterion against the spread of the predicted tip over 100 simulated campaigns.

    Of the linear model, in readings and fits: it is quick, and what a design counts. Nothing is gross, and one start
    is enough where the minimum is the only one.
    """
    options = FitOptions(linear=True, keep_all=True, starts=0)
    test = generate_candidates(m900ib, 40, seed=9)
    plan = design(m900ib, 12, "I", 150)
    rows = tip_rows(m900ib, None, test.pendant, m900ib.fit_names())
    promised = np.sqrt(np.mean([np.trace(A @ fit_covariance(m900ib, plan) @ A.T) for A in rows]))
    errors = []
    for seed in range(100):
        fit = identify(m900ib, simulate(m900ib, plan, seed=seed, linear=True).readings, options=options)
        step = np.array([e.value - e.initial for e in fit.estimates]) / scales(m900ib.fit_parameters())
        errors.append(np.mean([((A @ step) ** 2).sum() for A in rows]))
    assert np.isclose(np.sqrt(np.mean(errors)), promised, rtol=0.1)


def fit_covariance(experiment: Experiment, plan: Plan) -> np.ndarray:
    rows = sample_rows(experiment, plan.repeated(), experiment.fit_names(), experiment.model().nominal[None])
    flat = rows.reshape(-1, rows.shape[-1])
    return np.linalg.inv(flat.T @ flat)


def test_loads_share_poses_freely_and_keep_their_minimum(m900ib: Experiment) -> None:
    free = design(
        loads(m900ib, {"poses": None}, {"poses": None}),
        12,
        "D",
        150,
        options=DesignOptions(criterion="D", polish=False, starts=4),
    )
    stated = design(m900ib, 12, "D", 150, options=DesignOptions(criterion="D", polish=False, starts=4))
    least = loads(m900ib, {"poses": None, "poses_min": 8}, {"poses": None})
    kept = design(least, 12, "D", 150, options=DesignOptions(criterion="D", polish=False, starts=4))
    assert list(kept.load).count("weight") >= 8
    assert proof(free).value <= proof(kept).value <= proof(stated).value
    assert proof(kept).relaxed_efficiency > 0.9999
    with pytest.raises(InputError, match="the loads ask for 8 poses in all, the plan has 7"):
        design(least, 7, "D", 50)


def test_a_load_may_get_no_pose(m900ib: Experiment) -> None:
    """Three poses are all taken by the load that asks for three; the other's candidates stay out."""
    plan = design(m900ib, 3, "D", 150, options=DesignOptions(criterion="D", polish=False, starts=4))
    assert set(plan.load) == {"weight_and_side_pull"}
    assert proof(plan).relaxed_efficiency > 0.9999


def test_a_budget_buys_the_better_plan(m900ib: Experiment) -> None:
    """Dear side pulls: the plan costs at most the budget, and no split of it that we try does better."""
    priced = loads(m900ib, {"poses": None}, {"poses": None, "cost": 4.0})
    plan = design(priced, 1, "D", 150, options=DesignOptions(criterion="D", budget=20.0, polish=False, starts=4))
    sides = list(plan.load).count("weight_and_side_pull")
    weights = sum(plan.repeats) - sides
    assert weights + 4 * sides <= 20.0
    assert weights + 4 * sides + 1 > 20.0
    assert 0.8 < proof(plan).efficiency <= 1.0
    for count in range(1, 5):
        fixed = loads(m900ib, {"poses": 20 - 4 * count}, {"poses": count})
        other = design(fixed, 20 - 3 * count, "D", 150, options=DesignOptions(criterion="D", polish=False, starts=4))
        assert proof(plan).value <= proof(other).value * 1.01
    with pytest.raises(InputError, match="with a budget the loads say poses_min"):
        design(loads(m900ib, {}, {"cost": 4.0}), 1, "D", 100, options=DesignOptions(criterion="D", budget=20.0))


def test_repeats_are_counted(m900ib: Experiment) -> None:
    plan = design(m900ib, 18, "D", 200, options=DesignOptions(criterion="D", repeats=True, polish=False, starts=4))
    assert sum(plan.repeats) == 18
    assert max(plan.repeats) > 1
    once = design(m900ib, 18, "D", 200, options=DesignOptions(criterion="D", polish=False, starts=4))
    assert set(once.repeats) == {1}
    assert proof(plan).value <= proof(once).value * (1 + 1e-9)
    assert proof(once).relaxed_value >= proof(plan).relaxed_value, "weights up to 1/n only: a nearer bound"


def test_what_was_taken_counts(m900ib: Experiment) -> None:
    """Weight alone cannot tell joint 1; after a side pull was taken it need not."""
    weight = m900ib.with_(loads=m900ib.loads[:1])
    first = design(m900ib, 5, "D", 200)
    second = design(weight, 4, "D", 200, taken=(first,))
    assert np.isinf(predicted_sd(weight, second)[0])
    together = joint_sd(m900ib, [first, second])
    assert np.isfinite(together).all()
    assert (together <= predicted_sd(m900ib, first) * (1 + 1e-9)).all()
    readings = simulate(m900ib, first).readings
    assert np.allclose(joint_sd(m900ib, [readings]), predicted_sd(m900ib, first), rtol=1e-9)
    with pytest.raises(NotIdentifiable, match="joint_1"):
        design(weight, 4, "D", 200)


def test_a_pose_that_was_read_counts_once(m900ib: Experiment) -> None:
    """A plan and readings of four of its five poses, one of them under another name: one pose is left of the plan."""
    first = design(m900ib, 5, "D", 200)
    named = replace(first.take(np.arange(4)), pose=("p01", "p02", "p03", "own"))
    readings = simulate(m900ib, replace(named, pendant=named.pendant + np.deg2rad(0.01))).readings
    (read, rest), again = counted_once([first, readings])
    assert (read, again) == (readings, ["p01", "p02", "p03", "p04"])
    assert isinstance(rest, Plan)
    assert rest.pose == ("p05",)
    assert counted_once([first, first])[1] == list(first.pose)
    far = replace(first, pendant=first.pendant + np.deg2rad(5.0))
    assert counted_once([far, readings])[1] == []
    plan = design(m900ib, 4, "D", 200, taken=(first, readings))
    assert proof(plan).value == pytest.approx(proof(design(m900ib, 4, "D", 200, taken=(readings, rest))).value)
    assert any("count once: p01, p02, p03, p04" in note for note in proof(plan).notes)


def test_interest_in_one_parameter(m900ib: Experiment) -> None:
    name = "joint_compliance[joint_6]"
    i = m900ib.fit_names().index(name)
    of_it = design(
        m900ib, 12, candidates=150, options=DesignOptions(criterion="Ds", interest=(name,), polish=False, starts=4)
    )
    linear = design(
        m900ib, 12, candidates=150, options=DesignOptions(criterion="L", interest=(name,), polish=False, starts=4)
    )
    plain = design(m900ib, 12, candidates=150, options=DesignOptions(criterion="D", polish=False, starts=4))
    assert predicted_sd(m900ib, of_it)[i] < predicted_sd(m900ib, plain)[i]
    assert np.isclose(predicted_sd(m900ib, of_it)[i], predicted_sd(m900ib, linear)[i], rtol=0.02)
    with pytest.raises(InputError, match="needs the parameters of interest"):
        design(m900ib, 12, "Ds", 100)
    with pytest.raises(InputError, match="no parameter 'joint_7'"):
        design(m900ib, 12, candidates=100, options=DesignOptions(criterion="Ds", interest=("joint_7",)))


def test_a_robust_plan_suits_its_worst_sample(m900ib: Experiment) -> None:
    """With the balancer's equivalent stiffness the information depends on unknown values."""
    names = ("joint_compliance", "compensator_stiffness")
    parameters = tuple(
        replace(p, nominal=2e6, sd=6e5) if p.name.endswith("].stiffness") else p for p in m900ib.robot.parameters
    )
    parameters = tuple(
        replace(p, nominal=0.7, sd=0.1) if p.name.startswith("compensator_stiffness") and p.unit == "m" else p
        for p in parameters
    )
    bent = m900ib.with_(fit=names, robot=replace(m900ib.robot, parameters=parameters))
    candidates = generate_candidates(bent, 150)
    samples = draw_samples(bent.model(), 6, 0)
    mean = design(
        bent, 14, candidates=candidates, options=DesignOptions(criterion="D", samples=6, polish=False, starts=4)
    )
    assert np.isclose(np.mean([_d(bent, mean, x) for x in samples]), proof(mean).value, rtol=1e-9)
    assert proof(mean).relaxed_efficiency > 0.9999


def _d(experiment: Experiment, plan: Plan, x: np.ndarray) -> float:
    rows = sample_rows(experiment, plan.repeated(), experiment.fit_names(), x[None])
    flat = rows.reshape(-1, rows.shape[-1])
    return float(np.exp(-np.linalg.slogdet(flat.T @ flat)[1] / flat.shape[1]))


def test_candidates_from_a_grid_and_a_file(m900ib: Experiment, tmp_path: Path) -> None:
    grid = grid_candidates(m900ib, 3)
    assert grid.tried == 3**6
    lower = np.rad2deg(grid.pendant).min(axis=0)
    assert np.isclose(lower[1], -64.0, atol=0.02) or lower[1] >= -64.0
    plan = design(m900ib, 8, "D", grid, options=DesignOptions(criterion="D", polish=False, starts=4))
    assert all(np.abs(grid.pendant - q).max(axis=1).min() < 1e-12 for q in plan.pendant)
    write_plan(tmp_path / "poses.csv", plan, m900ib)
    again = read_candidates(m900ib, tmp_path / "poses.csv")
    assert np.allclose(again.pendant, plan.pendant)
    (tmp_path / "few.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,0,0,0,0,0\n0,500,0,0,0,0\n")
    with pytest.raises(InputError, match="line 3, column q2_deg"):
        read_candidates(m900ib, tmp_path / "few.csv")
    with pytest.raises(InputError, match="a grid needs 2 or more levels"):
        grid_candidates(m900ib, 40)


def test_the_two_step_method_gets_its_angles(m900ib: Experiment) -> None:
    """joint_values: the same angles of joint 2 several times, also after polish."""
    angles = tuple(np.deg2rad([-30.0, 20.0, 55.0]))
    stepped = m900ib.with_(constraints=replace(m900ib.constraints, joint_values={"joint_2": angles}))
    plan = design(stepped, 12, "D", 150)
    found = {round(float(a), 6) for a in np.rad2deg(plan.pendant[:, 1])}
    assert found <= {-30.0, 20.0, 55.0}
    assert len(found) >= 2


def test_the_wrists_flip_is_folded(m900ib: Experiment, r2000ic: Experiment) -> None:
    assert folds(m900ib)
    assert (generate_candidates(m900ib, 200).pendant[:, 4] >= 0.0).mean() > 0.95
    assert not folds(r2000ic), "without loads nothing can be asked of the model"


def test_given_candidates_are_checked(m900ib: Experiment) -> None:
    with pytest.raises(InputError, match="rows 1"):
        make_problem(m900ib, np.array([[0.0] * 6, [np.nan] + [0.0] * 5]), 4)
    one = generate_candidates(m900ib, 1)
    with pytest.raises((NotIdentifiable, InputError)):
        design(m900ib, 12, "D", one)
    with pytest.raises(InputError, match="no pose keeps the constraints"):
        filter_candidates(m900ib, np.zeros((3, 6)) + np.deg2rad([0, 80, -120, 0, 0, 0]))
    twice = generate_candidates(m900ib, 100)
    doubled = np.concatenate([twice.pendant, twice.pendant])
    first, second = (
        design(m900ib, 12, "D", poses, options=DesignOptions(criterion="D", polish=False, repeats=True))
        for poses in (twice, doubled)
    )
    assert np.isclose(proof(first).relaxed_value, proof(second).relaxed_value, rtol=1e-5)


def test_cvxpy_is_the_reference(m900ib: Experiment) -> None:
    ours, theirs = (
        proof(design(m900ib, 12, candidates=60, options=DesignOptions(criterion="D", solver=s, polish=False, starts=4)))
        for s in ("columns", "cvxpy")
    )
    assert np.isclose(ours.relaxed_value, theirs.relaxed_value, rtol=1e-5)
    assert theirs.solver == "CLARABEL"
    with pytest.raises(InputError, match="cvxpy takes up to 5000 candidates"):
        design(m900ib, 12, candidates=3000, options=DesignOptions(criterion="D", solver="cvxpy"))
    with pytest.raises(InputError, match="unknown solver"):
        DesignOptions(criterion="D", solver="magic")
    with pytest.raises(NotCertified):
        design(m900ib, 12, candidates=100, options=DesignOptions(criterion="D", efficiency=1.0))


def test_a_lopsided_criterion_warns(m900ib: Experiment) -> None:
    """A parameter scaled by a tiny sd decides A all by itself; D does not care."""
    robot = m900ib.robot
    scaled = tuple(replace(p, sd=p.nominal * (1e-4 if "joint_6" in p.name else 0.3) or None) for p in robot.parameters)
    odd = m900ib.with_(robot=replace(robot, parameters=scaled))
    assert (
        "joint_compliance[joint_6]"
        in proof(design(odd, 12, "A", 200, options=DesignOptions(criterion="A", polish=False, starts=4))).notes[0]
    )
    assert not proof(design(odd, 12, "D", 200, options=DesignOptions(criterion="D", polish=False, starts=4))).notes


def test_minutes_of_a_plan_survive_its_file(m900ib: Experiment, tmp_path: Path) -> None:
    plan = design(m900ib, 8, "A", 200)
    write_plan(tmp_path / "p.csv", plan, m900ib)
    assert read_plan(tmp_path / "p.csv", m900ib).certificate == plan.certificate


def test_the_paper_plan_promises_less(m900ib: Experiment) -> None:
    paper = read_plan(example("m900ib") / "table5.csv", m900ib)
    assert np.isinf(predicted_sd(m900ib, paper)[0])
