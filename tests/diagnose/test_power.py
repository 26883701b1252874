"""What a plan would detect and name, against simulated measurements of that plan."""

import json
from dataclasses import replace

import numpy as np
import pytest

from qsframework.diagnoses.foresight import Outlook
from qsframework.diagnoses.power import (
    Bench,
    detection_rate,
    forecast,
    mistaken_by,
    needed_size,
    threshold,
)
from qsframework.errors import InputError, NotIdentifiable
from qsframework.estimation import Independent
from qsframework.experiment import example, load_experiment
from qsframework.hypotheses.catalogue.causes import find_causes, widened
from qsframework.hypotheses.search.family_test import log_p_values
from qsframework.plans import generate_candidates
from qsframework.plugin import Poses
from qsframework.report.result_json import foresight_json
from qsframework.report.words.forecast import foresight_words, smallest_words, why_words

LEVEL, POWER, SIGMA = 0.04, 0.85, 3e-5


def some_poses(experiment, count, seed=1):
    pendant = generate_candidates(experiment, count, seed=seed).pendant
    wrench = np.stack([experiment.loads[i % len(experiment.loads)].wrench for i in range(count)])
    return Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench)


@pytest.fixture(scope="module")
def experiment():
    found = load_experiment(example("m900ib") / "experiment.yaml")
    return found.with_(constraints=replace(found.constraints, joint_margin=0.0))  # poses up to the joints' limits


@pytest.fixture(scope="module")
def foresight(experiment):
    return forecast(experiment, some_poses(experiment, 40), level=LEVEL, power=POWER, exact=False)


@pytest.fixture(scope="module")
def exact_foresight(experiment):
    """With the exact laws, at full equilibria."""
    return forecast(experiment, some_poses(experiment, 40), level=LEVEL, power=POWER)


@pytest.fixture(scope="module")
def laboratory(foresight):
    """Falls of chi-square of every cause (draws, G) in measurements with a whitened trace y (m,) added, and limits."""
    case = foresight.case
    subspaces = case.subspaces()
    blocks = subspaces
    sizes = np.array([b.Q.shape[1] for b in blocks])
    sided = np.array([b.one_sided for b in blocks])
    Q = np.concatenate([b.Q for b in blocks], axis=1)
    owner = np.repeat(np.arange(len(blocks)), sizes)
    noise = np.random.default_rng(5).standard_normal((2000, len(Q))) @ Q
    edges = np.flatnonzero(np.r_[True, np.diff(owner) != 0])

    def falls(y):
        c = noise + y @ Q
        c = np.where(sided[owner] & (c < 0.0), 0.0, c)
        out = np.zeros((len(c), len(blocks)))
        out[:, owner[edges]] = np.add.reduceat(c**2, edges, axis=1)
        return out

    quiet = falls(np.zeros(len(Q)))
    log_p = log_p_values(quiet, np.tile(sizes, (len(quiet), 1)), np.tile(sided, (len(quiet), 1)))
    alarm = float(np.quantile(log_p.min(axis=1), LEVEL))  # from draws that `forecast` has not seen
    limits = np.array([threshold(int(k), bool(o), alarm) if k else np.inf for k, o in zip(sizes, sided, strict=True)])
    return case, sizes, falls, limits


def trace(case, i, j, size):
    return case.B[i][:, j] * (size / case.causes[i].sizes[j])


def test_promised_sizes_are_detected_as_often_as_promised(foresight, laboratory):
    case, _, falls, limits = laboratory
    rates = []
    for i, prospect in enumerate(foresight.prospects):
        for j, size in enumerate(prospect.sizes):
            if np.isfinite(size.detect):
                rates.append(np.mean((falls(trace(case, i, j, size.detect)) > limits).any(axis=1)))
    assert len(rates) > 80
    assert min(rates) >= 0.80
    assert np.median(rates) <= 0.90
    assert max(rates) <= 0.95


