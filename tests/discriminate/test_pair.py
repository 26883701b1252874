"""Poses that tell two causes apart: against brute force, against whole fits, and against simulated measurements."""

import json
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from qsframework.design import check_poses, generate_candidates
from qsframework.diagnose.linearization.candidates import Cause, find_causes, widened
from qsframework.discriminate import alternatives, t_optimal
from qsframework.discriminate.alternatives import Offer, _frame, batch, kinds
from qsframework.discriminate.follow_up import follow_up
from qsframework.discriminate.pair import discriminate, mistaken
from qsframework.discriminate.t_optimal import ask, choose, limit_angle, told
from qsframework.errors import InputError, NotCertified, NotIdentifiable
from qsframework.experiment import LoadCase, example, load_experiment, read_plan, write_plan
from qsframework.plugin import Poses
from qsframework.report.result_json import discrimination_json, follow_up_json
from qsframework.report.words.discrimination import discrimination_words, follow_up_words, size_words
from tests.diagnose.cases import hardened

SIGMA = 3e-5
BEARING = "offaxis_compliance[joint_1/x]"
PEDESTAL = "base_compliance[rx]"
LINK_3, LINK_4 = "link_compliance[link_3/x]", "link_compliance[link_4/x]"


@pytest.fixture(scope="module")
def experiment():
    return load_experiment(example("m900ib") / "experiment.yaml")


@pytest.fixture(scope="module")
def pendant(experiment):
    return generate_candidates(experiment, 60, seed=2).pendant


def loaded(experiment, pendant):
    wrench = np.stack([experiment.loads[i % 2].wrench for i in range(len(pendant))])
    return Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench)


@pytest.fixture(scope="module")
def first_day(experiment, pendant):
    return loaded(experiment, pendant[48:])


def question(experiment, first, second, **more):
    poses = loaded(experiment, np.zeros((1, experiment.robot.facts.n)))
    causes = {c.name: c for c in find_causes(experiment, experiment.fit_names(), poses)[0]}
    return ask(experiment, causes[first], causes[second], SIGMA, **more)


def flat(asked, poses):
    rows = asked.rows(poses)
    return rows.reshape(len(rows), -1, rows.shape[-1])


def best_of_all(parts, before, count):
    """The largest smallest s over all subsets, each fitted by itself."""

    def smallest(subset):
        added = [
            np.concatenate([b, r[list(subset)].reshape(-1, r.shape[-1])]) for r, b in zip(parts, before, strict=True)
        ]
        return min(residual(rows) for rows in added)

    return max(smallest(s) for s in combinations(range(len(parts[0])), count))


def residual(rows):
    other, trace = rows[:, :-1] / np.linalg.norm(rows[:, :-1], axis=0), rows[:, -1]
    return np.linalg.norm(trace - other @ np.linalg.lstsq(other, trace, rcond=None)[0])


def test_exchange_finds_the_best_of_all_subsets(experiment, pendant, first_day):
    asked = question(experiment, PEDESTAL, BEARING)
    rows, before = flat(asked, loaded(experiment, pendant[:12])), asked.taken([first_day])
    for count in (2, 3):
        chosen = choose([rows], [before], count, np.arange(12), seed=0)
        best = best_of_all([rows], [before], count)
        assert len(set(chosen.index)) == count
        assert chosen.s == pytest.approx(best, rel=1e-4)
        assert best <= chosen.bound * (1.0 + 1e-6)
        assert chosen.bound < 1.3 * best


def test_maximin_over_two_pairs_finds_the_best_of_all_subsets(experiment, pendant, first_day):
    names = [(PEDESTAL, BEARING), ("joint_hardening[joint_3]", "load_point_offset")]
    asked = [question(experiment, *pair) for pair in names]
    asked[1] = question(experiment, *names[1], values=0.5 * asked[1].values)
    poses = loaded(experiment, pendant[:12])
    rows, before = [flat(q, poses) for q in asked], [q.taken([first_day]) for q in asked]
    chosen = choose(rows, before, 3, np.arange(12), seed=0)
    best = best_of_all(rows, before, 3)
    assert chosen.s == pytest.approx(best, rel=1e-3)
    assert best <= chosen.bound * (1.0 + 1e-6)


