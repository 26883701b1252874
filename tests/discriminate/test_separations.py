"""What would tell a named cause from its alias: no poses, but another marker."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.diagnose import Diagnosis
from qsframework.discriminate.alternatives import Offer
from qsframework.discriminate.pair import Discrimination
from qsframework.discriminate.separations import separations
from qsframework.experiment import LoadCase, Marker, make_plan
from qsframework.plugin import Parameter
from qsframework.report.words.diagnosis import diagnosis_words, statements, tied_words
from qsframework.report.words.discrimination import (
    discrimination_words,
    not_separated_words,
    offer_words,
    outlook_words,
)
from tests.diagnose.cases import poses as campaign_poses, twisted


@pytest.fixture(scope="module")
def tied() -> Diagnosis:
    """The bearing before the wrist gives, which to markers on the tool is the forearm that twists."""
    return twisted()


def test_aliases_are_separated_by_a_marker_between_them_and_by_no_pose(tied: Diagnosis) -> None:
    (f,) = tied.findings
    names = {f.name, *(r.name for r in f.alternatives)}
    assert names == {"offaxis_compliance[joint_4/z]", "link_compliance[link_3/rz]"}, diagnosis_words(tied)
    calls: list[tuple[str, int, int]] = []
    (pair,), notes = separations(tied, 6, progress=lambda *a: calls.append(a))
    assert not notes
    assert {pair.first, pair.second} == names
    assert np.allclose(pair.values, [v.value - v.initial for v in f.values])
    assert not pair.helps
    assert pair.s_after < 0.01
    best = pair.offers[0]
    assert isinstance(best.other, Marker)
    assert best.other.link == "link_3"
    assert best.s > 0.5
    assert any("a marker on link_3" in line and "enough from" in line for line in discrimination_words(pair))
    assert calls[-1][1] == calls[-1][2] == 1
    (before,) = (s.text for s in statements(tied) if s.text.startswith("These readings cannot separate"))
    assert before.endswith("(angle 0 deg): to these readings they are the same.")
    (after,) = {s.text for s in statements(tied, [pair])} - {s.text for s in statements(tied)}
    assert after.startswith(before.partition(": to these")[0])
    assert f"no more poses like these separate it from {pair.second}, {offer_words(best)} would" in after
    assert len(statements(tied, [pair])) == len(statements(tied))


@pytest.mark.parametrize(
    ("s", "angle", "offered", "said"),
    [
        (8.0, 40.0, (), "2 more poses would separate it from b"),
        (2.0, 40.0, (), "2 more poses would separate it from b from 0.200 mm on"),
        (2.0, 40.0, (8.0,), "2 more poses would separate it from b from 0.200 mm on, the load 8 would"),
        (8.0, 0.3, (1.0, 5.0, 0.1), "no more poses like these separate it from b, the load 5 would"),
        (0.1, 40.0, (1.0,), "no more poses like these separate it from b, the load 1 would from 0.400 mm on"),
        (8.0, 0.3, (0.1,), "nothing that was tried separates it from b"),
    ],
)
def test_poses_are_promised_only_where_they_help(s: float, angle: float, offered: tuple[float, ...], said: str) -> None:
    limit = float(np.deg2rad(angle))
    offers = tuple(Offer(f"{o:g}", LoadCase(f"{o:g}", np.zeros(6), None), o, 0.5) for o in offered)
    plan = make_plan(campaign_poses(1, 2), ["load"] * 2)
    parameters = (Parameter("a", "m"),)
    pair = Discrimination(
        first="a",
        second="b",
        parameters=parameters,
        values=np.array([1e-4]),
        plan=plan,
        s_before=0.1,
        s_after=s,
        angle_before=limit,
        angle_after=limit,
        bound=s,
        limit=limit,
        offers=offers,
        candidates=9,
    )
    assert outlook_words(pair) == said


def test_poses_are_offered_in_the_verdict_where_the_angle_is_open(tied: Diagnosis) -> None:
    (f,) = tied.findings
    apart = replace(f, alternatives=(replace(f.alternatives[0], angle=0.1),))
    assert tied_words(apart).endswith(f"{f.alternatives[0].name} (angle 6 deg): poses can be designed that would.")


def test_what_cannot_be_computed_is_said(tied: Diagnosis) -> None:
    (f,) = tied.findings
    lost = replace(f, alternatives=(replace(f.alternatives[0], name="nobody[joint_1]"),))
    pairs, missing = separations(replace(tied, findings=(lost,)), 6)
    assert pairs == ()
    assert missing[0].second == "nobody[joint_1]"
    assert "nobody[joint_1]" in not_separated_words(missing)[0]


def test_without_rivals_there_is_nothing_to_separate(tied: Diagnosis) -> None:
    alone = replace(tied, findings=tuple(replace(f, alternatives=()) for f in tied.findings))
    assert separations(alone) == ((), ())
