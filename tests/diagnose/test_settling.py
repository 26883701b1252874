"""Fits of the exact model: what ends them, what they do where the physics refuses, and what no answer may hold."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from qsframework.diagnose import fitted
from qsframework.diagnose.causes import find_causes
from qsframework.diagnose.explain import _beyond, refit  # pyright: ignore[reportPrivateUsage]
from qsframework.diagnose.fitted import Settled, settle_fit
from qsframework.elastostatics import Model, exact_readings
from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.experiment import Readings
from qsframework.identify.linear import fit_rows, identify_linear
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen
from tests.diagnose.cases import campaign, measured

SPRING = "joint_compliance[joint_2]"


@pytest.fixture(scope="module")
def readings() -> Readings:
    return measured(seed=2, count=12)


def fit(readings: Readings, names: tuple[str, ...] = (), start: Array | None = None) -> Settled:
    experiment = campaign()
    model = experiment.model()
    rows, _ = fit_rows(experiment, readings, 6)
    return settle_fit(model, readings, rows, rows.noise, names or experiment.fit_names(),
                      model.nominal if start is None else start)  # fmt: skip


def test_too_few_steps_are_said_and_no_explanation(readings: Readings, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit that does not settle is refused in words; as a cause's refit it leads nowhere, and nothing breaks."""
    experiment = campaign()
    baseline = fit(readings)
    rows, _ = fit_rows(experiment, readings, 6)
    causes, _ = find_causes(experiment, experiment.fit_names(), readings.poses)
    case: Any = SimpleNamespace(experiment=experiment, fitted=experiment.fit_names())
    one = [next(c for c in causes if c.name == "tool_compliance[y]")]
    found = refit(case, one, baseline, readings, rows, rows.noise)
    assert found is not None
    assert found.chi2 <= baseline.chi2
    monkeypatch.setattr(fitted, "_STEPS", 1)
    with pytest.raises(NotConverged, match=r"did not settle in 1 steps; .*joint_compliance\[joint_2\].* far from lin"):
        fit(readings)
    assert refit(case, one, baseline, readings, rows, rows.noise) is None


def test_what_the_readings_do_not_tell_is_refused(readings: Readings) -> None:
    """Loads along gravity only never turn joint 1; without any load no joint is told."""
    down = np.zeros((12, 6))
    down[:, 2] = -4000.0
    for wrench in (down, np.zeros((12, 6))):
        poses = replace(readings.poses, wrench=frozen(wrench))
        with pytest.raises(NotIdentifiable, match="cannot tell the parameters"):
            fit(replace(readings, poses=poses))


def test_without_an_equilibrium_the_fit_is_the_linear_one(readings: Readings, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against the linear least squares of `identify`, which know nothing of the equilibrium."""

    def unstable(*_: object) -> None:
        raise NotConverged("beyond the arm's stability")

    monkeypatch.setattr(fitted, "exact_readings", unstable)
    found = fit(readings)
    assert not found.exact
    names = campaign().fit_names()
    expected = identify_linear(campaign(), readings, names)
    assert [found.value(n) for n in names] == pytest.approx([e.value for e in expected.estimates], rel=1e-5)
    predicted = campaign().model().predict(readings.poses, found.x)[readings.measurement, readings.marker]
    np.testing.assert_allclose(found.residuals, readings.displacement - predicted, atol=1e-12)


def refusing(monkeypatch: pytest.MonkeyPatch, limit: float) -> None:
    """From now on joint 2 must not give more than a limit."""

    def bounded(model: Model, poses: Any, x: Array) -> Array:
        if x[model.names.index(SPRING)] > limit:
            raise InputError("the effect refuses this value")
        return exact_readings(model, poses, x)

    monkeypatch.setattr(fitted, "exact_readings", bounded)


def test_a_step_into_values_that_an_effect_refuses_is_halved(
    readings: Readings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fit comes near the edge of what is allowed, not beyond, and better than its start."""
    free = fit(readings).value(SPRING)
    start = campaign().model().nominal
    at = campaign().model().names.index(SPRING)
    start[at] = 0.3 * free
    refusing(monkeypatch, 0.8 * free)
    found = fit(readings, (SPRING,), start)
    assert 0.75 * free < found.value(SPRING) <= 0.8 * free
    assert found.exact


def test_a_fit_that_can_go_nowhere_stays(readings: Readings, monkeypatch: pytest.MonkeyPatch) -> None:
    free = fit(readings).value(SPRING)
    start = campaign().model().nominal
    start[campaign().model().names.index(SPRING)] = 0.5 * free
    refusing(monkeypatch, 0.5 * free)
    found = fit(readings, (SPRING,), start)
    np.testing.assert_array_equal(found.x, start)
    left = readings.displacement - exact_readings(found.model, readings.poses, start)[
        readings.measurement, readings.marker]  # fmt: skip
    np.testing.assert_allclose(found.residuals, left, atol=1e-15)


@pytest.mark.parametrize(("sds", "unphysical"), [(0.0, False), (1.9, False), (2.1, True)])
def test_a_parameter_significantly_beyond_its_bound_is_not_physical(
    readings: Readings, sds: float, unphysical: bool
) -> None:
    found = fit(readings)
    at = found.model.names.index(SPRING)
    assert found.model.parameters[at].lower == 0.0
    x = found.x.copy()
    x[at] = -sds * found.sd(SPRING)
    assert _beyond(replace(found, x=x)) is unphysical
    capped = replace(found.model.parameters[at], upper=found.value(SPRING) - sds * found.sd(SPRING), nominal=0.0)
    model = replace(found.model, parameters=(*found.model.parameters[:at], capped, *found.model.parameters[at + 1 :]))
    assert _beyond(replace(found, model=model)) is unphysical
