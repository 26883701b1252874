"""A law whose variable can hardly reach its place is less likely, and says that it stands in for another."""

from __future__ import annotations

import pytest

from qsframework.hypotheses.catalogue.law import Law, Part
from qsframework.report.words.law import moving_words
from qsframework.robot import load_robot


@pytest.mark.parametrize(
    ("part", "place", "by", "reaches"),
    [
        ("link", "base_link", ("loaded", "joint_6"), False),
        ("link", "base_link", ("loaded", "joint_1"), True),
        ("drive", "joint_5", ("torque", "joint_4"), True),
        ("drive", "joint_5", ("torque", "joint_1"), False),
        ("drive", "joint_3", ("torque joint_2",), True),
        ("bearing", "joint_1", ("torque joint_6",), False),
        ("link", "link_2", ("loaded", "joint_2+joint_3"), True),
        ("link", "link_6", ("loaded", "joint_1+joint_2"), False),
        ("drive", "joint_2", ("came joint_5",), False),
        ("drive", "joint_2", ("torque",), True),
        ("link", "base_link", ("loaded", "order"), True),
        ("link", "base_link", ("attitude",), True),
        ("readings", "", ("loaded", "joint_6"), True),
        ("marker", "m1", ("loaded", "joint_1"), True),
    ],
)
def test_what_a_joint_does_acts_near_it(part: Part, place: str, by: tuple[str, ...], reaches: bool) -> None:
    facts = load_robot("fanuc_m900ib").facts
    law = Law(part, facts.base if place == "base_link" else place, by)
    assert law.reaches(facts) is reaches
    assert ("stands in for something else" in moving_words(law, facts)) is not reaches
