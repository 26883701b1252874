"""The whole verb on hidden effects: name, place, size and gain; nothing where nothing acts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from qsframework.diagnoses import diagnose
from qsframework.diagnoses.result import Status
from qsframework.errors import InputError
from qsframework.plugin import Array, At, Context, Parameter, RobotFacts, SpringLaw, find, place
from qsframework.report.result_json import diagnosis_json
from qsframework.report.words.diagnosis import diagnosis_words, method_words
from tests.diagnose.cases import HARDENING, campaign, diagnosed, hardened, measured, quiet


def test_a_hidden_effect_is_named_sized_and_gains() -> None:
    """A drive that stiffens; other springs, backlash, the pedestal and the load: tests/proof/test_pinned.py."""
    (hidden,), truth = HARDENING
    found = hardened()
    assert found.verdict == "explained", diagnosis_words(found)
    assert [f.name for f in found.findings] == [hidden.name], diagnosis_words(found)
    for value in found.findings[0].values:
        assert abs(value.value - truth[value.name]) < 3.5 * value.sd
        assert value.sd < 0.2 * abs(truth[value.name])
    assert found.rms.heldout_gain > 0.0
    assert found.findings[0].p_value < 0.01
    json.dumps(diagnosis_json(found), allow_nan=False)


def test_two_causes_are_both_named() -> None:
    first, second = find("joint_hardening")("joint_3"), find("flange_compliance")("y")
    truth = {p.name: 0.4 * p.typical for e in (first, second) for p in e.parameters(campaign().robot.facts)}
    found = diagnose(campaign(), measured((first, second), truth, seed=2, count=30), repeats=1)
    assert {f.name for f in found.findings} == {first.name, second.name}, diagnosis_words(found)


def test_nothing_is_named_where_nothing_acts_and_bounds_are_given() -> None:
    """How often something is named by chance: test_family_test.py, over hundreds of draws."""
    for seed in (0, 3):
        found = quiet(seed)
        assert found.verdict == "none", diagnosis_words(found)
        assert found.rms.heldout_extended == pytest.approx(found.rms.noise, rel=0.15)
    assert "no " in diagnosis_words(quiet(0))
    assert " above " in diagnosis_words(quiet(0))


def test_bounds_of_excluded_causes_hold_the_truth_that_nothing_acts() -> None:
    found = quiet(3)
    excluded = [x for x in found.table if x.status is Status.EXCLUDED]
    invisible = {x.name for x in found.table if x.status is Status.INVISIBLE}
    assert len(excluded) > 40
    assert all(size > 0.0 for x in excluded for _, size in x.limits or ())
    assert all(x.limits is None or x.limits for x in excluded)
    assert {"load_scale", "base_compliance[rz]"} <= invisible


def test_the_same_seed_gives_the_same_result() -> None:
    one = hardened()
    again = diagnose(campaign(), one.readings, repeats=1)
    assert one.findings
    assert diagnosis_json(one) == diagnosis_json(again)


def test_the_r2000ic_joint_springs_are_not_the_whole_truth() -> None:
    found = diagnosed("r2000ic")
    assert found.verdict in ("explained", "partly_explained")
    assert found.rms.heldout_extended <= 165e-6
    assert found.audit.unit_source != "stated"
    assert any(
        f.name.startswith(("offaxis_compliance", "flange_compliance", "link_compliance")) for f in found.findings
    )
    for finding in found.findings:
        if "compliance" in finding.name:
            assert all(v.value > 0.0 for v in finding.values)
    assert any(f.hangs_on for f in found.findings)
    assert any(f.alternatives for f in found.findings)


def test_bad_levels_and_masked_readings_are_refused() -> None:
    readings = measured(seed=0, count=12)
    with pytest.raises(InputError, match="level"):
        diagnose(campaign(), readings, level=0.0)
    with pytest.raises(InputError, match="masked"):
        diagnose(campaign(), replace(readings, use=np.zeros(len(readings.use), dtype=bool)))


def test_parameters_that_the_readings_do_not_tell_stay_nominal_and_are_named() -> None:
    readings = measured(seed=20, count=40)
    vertical = np.isclose(readings.poses.wrench[readings.plus, 1], 0.0)
    found = diagnose(campaign(), replace(readings, use=vertical), repeats=1)
    assert any("joint_compliance[joint_1]" in note for note in method_words(found))
    assert "joint_compliance[joint_1]" not in found.baseline.names
    assert found.verdict == "none", diagnosis_words(found)


def test_a_strangers_effect_takes_part_without_further_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """A law that no built-in effect knows: the drive gives more near one angle of its joint."""

    @dataclass(frozen=True)
    class WornTeeth(SpringLaw):
        """A gear gives more under one sense of the torque where its teeth are worn: near one angle of the joint."""

        joint: str = place()

        def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
            return (Parameter(self.name, "rad/(N m)", typical=2e-7, lower=0.0),)

        def springs(self, robot: RobotFacts) -> tuple[At, ...]:
            return (("gear", self.joint),)

        def extra(self, torque: Array, x: Array, context: Context) -> Array:
            angle = context.poses.q[:, context.robot.joint_index(self.joint), None]
            return x[0] * np.exp(-((angle - 0.5) ** 2)) * np.logaddexp(0.0, torque / 50.0) * 50.0

        @classmethod
        def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[WornTeeth, ...]:
            return tuple(cls(joint) for joint in robot.joints)

    from qsframework.hypotheses.catalogue import causes

    gears = ("joint_hardening", "joint_backlash", "gear_flank", "gear_waves", "offaxis_compliance", "link_compliance")
    built_in = {name: causes.registry()[name] for name in gears}
    known = built_in | {"worn_teeth": WornTeeth}
    monkeypatch.setattr(causes, "registry", lambda: known)
    hidden = WornTeeth("joint_4")
    readings = measured((hidden,), {hidden.name: 1.2e-7}, seed=8, count=30)
    found = diagnose(campaign(), readings, repeats=1)
    assert [f.name for f in found.findings] == ["worn_teeth[joint_4]"], diagnosis_words(found)
    (value,) = found.findings[0].values
    assert abs(value.value - 1.2e-7) < 4.0 * value.sd
    monkeypatch.setattr(causes, "registry", lambda: built_in)
    without = diagnose(campaign(), readings, repeats=1)
    assert without.verdict != "none"
    assert "worn_teeth[joint_4]" not in [f.name for f in without.findings]
