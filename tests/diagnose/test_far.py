"""A cause so large that it is far from linear does not pass for noise."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

from qsframework.diagnoses import Diagnosis, diagnose
from qsframework.diagnoses.residuals.audited_rows import far_from_linear
from qsframework.experiment import Readings
from qsframework.report.words.diagnosis import diagnosis_words, method_words
from tests.diagnose.cases import SIGMA, campaign, measured

TURN = 0.7
"""rad: how far the tracker's frame is turned about the vertical."""


def turned(readings: Readings) -> Readings:
    c, s = np.cos(TURN), np.sin(TURN)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return readings.with_values(readings.value @ R.T)


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    """Two loads at 18 poses: the linear library takes nearly all that it can. The screening, which calls so large a
    turn a mistake in the table, is left out: the tests have to name it without."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_module("qsframework.diagnoses.diagnose"), "find_mistakes", lambda *_, **__: ())
        return diagnose(campaign(), turned(measured(seed=4, count=18)), repeats=1)


def test_a_frame_turned_far_is_named_and_is_no_noise(found: Diagnosis) -> None:
    assert [f.name for f in found.findings] == ["tracker_frame"], diagnosis_words(found)
    (f,) = found.findings
    rz = next(v for v in f.values if v.name == "tracker_frame.rz")
    assert rz.value == pytest.approx(TURN, abs=4.0 * rz.sd)
    assert rz.sd < 0.02
    assert found.audit.unit_source == "stated"
    assert found.audit.shared == 0.0
    assert len(found.outliers) == 0
    assert found.rms.noise == SIGMA
    assert found.verdict == "explained"
    assert found.rms.heldout_extended < 1.3 * SIGMA < 0.1 * found.rms.heldout_identified
    assert any("far from linear" in note for note in method_words(found))
    assert "the causes are given" in method_words(found)[0]


def test_what_is_nearly_linear_is_audited_once() -> None:
    """A frame turned by a degree, and nothing at all: the first audit stands, the search is nested."""
    small = measured(seed=4, count=18)
    R = np.eye(3) + 0.017 * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    found = diagnose(campaign(), small.with_values(small.value @ R.T), repeats=1)
    assert [f.name for f in found.findings] == ["tracker_frame"]
    assert not far_from_linear(found.case, found.extended)
    assert "the search chose the same causes" in method_words(found)[0]
    assert not any("far from linear" in note for note in method_words(found))
