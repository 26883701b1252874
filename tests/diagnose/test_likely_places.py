"""Where what is left may be: the places that hold 95 % of the evidence together."""

from __future__ import annotations

import numpy as np

from qsframework.diagnose.law import Law
from qsframework.diagnose.linearization.generic_blocks import Block
from qsframework.diagnose.result import Leftover
from qsframework.diagnose.selection.closing_gate import Likely, finest, likely_places
from qsframework.plugin import find

_EFFECT = find("learned")(at="joint_1", by="order", first=0.0, last=1.0)


def likely(law: Law, evidence: float, axis: str = "") -> Likely:
    """A law with its evidence, about one axis alone where one is given."""
    own = Law(law.part, law.place, law.by, axis)
    return Likely(law, Block(own, np.zeros((3, 1)), _EFFECT), evidence)


ELBOW = Law("drive", "joint_3", ("torque",))
ANGLE = Law("drive", "joint_3", ("joint_3",))
LINK = Law("link", "link_3", ("joint_2",))
SHIFT = Law("shift", "link_3", ("torque",))
FAR = Law("marker", "m1", ("force",))


def test_the_evidence_of_all_laws_of_a_place_adds_up() -> None:
    """Two laws of the elbow beat a single one of the link that is a little likelier than either."""
    found = likely_places([likely(LINK, 10.2), likely(ELBOW, 10.0), likely(ANGLE, 10.0), likely(FAR, 4.0)])
    assert [x.law for x in found] == [ELBOW, LINK], "a marker that holds a hundredth is not told"
    odds = np.array([2.0, np.exp(0.2)])
    assert np.allclose([x.share for x in found], odds / (odds.sum() + np.exp(-6.0)))


def test_a_link_that_shifts_is_the_place_of_the_link_and_a_plain_place_stands_alone() -> None:
    found = likely_places([likely(SHIFT, 9.0, "z"), likely(LINK, 8.5)])
    assert [(x.law.part, x.law.axis, x.share) for x in found] == [("shift", "z", 1.0)]
    (plain,) = likely_places([likely(ELBOW, 20.0), likely(FAR, 16.0)])
    assert plain.law == ELBOW
    assert plain.share > 0.95
    assert likely_places([]) == ()


def test_what_is_left_is_told_by_the_axis_where_that_is_likelier() -> None:
    left = (Leftover(ELBOW, 0.001, 9.0), Leftover(SHIFT, 0.002, 8.0))
    assert finest(left, [likely(ELBOW, 9.0), likely(SHIFT, 9.5, "z")]) == (
        Leftover(Law("shift", "link_3", ("torque",), "z"), 0.002, 9.5),
        Leftover(ELBOW, 0.001, 9.0),
    )