def test_promised_sizes_are_named_right(foresight, laboratory):
    """By EBIC over single causes, up to aliases, and detected."""
    case, sizes, falls, limits = laboratory
    names = [p.name for p in foresight.prospects]
    right = []
    for i, prospect in enumerate(foresight.prospects):
        if prospect.status is not Outlook.NAMED or len(prospect.sizes) > 1:
            continue
        fall = falls(trace(case, i, 0, prospect.sizes[0].name))
        gain = np.where(sizes > 0, fall - sizes * np.log(len(case.A)), -np.inf)
        allowed = [i, *(names.index(a) for a in prospect.aliases)]
        right.append(np.mean(np.isin(gain.argmax(axis=1), allowed) & (fall > limits).any(axis=1)))
    assert len(right) > 15
    assert min(right) >= 0.93
    assert np.median(right) <= 0.995


def test_smaller_noise_and_more_poses_see_smaller_causes(experiment, foresight):
    name = "joint_backlash[joint_2]"
    first = foresight.of(name).sizes[0]
    finer = forecast(experiment, some_poses(experiment, 40), level=LEVEL, power=POWER, sigma=1.5e-5, exact=False)
    assert finer.of(name).sizes[0].detect == pytest.approx(first.detect / 2.0, rel=0.05)
    more = forecast(experiment, some_poses(experiment, 80), level=LEVEL, power=POWER, exact=False)
    assert more.of(name).sizes[0].detect < first.detect


def test_says_what_is_invisible_and_why(foresight):
    reasons = {p.name: why_words(p) for p in foresight.prospects if p.status is Outlook.INVISIBLE}
    assert "confounded with the fitted parameters" in reasons["load_scale"]
    assert "no reading" in reasons["link_mass[link_2]"]
    assert {u.name: u.needs for u in foresight.untested}["tracker_drift"] == ("time", "time_unloaded")
    said = " ".join(foresight_words(foresight))
    assert "load_scale" in said
    assert "Only with the column time and time_unloaded: tracker_drift" in said


def test_aliases_stand_together(foresight):
    group = next(g for g in foresight.groups if "link_compliance[link_3/x]" in g)
    assert "link_compliance[link_4/x]" in group
    prospect = foresight.of("link_compliance[link_3/x]")
    assert prospect.status is Outlook.DETECTED
    assert "link_compliance[link_4/x]" in prospect.aliases
    assert prospect.nearest not in prospect.aliases
    closest = foresight.pairs[0]
    assert closest.angle < 1e-3
    assert closest.s > 1e3


def test_sizes_are_said_in_the_units_of_the_trade(foresight):
    assert smallest_words(foresight.of("joint_backlash[joint_2]")).endswith("arcmin")
    assert "MN m/rad" in smallest_words(foresight.of("offaxis_compliance[joint_1/x]"), named=True)
    content = json.loads(json.dumps(foresight_json(foresight), allow_nan=False))
    assert len(content["causes"]) == len(foresight.prospects)
    assert content["groups"]


def test_needs_the_noise_and_the_fitted_parameters(experiment):
    from qsframework.experiment import NoiseModel

    with pytest.raises(InputError, match="noise"):
        forecast(experiment.with_(noise=NoiseModel(None)), some_poses(experiment, 10))
    with pytest.raises(NotIdentifiable):
        forecast(experiment, some_poses(experiment, 10).take(np.zeros(1, dtype=int)))


@pytest.mark.parametrize(("dof", "sided"), [(1, False), (1, True), (3, False), (6, False)])
def test_detection_rates_agree_with_draws(dof, sided):
    rng = np.random.default_rng(3)
    limit = threshold(dof, sided, float(np.log(5e-4)))
    s = needed_size(dof, sided, limit, POWER)
    z = rng.standard_normal((200_000, dof))
    z[:, 0] += s
    statistic = np.square(np.maximum(z[:, 0], 0.0)) if sided else np.square(z).sum(axis=1)
    assert np.mean(statistic > limit) == pytest.approx(POWER, abs=0.005)
    assert float(detection_rate(s, dof, sided, limit)) == pytest.approx(POWER, abs=1e-6)


