"""What is left is told by the axis of its place that it moves about, where that is likelier."""

from __future__ import annotations

import numpy as np

from qsframework.diagnoses.remaining import Likely, finest
from qsframework.diagnoses.result import Leftover
from qsframework.hypotheses.catalogue.generic_laws import Block
from qsframework.hypotheses.catalogue.law import Law
from qsframework.plugin import find

_EFFECT = find("learned")(at="joint_1", by="order", first=0.0, last=1.0)


def likely(law: Law, evidence: float, axis: str = "") -> Likely:
    """A law with its evidence, about one axis alone where one is given."""
    own = Law(law.part, law.place, law.by, axis)
    return Likely(law, Block(own, _EFFECT, lambda: np.zeros((3, 1))), evidence)


ELBOW = Law("drive", "joint_3", ("torque",))
SHIFT = Law("shift", "link_3", ("torque",))


def test_what_is_left_is_told_by_the_axis_where_that_is_likelier() -> None:
    left = (Leftover(ELBOW, 0.001, 9.0), Leftover(SHIFT, 0.002, 8.0))
    assert finest(left, [likely(ELBOW, 9.0), likely(SHIFT, 9.5, "z")]) == (
        Leftover(Law("shift", "link_3", ("torque",), "z"), 0.002, 9.5),
        Leftover(ELBOW, 0.001, 9.0),
    )
