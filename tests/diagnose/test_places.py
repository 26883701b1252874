"""Which place moves: against dense matrices, against what geometry says, and where nothing does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import second_generator
from independent import Setting, forces, noisy, write_campaign
from independent_arm import COILED, SEVEN, Arm

from qsframework.diagnoses import diagnose
from qsframework.diagnoses.baseline import fits_beside
from qsframework.estimation.visit_noise import Reml
from qsframework.experiment import load_experiment, read_readings
from qsframework.hypotheses.catalogue.generic_laws import Motions, motions
from qsframework.hypotheses.catalogue.law import Law
from qsframework.hypotheses.catalogue.place_motions import Place, law_columns, places_of, variables, visits_of
from qsframework.hypotheses.search.places import (
    Competition,
    _free,  # pyright: ignore[reportPrivateUsage]
    _likelihood,  # pyright: ignore[reportPrivateUsage]
    _Noise,  # pyright: ignore[reportPrivateUsage]
    _noises,  # pyright: ignore[reportPrivateUsage]
    _Race,  # pyright: ignore[reportPrivateUsage]
    _with_law,  # pyright: ignore[reportPrivateUsage]
    compete,
)
from qsframework.plugin import Array
from qsframework.report.words.law import variable_words
from tests.diagnose.clean_fit import clean_fit

_TG = np.geomspace(0.1, 12.0, 7)


def campaign(
    arm: Arm, folder: Path, kind: str = "displacements", poses: int = 14, **setting: Any
) -> tuple[Motions, Reml, Array]:
    """What moves in a clean campaign, its fits, and what its noise left."""
    _, rows, fit = clean_fit(arm, folder, poses=poses, kind=kind, **setting)
    moved = motions(fit.model, rows, fit.x, fit.frames)
    return moved, fits_beside(rows, rows.padded_noise.colour(fit.jacobian)), fit.residuals.ravel()


def place(moved: Motions, part: str, name: str) -> Place:
    return next(p for p in places_of(moved) if (p.law.part, p.law.place) == (part, name))


def moving(moved: Motions, of: Place, size: float, seed: int = 1) -> Array:
    """Readings (3 R,) m of a place that moves at random, anew at each visit, by this sd."""
    visit = np.unique(moved.rows.plus, return_inverse=True)[1]
    step = size * np.random.default_rng(seed).standard_normal((visit.max() + 1, of.plus.shape[2]))
    return np.einsum("rxc,rc->rx", of.plus, step[visit]).ravel()


def dense(V: Array, Q: Array, y: Array, noise: _Noise) -> float:
    """L of readings y of covariance V beside columns Q."""
    inverse = np.linalg.inv(V)
    P = inverse - inverse @ Q @ np.linalg.solve(Q.T @ inverse @ Q, Q.T @ inverse)
    det = np.linalg.slogdet(V)[1] + np.linalg.slogdet(Q.T @ inverse @ Q)[1]
    return float(noise.start - 0.5 * (noise.free * np.log(float(y @ P @ y) / noise.total) + det))


@pytest.mark.parametrize("kind", ["displacements", "positions"])
def test_the_likelihoods_are_those_of_dense_matrices(kind: str, tmp_path: Path) -> None:
    """REML of a free motion in two sizes, without and with a law beside it, written out."""
    moved, fits, left = campaign(COILED, tmp_path, kind)
    visits = visits_of(moved.rows)
    values = left + moving(moved, place(moved, "drive", "j3"), 3e-5)
    race = _Race(fits, visits, _noises(fits, values, visits))
    of, at = place(moved, "drive", "j3"), [0]
    _, Z = next(law_columns(of, at, moved, [v for v in variables(moved) if v.name == "j4"]))
    unit, _ = race.unit(of.plus)
    law, _ = race.unit(Z)
    taus = np.array([0.4, 2.0])
    for noise in race.noises[:: len(race.noises) - 1]:
        own, J = fits.noise.noises[noise.k], visits.apart(unit)
        free = _free(race.white(J, noise), noise, taus)
        alone = _likelihood(noise, free.rss, free.log_det)
        both = _with_law(free, noise, race.white(law.reshape(-1, law.shape[2]), noise))
        Q, y = fits.Q[noise.k], fits.left(noise.k, values)
        visit = np.unique(moved.rows.plus, return_inverse=True)[1]
        columns = np.zeros((len(visit), 3, visit.max() + 1))
        columns[np.arange(len(visit)), :, visit] = unit[..., 0]
        W, L = own.whiten(columns.reshape(len(y), -1)), own.whiten(law.reshape(len(y), -1))

        for i, tau in enumerate(taus):
            V = np.eye(len(y)) + tau**2 * W @ W.T
            assert alone[i] == pytest.approx(dense(V, Q, y, noise), abs=1e-6)
            for j in (0, 3, 6):
                assert both[i, j] == pytest.approx(dense(V + _TG[j] ** 2 * L @ L.T, Q, y, noise), abs=1e-6)


def test_what_moves_the_markers_alike_is_one_answer_and_a_marker_stands_alone(tmp_path: Path) -> None:
    """The first drive turns the arm as its base does about the vertical: no marker on the arm tells them apart."""
    moved, fits, left = campaign(SEVEN, tmp_path)
    first = compete(moved, fits, left + moving(moved, place(moved, "drive", "j1"), 2e-4), {}).likely()[0]
    assert {("drive", "j1"), ("link", "base"), ("link", "l1")} <= first.wheres
    assert first.law.by == (), "no variable was asked: it differs at each visit"
    assert first.sd == pytest.approx(2e-4, rel=0.5)
    marker = compete(moved, fits, left + moving(moved, place(moved, "marker", "m2"), 2e-4), {}).likely()[0]
    assert marker.wheres == {("marker", "m2")}


def test_what_the_markers_of_a_visit_share_is_repeatability_and_no_part(tmp_path: Path) -> None:
    moved, fits, left = campaign(COILED, tmp_path)
    race = compete(moved, fits, left + moving(moved, place(moved, "readings", ""), 6e-5), {})
    assert race.entries[0].is_repeatability
    assert race.margin < 1.5


def test_a_law_is_told_where_it_is_plain(tmp_path: Path) -> None:
    """The third drive follows the angle of the fifth joint."""
    moved, fits, left = campaign(COILED, tmp_path, poses=40)
    of = place(moved, "drive", "j3")
    angle = moved.plus.q[:, moved.facts.joint_index("j5")]
    values = left + (of.plus[..., 0] * (1e-4 * np.sin(2.0 * angle))[:, None]).ravel()
    race = compete(moved, fits, values, {})
    first = race.likely()[0]
    assert (first.law.part, first.law.place) == ("drive", "j3")
    assert "j5" in first.law.by
    assert race.margin > 5.0


def test_what_the_load_before_has_left_is_told(tmp_path: Path) -> None:
    """The third drive gives more after large loads: what hung at the visit before counts, at the first one nothing."""
    loads = forces(Setting(COILED, loads="many"))
    pull = loads[np.random.default_rng(0).integers(len(loads), size=40)]  # in turns, the one before would say the next
    moved, fits, left = campaign(COILED, tmp_path, poses=40, pull=pull)
    of, size = place(moved, "drive", "j3"), np.linalg.norm(pull, axis=1)
    assert np.array_equal(moved.rows.plus, np.repeat(np.arange(40), 3)), "three markers a visit, as they were measured"
    before = np.repeat([0.0, *size[:-1]], 3)
    values = left + (of.plus[..., 0] * (2e-4 * before / size.max())[:, None]).ravel()
    first = compete(moved, fits, values, {}).likely()[0]
    assert (first.law.part, first.law.place, first.law.by) == ("drive", "j3", ("loaded", "before"))
    assert variable_words(first.law) == "the load that hung before (once a load hangs)"


def test_half_of_the_evidence_is_that_of_blocks(tmp_path: Path) -> None:
    moved, fits, left = campaign(COILED, tmp_path)
    race: Competition = compete(moved, fits, left + moving(moved, place(moved, "drive", "j3"), 4e-5), {})
    alone = {x.law.where: x.share for x in race.likely()}
    both = race.likely([(Law("marker", "m1", ("order",)), 30.0)])
    told = {x.law.where: x.share for x in both}
    assert told["marker", "m1"] == pytest.approx(0.5 + 0.5 * alone.get(("marker", "m1"), 0.0), abs=0.03)
    assert told["drive", "j3"] == pytest.approx(0.5 * alone["drive", "j3"], rel=1e-9)


def test_plain_noise_moves_no_part(tmp_path: Path) -> None:
    """Draws of the noise about a clean fit are not told as a motion of some part."""
    moved, fits, left = campaign(COILED, tmp_path)
    rng, size = np.random.default_rng(5), float(left.std())
    told = [compete(moved, fits, size * rng.standard_normal(left.shape), {}).margin for _ in range(12)]
    assert sum(m > 1.5 for m in told) <= 1


def test_a_name_that_a_place_is_far_ahead_of_drops_out(tmp_path: Path) -> None:
    """A bearing slides along its seat once the thrust beats the friction: a spring of link 1 stood in its place."""
    case = next(c for c in second_generator.make_cases(3, ["kinds_b"], 0) if c.id == "kinds_b/snap_ring/40/2")
    told = second_generator.make(case)
    readings = noisy(told.campaign, told.campaign.clean(told.hidden))
    experiment = load_experiment(write_campaign(told.campaign, readings, tmp_path))
    assert experiment.data is not None
    found = diagnose(experiment, read_readings(experiment.data, experiment))
    assert found.verdict == "unexplained"
    assert not found.findings
    assert ("link", "l2") in found.places[0].wheres, "links that joints of one direction carry slide alike"