def test_the_price_of_directions_decides_between_nested_causes():
    """A trace that a narrower rival explains as well is given to it; one that only a wider one explains is not."""
    assert mistaken_by(8.0, np.array([1.0, 1.0]), np.array([2, -2]), 500) == pytest.approx([1.0, 0.0])
    assert mistaken_by(8.0, np.array([1.0]), np.array([0]), 500) == pytest.approx([0.5])
    third = mistaken_by(6.4, np.array([np.cos(np.deg2rad(30.0))]), np.array([0]), 500)
    assert third == pytest.approx([0.05], abs=0.003)


NAMES = [
    "joint_hardening[joint_3]",
    "joint_backlash[joint_2]",
    "offaxis_compliance[joint_3/x]",
    "bar_compliance[joint_3]",
]


@pytest.mark.parametrize("name", NAMES)
def test_promises_hold_for_the_exact_laws_and_the_full_equilibrium(experiment, exact_foresight, laboratory, name):
    """The effect acts at the promised size in the loaded equilibrium; the fitted parameters are fitted to it."""
    case, _, falls, limits = laboratory
    planned = some_poses(experiment, 40)
    exact = exact_foresight.of(name).sizes[0]
    model = case.model
    x = case.x.copy()
    x[model.index([exact.parameter.name])] += exact.detect
    bare = model.predict(planned, case.x)
    shown = (model.predict(planned, x) - bare).ravel() / SIGMA
    Q, _ = np.linalg.qr(case.A)
    left = shown - Q @ (Q.T @ shown)
    rate = np.mean((falls(left) > limits).any(axis=1))
    assert 0.80 <= rate <= 0.92


def test_the_bench_finds_sizes_of_curved_laws(experiment, laboratory):
    """The size that the full equilibrium needs, and infinity where a law saturates below what is asked."""
    case = laboratory[0]
    i = [c.name for c in case.causes].index("joint_backlash[joint_2]")
    cause, subspace = case.causes[i], case.subspaces()[i]
    bench = Bench(experiment, some_poses(experiment, 40), case.noise)
    size = bench.size_for(cause, 0, subspace.Q, cause.sizes[0], 3.0)
    assert bench.shown(cause, 0, subspace.Q, size) == pytest.approx(3.0, rel=0.011)
    bench.shown = lambda cause, j, Q, size: 5.0 * size / (1.0 + size)
    assert bench.size_for(cause, 0, subspace.Q, 1.0, 4.0) == pytest.approx(4.0, rel=0.06)
    assert bench.size_for(cause, 0, subspace.Q, 1.0, 6.0) == np.inf


def test_a_plan_that_separates_all_says_nothing_of_groups(foresight):
    assert any(said.startswith("Cannot be separated: ") for said in foresight_words(foresight))
    alone = foresight_words(replace(foresight, groups=()))
    assert alone == tuple(said for said in foresight_words(foresight) if not said.startswith("Cannot be separated"))


def test_a_size_under_which_the_arm_does_not_settle_shows_nothing(experiment):
    """A realistic size shows what the linear model says; where the arm collapses nothing is shown."""
    poses = some_poses(experiment, 6)
    cause = next(
        c for c in find_causes(experiment, experiment.fit_names(), poses)[0] if c.name == "link_compliance[link_2/ry]"
    )
    bench, Q = Bench(experiment, poses, Independent(np.array([SIGMA]))), np.eye(6 * 3 * len(experiment.markers))
    model = widened(experiment.model(), [cause])
    expected = np.linalg.norm(model.sensitivity(poses, names=cause.names, linear=True)) * cause.sizes[0] / SIGMA
    assert bench.shown(cause, 0, Q, cause.sizes[0]) == pytest.approx(expected, rel=0.1)
    assert bench.shown(cause, 0, Q, 1e6 * cause.sizes[0]) is None
    assert bench.size_for(cause, 0, Q, 1e6 * cause.sizes[0], 5.0) == 1e6 * cause.sizes[0]
