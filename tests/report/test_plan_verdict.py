"""When a plan is called ready."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qsframework.experiment import Experiment
from qsframework.information import predicted_sd
from qsframework.plans import DesignOptions, design
from qsframework.report.words.plan import plan_verdict


def test_a_plan_in_one_corner_is_not_ready(m900ib: Experiment) -> None:
    plan = design(m900ib, 6, "D", 100, options=DesignOptions(criterion="D", polish=False, starts=2))
    assert plan_verdict(m900ib, plan, predicted_sd(m900ib, plan)).word == "Plan ready"
    pendant = plan.pendant.mean(axis=0) + np.deg2rad(0.5) * (plan.pendant - plan.pendant.mean(axis=0)) / np.pi
    near = replace(plan, pendant=pendant, q=m900ib.robot.controller.to_joints(pendant))
    verdict = plan_verdict(m900ib, near, predicted_sd(m900ib, plan))
    assert verdict.word == "Plan is weak"
    assert "all at one place" in verdict.said
