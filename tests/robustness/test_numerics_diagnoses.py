"""One diagnosis, told again in another order and in another unit of force: what it is held against is made once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
from numerics import campaign, diagnosed, in_force_unit, with_forces
from test_numerics_order import all_in_order
from test_numerics_units import same

from qsf_plugins.joint_backlash import JointBacklash
from qsframework.diagnoses import diagnose
from qsframework.plugin import RobotFacts


def test_diagnoses_do_not_depend_on_any_order() -> None:
    data, wanted = diagnosed()
    found = diagnose(*all_in_order(campaign(), data, 2), repeats=1)
    assert found.verdict == wanted.verdict
    assert [f.name for f in found.findings] == [f.name for f in wanted.findings]
    for a, b in zip(found.findings, wanted.findings, strict=True):
        assert {r.name for r in a.alternatives} == {r.name for r in b.alternatives}
        assert a.s == pytest.approx(b.s, rel=1e-9)
        assert [v.value for v in a.values] == pytest.approx([v.value for v in b.values], rel=1e-9)
        assert [v.sd for v in a.values] == pytest.approx([v.sd for v in b.values], rel=1e-9)


def backlash_in_force_unit(monkeypatch: pytest.MonkeyPatch, k: float) -> None:
    """The one size of the library that is stated in N m, in a force unit 1/k as large; others follow the payload."""
    places = JointBacklash.places

    def wider(robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[JointBacklash, ...]:
        return tuple(replace(e, width=e.width * k) for e in places(robot, markers))

    monkeypatch.setattr(JointBacklash, "places", staticmethod(wider))


def test_diagnoses_do_not_depend_on_the_unit_of_force(monkeypatch: pytest.MonkeyPatch) -> None:
    k = 1e9
    data, wanted = diagnosed()
    other = in_force_unit(campaign(), k)
    backlash_in_force_unit(monkeypatch, k)
    found = diagnose(other, with_forces(data, k), repeats=1)
    assert found.verdict == wanted.verdict == "explained"
    assert [f.name for f in found.findings] == [f.name for f in wanted.findings] == ["offaxis_compliance[joint_3/x]"]
    assert [f.alternatives for f in found.findings] == [f.alternatives for f in wanted.findings]
    same(found.findings[0].values[0].value * k, wanted.findings[0].values[0].value)
    same(found.findings[0].values[0].sd * k, wanted.findings[0].values[0].sd)
    same(found.findings[0].s, wanted.findings[0].s)
