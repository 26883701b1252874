"""The statistics of the search by brute force and by simulation, in a linear case of the M-900iB's own columns."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest

from qsframework.diagnoses.evidence_table import alternative_set, hangs_on
from qsframework.diagnoses.remaining import NamedEffect, open_alternative, remaining_signal
from qsframework.estimation.noise import Independent, grouped
from qsframework.estimation.visit_noise import RHOS, Reml, VisitNoise, reml
from qsframework.experiment import make_rows
from qsframework.experiment.simulate import displaced
from qsframework.hypotheses.catalogue.causes import REACH, find_causes
from qsframework.hypotheses.catalogue.generic_laws import Motions, generic_blocks, motions
from qsframework.hypotheses.catalogue.law import Law
from qsframework.hypotheses.columns import Case, Subspace, plan_case
from qsframework.hypotheses.search.evidence import TAUS, evidence
from qsframework.hypotheses.search.family_test import FamilyBlock, chance, family_test, log_p_values
from qsframework.hypotheses.search.model_selection import blocks_of
from qsframework.hypotheses.search.subsets import Gram, Subset, make_gram, search
from qsframework.plugin import Array, Poses
from qsframework.plugin.facts import frozen
from tests.diagnose.cases import SIGMA, campaign, poses


@cache
def linear() -> tuple[Case, tuple[Subspace, ...]]:
    experiment = campaign()
    planned = poses(3)
    causes, _ = find_causes(experiment, experiment.fit_names(), planned)
    case = plan_case(experiment, planned, experiment.fit_names(), causes)
    return case, case.subspaces()


def lone(case: Case) -> Reml:
    """Fits of the case's own columns, in noise of which visits share nothing."""
    noise = VisitNoise(np.zeros(1), (case.noise,), len(case.pose), 1.0)
    return reml(noise, case.raw[:, : case.A.shape[1]], len(case.pose))


def noise_left(case: Case, rng: np.random.Generator) -> Array:
    Q, _ = np.linalg.qr(case.A)
    r = rng.standard_normal(len(case.pose))
    return r - Q @ (Q.T @ r)


def moved_of(case: Case, planned: Poses) -> Motions:
    """What extra motions do to displacements of all markers."""
    nothing = np.zeros((len(planned), len(campaign().markers), 3))
    readings = displaced(planned, nothing, SIGMA, [f"{i:03d}" for i in range(len(planned))])
    return motions(case.model, make_rows(readings), case.x, ())


def test_subspaces_are_what_is_left_of_the_columns_beside_the_fit() -> None:
    case, subspaces = linear()
    for cause, columns, subspace in zip(case.causes, case.B, subspaces, strict=True):
        assert np.abs(case.A.T @ subspace.Q).max(initial=0.0) < 1e-6 * np.linalg.norm(case.A)
        if not subspace.visible:
            continue
        assert np.allclose(subspace.Q.T @ subspace.Q, np.eye(subspace.Q.shape[1]), atol=1e-12)
        beta = subspace.turn[:, 0]  # SI parameters for one unit of s along the first direction
        moved = columns @ (beta / np.array(cause.sizes))
        fitted = case.A @ (subspace.absorbed[:, 0] / case.scale)
        assert np.allclose(moved + fitted, subspace.Q[:, 0], atol=1e-6)
        best = np.linalg.lstsq(case.A / np.linalg.norm(case.A, axis=0), moved, rcond=None)[0]
        assert np.linalg.norm(moved - case.A / np.linalg.norm(case.A, axis=0) @ best) == pytest.approx(1.0, rel=1e-6)


def test_invisible_causes_stay_below_four_units_at_ten_times_their_typical_size() -> None:
    case, subspaces = linear()
    Q, _ = np.linalg.qr(case.A)
    for columns, subspace in zip(case.B, subspaces, strict=True):
        if not subspace.visible:
            left = columns - Q @ (Q.T @ columns)
            assert np.linalg.norm(left, 2) * REACH < 4.0 or np.linalg.norm(left) < 1e-5 * np.linalg.norm(columns)