def test_s_is_that_of_a_whole_fit(experiment, pendant):
    """The trace's coefficient, fitted beside all other parameters, has the standard deviation 1 / s."""
    asked = question(experiment, PEDESTAL, BEARING)
    poses = loaded(experiment, pendant[:20])
    s, angle = told(flat(asked, poses).reshape(-1, sum(asked.width) + 1), asked.width)
    model = widened(experiment.model(), [asked.first, asked.second])
    names = [*experiment.fit_names(), BEARING, PEDESTAL]
    A = model.sensitivity(poses, names=names).reshape(-1, len(names)) / SIGMA
    size = np.linalg.norm(A, axis=0)
    covariance = np.linalg.inv((A / size).T @ (A / size)) / np.outer(size, size)
    assert s == pytest.approx(asked.values[0] / np.sqrt(covariance[-1, -1]), rel=1e-6)
    correlation = covariance[-1, -2] / np.sqrt(covariance[-1, -1] * covariance[-2, -2])
    assert np.cos(angle) == pytest.approx(abs(correlation), rel=1e-6)


def test_the_wrong_cause_wins_as_rarely_as_said():
    """First and second cause each fitted to simulated readings of the first one."""
    rng = np.random.default_rng(0)
    angle, size = np.deg2rad(25.0), 7.0
    a, b = np.array([1.0, 0.0]), np.array([np.cos(angle), np.sin(angle)])
    y = size * a + rng.standard_normal((100_000, 2))
    wrong = np.mean(np.abs(y @ b) > np.abs(y @ a))
    assert mistaken(size * np.sin(angle)) == pytest.approx(wrong, abs=0.02)


def test_designed_poses_separate_better_and_keep_the_constraints(experiment, first_day, tmp_path):
    found = discriminate(experiment, first_day, PEDESTAL, BEARING, 8, candidates=150, seed=1)
    assert found.s_after > 1.3 * found.s_before
    assert found.angle_after > found.angle_before
    assert found.s_after <= found.bound * (1.0 + 1e-6)
    assert found.s_after > 0.95 * found.bound
    assert found.helps
    assert not found.offers
    assert all(ok.all() for ok in check_poses(experiment, experiment.model(), found.plan.pendant).values())
    write_plan(tmp_path / "more.csv", found.plan, experiment)
    assert read_plan(tmp_path / "more.csv", experiment).pose == found.plan.pose
    said = " ".join(discrimination_words(found))
    assert PEDESTAL in said
    assert "MN m/rad" in said
    json.dumps(discrimination_json(found), allow_nan=False)
    rng = np.random.default_rng(0)
    asked = question(experiment, PEDESTAL, BEARING)
    rows, place = (
        flat(asked, batch(experiment, generate_candidates(experiment, 150, seed=1).pendant)[0]),
        np.arange(150),
    )
    before = asked.taken([first_day])
    by_chance = [
        told(
            np.concatenate([before, rows[rng.choice(place, 8, replace=False)].reshape(-1, rows.shape[-1])]), asked.width
        )
        for _ in range(20)
    ]
    assert found.s_after > max(s for s, _ in by_chance)


def test_where_poses_cannot_help_another_marker_does(experiment, first_day):
    found = discriminate(experiment, first_day, LINK_3, LINK_4, 8, candidates=60)
    assert not found.helps
    assert found.s_after < 0.1, "the same at the commanded pose; where the arm settles, far below the noise"
    by_name = {o.name: o for o in found.offers}
    assert by_name["elbow marker"].s > 4.0
    assert by_name["base marker"].s < 0.2
    assert found.offers[0].s >= by_name["elbow marker"].s
    assert all(o.s < 0.2 for o in found.offers if o.name.startswith("load"))
    said = " ".join(discrimination_words(found))
    assert "no more poses like these separate them" in said
    assert not found.useful
    assert "a marker on link_3" in said
    assert "No help" in said


def test_where_the_size_is_too_small_the_words_say_which_is_enough(experiment, first_day):
    found = discriminate(experiment, first_day, PEDESTAL, BEARING, 8, candidates=60, values=[1e-9], alternatives=False)
    assert found.useful
    assert not found.helps
    enough = 1e-9 * 4.0 / found.s_after
    again = discriminate(experiment, first_day, PEDESTAL, BEARING, 8, candidates=60, values=[1.01 * enough])
    assert again.helps
    assert "from" in discrimination_words(found)[1]
    assert f"{1e9 * enough:.2f} nrad/(N m)" in discrimination_words(found)[1]


