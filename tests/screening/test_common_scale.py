"""Springs that are all off by one factor: a load or readings in another unit, which no residual shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from qsf_onboarding.text import PROPOSED
from qsframework.experiment import Experiment, LoadUncertainty, Readings
from qsframework.fits import Fit, identify
from qsframework.fits.soundness import check_findings
from qsframework.screening import Mistake, find_mistakes
from qsframework.screening.common_scale import common_factor, log_sd
from tests.screening.test_conventions import campaign


def scaled(readings: Readings, factor: float) -> Readings:
    """The same readings beside loads of which the file says 1 / factor."""
    return readings.with_poses(replace(readings.poses, wrench=readings.poses.wrench / factor))


def suspected(experiment: Experiment, readings: Readings) -> list[Mistake]:
    return [c for c in find_mistakes(experiment, readings, gross=False) if c.name == "load_unit"]


def changed(experiment: Experiment, names: Sequence[str], **values: object) -> Experiment:
    """The campaign with these fields of some parameters changed."""
    own = tuple(replace(p, **values) if p.name in names else p for p in experiment.robot.parameters)
    return experiment.with_(robot=replace(experiment.robot, parameters=own))


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (2.0, "half of the load stands in the file"),
        (0.5, "the load is counted twice"),
        (4.4482216, "in lbf"),
        (1 / 9.80665, "once more"),
    ],
)
def test_all_springs_off_together_are_named_on_both_sides(m900ib: Experiment, factor: float, said: str) -> None:
    (found,) = suspected(m900ib, scaled(campaign(m900ib, 7), factor))
    assert said in found.words
    assert "95 %" in found.words
    assert np.isclose(found.value, factor)
    assert found.finding.stops


def test_a_factor_of_no_unit_is_named_as_it_is(m900ib: Experiment) -> None:
    """60 times: between that of inches and that of kN."""
    (found,) = suspected(m900ib, scaled(campaign(m900ib, 7), 60.0))
    assert "in another unit, or the load is counted wrong" in found.words
    assert 40.0 < found.value < 80.0


def test_one_spring_ten_times_as_soft_is_no_common_factor(m900ib: Experiment) -> None:
    for name in ("joint_compliance[joint_2]", "joint_compliance[joint_5]"):
        soft = changed(m900ib, [name], nominal=1e-8, sd=3e-9)
        assert not suspected(soft, campaign(m900ib, 7))


@pytest.mark.parametrize("source", [f"{PROPOSED}: 1 mrad under its own weight", ""])
def test_of_values_that_nobody_states_it_is_a_note(m900ib: Experiment, source: str) -> None:
    """Ten times stiffer than the arm is what a guess may be: what uses the fit says so and goes on."""
    proposed = changed(m900ib, m900ib.fit_names(), source=source)
    fit: Fit = identify(proposed, scaled(campaign(m900ib, 7), 9.80665))
    (finding,) = fit.account.findings
    assert not finding.stops
    assert "No source is stated of the nominal values" in finding.words
    assert fit.account.stopping == ()
    (note,) = check_findings(fit)
    assert note.startswith("load unit: all compliances come out about")


def test_the_loads_own_uncertainty_counts(m900ib: Experiment) -> None:
    """Springs that are known to 5 % and a load that is known to 40 %: a factor of 1.5 is no finding."""
    own = tuple(replace(p, sd=0.05 * p.nominal) if p.sd else p for p in m900ib.robot.parameters)
    known = m900ib.with_(robot=replace(m900ib.robot, parameters=own))
    readings = scaled(campaign(known, 7), 1.5)
    assert suspected(known, readings)
    assert not suspected(known.with_(load_uncertainty=LoadUncertainty(0.4, 0.0)), readings)


@pytest.mark.parametrize(("n", "sd"), [(2, 0.5), (2, 0.3), (3, 0.6), (6, 0.3), (6, 0.6)])
def test_arms_drawn_from_what_is_stated_are_hardly_ever_stopped(n: int, sd: float) -> None:
    """Below 1 %, however wide the priors: values as `simulate` draws them, at least a tenth of the nominal ones."""
    rng = np.random.default_rng(0)
    noise, count, stopped = 0.02**2 * (np.eye(n) + 0.5), 3000, 0
    for drawn in np.maximum(1.0 + sd * rng.standard_normal((count, n)), 0.1):
        identified = drawn * np.exp(rng.multivariate_normal(np.zeros(n), noise))
        C = noise * np.outer(identified, identified)
        stopped += common_factor(identified, C, np.ones(n), np.full(n, log_sd(sd))).off
    assert stopped < 0.01 * count


def test_its_interval_holds_the_factor() -> None:
    """95 % of springs of 30 %, lognormal with the same sd of the logarithm, doubled; most of these are found."""
    rng = np.random.default_rng(1)
    inside = found = 0
    for drawn in np.exp(log_sd(0.3) * rng.standard_normal((2000, 6))):
        one = common_factor(2.0 * drawn, np.zeros((6, 6)), np.ones(6), np.full(6, log_sd(0.3)))
        low, high = one.interval
        inside += low < 2.0 < high
        found += one.off
    assert 0.94 < inside / 2000 < 0.97
    assert found > 0.75 * 2000
