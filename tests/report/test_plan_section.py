"""The plan's section of a report: what it fits, and what it could tell besides."""

from __future__ import annotations

import numpy as np

from qsframework.experiment import Experiment, example, read_plan
from qsframework.information import predicted_beyond, predicted_sd
from qsframework.report.plan_section import beyond_table


def test_what_a_plan_tells_of_parameters_that_are_not_fitted(m900ib: Experiment) -> None:
    """The balancer's own spring is not seen by load-minus-no-load readings."""
    plan = read_plan(example("m900ib") / "table5.csv", m900ib)
    fitted = m900ib.with_(fit=tuple(f"joint_compliance[joint_{k}]" for k in range(2, 7)))
    beyond = predicted_beyond(fitted, plan)
    assert np.isinf(beyond["joint_compliance[joint_1]"])
    name = "compensator_stiffness[joint_2].stiffness"
    assert np.isclose(beyond[name], predicted_sd(fitted, plan, (*fitted.fit_names(), name))[-1])
    words = dict(beyond_table(fitted, beyond).rows)
    assert "no reading depends on it" in words["joint_compliance[joint_1]"]
    spring = next(text for key, text in words.items() if key.startswith("gravity_compensator") and "stiffness" in key)
    assert "not identifiable" in spring
