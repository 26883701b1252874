"""No plan beats the bound: every plan of a tiny problem, counted out, against the certificate."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, combinations_with_replacement, product
from pathlib import Path

import numpy as np
import pytest

from qsframework.experiment import Experiment, PlanCertificate
from qsframework.information import information
from qsframework.information.sensitivities import known_before
from qsframework.plans import DesignOptions, design, generate_candidates
from qsframework.plans.catalogue import find_criterion
from qsframework.plans.problem import make_problem
from qsframework.plans.tip import tip_rows
from tests.calibration.small_arm import SPRINGS, small_arm

FIT = tuple(f"joint_compliance[joint_{k}]" for k in (1, 2, 3))
KNOWN = (*FIT[:2], "gravity_compensator[joint_2].lc")
"""The last is known before any reading, as arms are delivered."""
POSES, COUNT = 7, 4


def small(experiment: Experiment, *changes: dict[str, object], fit: tuple[str, ...] = FIT) -> Experiment:
    loads = tuple(replace(load, **change) for load, change in zip(experiment.loads, changes, strict=True))  # type: ignore[arg-type]
    return experiment.with_(fit=fit, loads=loads, markers=experiment.markers[:1])


ASKED = {
    "stated": ({"poses": 2}, {"poses": 2}, {}),
    "least": ({"poses": None, "poses_min": 3}, {"poses": None}, {}),
    "free": ({"poses": None}, {"poses": None}, {}),
    "repeats": ({"poses": None}, {"poses": None}, {"repeats": True}),
    "budget": ({"poses": None}, {"poses": None, "cost": 2.5}, {"budget": 7.0}),
    "known": ({"poses": None}, {"poses": None}, {"fit": KNOWN}),
}


@pytest.mark.parametrize("criterion", ["D", "A", "I"])
@pytest.mark.parametrize("case", ASKED)
def test_no_plan_beats_the_bound(m900ib: Experiment, case: str, criterion: str) -> None:
    first, second, more = ASKED[case]
    fit = more.get("fit", FIT)
    more = {key: value for key, value in more.items() if key != "fit"}
    experiment = small(m900ib, first, second, fit=fit)
    candidates = generate_candidates(experiment, POSES, seed=3)
    options = DesignOptions(criterion=criterion, polish=False, efficiency=0.999, **more)  # type: ignore[arg-type]
    certificate = design(experiment, COUNT, candidates=candidates, options=options).certificate
    assert certificate is not None
    problem = make_problem(experiment, candidates, options.budget or COUNT, budget=options.budget is not None)
    M = information(problem.rows.take(np.arange(2 * POSES))[:, 0])
    rule = find_criterion(criterion, (), 3, tip_rows(experiment, None, candidates.pendant, fit))
    before = np.diag(known_before(experiment.model(), fit) ** 2)
    assert before.any() == (case == "known")
    values = [float(rule.value(before + M[list(plan)].sum(axis=0))) for plan in plans(experiment, options)]
    best = min(values)
    assert certificate.relaxed_value * certificate.relaxed_efficiency <= best * (1 + 1e-9)
    assert certificate.value <= best * (1 + 1e-9), "the exchange found less than the best plan"


def plans(experiment: Experiment, options: DesignOptions):  # type: ignore[no-untyped-def]
    """Every allowed plan, as candidates: pose i under load g is g * POSES + i."""
    choose = combinations_with_replacement if options.repeats else combinations
    for sides in range(COUNT + 1 if options.budget is None else 3):
        weights = COUNT - sides if options.budget is None else int(7.0 - 2.5 * sides + 1e-9)
        one, two = experiment.loads
        if (one.poses or weights) != weights or (two.poses or sides) != sides or weights < (one.poses_min or 0):
            continue
        for a, b in product(choose(range(POSES), min(weights, POSES)), choose(range(POSES), sides)):
            if options.repeats or not set(a) & set(b):
                yield (*a, *(POSES + i for i in b))


def test_the_bound_allows_more_of_a_load_than_its_least_number(tmp_path: Path) -> None:
    """Of three loads the slanted one would take all poses; with half of them for the side, the weight is better.

    The solver has made both least numbers exact by then: its own optimum is no bound for plans with more weights.
    """

    def certified(number: str) -> PlanCertificate:
        pulls = f"{{name: side, fy_N: 1050, poses_min: 4}}, {{name: down, fz_N: -2000, {number}}}"
        loads = f"[{pulls}, {{name: slanted, fy_N: 1000, fz_N: -1000}}]"
        arm = small_arm(tmp_path, loads=loads, more=f"fit: {list(SPRINGS[:2])}")
        options = DesignOptions(criterion="D", polish=False, repeats=True, efficiency=0.8)
        found = design(arm, 8, candidates=15, options=options).certificate
        assert found is not None
        return found

    free, best = certified("poses_min: 1"), min(certified(f"poses: {k}").value for k in range(1, 5))
    assert best < 0.98 * certified("poses: 1").value
    assert free.relaxed_value * free.relaxed_efficiency <= best * (1 + 1e-9)
