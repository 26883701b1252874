"""From scores to an answer: what is passed over, what stays unsure, and what a result says of its readings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from qsframework.diagnoses import Diagnosis, diagnose
from qsframework.diagnoses.result import AlternativeCause, NamedCause, Status
from qsframework.diagnoses.verdict import ambiguous
from qsframework.errors import InputError, NotConverged
from qsframework.experiment import Readings, make_rows
from qsframework.hypotheses.catalogue import causes
from qsframework.hypotheses.catalogue.causes import find_causes
from qsframework.hypotheses.search import model_selection
from qsframework.plugin import Array, At, Conditions, Context, LawTerm, Parameter, RobotFacts, SpringLaw, place
from qsframework.report.result_json import diagnosis_json
from qsframework.report.words.diagnosis import diagnosis_words, limit_words
from tests.diagnose import cases
from tests.diagnose.cases import campaign, measured, quiet, unstable

named_causes = import_module("qsframework.diagnoses.named_causes")


@pytest.fixture(scope="module")
def twisted() -> Readings:
    """Of a bearing before the wrist that gives."""
    return cases.twisted().readings


TABLE = ("tracker_drift", "thermal_expansion", "offaxis_compliance")
BEARINGS = ("offaxis_compliance", "link_compliance", "flange_compliance")
"""Kinds of causes that are enough where the claim is not about the others."""


def few(monkeypatch: pytest.MonkeyPatch, kinds: Sequence[str]) -> None:
    """A library of these kinds, which takes a fraction of the time of the whole one."""
    known = {name: causes.registry()[name] for name in kinds}
    monkeypatch.setattr(causes, "registry", lambda: known)


@pytest.fixture(scope="module")
def tied() -> Diagnosis:
    """With the whole library."""
    return cases.twisted()


@pytest.fixture(scope="module")
def narrow(twisted: Readings) -> Diagnosis:
    """With bearings, links and the tool only."""
    with pytest.MonkeyPatch.context() as patched:
        few(patched, BEARINGS)
        return diagnose(campaign(), twisted, repeats=1)


def test_causes_whose_fits_lead_nowhere_are_not_named(
    twisted: Readings, narrow: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Something acts, and no cause can be fitted: the verdict says so, and the model stays as it was."""
    few(monkeypatch, BEARINGS)
    assert narrow.findings[0].name in [e.name for e in narrow.extended.model.effects]
    monkeypatch.setattr(model_selection, "refit", lambda *_: None)
    found = diagnose(campaign(), twisted, repeats=1)
    assert found.findings == ()
    assert found.verdict == "unexplained"
    assert found.leftovers
    assert dict(found.values()) == found.baseline.by_name()
    assert found.extended.model.effects == campaign().model().effects


