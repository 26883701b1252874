"""The average of fits: what it predicts, how sure it is, and what it errs by at poses that no fit has seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from independent_arm import HEAVY

from qsframework.diagnoses import diagnose
from qsframework.diagnoses.learn import shares
from qsframework.experiment import ReadingRows, load_experiment, read_readings
from qsframework.hypotheses.catalogue.causes import find_causes, widened
from qsframework.hypotheses.columns import Case, make_case
from qsframework.hypotheses.exact_refit import SettledFit, averaged_fit
from qsframework.hypotheses.search.cross_validation import folds, held_out_average
from qsframework.hypotheses.search.model_selection import refit
from qsframework.plugin import Array
from qsframework.report.result_json import diagnosis_json
from tests.diagnose.clean_fit import clean_fit

SHARES = (0.6, 0.3, 0.1)
NAMES = ("joint_hardening[j3]", "joint_backlash[j2]", "offaxis_compliance[j4/z]")


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> tuple[Case, ReadingRows, list[SettledFit], SettledFit]:
    """Of three causes, each by itself, and their average."""
    experiment, rows, base = clean_fit(HEAVY, tmp_path_factory.mktemp("average"), poses=14)
    every, _ = find_causes(experiment, base.names, rows)
    causes = [c for name in NAMES for c in every if c.name == name]
    case = make_case(experiment, rows, base.names, causes, base.by_name(), base.residuals, base.frames)
    each = [refit(case, [c], base, rows) for c in causes]
    known = [fit for fit in each if fit is not None]
    model = widened(experiment.model(), causes)
    names = [*base.names, *(n for c in causes for n in c.names)]
    return case, rows, known, averaged_fit(model, names, rows, list(zip(SHARES, known, strict=True)))


def test_one_model_predicts_what_the_fits_predict_on_average(
    fits: tuple[Case, ReadingRows, list[SettledFit], SettledFit],
) -> None:
    _, rows, known, average = fits
    expected = sum(s * fit.residuals for s, fit in zip(SHARES, known, strict=True))
    apart = max(np.abs(a.residuals - b.residuals).max() for a in known for b in known)
    assert apart > 5e-6
    assert np.abs(average.residuals - expected).max() < 0.02 * apart
    assert average.chi2 == pytest.approx(float(np.square(rows.padded_noise.whiten(average.residuals.ravel())).sum()))
    assert average.jacobian.shape[1] == len(average.names)


def test_its_uncertainty_holds_that_of_the_fits_and_what_they_differ_by(
    fits: tuple[Case, ReadingRows, list[SettledFit], SettledFit],
) -> None:
    """By draws: of a fit by its share, then of its estimate."""
    _, _, known, average = fits
    rng = np.random.default_rng(3)
    draws: list[Array] = []
    for fit, share in zip(known, SHARES, strict=True):
        own = np.zeros((int(200_000 * share), len(average.names)))
        at = [average.names.index(n) for n in fit.names]
        own[:, at] = rng.multivariate_normal([fit.value(n) for n in fit.names], fit.covariance, len(own))
        draws.append(own)
    drawn, sd = np.concatenate(draws), np.sqrt(np.diag(average.covariance))
    assert drawn.std(axis=0) == pytest.approx(sd, rel=0.02)
    assert drawn.mean(axis=0) / sd == pytest.approx([average.value(n) for n in average.names] / sd, abs=0.02)


def test_held_out_errors_are_those_of_the_average_prediction(
    fits: tuple[Case, ReadingRows, list[SettledFit], SettledFit],
) -> None:
    case, _, _, _ = fits
    one, other = case.beside([0]), case.beside([1])
    cases = [(0.7, _fitted_to(case, one)), (0.3, _fitted_to(case, other))]
    held = held_out_average(case, cases)
    expected = np.zeros(len(case.pose))
    for pose in np.unique(case.pose):
        out = case.pose == pose
        for share, columns in ((0.7, one), (0.3, other)):
            x = np.linalg.lstsq(columns[~out], case.residuals[~out], rcond=None)[0]
            expected[out] += share * (case.residuals[out] - columns[out] @ x)
    assert held.extended[0] == pytest.approx(case.noise.colour(expected), rel=1e-6, abs=1e-12)
    assert held.repeats == 0


def _fitted_to(case: Case, columns: Array) -> Case:
    return replace(case, A=columns, held=np.zeros(columns.shape[1]), aim=None)


def test_every_reading_is_left_out_once_with_its_pose() -> None:
    pose = np.repeat(np.arange(60), 6)
    labels = folds(pose, seed=1, repeats=3)
    assert len(labels) == 3
    for label in labels:
        assert len(np.unique(label)) == 10
        assert all(len(np.unique(label[pose == p])) == 1 for p in range(60))
    assert not np.array_equal(labels[0], labels[1])
    assert np.array_equal(folds(pose[:60], seed=1)[0], pose[:60])


def test_shares_follow_half_of_the_evidence() -> None:
    """The readings that chose the laws judge them; what does next to nothing is left out."""
    found = shares([10.0, 10.0 - 2.0 * np.log(2.0), 3.0])
    assert found == pytest.approx([2.0 / 3.0, 1.0 / 3.0, 0.0])
    assert shares([5.0] * 60).sum() == pytest.approx(1.0)


def test_an_average_without_its_plainest_law_is_led_by_the_next() -> None:
    """48 poses at which the plainest law gets no share: names and weights are of one law."""
    folder = Path(__file__).parent / "no_share_of_the_plainest"
    experiment = load_experiment(folder / "experiment.yaml")
    diagnosis = diagnose(experiment, read_readings([folder / "readings.csv", folder / "second.csv"], experiment))
    learned = diagnosis.learned
    assert learned is not None
    assert set(learned.cause.names) <= set(learned.alone.names)
    assert learned.leftover.law.place in learned.name
    assert learned.shares[0] > 0.0
    assert diagnosis_json(diagnosis)["learned"]["weights"].keys() == set(learned.cause.names)
