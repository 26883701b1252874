"""The level and the power of the test of all causes, in noise that it is not told."""

from __future__ import annotations

import numpy as np
import pytest

from qsframework.estimation import grouped
from qsframework.estimation.linear_fit import winsorised
from qsframework.estimation.visit_noise import RHOS, Reml, VisitNoise, reml
from qsframework.hypotheses.search.family_test import FamilyBlock, family_test
from qsframework.plugin import Array

LEVEL, RUNS, MARKERS, FITTED = 0.024, 150, 3, 9


class Campaign:
    """Poses x 3 markers: columns that move all markers of a pose alike or nearly, as those of drives and links do."""

    def __init__(self, poses: int, seed: int = 0):
        rng = np.random.default_rng([seed, poses])
        self.poses, self.count = poses, 9 * poses
        self.label = (3 * np.repeat(np.arange(poses), MARKERS)[:, None] + np.arange(3)).ravel()
        own = np.ones(self.count)
        made = [grouped(own, [(self.label, np.full(self.count, rho))]) for rho in RHOS]
        self.noise = VisitNoise(np.array(RHOS), tuple(made), 3 * poses, float(MARKERS))
        self.A = self._columns(rng, FITTED)
        sizes = [1, 1, 2, 3] * 12
        self.blocks = [FamilyBlock(self._columns(rng, k), k == 1 and i % 8 == 0) for i, k in enumerate(sizes)]
        self.fits: Reml = reml(self.noise, self.A, self.count)

    def _columns(self, rng: np.random.Generator, k: int) -> Array:
        shift = rng.standard_normal((self.poses, 1, 3, k))
        return (shift + 0.3 * rng.standard_normal((self.poses, MARKERS, 3, k))).reshape(self.count, k)

    def errors(self, kind: str, rng: np.random.Generator) -> Array:
        e = rng.standard_normal(self.count)
        pose = rng.standard_normal(3 * self.poses)
        if kind.startswith("shared"):
            e += float(kind.split()[1]) * pose[self.label]
        if kind == "uneven":
            e += (rng.uniform(0.0, 3.0, self.poses).repeat(3) * pose)[self.label]
        if kind == "misstated":
            e *= 2.0
        if kind == "t3":
            e = rng.standard_t(3, self.count)
        if kind == "outliers":
            bad = np.flatnonzero(rng.random(self.count // 3) < 0.05)
            e.reshape(-1, 3)[bad] *= 15.0
        return e

    def test(self, y: Array, seed: int, draws: int = 124) -> float:
        """p, from as few draws as can hold LEVEL exactly: 3 of 125, as 6 of 251 would."""
        k = int(self.fits.choose(y[:, None])[0])
        tame = winsorised(self.noise.noises[k].whiten(y), self.fits.Q[k])
        return family_test(self.blocks, self.fits, self.noise.noises[k].colour(tame), seed, draws).p_value


KINDS = ("plain", "misstated", "shared 1", "shared 2", "uneven", "t3", "outliers")


@pytest.mark.parametrize(("kind", "poses"), [*((kind, 12) for kind in KINDS), ("shared 2", 40), ("outliers", 40)])
def test_nothing_is_found_where_nothing_acts(kind: str, poses: int) -> None:
    """At 2.4 % at most 12 of 150: more has a probability of 1e-4."""
    campaign, rng = Campaign(poses), np.random.default_rng([poses, KINDS.index(kind)])
    runs = RUNS if poses == 12 else RUNS // 3
    alarms = sum(campaign.test(campaign.errors(kind, rng), s) <= LEVEL for s in range(runs))
    assert alarms <= (12 if poses == 12 else 6)


@pytest.mark.parametrize(("s", "share"), [(6.0, 0.75), (9.0, 0.97)])
def test_what_acts_is_found(s: float, share: float) -> None:
    campaign, rng = Campaign(20), np.random.default_rng(5)
    hits = 0
    for n in range(40):
        direction = campaign.blocks[2 * (n % 20)].columns[:, 0]
        left = campaign.fits.left(0, direction)
        hits += campaign.test(campaign.errors("plain", rng) + s * direction / np.linalg.norm(left), n) <= LEVEL
    assert hits / 40 >= share


def test_p_does_not_depend_on_the_unit_of_the_readings() -> None:
    campaign = Campaign(20)
    y = campaign.errors("shared 1", np.random.default_rng(7))
    a, b = (family_test(campaign.blocks, campaign.fits, f * y, 3, 200) for f in (1.0, 1e-5))
    np.testing.assert_allclose(a.log_p, b.log_p, rtol=1e-8)
    np.testing.assert_allclose(a.size, b.size, rtol=1e-8, atol=1e-8)


def test_alone_a_block_has_the_p_value_of_the_f_test() -> None:
    """Without a shared error and with one block: against two fits by least squares."""
    from scipy.stats import f

    campaign = Campaign(20)
    noise = VisitNoise(np.zeros(1), campaign.noise.noises[:1], 60, 3.0)
    y, block = campaign.errors("plain", np.random.default_rng(8)), campaign.blocks[3]
    found = family_test([block], reml(noise, campaign.A, campaign.count), y, draws=50)
    both = np.concatenate([campaign.A, block.columns], axis=1)
    less, more = (y - M @ np.linalg.lstsq(M, y, rcond=None)[0] for M in (both, campaign.A))
    free = campaign.count - both.shape[1]
    F = (more @ more - less @ less) / 3.0 / (less @ less / free)
    assert found.log_p[0] == pytest.approx(f.logsf(F, 3, free), rel=1e-6)


def test_a_block_that_can_only_grow_is_not_found_shrinking() -> None:
    campaign = Campaign(20)
    sided = [FamilyBlock(b.columns[:, :1], True) for b in campaign.blocks]
    y = campaign.errors("plain", np.random.default_rng(9))
    k = 5
    push = 15.0 * sided[k].columns[:, 0] / np.linalg.norm(campaign.fits.left(0, sided[k].columns[:, 0]))
    grown, shrunk = (family_test(sided, campaign.fits, y + sign * push, draws=200) for sign in (1.0, -1.0))
    assert grown.p_adjusted[k] < 1e-3
    assert shrunk.p_adjusted[k] > 0.5