def test_a_base_marker_separates_the_pedestal_from_the_first_link(experiment, first_day):
    found = discriminate(
        experiment, first_day, "base_compliance[z]", "link_compliance[link_1/z]", 8, candidates=60, values=[2e-8]
    )
    assert found.offers[0].name == "base marker"
    assert found.offers[0].s > 4.0
    assert found.offers[0].angle > np.deg2rad(20.0)


def test_absolute_positions_separate_a_scale_of_the_load_from_one_of_the_tracker(experiment, first_day):
    found = discriminate(experiment, first_day, "load_scale", "tracker_scale", 8, candidates=60)
    assert found.offers[0].name == "absolute positions"
    assert max(o.s for o in found.offers[1:]) < 0.1, "apart only by what the arm's own give changes of the lever"


def test_the_tracker_frame_columns_are_small_motions():
    points = np.random.default_rng(0).standard_normal((4, 2, 3))
    turn = 1e-6 * np.array([0.3, -0.5, 0.2])
    shift = 1e-6 * np.array([1.0, 2.0, -1.0])
    moved = points + np.cross(turn, points) + shift
    assert np.allclose(_frame(points) @ np.concatenate([shift, turn]), moved - points, atol=1e-18)


def test_the_limit_of_the_angle_is_that_of_many_poses(experiment, pendant):
    asked = question(experiment, PEDESTAL, BEARING)
    rows = flat(asked, loaded(experiment, pendant))
    limit = limit_angle(rows, asked.width, 0)
    all_of_them = told(rows.reshape(-1, rows.shape[-1]), asked.width)[1]
    many = choose([rows], [np.zeros((0, rows.shape[-1]))], 12, np.arange(len(rows)), 0)
    designed = told(rows[many.index].reshape(-1, rows.shape[-1]), asked.width)[1]
    assert all_of_them < limit
    assert designed < limit + np.deg2rad(3.0)


def test_bad_questions_are_refused(experiment, first_day):
    with pytest.raises(InputError, match="no cause 'joint_slack") as error:
        discriminate(experiment, first_day, "joint_slack[joint_2]", BEARING, 4, candidates=20)
    assert "joint_backlash[joint_2]" in str(error.value)
    with pytest.raises(InputError, match="column time"):
        discriminate(experiment, first_day, "tracker_drift", BEARING, 4, candidates=20)
    with pytest.raises(InputError, match="from itself"):
        discriminate(experiment, first_day, BEARING, BEARING, 4, candidates=20)


def test_a_second_day_confirms_what_the_first_one_named(tmp_path):
    diagnosis = hardened()
    experiment = diagnosis.experiment
    found = follow_up(diagnosis, 6, candidates=100)
    assert found.before <= found.after <= 1.0
    assert found.variable_before <= found.variable_after
    assert {f.name for f in diagnosis.findings} <= {s.law.name for s in found.suspects if isinstance(s.law, Cause)}
    write_plan(tmp_path / "day2.csv", found.plan, experiment)
    assert len(read_plan(tmp_path / "day2.csv", experiment).pose) == 6
    json.dumps(follow_up_json(found), allow_nan=False)
    assert "6 visits bring the chance of naming the right place from" in " ".join(follow_up_words(found))


def test_a_trace_that_nothing_else_touches_wants_the_poses_that_show_it_most(experiment, pendant):
    """Other columns that no candidate shows: s^2 is a plain sum of squares, the best poses are its largest terms."""
    rng = np.random.default_rng(4)
    rows = np.zeros((15, 3, 4))
    rows[..., -1] = rng.standard_normal((15, 3))
    before = np.zeros((2, 4))
    before[:, -1] = [0.5, -0.3]
    shown = np.square(rows[..., -1]).sum(axis=1)
    chosen = choose([rows], [before], 4, np.arange(15), seed=0)
    assert sorted(chosen.index) == sorted(np.argsort(-shown)[:4])
    assert chosen.s == pytest.approx(np.sqrt(0.34 + np.sort(shown)[-4:].sum()), rel=1e-6)
    assert chosen.bound == pytest.approx(chosen.s, rel=0.02)