def test_max_t_keeps_its_level() -> None:
    case, subspaces = linear()
    blocks, fits = blocks_of(case, subspaces), lone(case)
    rng = np.random.default_rng(0)
    threshold = family_test(blocks, fits, noise_left(case, rng) * SIGMA, seed=1, draws=4000).threshold(0.04)
    runs = 600
    found = [family_test(blocks, fits, noise_left(case, rng) * SIGMA, draws=1).log_p.min() for _ in range(runs)]
    assert 0.015 < np.mean(np.array(found) <= threshold) < 0.072  # 0.04 and four sds


def test_chance_is_that_of_orthonormal_blocks_in_estimated_noise() -> None:
    rng = np.random.default_rng(1)
    Q, _ = np.linalg.qr(rng.standard_normal((60, 10)))
    blocks = [FamilyBlock(Q[:, :1]), FamilyBlock(Q[:, 1:4]), FamilyBlock(Q[:, 4:5], True), FamilyBlock(Q[:, 5:10])]
    dof, sided = np.array([1, 3, 1, 5]), np.array([False, False, True, False])
    threshold = np.quantile(chance(blocks, 20.0, draws=20000), 0.05)
    hits = 0
    for _ in range(3000):
        r = rng.standard_normal(60) / np.sqrt(rng.chisquare(20) / 20)
        squares = np.array([np.square(b.columns.T @ r).sum() for b in blocks])
        squares[2] *= Q[:, 4] @ r > 0.0
        hits += log_p_values(squares, dof, sided, 20.0).min() <= threshold
    assert 0.034 < hits / 3000 < 0.066


def test_detection_reaches_its_goal_at_s_of_four_and_a_half() -> None:
    case, subspaces = linear()
    blocks, fits = blocks_of(case, subspaces), lone(case)
    rng = np.random.default_rng(2)
    threshold = family_test(blocks, fits, noise_left(case, rng) * SIGMA, seed=1).threshold(0.04)
    seen = [s for s in subspaces if s.visible]
    hits = []
    for _ in range(400):
        s = seen[rng.integers(len(seen))]
        direction = s.Q[:, 0] if s.one_sided else s.Q @ _unit(rng, s.Q.shape[1])
        y = SIGMA * (noise_left(case, rng) + 4.5 * direction)
        hits.append(family_test(blocks, fits, y, draws=1).log_p.min() <= threshold)
    assert np.mean(hits) > 0.78


def _unit(rng: np.random.Generator, k: int) -> Array:
    v = rng.standard_normal(k)
    return v / np.linalg.norm(v)


def small(seed: int) -> tuple[list[Subspace], Array, Gram]:
    """Eight of the causes, so that all subsets can be counted out."""
    case, subspaces = linear()
    rng = np.random.default_rng(seed)
    seen = [i for i, s in enumerate(subspaces) if s.visible]
    chosen = [subspaces[i] for i in rng.choice(seen, 8, replace=False)]
    residuals = noise_left(case, rng) + 12.0 * chosen[0].Q[:, 0] + 9.0 * chosen[1].Q[:, -1]
    return chosen, residuals, make_gram(chosen, residuals, None)


@pytest.mark.parametrize("seed", range(6))
def test_search_finds_what_counting_all_subsets_finds(seed: int) -> None:
    """A link that twists and the next bearing that tilts about the same axis are one motion, and tie to rounding."""
    chosen, residuals, gram = small(seed)
    counted: dict[tuple[int, ...], float] = {}
    for size in (1, 2, 3):
        for members in combinations(range(len(chosen)), size):
            Q = np.concatenate([chosen[i].Q for i in members], axis=1)
            z = np.linalg.lstsq(Q, residuals, rcond=1e-9)[0]
            first = 0
            physical = True
            for i in members:
                physical &= not (chosen[i].one_sided and z[first] < 0.0)
                first += chosen[i].Q.shape[1]
            left = float(np.square(residuals - Q @ z).sum())
            ebic = gram.ebic(left, Q.shape[1], size, len(chosen))
            if physical:
                counted[members] = ebic
    found, best = search(gram, range(len(chosen)))[0], min(counted.values())
    assert found.members in [members for members, ebic in counted.items() if ebic < best + 1e-6]
    assert found.ebic == pytest.approx(best, abs=1e-3)


