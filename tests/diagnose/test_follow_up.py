"""Two days of measuring: what the first leaves open the second one settles."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from independent import Campaign, Setting, noisy, write_campaign
from independent_arm import COILED, Hidden, Rest

from qsframework.diagnoses import Diagnosis, FollowUp, diagnose, follow_up
from qsframework.diagnoses.explanations import Explanations
from qsframework.diagnoses.second_day import chosen_visits, opened, suspects_of
from qsframework.errors import InputError
from qsframework.experiment import example, load_experiment, read_readings, simulate
from qsframework.plans import design
from qsframework.plugin import Array, find
from qsframework.report.words.diagnosis import statements
from qsframework.report.words.follow_up import suspect_words
from qsframework.report.words.next_steps import next_steps
from tests.diagnose.cases import HARDENING, campaign, hardened, measured, twisted as twisted_bearing, with_size

BEARING, LINK = "offaxis_compliance[joint_4/z]", "link_compliance[link_3/rz]"


def twisted(size: float) -> Hidden:
    """The third gear gives more where the fifth joint stands high."""

    def law(still: Rest) -> Array:
        return np.eye(6)[2] * still.torque[:, [2]] * size * 1e-8 * np.sin(still.angles[:, [4]])

    return Hidden(gears=(law,))


def answer(day: Campaign, tables: Any) -> Diagnosis:
    with tempfile.TemporaryDirectory() as folder:
        experiment = load_experiment(write_campaign(day, tables, Path(folder)))
        assert experiment.data is not None
        return diagnose(experiment, read_readings(experiment.data, experiment), repeats=1)


@pytest.fixture(scope="module")
def first() -> tuple[Campaign, float, Diagnosis]:
    """Fourteen poses of an arm with an effect that no library holds."""
    day = Campaign(Setting(COILED, 14, 3, loads="many"))
    size = day.sized(twisted, 12.0, 1.0, 300.0)
    return day, size, answer(day, noisy(day, day.clean(twisted(size))))


@pytest.fixture(scope="module")
def second(first: tuple[Campaign, float, Diagnosis]) -> FollowUp:
    return follow_up(first[2], 8, candidates=200)


@pytest.fixture(scope="module")
def every(first: tuple[Campaign, float, Diagnosis]) -> Explanations:
    """What 30 candidates would show, and the poses of the first day once more."""
    return opened(first[2], 30, 7)[1]


def test_a_visit_parts_two_explanations_by_what_they_foretell(every: Explanations) -> None:
    """delta^2 of one visit is the square of what a fit of the rival to the other's readings misses there, in the noise
    of that prediction: written out with one dense covariance."""
    h, k = 0, len(every.odds) - 1
    C, F = every.first[k], every.visits[k][0]
    readings = every.first[h] @ every.theta[h]
    prior = np.where(np.arange(C.shape[1]) < every.free, 1e-9, 1.0)
    covariance = np.linalg.inv(C.T @ C + np.diag(prior))
    missed = every.visits[h][0] @ every.theta[h] - F @ covariance @ C.T @ readings
    dense = float(missed @ np.linalg.solve(np.eye(len(F)) + F @ covariance @ F.T, missed))
    assert every.squares([0])[k, h] == pytest.approx(dense, rel=1e-9)
    assert every.squares([0, 3])[k, h] >= dense


def test_new_visits_are_rounded_as_any_plan(second: FollowUp) -> None:
    """Those of the first day stand at its angles."""
    shown = np.rad2deg(second.plan.pendant)
    assert (np.abs(shown - np.round(shown, 2)).max(axis=1) < 1e-9).sum() >= 4


def test_the_visits_tell_more_than_others(every: Explanations, second: FollowUp) -> None:
    """The bound on confusing two explanations is below that of any of 20 random choices of as many visits, and no
    exchange of one of them for another makes it smaller."""
    chosen = chosen_visits(every, 6, np.array([], dtype=np.intp), lambda *_: None)
    rng, count = np.random.default_rng(0), len(every.shown)

    def bound(visits: Sequence[int]) -> float:
        return float(every.bound(every.squares(visits)[None])[0])

    assert bound(chosen) < min(bound(rng.choice(count, 6, replace=False).tolist()) for _ in range(20))
    last = [bound([*chosen[:-1], other]) for other in range(count) if other not in chosen]
    assert bound(chosen) <= min(last) * (1.0 + 1e-9)
    assert second.before <= second.after <= 1.0
    assert second.variable_before <= second.variable_after <= second.after + 1e-9


def test_mounts_are_judged_by_the_visits_with_their_readings(
    first: tuple[Campaign, float, Diagnosis], second: FollowUp
) -> None:
    """Each once, the best first; a reflector nearer the moving joint tells more than none; what nobody can reach is
    left out, and an unknown link is no link."""
    names = [m.marker.name for m in second.mounts]
    assert len(names) == len(set(names))
    assert [m.chance for m in second.mounts] == sorted((m.chance for m in second.mounts), reverse=True)
    assert all(second.after - 0.05 <= m.chance <= 1.0 for m in second.mounts)
    assert {m.marker.link for m in second.mounts} >= {"world", first[2].experiment.robot.facts.base}
    assert sum(bool(m.along) for m in second.mounts) == 6
    few = follow_up(first[2], 4, candidates=20, without=("world", "gauges"))
    assert not [m for m in few.mounts if m.along or m.marker.link == "world"]
    with pytest.raises(InputError, match="nothing is mounted on 'wrold'") as error:
        follow_up(first[2], 4, candidates=20, without=("wrold",))
    assert "world" in str(error.value)


def test_two_visits_repeat_poses_of_the_first_day(first: tuple[Campaign, float, Diagnosis], second: FollowUp) -> None:
    old = first[2].readings.poses.pendant
    again = [bool(np.isclose(old, q, atol=1e-9).all(axis=1).any()) for q in second.plan.poses.pendant]
    assert sum(again) >= 2
    assert len(again) == 8


def test_the_second_day_settles_the_place(first: tuple[Campaign, float, Diagnosis], second: FollowUp) -> None:
    """Measured by the arm that made the first day; both days in one table."""
    day, size, _ = first
    visits = day.visits[0]
    assert visits is not None
    plan, pull = (visits[1].shown, second.plan.pendant), (visits[1].force, second.plan.wrench[:, :3])
    both = Campaign(replace(day.setting, poses=22, plan=np.concatenate(plan), pull=np.concatenate(pull)))
    after = answer(both, noisy(both, both.clean(twisted(size), day.built)))
    assert ("drive", "j3") in after.places[0].wheres
    assert after.places[0].share > 0.9
    assert not after.findings, "no name takes its place"


def test_nothing_named_leaves_nothing_open() -> None:
    experiment = load_experiment(example("m900ib") / "experiment.yaml")
    plan = design(experiment, 12, "D", candidates=300, seed=3)
    quiet = diagnose(experiment, simulate(experiment, plan, seed=0).readings, repeats=1)
    assert quiet.verdict == "none"
    with pytest.raises(InputError, match="nothing is open"):
        follow_up(quiet)


@pytest.fixture(scope="module")
def alike() -> Diagnosis:
    """A bearing that gives much: to markers on the tool it is the link before it that twists."""
    hidden = with_size(find("offaxis_compliance")("joint_4", "z"), 8.0)
    return diagnose(campaign(), measured(*hidden, seed=1, count=16), repeats=1)


def test_what_no_visit_parts_a_reflector_between_does(alike: Diagnosis) -> None:
    """Markers on the tool see a link and the bearing that ends it alike; one on the link does not."""
    (f,) = alike.findings
    assert {f.name, *(r.name for r in f.alternatives)} >= {BEARING, LINK}
    assert alike.open
    day = follow_up(alike, 6, candidates=60)
    best = day.mounts[0]
    assert day.after < 0.75
    assert best.chance > 0.98
    assert best.marker.link == "link_3"
    first = next_steps(alike, day)
    (mount,) = (step for step in first if step.do.startswith("Mount a reflector on link_3"))
    assert mount.settles.startswith("the chance of naming the right place rises to")
    assert [s.text for s in statements(alike) if s.text.startswith("These readings cannot separate")]
    there = follow_up(alike, 6, candidates=60, without=("link_3",))
    assert all(m.marker.link != "link_3" for m in there.mounts)


def test_what_is_certain_is_no_explanation_of_the_rest() -> None:
    """Beside a drive that stiffens, which is certain, only the two places that look alike are open."""
    bearing = find("offaxis_compliance")("joint_4", "z")
    effects, values = with_size(bearing, 2.0)
    found = diagnose(
        campaign(), measured((*HARDENING[0], *effects), HARDENING[1] | values, seed=5, count=30), repeats=1
    )
    assert {f.name for f in found.findings} & {BEARING, LINK}
    assert [c.name for c in found.known] == ["joint_hardening[joint_3]"]
    assert set(found.known[0].names) <= set(found.settled.names)
    said = {suspect_words(s): s.share for s in suspects_of(found)}
    assert "joint_hardening[joint_3]" not in said
    assert said[BEARING] + said[LINK] > 0.8
    day = follow_up(found, 4, candidates=40)
    assert day.before == pytest.approx(0.5, abs=0.1)


def test_what_is_explained_leaves_nothing_open() -> None:
    found = hardened()
    assert not found.open
    assert found.known == ()
    assert found.settled is found.baseline


def test_loads_that_nobody_lists_are_those_of_the_first_day() -> None:
    found = twisted_bearing()
    bare = replace(found, experiment=found.experiment.with_(loads=()))
    pool, _ = opened(bare, 10, 0)
    hung = np.unique(pool.poses.wrench, axis=0)
    listed = np.array([load.wrench for load in found.experiment.loads])
    assert {tuple(w) for w in hung.round(6)} == {tuple(w) for w in listed.round(6)}
