"""What each cause gains at poses that the fit has not seen, against fits without each pose."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from qsframework.diagnoses import Diagnosis
from qsframework.diagnoses.error_budget import linear_errors
from qsframework.hypotheses.columns import Case
from qsframework.hypotheses.search.cross_validation import standard_errors
from qsframework.plugin import Array
from qsframework.report.diagnosis_tables import cause_table, verdict_groups
from qsframework.report.result_json import diagnosis_json
from tests.diagnose.cases import diagnosed, reversed_sign, twisted


@pytest.fixture(scope="module")
def real() -> Diagnosis:
    """The R-2000iC has three causes."""
    return diagnosed("r2000ic")


def refitted(case: Case, names: list[str], residuals: Array) -> float:
    """Held-out RMS, m, by a fit without each pose."""
    at = [i for i, c in enumerate(case.causes) if c.name in names]
    sizes = [len(case.fitted), *(len(c.parameters) for c in case.causes)]
    parts = np.split(case.raw, np.cumsum(sizes)[:-1], axis=1)
    raw = np.concatenate([parts[0], *(parts[i + 1] for i in at)], axis=1)
    white = np.concatenate([case.A, *(case.B[i] for i in at)], axis=1)
    left = residuals.ravel().copy()
    for pose in np.unique(case.pose):
        test = case.pose == pose
        x = np.linalg.lstsq(white[~test], case.residuals[~test], rcond=None)[0]
        left[test] -= raw[test] @ x
    return float(np.sqrt(np.mean(left**2)))


def test_each_cause_has_the_gain_that_is_lost_without_it(real: Diagnosis) -> None:
    names = [f.name for f in real.findings]
    assert len(names) == 3
    every = refitted(real.case, names, real.baseline.residuals)
    assert every == pytest.approx(real.rms.heldout_extended, rel=0.1)
    for f in real.findings:
        without = refitted(real.case, [n for n in names if n != f.name], real.baseline.residuals)
        assert f.heldout_gain == pytest.approx(1.0 - every / without, rel=1e-6)
        assert 0.05 < f.heldout_gain < real.rms.heldout_gain
    assert len({round(f.heldout_gain, 2) for f in real.findings}) == 3
    table = cause_table(real)
    at = table.header.index("held-out gain")
    shown = [row[at] for row in table.rows[:3]]
    assert shown == [f"{100 * f.heldout_gain:.0f} %" for f in real.findings]
    assert [c["heldout_gain"] for c in diagnosis_json(real)["causes"]] == [f.heldout_gain for f in real.findings]


def test_how_clear_a_gain_is_is_its_t_over_the_poses(real: Diagnosis) -> None:
    rng = np.random.default_rng(1)
    pose = np.repeat(np.arange(9), [3, 6, 3, 3, 6, 3, 3, 3, 6])
    before, after = rng.standard_normal((2, 2, len(pose)))
    falls = [np.sum(before[:, pose == k] ** 2 - after[:, pose == k] ** 2) / 2.0 for k in range(9)]
    expected = scipy.stats.ttest_1samp(falls, 0.0).statistic
    assert standard_errors(before, after, pose) == pytest.approx(expected, rel=1e-12)
    assert standard_errors(before, before, pose) == 0.0
    assert standard_errors(before[:, :3], after[:, :3], pose[:3]) == 0.0, "one pose tells no spread"
    assert all(f.heldout_clear > 1.0 for f in real.findings)


def test_a_name_that_is_barely_seen_needs_a_clear_gain(real: Diagnosis) -> None:
    """What 1,000 draws never reached, p = 1/1001, is barely seen; a plain name only needs a gain."""
    sure = replace(real.findings[0], p_value=1e-6, heldout_gain=0.01, heldout_clear=0.5)
    assert not sure.doubtful
    assert replace(sure, heldout_gain=-0.01).doubtful
    faint = replace(sure, p_value=1.0 / 1001.0)
    assert faint.faint
    assert faint.doubtful
    assert not replace(faint, heldout_clear=1.5).doubtful


def test_json_holds_what_the_report_shows(real: Diagnosis) -> None:
    """The evidence of each cause, the budget, and the tests before and after."""
    told = json.loads(json.dumps(diagnosis_json(real), allow_nan=False))
    assert [c["delta_ebic"] for c in told["causes"]] == [f.ebic_gain for f in real.findings]
    assert min(c["delta_ebic"] for c in told["causes"]) > 10.0
    steps = told["budget"]
    assert [s["label"] for s in steps] == ["nominal", "identified", *(f"+ {f.name}" for f in real.findings), "noise"]
    held = [s["heldout_mm"] for s in steps]
    assert held == sorted(held, reverse=True)
    assert held[1] == told["error_mm"]["heldout_identified"]
    assert held[-2] == told["error_mm"]["heldout_extended"]
    first = refitted(real.case, [real.findings[0].name], real.baseline.residuals)
    assert held[2] == pytest.approx(1e3 * np.sqrt(3.0) * first, rel=1e-6)
    before, after = told["lack_of_fit"]["before"], told["lack_of_fit"]["after"]
    assert before["chi2"] == pytest.approx(real.baseline.chi2, rel=1e-6)
    assert before["dof"] == 3 * len(real.kept) - len(real.baseline.names)
    assert after["chi2"] / after["dof"] < before["chi2"] / before["dof"]
    assert (before["p_replicates"], before["dof_replicates"]) == (None, 0)
    assert [t["variable"] for t in before["trends"]] == [t.variable for t in real.before.trends]
    assert all(0.0 <= t["p_value"] <= 1.0 and 0.0 <= t["share"] <= 1.0 for t in before["trends"])


def test_one_cause_has_the_gain_of_the_extension() -> None:
    found = twisted()
    assert len(found.findings) == 1
    assert [f.heldout_gain for f in found.findings] == [pytest.approx(found.rms.heldout_gain, rel=1e-12)]


def test_a_convention_has_no_held_out_gain() -> None:
    found = reversed_sign()
    assert found.findings[0].name == "displacement_sign"
    assert np.isnan(found.findings[0].heldout_gain)
    assert diagnosis_json(found)["causes"][0]["heldout_gain"] is None
    rows = [row for _, lines in verdict_groups(found) for row in lines.rows]
    said = [row for row in rows if "of them is reversed" in " ".join(row)]
    assert len(said) == 1, "once is enough"


def test_a_direction_that_one_pose_carries_costs_nothing_elsewhere(real: Diagnosis) -> None:
    """Without that pose its column is told by nothing: the fit is made anew, and predicts as if it were not there."""
    case = real.case
    pose = case.pose == case.pose[0]
    white, raw = case.A.copy(), case.raw.copy()
    white[:, -1] = 0.0
    white[pose, -1] = np.array([1.0, 2.0, -1.0])
    raw[:, white.shape[1] - 1] = case.noise.colour(white[:, -1])
    one = replace(case, A=white, raw=raw)
    _, held, _ = linear_errors(one, [], real.baseline.residuals)
    assert held == pytest.approx(refitted(one, [], real.baseline.residuals), rel=1e-9)
