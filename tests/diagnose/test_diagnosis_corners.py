"""Corners of the diagnosis: nothing to work on, words for every outcome, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from qsframework.diagnoses import Diagnosis, diagnose, follow_up
from qsframework.diagnoses.foresight import Outlook, Prospect, Why
from qsframework.diagnoses.power import Bench
from qsframework.diagnoses.residuals.audited_rows import split_told
from qsframework.diagnoses.residuals.lack_of_fit import LackOfFit, arm_axes, variables_of
from qsframework.diagnoses.residuals.noise_components import visible
from qsframework.diagnoses.verdict import misfits, verdict_of
from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.estimation import Independent
from qsframework.estimation.visit_noise import VisitNoise, reml
from qsframework.experiment import make_rows, observation_model
from qsframework.hypotheses.catalogue.conventions import couplings
from qsframework.hypotheses.search.family_test import FamilyBlock, family_test
from qsframework.hypotheses.search.subsets import Gram
from qsframework.plugin import Poses
from qsframework.plugin.facts import frozen
from qsframework.report.words.diagnosis import diagnosis_words
from qsframework.report.words.forecast import smallest_words
from qsframework.report.words.headline import worst_poses
from qsframework.report.words.next_steps import next_steps
from qsframework.report.words.noise import misfit_words
from qsframework.report.words.sizes import three, two
from tests.diagnose.cases import SIGMA, campaign, measured, poses, quiet


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (np.nan, "unknown"),
        (np.inf, "unknown"),
        (1.23456e-9, "1.23e-09"),
        (-4.5678e7, "-4.57e+07"),
        (0.012345, "0.0123"),
        (123456.0, "123000"),
        (-1.5, "-1.50"),
    ],
)
def test_three_digits_of_any_number(value: float, text: str) -> None:
    assert three(value) == text


def test_two_digits_of_a_small_one() -> None:
    assert two(1.26e-8) == "1.3e-08"
    assert two(0.0126) == "0.013"


@cache
def still() -> tuple[Diagnosis, list[str]]:
    """Few readings of an arm in which nothing acts, and what is told on the way."""
    steps: list[str] = []

    def tell(step: str, done: int, total: int) -> None:
        steps.append(f"{step} {done}/{total}")

    return diagnose(campaign(), measured(count=16), repeats=1, progress=tell), steps


def test_a_level_is_a_small_probability() -> None:
    for level in (0.0, 0.5, -1.0):
        refused(level)


def refused(level: float) -> None:
    with pytest.raises(InputError, match=r"level must be between 0 and 0\.5"):
        diagnose(campaign(), measured(count=12), level=level)


def test_no_direction_no_statistic() -> None:
    """Causes that these readings cannot show score nothing and have p = 1."""
    noise = VisitNoise(np.zeros(1), (Independent(np.ones(9)),), 9, 1.0)
    found = family_test([FamilyBlock(np.zeros((9, 0)))] * 3, reml(noise, np.ones((9, 1)), 9), np.ones(9), draws=50)
    assert found.size.tolist() == [0.0, 0.0, 0.0]
    assert found.p_adjusted.tolist() == [1.0, 1.0, 1.0]
    assert found.p_value == 1.0
    assert visible(np.full((4, 3, 2), 1e-12)).shape == (12, 0)


def test_nothing_given_nothing_falls() -> None:
    none = np.zeros(0)
    gram = Gram(G=np.zeros((0, 0)), c=none, total=5.0, count=9, at=(), sided=(), absorbed=(), bounds=None)
    assert gram.solve(())[0] == 5.0


def test_readings_of_an_arm_without_load_tell_nothing() -> None:
    data = measured(count=6)
    still = data.with_poses(replace(data.poses, wrench=frozen(np.zeros((12, 6)))))
    with pytest.raises(NotIdentifiable, match="was the arm loaded"):
        split_told(observation_model(campaign(), still, linear=True))
    told, lost = split_told(observation_model(campaign(), data, linear=True))
    assert len(told) == 6
    assert not lost


def test_what_was_recorded_is_a_variable_if_it_varies() -> None:
    data = measured(count=6)
    sides = np.tile([1.0, -1.0], 6)
    recorded = replace(data.poses.loaded, time=np.arange(12.0), temperature=np.full(12, 293.0), approach=sides)
    timed = data.with_poses(replace(data.poses, loaded=recorded))
    found = variables_of(campaign(), make_rows(timed))
    assert {"time", "approach", "marker", "joint_2"} <= set(found)
    assert "temperature" not in found  # it never changed
    assert "fx" not in found
    np.testing.assert_array_equal(found["time"][::3], np.arange(6.0))


def test_the_axes_of_the_arm_are_orthonormal_with_and_without_weight() -> None:
    rows = make_rows(measured(count=6))
    robot = campaign().robot
    floating = campaign().with_(robot=replace(robot, gravity=frozen(np.zeros(3))))
    leaning = campaign().with_(robot=replace(robot, gravity=frozen([9.81, 0.0, 0.0])))
    for experiment in (campaign(), floating, leaning):
        axes = arm_axes(experiment, rows)
        np.testing.assert_allclose(axes.transpose(0, 2, 1) @ axes, np.tile(np.eye(3), (18, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(arm_axes(leaning, rows)[:, :, 2], np.tile([-1.0, 0, 0], (18, 1)))
    np.testing.assert_allclose(arm_axes(floating, rows)[:, :, 2], np.tile([0, 0, 1.0], (18, 1)))


def lack(p_replicates: float) -> LackOfFit:
    """A lack of fit with a given p-value."""
    return LackOfFit(40.0, 10, p_replicates, free_replicates=7, trends=())


@pytest.mark.parametrize(
    ("p_replicates", "words"),
    [
        (1e-9, ("larger than the replicates' scatter",)),
        (0.3, ("as large as the replicates' scatter",)),
        (np.nan, ()),
    ],
)
def test_the_lack_of_fit_is_said(p_replicates: float, words: tuple[str, ...]) -> None:
    said = misfit_words(lack(p_replicates))
    assert len(said) == len(words)
    assert all(word in text for word, text in zip(words, said, strict=True))
    assert misfits(lack(p_replicates)) == (p_replicates < 1e-3)


def test_a_misfit_without_a_place_is_unexplained_and_said() -> None:
    bad = lack(1e-9)
    audit = quiet(0).audit
    assert verdict_of((), (), bad, audit, False) == "unexplained"
    assert verdict_of((), (), lack(0.5), audit, False) == "none"
    assert verdict_of((), (), lack(0.5), replace(audit, unit=3.5), False) == "unexplained"


def test_what_no_place_explains_is_said_with_where_it_is_and_what_would_tell() -> None:
    calm = quiet(3)
    bad = replace(calm.after, p_replicates=1e-9)
    found = replace(calm, verdict="unexplained", findings=(), leftovers=(), after=bad, outliers=np.array([0, 1]))
    said = diagnosis_words(found)
    worst = worst_poses(found, 3)
    left = {p: 0.0 for p in found.readings.states.pose}
    for row, r in zip(found.kept, found.residuals()[1], strict=True):
        left[found.readings.states.pose[found.readings.plus[row]]] += float(r @ r)
    assert list(worst) == sorted(left, key=lambda p: -left[p])[:3]
    assert f"Look first at poses {worst[0]}, {worst[1]} and {worst[2]}, where most of it is" in said
    assert "stands out" not in said
    first, second = found.readings.line[:2]
    assert f"Outliers, not used: rows {first}, {second}." in said
    (step, *_) = next_steps(found)
    assert step.do.startswith("Repeat 6 poses, such as ")
    assert step.settles == "separates a larger noise from an unmodelled effect"


def test_an_arm_has_no_couplings_without_their_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    data = measured(count=6)
    assert sum(1 for _ in couplings(campaign(), data)) >= 2
    monkeypatch.setattr(import_module("qsframework.hypotheses.catalogue.conventions"), "with_role", lambda _: ())
    assert list(couplings(campaign(), data)) == []


def test_a_prospect_without_sizes_says_a_dash() -> None:
    cause: Any = SimpleNamespace(name="x")
    none = Prospect(cause=cause, status=Outlook.INVISIBLE, why=Why.NO_READING)
    assert smallest_words(none) == "-"
    assert smallest_words(none, named=True) == "-"


def test_a_second_day_needs_something_that_is_open() -> None:
    """A diagnosis that names nothing leaves nothing open; progress of every step is told on the way."""
    found, steps = still()
    assert found.verdict == "none"
    assert steps[0].startswith("conventions 0/")
    assert len(steps) >= 6
    with pytest.raises(InputError, match="nothing is open: the diagnosis names no cause and no place"):
        follow_up(found, 4)


def test_poses_are_a_batch_that_can_be_taken_apart() -> None:
    some = poses(3, 5)
    assert isinstance(some.take(slice(0, 2)), Poses)
    assert len(some.take([0, 2])) == 2


def test_a_size_that_settles_nowhere_stays_where_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(campaign(), poses(2, 4), Independent(np.array([SIGMA])))
    cause: Any = SimpleNamespace(names=("x",))
    monkeypatch.setattr(Bench, "shown", lambda *a: None)
    assert bench.size_for(cause, 0, np.eye(3), 2e-7, 5.0) == 2e-7
    monkeypatch.setattr(Bench, "shown", lambda self, cause, j, Q, size: 1e7 * size**2 * 1e6)
    assert 1e13 * bench.size_for(cause, 0, np.eye(3), 2e-7, 5.0) ** 2 == pytest.approx(5.0, rel=0.05)
    monkeypatch.setattr(Bench, "shown", lambda *a: 1e-3)
    assert bench.size_for(cause, 0, np.eye(3), 2e-7, 5.0) == np.inf


def test_a_load_that_no_equilibrium_bears_shows_nothing() -> None:
    heavy = poses(2, 2)
    bench = Bench(campaign(), replace(heavy, wrench=frozen(heavy.wrench * 1e6)), Independent(np.array([SIGMA])))
    assert bench.bare is None


def test_nominal_values_far_off_do_not_keep_a_fit_from_its_diagnosis() -> None:
    """Compliances a thousand times too large bear no load; the fit is right all the same."""
    right, _ = still()
    robot = campaign().robot
    names = campaign().fit_names()
    soft = tuple(replace(p, nominal=1e3 * p.nominal) if p.name in names else p for p in robot.parameters)
    found = diagnose(campaign().with_(robot=replace(robot, parameters=soft)), right.readings, repeats=1)
    assert found.verdict == right.verdict
    assert [found.values()[n] for n in names] == pytest.approx([right.values()[n] for n in names], rel=1e-4)
    assert found.rms.identified == pytest.approx(right.rms.identified, rel=1e-4)
    assert found.rms.nominal > 100.0 * right.rms.nominal


@pytest.mark.parametrize("factor", [1e4, 1e9])
def test_nominal_values_beyond_all_reason_are_told_as_that(factor: float) -> None:
    """Ten thousand times too large and more: the baseline says where to look, and blames no extension."""
    robot = campaign().robot
    names = campaign().fit_names()
    mud = tuple(replace(p, nominal=factor * p.nominal) if p.name in names else p for p in robot.parameters)
    with pytest.raises((NotConverged, NotIdentifiable), match=r"[Cc]heck the nominal values") as error:
        diagnose(campaign().with_(robot=replace(robot, parameters=mud)), measured(count=16), repeats=1)
    assert "joint_compliance[joint_2]" in str(error.value)
    assert "extended" not in str(error.value)


def test_a_suspicion_changes_nothing() -> None:
    """Readings of a load in kgf: the suspicion is said, the readings stay as given, no cause is named for it."""
    names = campaign().fit_names()
    nominal = dict(zip(campaign().model().names, campaign().model().nominal.tolist(), strict=True))
    data = measured(values={n: 9.80665 * nominal[n] for n in names}, count=16)
    found = diagnose(campaign(), data, repeats=1)
    assert [c.name for c in found.conventions] == ["load_unit"]
    assert found.readings is data
    assert found.findings == ()
    assert "perhaps the load is in kg" in diagnosis_words(found)
