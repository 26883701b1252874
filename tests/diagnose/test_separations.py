"""What would tell a named cause from its alias: no poses, but another marker."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsf_plugins.offaxis_compliance import OffaxisCompliance
from qsframework.diagnose import Diagnosis, diagnose
from qsframework.diagnose.separations import separations
from tests.diagnose.cases import campaign, measured


@pytest.fixture(scope="module")
def tied() -> Diagnosis:
    """The bearing before the wrist gives, which to markers on the tool is the forearm that twists."""
    hidden = OffaxisCompliance("joint_4", "z")
    truth = {p.name: 0.4 * p.typical for p in hidden.parameters(campaign().robot.facts)}
    return diagnose(campaign(), measured((hidden,), truth, seed=1, count=30), seed=0)


def test_aliases_are_separated_by_a_marker_between_them_and_by_no_pose(tied: Diagnosis) -> None:
    (f,) = tied.findings
    names = {f.name, *(r.name for r in f.rivals)}
    assert names == {"offaxis_compliance[joint_4/z]", "link_compliance[link_3/rz]"}, tied.words
    calls: list[tuple[str, int, int]] = []
    (pair,), notes = separations(tied, 6, progress=lambda *a: calls.append(a))
    assert not notes
    assert {pair.first, pair.second} == names
    assert np.allclose(pair.values, [v.value - v.initial for v in f.values])
    assert not pair.helps
    assert pair.s_after < 0.01
    best = pair.offers[0]
    assert "marker on link_3" in best.what
    assert best.s > 0.5
    assert any("a marker on link_3" in line and "enough from" in line for line in pair.words())
    assert calls[-1][1] == calls[-1][2] == 1


def test_what_cannot_be_computed_is_said(tied: Diagnosis) -> None:
    (f,) = tied.findings
    lost = replace(f, rivals=(replace(f.rivals[0], name="nobody[joint_1]"),))
    pairs, notes = separations(replace(tied, findings=(lost,)), 6)
    assert pairs == ()
    assert "nobody[joint_1]" in notes[0]


def test_without_rivals_there_is_nothing_to_separate(tied: Diagnosis) -> None:
    alone = replace(tied, findings=tuple(replace(f, rivals=()) for f in tied.findings))
    assert separations(alone) == ((), ())