def test_the_set_of_rivals_covers_the_truth_and_is_small() -> None:
    """Single causes of s = 8: the set holds the truth in at least 93 % and has at most 1.5 members on average."""
    case, subspaces = linear()
    rng = np.random.default_rng(5)
    groups = [i for i, s in enumerate(subspaces) if s.cause.group]
    seen = [i for i, s in enumerate(subspaces) if s.visible and i not in groups]
    covered, sizes = [], []
    for run in range(100):
        truth = int(rng.choice(seen))
        s = subspaces[truth]
        direction = s.Q[:, 0] if s.one_sided else s.Q @ _unit(rng, s.Q.shape[1])
        gram = make_gram(subspaces, noise_left(case, rng) + 8.0 * direction, None)
        falls = gram.falls((), gram.visible)
        order = [gram.visible[i] for i in np.argsort(-falls) if not _wrong(gram, gram.visible[i])]
        order = [i for i in order if i in seen]
        members = {order[0], *alternative_set(gram, order[0], (), {}, seed=run, without=groups)}
        covered.append(truth in members)
        sizes.append(len({tuple(np.round(subspaces[i].Q[:, 0], 6)) for i in members}))
    assert np.mean(covered) >= 0.93
    assert np.mean(sizes) <= 1.6


def _wrong(gram: Gram, i: int) -> bool:
    return gram.sided[i] and gram.c[gram.at[i][0]] < 0.0


def test_deleting_poses_agrees_with_refits() -> None:
    case, subspaces = linear()
    rng = np.random.default_rng(8)
    i = next(n for n, s in enumerate(subspaces) if s.cause.name == "joint_hardening[joint_3]")
    j = next(n for n, s in enumerate(subspaces) if s.cause.name == "flange_compliance[y]")
    residuals = noise_left(case, rng) + 4.0 * subspaces[i].Q[:, 0]
    case = replace(case, residuals=residuals)
    kept = case.pose < 12
    case = replace(case, A=case.A[kept], residuals=residuals[kept], pose=case.pose[kept])
    few = [replace(s, Q=s.Q[kept]) for s in subspaces]
    chosen, other = Subset((i,), 0.0, 1, 0.0), Subset((j,), 0.0, 1, 0.0)
    found = hangs_on(case, few, chosen, Subset((), 0.0, 0, 0.0), [other], 9.0)

    def left(columns: Array, poses_out: tuple[int, ...]) -> float:
        rows = ~np.isin(case.pose, poses_out)
        A = np.concatenate([case.A, columns], axis=1)[rows]
        A = A / np.linalg.norm(A, axis=0)
        r = case.residuals[rows]
        return float(np.square(r - A @ np.linalg.lstsq(A, r, rcond=None)[0]).sum())

    expected: list[tuple[int, ...]] = []
    for out in [*combinations(range(12), 1), *combinations(range(12), 2)]:
        named = left(few[i].Q, out)
        lost = left(np.zeros((len(case.pose), 0)), out) - named < 9.0 or left(few[j].Q, out) < named
        if lost and not any(set(e) < set(out) for e in expected):
            expected.append(out)
    assert expected
    assert sorted(found) == sorted(expected)


def test_generic_blocks_are_silent_on_noise_and_see_a_coupling_between_joints() -> None:
    case, _ = linear()
    moved, fits, every = moved_of(case, poses(3)), lone(case), np.ones(len(case.pose), dtype=bool)
    rng = np.random.default_rng(3)
    blocks, runs = list(generic_blocks(moved)), 120
    few = [b.columns for b in blocks[::6]]
    limit = evidence(few, fits, SIGMA * noise_left(case, rng), seed=1).threshold(0.05)
    flags = sum(evidence(few, fits, SIGMA * noise_left(case, rng), draws=0).e.max() > limit for _ in range(runs))
    assert flags / runs < 0.05 + 4 * np.sqrt(0.05 * 0.95 / runs)
    # the drive of joint 5 gives under the torque of joint 2: no effect of the library does that
    extra = coupled(case, moved)
    for _ in range(5):
        hits, _ = remaining_signal(blocks, fits, SIGMA * (noise_left(case, rng) + extra), 0.05, 0, every)
        assert hits[0].law == Law("drive", "joint_5", ("others",))
        assert hits[0].p_value < 1e-4


