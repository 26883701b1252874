"""Fits of the exact model: what ends them, what they do where the physics refuses, and what no answer may hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from qsframework.elastostatics import Model
from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.experiment import ReadingRows, Readings, make_rows
from qsframework.hypotheses.catalogue.causes import find_causes
from qsframework.hypotheses.exact_refit import SettledFit, settle_fit
from qsframework.hypotheses.search.model_selection import _beyond, refit  # pyright: ignore[reportPrivateUsage]
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen
from tests.diagnose.cases import campaign, measured, unstable

SPRING = "joint_compliance[joint_2]"


@pytest.fixture(scope="module")
def readings() -> Readings:
    return measured(seed=2, count=12)


def fit(readings: Readings, names: tuple[str, ...] = (), start: Array | None = None) -> SettledFit:
    experiment = campaign()
    model = experiment.model()
    return settle_fit(
        model, make_rows(readings), names or experiment.fit_names(), model.nominal if start is None else start
    )


def test_too_few_steps_are_said_and_no_explanation(readings: Readings, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit that does not settle is refused in words; as a cause's refit it leads nowhere, and nothing breaks."""
    experiment = campaign()
    baseline = fit(readings)
    rows = make_rows(readings)
    causes, _ = find_causes(experiment, experiment.fit_names(), rows)
    case: Any = SimpleNamespace(experiment=experiment, fitted=experiment.fit_names())
    one = [next(c for c in causes if c.name == "flange_compliance[y]")]
    found = refit(case, one, baseline, rows)
    assert found is not None
    assert found.chi2 <= baseline.chi2
    monkeypatch.setattr("qsframework.estimation.solver._STEPS", 1)
    with pytest.raises(NotConverged, match=r"did not settle in 1 steps: joint_compliance\[joint_\d\] is at .* nominal"):
        fit(readings)
    assert refit(case, one, baseline, rows) is None


def test_what_the_readings_do_not_tell_is_refused(readings: Readings) -> None:
    """Loads along gravity only never turn joint 1; without any load no joint is told."""
    down = np.zeros((24, 6))
    down[:12, 2] = -4000.0
    for wrench in (down, np.zeros((24, 6))):
        poses = replace(readings.poses, wrench=frozen(wrench))
        with pytest.raises(NotIdentifiable, match="do not identify the parameters"):
            fit(readings.with_poses(poses))


def test_without_an_equilibrium_there_is_no_fit(readings: Readings, monkeypatch: pytest.MonkeyPatch) -> None:
    """The linear fit is a start, and never given out for the exact one; where its values are borne, it leads home."""
    right = fit(readings)
    model = campaign().model()
    far = model.nominal
    far[model.index(campaign().fit_names())] *= 5e2  # no equilibrium here, and one at the linear fit
    found = fit(readings, start=far)
    names = campaign().fit_names()
    assert [found.value(n) for n in names] == pytest.approx([right.value(n) for n in names], rel=1e-4)
    unstable(monkeypatch)
    with pytest.raises(NotConverged, match=r"the full equilibrium can be fitted neither .* Check the nominal values"):
        fit(readings)


def refusing(monkeypatch: pytest.MonkeyPatch, limit: float, times: float = np.inf) -> list[float]:
    """From now on an effect refuses that joint 2 gives more than a limit, so many times; the values that it refused."""
    refused: list[float] = []

    def bounded(right: Callable[..., Any]) -> Callable[..., Any]:
        def asked(self: ReadingRows, model: Model, x: Array, *more: Any) -> Any:
            value = float(x[model.names.index(SPRING)])
            if value > limit and len(refused) < times:
                refused.append(value)
                raise InputError("the effect refuses this value")
            return right(self, model, x, *more)

        return asked

    for name in ("predict", "rates"):
        monkeypatch.setattr(ReadingRows, name, bounded(getattr(ReadingRows, name)))
    return refused


def test_a_step_into_values_that_an_effect_refuses_is_shortened(
    readings: Readings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is refused twice on the way costs steps; the fit comes to where it would have come."""
    free = fit(readings, (SPRING,)).value(SPRING)
    start = campaign().model().nominal
    start[campaign().model().names.index(SPRING)] = 0.3 * free
    refused = refusing(monkeypatch, 0.8 * free, 2)
    found = fit(readings, (SPRING,), start)
    assert len(refused) == 2
    assert refused[1] < refused[0]
    assert found.value(SPRING) == pytest.approx(free, rel=1e-4)


def test_a_fit_at_the_edge_of_what_an_effect_allows_says_that_it_is_stuck(
    readings: Readings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The least squares lie beyond: where the steps end is no optimum, and is not given out as one."""
    free = fit(readings, (SPRING,)).value(SPRING)
    start = campaign().model().nominal
    start[campaign().model().names.index(SPRING)] = 0.5 * free
    refusing(monkeypatch, 0.8 * free)
    with pytest.raises(NotConverged, match=r"the fit (is stuck|did not settle)|no answer where the fit leads"):
        fit(readings, (SPRING,), start)


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
