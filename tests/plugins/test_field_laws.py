"""Every law that the field knows, through the protocol, a simulation, a design, a fit and a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import pytest

from qsframework.diagnoses import diagnose
from qsframework.diagnoses.result import Status
from qsframework.elastostatics import Site, make_model
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Frame, Readings, make_plan, simulate
from qsframework.experiment.simulate import displaced
from qsframework.fits import identify
from qsframework.plans import DesignOptions, design
from qsframework.plugin import (
    Array,
    Conditions,
    Context,
    Effect,
    InputError,
    ParallelSpring,
    Poses,
    Reading,
    Sensor,
    SpringLaw,
    build_effects,
    check_effect,
    laws,
)
from qsframework.plugin.check import sample_robot
from tests.diagnose.cases import SIGMA, campaign, poses
from tests.identify.arm import position_readings, settled


@dataclass(frozen=True)
class Law:
    """An entry of `effects`, how large it is hidden (natural sizes), and what shows it.

    read: "displacements" or "positions"; without: parameters that these readings cannot tell; count: of poses
    """

    entry: Mapping[str, object]
    size: float = 3.0
    read: str = "displacements"
    without: tuple[str, ...] = field(default=())
    count: int = 18

    def __str__(self) -> str:
        return str(self.entry["effect"])


LAWS = (
    Law({"effect": "gear_flank", "joint": "joint_5"}, 1.0),
    Law({"effect": "gear_waves", "joint": "joint_3"}, 0.3),
    Law({"effect": "gear_friction", "joint": "joint_3"}, 1.0),
    Law({"effect": "link_growth", "link": "link_2"}, 1.5, without=("drift",)),
    Law({"effect": "link_bending", "link": "link_3", "across": "v"}, 18.0),
    Law({"effect": "hose", "link": "link_6", "from_z_m": 4.5}, 5.0, "positions"),
    Law({"effect": "base_lift", "direction": "ry"}, 1.5, count=24),
    Law({"effect": "marker_offset_loaded", "marker": "m2"}, 1.0),
    Law({"effect": "gear_ratio", "joint": "joint_2"}, 0.5, "positions"),
    Law({"effect": "marker_offset_after", "marker": "m2", "percent": "50"}, 0.5, "positions"),
    Law({"effect": "tracker_move", "percent": "50"}, 0.3, "positions"),
    Law({"effect": "reading_drift"}, 1.0, "positions"),
)
every_law = pytest.mark.parametrize("law", LAWS, ids=str)
ONE_OF_EACH = ("gear_friction", "link_bending", "hose", "base_lift", "marker_offset_loaded", "gear_ratio")


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
    count = law.count
    rng = np.random.default_rng(5)
    wide, truth = hidden(law)
    model = wide.model()
    x = model.nominal
    x[model.index(list(truth))] = list(truth.values())
    at = poses(3, count)
    if law.read == "displacements":
        at = replace(at, unloaded=conditions(count, 1), loaded=conditions(count, 2))
        moved = model.predict(at, x, linear)
        moved = moved + SIGMA * rng.standard_normal(moved.shape)
        return displaced(at, moved, SIGMA, [f"p{i}" for i in range(count)])
    loaded = np.arange(2 * count) % 2 == 1
    at = at.take(np.arange(2 * count) // 2)
    both = conditions(2 * count)
    at = replace(at, unloaded=both, loaded=both)
    seen = settled(model, at, loaded, x)
    seen = seen + SIGMA * rng.standard_normal(seen.shape)
    readings = position_readings(at, loaded, seen, SIGMA, pose=[f"p{i // 2}" for i in range(2 * count)])
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
    plan = design(wide, 8, candidates=60, seed=1, options=DesignOptions(criterion="D", polish=False))
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


@pytest.mark.parametrize("law", [law for law in LAWS if str(law) in ONE_OF_EACH], ids=str)
def test_a_diagnosis_names_it(law: Law) -> None:
    """One law of each kind: of a drive, a link, a hose, the base, a marker, the geometry. All others are tried."""
    found = diagnose(based(), measured(law), repeats=1)
    lines = {line.name: line for line in found.table}
    for tried in LAWS:
        if law.read == tried.read or law.read == "positions":
            assert lines[built(tried).name].status is not Status.UNTESTED, tried
    assert built(law).name in {f.name for f in found.findings} | {
        r.name for f in found.findings for r in f.alternatives
    }


ROBOT = sample_robot()
TORQUES = np.array([-5e4, -2e3, 0.0, 2e3, 5e4])[:, None]


def bent(entry: str, x: Array, torque: Array, at: Context, **more: object) -> Array:
    (effect,) = build_effects({"effect": entry, **more}, ROBOT)
    assert isinstance(effect, SpringLaw)
    return laws.extra(effect, torque, x, at).value


def still(loaded: bool = True, side: float = 1.0) -> Context:
    alike = Conditions(approach=np.full(5, side))
    q = np.tile(np.linspace(-1, 1, 5)[:, None], (1, 6))
    return Context(ROBOT, Poses(q, q, np.zeros((5, 6)), alike, alike), loaded)


def test_a_flank_gives_under_torques_of_one_sign() -> None:
    found = bent("gear_flank", np.array([1e-7]), TORQUES, still(), joint="joint_2", width_Nm=50)[:, 0]
    assert np.allclose(found, [-2.5e-6, -2.5e-6, 0.0, 2e-4, 5e-3], rtol=0.02, atol=1e-7)


def test_waves_follow_the_angle() -> None:
    found = bent("gear_waves", np.array([1e-7, 2e-7]), TORQUES, still(), joint="joint_3", waves_per_turn=2)
    q = np.linspace(-1, 1, 5)
    assert np.allclose(found[:, 0], (1e-7 * np.sin(2 * q) + 2e-7 * np.cos(2 * q)) * TORQUES[:, 0])


def test_friction_sticks_by_the_side_and_slips_under_a_load() -> None:
    width = np.array([1e-4])
    for side in (-1.0, 1.0):
        stuck = bent("gear_friction", width, TORQUES, still(False, side), joint="joint_2", slip_Nm=3e3)[:, 0]
        assert np.allclose(stuck, -1e-4 * side)
        slipped = bent("gear_friction", width, TORQUES, still(True, side), joint="joint_2", slip_Nm=3e3)[:, 0]
        assert np.allclose(slipped[[0, 4]], [1e-4, -1e-4], rtol=0.02), "whatever the side"
        assert slipped[2] == pytest.approx(-1e-4 * side)


def test_a_base_lifts_beyond_its_preload_on_one_side() -> None:
    found = bent("base_lift", np.array([1e-8, 0.0]), TORQUES, still(), direction="ry", preload_Nm=1e4)[:, 0]
    assert np.allclose(found, [0.0, 0.0, 0.0, 0.0, 4e-4], rtol=0.01, atol=3e-6)


def test_a_link_bends_as_a_beam_does() -> None:
    """End shift F L^3 / (3 E I) + M L^2 / (2 E I) and turn F L^2 / (2 E I) + M L / (E I), c = L / (2 E I)."""
    (effect,) = build_effects({"effect": "link_bending", "link": "link_2", "across": "u"}, ROBOT)
    c, L = 1e-7, 1.1
    own = [replace(p, nominal=c) for p in effect.parameters(ROBOT)]
    # link 2 stands along z at zero angles: "u" lies along the base's y or x
    axis = effect.virtual_joints(ROBOT)[1].axis  # type: ignore[attr-defined]
    side = np.cross(axis, [0.0, 0.0, 1.0])
    beyond = 0.5
    sites = [("end", Site(2, np.array([0.0, 0.0, L]))), ("beyond", Site(2, np.array([0.0, 0.0, L + beyond])))]
    model = make_model(ROBOT, [effect], own, Site(2, np.array([0.0, 0.0, L])), sites, np.zeros(3))
    for force, moment in ((1e3, 0.0), (0.0, 1e3)):
        wrench = np.concatenate([force * side, moment * np.asarray(axis)])[None]
        end, farther = model.predict(Poses(np.zeros((1, 6)), np.zeros((1, 6)), wrench), linear=True)[0] @ side
        assert end == pytest.approx(2.0 * c * (force * L**2 / 3.0 + moment * L / 2.0), rel=1e-9)
        assert (farther - end) / beyond == pytest.approx(2.0 * c * (force * L / 2.0 + moment), rel=1e-9)


def test_a_slack_hose_does_not_pull_and_a_taut_one_does() -> None:
    (hose,) = build_effects({"effect": "hose", "link": "link_6", "from_z_m": 4, "length_m": 2}, ROBOT)
    assert isinstance(hose, ParallelSpring)
    found = laws.tension(hose, np.array([1.0, 1.5, 2.5, 4.0, 5.0]), np.array([100.0]), still()).value
    assert np.allclose(found, [0, 0, 50, 200, 300], atol=0.01)


def test_a_marker_and_a_tracker_move_from_a_reading_on() -> None:
    shares = Conditions(order=np.array([0.0, 0.2, 0.49, 0.5, 0.9]))
    context = still()
    context = replace(context, poses=replace(context.poses, loaded=shares))
    p, turned = np.ones((5, 2, 3)), np.tile(np.eye(3), (5, 2, 1, 1))
    reading = Reading(p, turned, ("m1", "m2"))
    after = np.array([0, 0, 0, 1, 1.0])[:, None]
    marker, tracker, drift = (
        build_effects({"effect": name, **more}, ROBOT, ("m1", "m2"))[0]
        for name, more in (("marker_offset_after", {"marker": "m2"}), ("tracker_move", {}), ("reading_drift", {}))
    )
    x = np.array([1e-3, 2e-3, 3e-3])
    assert isinstance(marker, Sensor)
    assert isinstance(tracker, Sensor)
    assert isinstance(drift, Sensor)
    moved = laws.seen(marker, reading, x, context) - p
    assert np.array_equal(moved[:, 0], np.zeros((5, 3)))
    assert np.allclose(moved[:, 1], after * x)
    moved = laws.seen(tracker, reading, np.concatenate([x, np.zeros(3)]), context) - p
    assert np.allclose(moved, (after * x)[:, None, :])
    assert np.allclose(laws.seen(drift, reading, x, context) - p, context.order[:, None, None] * x)


@pytest.mark.parametrize(
    "entry",
    [
        {"effect": "gear_flank", "joint": "joint_2", "width_Nm": -1},
        {"effect": "base_lift", "direction": "x"},
        {"effect": "gear_waves", "joint": "joint_2", "waves_per_turn": 0},
        {"effect": "link_growth", "link": "link_6"},
        {"effect": "gear_friction", "joint": "joint_2", "slip_Nm": -1},
        {"effect": "tracker_move", "percent": "half"},
        {"effect": "hose", "link": "link_6", "from_z_m": 3, "length_m": -1},
        {"effect": "link_bending", "link": "link_2", "across": "w"},
        {"effect": "marker_offset_after", "marker": "m1", "percent": "100"},
    ],
    ids=lambda entry: str(entry["effect"]),
)
def test_settings_that_make_no_sense_are_refused(entry: dict[str, object]) -> None:
    with pytest.raises(InputError, match=str(entry["effect"])):
        build_effects(entry, ROBOT, ("m1",))