def coupled(case: Case, moved: Motions) -> Array:
    """A drive that gives under another one's torque, whitened, beside the fit, of s = 10."""
    plus, minus = (end.columns[..., 4] * end.torque[:, [1]] for end in (moved.plus, moved.minus))
    Q, _ = np.linalg.qr(case.A)
    flat = (plus - minus).reshape(-1)
    flat = flat - Q @ (Q.T @ flat)
    return np.asarray(10.0 * flat / np.linalg.norm(flat), dtype=np.float64)


def test_evidence_of_one_column_is_the_integral_over_its_coefficient() -> None:
    """With the noise's size known to be one of two, e is the log of an integral that quadrature finds, tau the best."""
    from scipy.integrate import quad

    rng = np.random.default_rng(0)
    m, free = 402, 399
    noise = VisitNoise(np.zeros(1), (Independent(np.ones(m)),), m, 1.0)
    X, z = rng.standard_normal((m, 3)), rng.standard_normal((m, 1))
    fits = reml(noise, X, m)
    y = rng.standard_normal(m) + 0.2 * z[:, 0]
    found = float(evidence([z], fits, y, draws=0).e[0])
    Q = np.linalg.qr(X)[0]
    r, e = y - Q @ (Q.T @ y), z[:, 0] - Q @ (Q.T @ z[:, 0])
    e = e / np.linalg.norm(e)
    s2 = float(r @ r) / free

    def bayes(tau: float) -> float:
        def density(b: float) -> float:
            fall = float(r @ r) - float(np.square(r - b * e).sum())
            return float(np.exp(0.5 * fall / s2 - 0.5 * (b / (tau * np.sqrt(s2))) ** 2)) / tau / np.sqrt(2 * np.pi * s2)

        return float(np.log(quad(density, -60, 60, points=[float(e @ r)], limit=200)[0]))

    expected = max(bayes(float(t)) for t in TAUS)
    assert found == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("rho", [0.0, 1.0, 4.0])
@pytest.mark.parametrize("strength", [0.0, 3.0])
def test_evidence_of_readings_needs_no_noise_far_beyond_the_one_found(rho: float, strength: float) -> None:
    """With draws all sizes of what a visit shares are looked at, without them those that the readings can have."""
    rng = np.random.default_rng(6)
    visits, m = 30, 270
    label = (3 * np.repeat(np.arange(visits), 3)[:, None] + np.arange(3)).ravel()
    made = tuple(grouped(np.ones(m), [(label, np.full(m, r))]) for r in RHOS)
    fits = reml(VisitNoise(np.array(RHOS), made, 3 * visits, 3.0), rng.standard_normal((m, 5)), m)
    blocks = [rng.standard_normal((3 * visits, k))[label] for k in (1, 2, 4)] + [rng.standard_normal((m, 3))]
    y = rng.standard_normal(m) + rho * rng.standard_normal(3 * visits)[label] + strength * blocks[1][:, 0]
    every = evidence(blocks, fits, y, draws=100)
    np.testing.assert_allclose(evidence(blocks, fits, y, draws=0).e, every.e, rtol=0, atol=1e-9)
    assert (every.e[1] > 10.0) == (strength > 0.0)


def test_falls_beside_many_subsets_are_those_of_full_fits() -> None:
    """Subsets of any number of directions at once, against least squares of all columns."""
    case, subspaces = linear()
    gram = make_gram([s for s in subspaces if s.visible][:14], case.residuals, None)
    columns = [s.Q for s in subspaces if s.visible][:14]
    Q, _ = np.linalg.qr(case.A)
    residuals = case.residuals - Q @ (Q.T @ case.residuals)

    def square(members: tuple[int, ...]) -> float:
        if not members:
            return float(residuals @ residuals)
        A = np.concatenate([columns[i] for i in members], axis=1)
        return float(np.square(residuals - A @ np.linalg.lstsq(A, residuals, rcond=1e-10)[0]).sum())

    subsets, others = [(), (0,), (3,), (1, 4), (2, 9, 11)], [5, 6, 7, 8, 12, 13]
    found = gram.falls_beside(subsets, others)
    wanted = [[square(s) - square((*s, i)) for i in others] for s in subsets]
    np.testing.assert_allclose(found, wanted, rtol=1e-3, atol=1e-3)
    for s, row in zip(subsets, found, strict=True):
        np.testing.assert_allclose(gram.falls(s, others), row, rtol=1e-9, atol=1e-12)