def test_causes_whose_fits_are_not_physical_are_not_named(
    twisted: Readings, narrow: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The two that fit best end beyond a bound: the next answer is taken, and neither is named."""
    few(monkeypatch, BEARINGS)
    best = {narrow.findings[0].name, *(r.name for r in narrow.findings[0].alternatives)}
    monkeypatch.setattr(model_selection, "_beyond", lambda fit: not best.isdisjoint(e.name for e in fit.model.effects))
    found = diagnose(campaign(), twisted, repeats=1)
    assert best.isdisjoint(f.name for f in found.findings)
    assert found.extended.chi2 > narrow.extended.chi2


def test_of_two_aliases_the_plausible_one_is_named_only_if_it_fits(
    twisted: Readings, narrow: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both of a pair do the same to the readings; where the likelier size belongs to one whose exact fit fails, the
    other one stays."""
    few(monkeypatch, BEARINGS)
    name = narrow.findings[0].name
    names = [c.name for c in narrow.case.causes]
    (rival,) = (r.name for r in narrow.findings[0].alternatives)

    def prefer(wanted: str) -> None:
        monkeypatch.setattr(named_causes, "most_plausible", lambda library, i: names.index(wanted))

    prefer(rival)
    assert [f.name for f in diagnose(campaign(), twisted, repeats=1).findings] == [rival]
    kept: list[str] = []
    monkeypatch.setattr(named_causes, "refit", lambda *_: None)
    for wanted in (name, rival):
        prefer(wanted)
        kept += [f.name for f in diagnose(campaign(), twisted, repeats=1).findings]
    assert len(kept) == 2
    assert kept[0] == kept[1]
    assert kept[0] in (name, rival)


def test_no_diagnosis_stands_on_a_linear_model_in_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no equilibrium settles there is no exact fit, and no other is given out for one."""
    unstable(monkeypatch)
    with pytest.raises(NotConverged, match=r"the full equilibrium can be fitted neither .* Check the nominal values"):
        diagnose(campaign(), measured(count=16), repeats=1)


def test_an_error_that_markers_share_is_a_problem_of_the_data() -> None:
    """The robot comes back to each pose 0.04 mm off, so all its markers do; the tracker's noise is as stated."""
    data = measured(seed=3)
    away = 4e-5 * np.random.default_rng(1).standard_normal((60, 3))[data.plus]
    found = diagnose(campaign(), data.with_values(data.value + away), repeats=1)
    content = diagnosis_json(found)
    (problem,) = content["data_problems"]
    assert (problem["id"], problem["source"], problem["unit"]) == ("noise_level", "shared pose error", 1.0)
    assert problem["shared_mm"] == pytest.approx(0.04, rel=0.2)
    assert problem["p_value"] < 0.01
    assert content["words"] == diagnosis_words(found)
    assert diagnosis_json(quiet(3))["data_problems"] == []


def finding(name: str, p_value: float, alternatives: Sequence[str] = ()) -> NamedCause:
    return NamedCause(
        name=name,
        values=(),
        s=5.0,
        p_value=p_value,
        ebic_gain=9.0,
        alternatives=tuple(AlternativeCause(r, 0.1) for r in alternatives),
        hangs_on=(),
        physics="",
        check="",
    )


def test_a_name_that_is_barely_seen_is_unsure() -> None:
    names = [f"c{i}" for i in range(20)]
    aliases: Callable[[int], tuple[int, ...]] = lambda i: (2 * (i // 2), 2 * (i // 2) + 1)  # noqa: E731
    library: Any = SimpleNamespace(
        case=SimpleNamespace(causes=[SimpleNamespace(name=n) for n in names]), aliases=aliases
    )
    assert not ambiguous(library, ())
    assert not ambiguous(library, (finding("c0", 0.9e-3), finding("c4", 1e-9)))
    assert ambiguous(library, (finding("c0", 1.1e-3), finding("c4", 1e-9)))
    assert not ambiguous(library, (finding("c0", 1e-9, names[2:18]),))  # eight kinds of two aliases each
    assert ambiguous(library, (finding("c0", 1e-9, names[2:20]),))


def only(found: Diagnosis, names: Sequence[str]) -> Diagnosis:
    """The diagnosis as it were with these causes only."""
    case = found.case
    kept = [i for i, c in enumerate(case.causes) if c.name in names]
    few = replace(case, causes=tuple(case.causes[i] for i in kept), B=tuple(case.B[i] for i in kept))
    return replace(found, case=few)


@dataclass(frozen=True)
class SecondGear(SpringLaw):
    """A gear beside the drive of a joint, of which there is one at joint 2 only."""

    joint: str = place()

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "rad/(N m)", typical=2e-7, lower=0.0),)

    def validate(self, robot: RobotFacts) -> None:
        if self.joint != "joint_2":
            raise InputError(f"{self.name}: no second gear there")

    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        return (("gear", self.joint),)

    def extra(self, torque: Array, x: Array, context: Context) -> LawTerm:
        return LawTerm(x[0] * torque, x[0] + 0.0 * torque, torque[..., None])

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[SecondGear, ...]:
        return tuple(cls(joint) for joint in robot.joints)


def test_an_effect_is_tried_only_where_the_robot_can_have_it(
    twisted: Readings, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, _ = find_causes(campaign(), campaign().fit_names(), twisted.poses)
    known = dict(causes.registry()) | {"second_gear": SecondGear}
    monkeypatch.setattr(causes, "registry", lambda: known)
    after, _ = find_causes(campaign(), campaign().fit_names(), twisted.poses)
    assert {c.name for c in after} - {c.name for c in before} == {"second_gear[joint_2]"}
    assert {c.name for c in before} <= {c.name for c in after}


@pytest.mark.parametrize(
    ("recorded", "lacking"),
    [
        ({}, {"tracker_drift": ("time", "time_unloaded"), "thermal_expansion": ("temperature",)}),
        ({"loaded": ("time",)}, {"tracker_drift": ("time_unloaded",), "thermal_expansion": ("temperature",)}),
        ({"unloaded": ("time", "temperature")}, {"tracker_drift": ("time",), "thermal_expansion": ("temperature",)}),
        ({"loaded": ("temperature",)}, {"tracker_drift": ("time", "time_unloaded")}),
        ({"loaded": ("time",), "unloaded": ("time",)}, {"thermal_expansion": ("temperature",)}),
    ],
)
def test_half_of_the_columns_that_an_effect_needs_leave_it_untested(
    recorded: dict[str, tuple[str, ...]],
    lacking: dict[str, tuple[str, ...]],
    twisted: Readings,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A drift shows between two states, so their two times are needed; of the warmth one is enough."""
    count = len(twisted.poses) // 2
    values: Array = np.linspace(300.0, 310.0, count)
    parts = [(recorded.get("loaded", ())), recorded.get("unloaded", ())]
    columns = {
        name: np.concatenate([values if name in part else np.full(count, np.nan) for part in parts])
        for name in {*parts[0], *parts[1]}
    }
    own = Conditions(**columns)
    readings = twisted.with_poses(replace(twisted.poses, loaded=own, unloaded=own))
    known, untested = find_causes(campaign(), campaign().fit_names(), make_rows(readings))
    told = {u.name: u.needs for u in untested if "_friction" not in u.name}
    assert told == lacking
    assert {"tracker_drift", "thermal_expansion"} <= {c.name for c in known} | set(told)
    if "loaded" not in recorded or "unloaded" in recorded:
        return  # one table is enough: of half the columns that a drift needs, and none of the other's
    few(monkeypatch, TABLE)
    table = {line.name: line for line in diagnose(campaign(), readings, repeats=1).table}
    for name, needs in lacking.items():
        assert (table[name].status, table[name].needs) == (Status.UNTESTED, needs)
        assert limit_words(table[name]) == f"needs {', '.join(needs)}"
