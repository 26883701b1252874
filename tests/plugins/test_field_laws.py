"""Every law that the field knows, through the protocol, a simulation, a design, a fit and a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import pytest

from qsframework.design import Wish, design
from qsframework.diagnose import diagnose
from qsframework.diagnose.result import Status
from qsframework.elastostatics import exact_readings
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Frame, Readings, make_plan, simulate
from qsframework.experiment.simulate import displaced
from qsframework.identify import identify
from qsframework.plugin import Conditions, Effect, build_effects, check_effect
from tests.diagnose.cases import SIGMA, campaign, poses
from tests.identify.arm import position_readings, settled


@dataclass(frozen=True)
class Law:
    """An entry of `effects`, how large it is hidden (natural sizes), and what shows it.

    read: "displacements" or "positions"; named: whether a diagnosis must name it; without: parameters that these
    readings cannot tell
    """

    entry: Mapping[str, object]
    size: float = 3.0
    read: str = "displacements"
    named: bool = True
    without: tuple[str, ...] = field(default=())

    def __str__(self) -> str:
        return str(self.entry["effect"])


LAWS = (
    Law({"effect": "gear_flank", "joint": "joint_5"}, 8.0),
    Law({"effect": "gear_waves", "joint": "joint_3"}),
    Law({"effect": "gear_friction", "joint": "joint_3"}),
    Law({"effect": "link_growth", "link": "link_2"}, 3.0, without=("drift",)),
    Law({"effect": "link_bending", "link": "link_3", "across": "v"}, 6.0),
    Law({"effect": "hose", "link": "link_6", "from_z_m": 4.5}, 10.0, "positions"),
    Law({"effect": "base_lift", "direction": "ry"}, 3.0),
    Law({"effect": "marker_slip", "marker": "m2"}),
    Law({"effect": "gear_ratio", "joint": "joint_2"}, read="positions"),
    Law({"effect": "marker_move", "marker": "m2", "percent": "50"}, read="positions"),
    Law({"effect": "tracker_move", "percent": "50"}, read="positions"),
    Law({"effect": "reading_drift"}, 5.0, read="positions"),
)
every_law = pytest.mark.parametrize("law", LAWS, ids=str)
COUNT = 40


@cache
def based() -> Experiment:
    """The campaign of a robot whose pedestal gives."""
    (base,) = build_effects({"effect": "base_compliance", "direction": "ry"}, campaign().robot.facts)
    (own,) = base.parameters(campaign().robot.facts)
    return campaign().with_(effects=(base,), parameters=(replace(own, nominal=2e-8, sd=1e-8),))


def built(law: Law) -> Effect:
    (effect,) = build_effects(law.entry, based().robot.facts, ("m1", "m2", "m3"))
    return effect


def hidden(law: Law) -> tuple[Experiment, dict[str, float]]:
    """The experiment that has the law and fits it, and the true values."""
    effect = built(law)
    own = effect.parameters(based().robot.facts)
    truth = {p.name: law.size * p.typical for p in own if not p.name.endswith(law.without or "-")}
    wide = based().with_(
        effects=(*based().effects, effect),
        parameters=(*based().parameters, *own),
        fit=("joint_compliance", *truth),
    )
    return wide, truth


def conditions(count: int, seed: int = 0) -> Conditions:
    side = np.random.default_rng(seed).choice([-1.0, 1.0], count)
    return Conditions(approach=side, order=np.arange(count) / count)


def measured(law: Law, linear: bool = False) -> Readings:
    """Readings of an arm that has the law."""
    rng = np.random.default_rng(5)
    wide, truth = hidden(law)
    model = wide.model()
    x = model.nominal
    x[model.index(list(truth))] = list(truth.values())
    at = poses(3, COUNT)
    if law.read == "displacements":
        at = replace(at, unloaded=conditions(COUNT, 1), loaded=conditions(COUNT, 2))
        moved = model.predict(at, x) if linear else exact_readings(model, at, x)
        moved = moved + SIGMA * rng.standard_normal(moved.shape)
        return displaced(at, moved, SIGMA, [f"p{i}" for i in range(COUNT)])
    loaded = np.arange(2 * COUNT) % 2 == 1
    at = at.take(np.arange(2 * COUNT) // 2)
    both = conditions(2 * COUNT)
    at = replace(at, unloaded=both, loaded=both)
    seen = settled(model, at, loaded, x)
    seen = seen + SIGMA * rng.standard_normal(seen.shape)
    readings = position_readings(at, loaded, seen, SIGMA, pose=[f"p{i // 2}" for i in range(2 * COUNT)])
    return replace(
        readings.with_poses(replace(readings.poses, unloaded=both, loaded=both)),
        known=(Frame("", np.eye(3), np.zeros(3)),),
    )


@every_law
def test_it_keeps_the_protocol_at_every_place(law: Law) -> None:
    effect = built(law)
    for one in {effect, *type(effect).places(based().robot.facts, ("m1", "m2"))}:
        assert len(check_effect(one, based().robot.facts)) > 8
    assert effect.check
    assert effect.source
    assert effect.equation


@every_law
def test_it_is_simulated(law: Law) -> None:
    """From a plan, in which nobody knows the sides of approach; what positions alone show leaves displacements."""
    wide, truth = hidden(law)
    plan = make_plan(poses(1, 6), ["load"] * 6)
    x = wide.model().nominal
    without = simulate(wide, plan, x).readings.value
    x[wide.model().index(list(truth))] = list(truth.values())
    change = np.abs(simulate(wide, plan, x).readings.value - without).max()
    assert change > (2 * SIGMA if law.read == "displacements" else 0.0)


@every_law
def test_a_plan_is_made_for_it(law: Law) -> None:
    wide, truth = hidden(law)
    wide = wide if law.read == "displacements" else wide.with_(fit=("joint_compliance",))
    plan = design(wide, 8, candidates=60, seed=1, wish=Wish(criterion="D"))
    assert len(plan.pose) == 8
    if law.read == "displacements":
        assert plan.certificate is not None
        assert set(truth) <= set(plan.certificate.parameters)


@every_law
def test_it_is_found_where_the_fit_names_it(law: Law) -> None:
    wide, truth = hidden(law)
    fit = identify(wide, measured(law), options=FitOptions(keep_all=True))
    found = {e.name: e for e in fit.estimates}
    for name, true in truth.items():
        assert abs(found[name].value - true) < 4.5 * found[name].sd, name
        assert found[name].sd < 0.5 * abs(true), f"{name} is seen at all"


@every_law
def test_a_diagnosis_tries_it(law: Law) -> None:
    """Something is seen, and the law is among what is tested; where nothing is like it, it is named."""
    found = diagnose(based(), measured(law), repeats=1)
    lines = {line.name: line for line in found.table}
    assert built(law).name in lines
    assert lines[built(law).name].status is not Status.UNTESTED
    assert found.findings or found.leftovers
    named = {f.name for f in found.findings} | {r.name for f in found.findings for r in f.rivals}
    assert not law.named or built(law).name in named