def test_a_shortlist_of_many_candidates_holds_the_best(experiment, first_day, monkeypatch):
    """The exchange among a third of the candidates finds what it finds among all, and the bound is that of all."""
    asked = question(experiment, PEDESTAL, BEARING)
    poses = loaded(experiment, generate_candidates(experiment, 90, seed=5).pendant)
    rows, before = flat(asked, poses), asked.taken([first_day])
    full = choose([rows], [before], 4, np.arange(90), seed=0)
    monkeypatch.setattr(t_optimal, "_SHORT", 30)
    short = choose([rows], [before], 4, np.arange(90), seed=0)
    assert short.s == pytest.approx(full.s, rel=1e-6)
    assert short.bound == pytest.approx(full.bound, rel=1e-6)


def test_without_a_certificate_the_choice_and_its_bound_still_hold(experiment, pendant, first_day, monkeypatch):
    """Where the relaxed design is not reached: the best of all subsets, under a bound that is only looser."""
    asked = question(experiment, PEDESTAL, BEARING)
    rows, before = flat(asked, loaded(experiment, pendant[:12])), asked.taken([first_day])
    certified = choose([rows], [before], 3, np.arange(12), seed=0)

    def fails(*_):
        raise NotCertified("not reached")

    monkeypatch.setattr(t_optimal, "solve_columns", fails)
    chosen = choose([rows], [before], 3, np.arange(12), seed=0)
    best = best_of_all([rows], [before], 3)
    assert chosen.s == pytest.approx(best, rel=1e-4)
    assert chosen.bound >= certified.bound * (1.0 - 1e-9)
    all_of_them = told(rows.reshape(-1, rows.shape[-1]), asked.width)[1]
    assert limit_angle(rows, asked.width, 0) == pytest.approx(all_of_them, rel=1e-9)


def test_candidates_may_be_a_number_a_set_or_angles(experiment, first_day):
    """The same poses, however they are given, are the same plan."""
    drawn = generate_candidates(experiment, 40, seed=0)
    plans = [
        discriminate(experiment, first_day, PEDESTAL, BEARING, 4, candidates=c, alternatives=False).plan.pendant
        for c in (40, drawn, drawn.pendant.tolist())
    ]
    np.testing.assert_array_equal(plans[1], plans[0])
    np.testing.assert_array_equal(plans[2], plans[0])


def test_only_offers_that_help_are_offered(experiment, first_day):
    found = discriminate(experiment, first_day, PEDESTAL, BEARING, 4, candidates=40, alternatives=False)
    heavy = LoadCase("heavy", np.zeros(6), None)
    good, weak, bad = Offer("a", heavy, 9.0, 0.5), Offer("b", None, 2.0, 0.5), Offer("c", heavy, 0.1, 0.0)
    none, some, mixed = (discrimination_words(replace(found, offers=o)) for o in ((bad,), (good, weak), (good, bad)))
    assert none[-1] == "Nothing that was tried separates them: they stay a set."
    assert not any("No help" in w for w in (*none, *some))
    assert some[-2].startswith("- the load heavy: s = 9.0")
    assert "enough from" not in some[-2]
    assert f"enough from {size_words(found, 2.0)} on" in some[-1]
    assert mixed[-1] == "No help: c."


def test_markers_that_are_there_are_not_offered(experiment):
    names = [k.name for k in kinds(experiment)]
    assert {"elbow marker", "base marker", "absolute positions"} <= set(names)
    there = next(k.experiment for k in kinds(experiment) if k.name == "elbow marker")
    assert [k.name for k in kinds(there)] == [n for n in names if n != "elbow marker"]


def test_an_offer_that_cannot_be_made_leaves_the_others(experiment, first_day, monkeypatch):
    """A robot without any geometry to fit cannot use absolute positions; its markers are offered all the same."""
    judged = alternatives._judged

    def no_geometry(kind, *rest):
        if kind.other is None:
            raise NotIdentifiable("no geometry")
        return judged(kind, *rest)

    monkeypatch.setattr(alternatives, "_judged", no_geometry)
    found = discriminate(experiment, first_day, LINK_3, LINK_4, 4, candidates=20)
    assert {o.name for o in found.offers} == {k.name for k in kinds(experiment) if k.other is not None}