def test_a_name_is_contested_by_the_law_that_made_the_readings_and_not_by_its_own_shape() -> None:
    case, subspaces = linear()
    moved, fits = moved_of(case, poses(3)), lone(case)
    blocks = list(generic_blocks(moved))
    rng = np.random.default_rng(5)
    i = next(n for n, s in enumerate(subspaces) if s.cause.name == "joint_hardening[joint_3]")
    own = 8.0 * subspaces[i].Q[:, 0] * SIGMA
    right = NamedEffect("joint_hardening[joint_3]", case.metres(i), own)
    kept = [open_alternative(blocks, fits, SIGMA * noise_left(case, rng), right) for _ in range(5)]
    assert kept.count(None) >= 4
    wrong = replace(right, effect=own / 8.0)  # what it can do of a coupling is little
    seen = open_alternative(blocks, fits, SIGMA * (noise_left(case, rng) + coupled(case, moved)), wrong)
    assert seen is not None
    assert seen[0].law == Law("drive", "joint_5", ("others",))


def test_the_sign_that_a_decomposition_happens_to_choose_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """A positive coefficient means a larger parameter: else a joint with backlash would look like one with less."""
    case, subspaces = linear()
    right = np.linalg.svd

    def reversed_signs(a: Array, full_matrices: bool = True) -> tuple[Array, Array, Array]:
        U, values, V = right(a, full_matrices=full_matrices)
        return -U, values, -V

    monkeypatch.setattr(np.linalg, "svd", reversed_signs)
    single = [(a, b) for a, b in zip(subspaces, case.subspaces(), strict=True) if len(a.cause.names) == 1 and a.visible]
    assert len(single) > 40
    for a, b in single:
        assert b.turn[0, 0] > 0.0
        np.testing.assert_allclose(b.Q, a.Q, atol=1e-12)
        np.testing.assert_allclose(b.absorbed, a.absorbed)


def test_of_many_poses_each_is_deleted_but_no_two() -> None:
    """130 poses, of which number 7 alone holds all that is seen of a cause: against least squares without it."""
    base, subspaces = linear()
    rng = np.random.default_rng(4)
    count, alone = 130, 7
    pose = np.repeat(np.arange(count), 3)
    A = rng.standard_normal((3 * count, 4))
    q = rng.standard_normal(3 * count)
    q[pose == alone] *= 10.0
    q -= A @ np.linalg.lstsq(A, q, rcond=None)[0]
    q /= np.linalg.norm(q)
    left = rng.standard_normal(3 * count)
    left[pose == alone] += 12.0 * q[pose == alone]
    case = replace(base, A=A, residuals=left, pose=pose, held=np.zeros(4))
    few = [replace(subspaces[0], Q=q[:, None])]
    chosen, without = Subset((0,), 0.0, 1, 0.0), Subset((), 0.0, 0, 0.0)

    def squares(columns: Array, out: int) -> float:
        rows = pose != out
        return float(
            np.square(left[rows] - columns[rows] @ np.linalg.lstsq(columns[rows], left[rows], rcond=None)[0]).sum()
        )

    fall = [squares(A, i) - squares(np.column_stack([A, q]), i) for i in range(count)]
    for needed in (9.0, 1.05 * float(np.median(fall))):
        found = hangs_on(case, few, chosen, without, [], needed)
        assert found == [(i,) for i in range(count) if fall[i] < needed]
        assert (alone,) in found
    assert len(found) > 1


def test_without_load_only_what_needs_none_is_a_block() -> None:
    """An arm that nothing loads gives nothing more, whatever its weight does; the order can still act."""
    base, _ = linear()
    loaded = poses(3)
    still = replace(loaded, wrench=frozen(np.zeros_like(loaded.wrench)))
    seen = {}
    for name, given in (("loaded", loaded), ("still", still)):
        blocks = generic_blocks(moved_of(base, given))
        seen[name] = {b.law.by for b in blocks if np.abs(b.columns).max() > 1e-9}
    assert {("torque",), ("others",), ("joint_2+joint_3",)} <= seen["loaded"]
    assert {("loaded", "order"), ("loaded",)} <= seen["still"]
    assert not {("torque",), ("others",), ("force",)} & seen["still"]
