"""Stiffnesses from 1e-9 to 1e9, of what is usual and in SI: right limits, or an error that says so."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numerics import campaign, few, poses

from qsframework.elastostatics import cartesian_compliance, make_model
from qsframework.elastostatics.model import Model
from qsframework.errors import NotConverged, QsfError
from qsframework.plugin import Array, Effect, ParallelSpring, Parameter, Spring, SpringLaw, build_effects
from qsframework.plugin.registry import registry

ENTRIES: tuple[dict[str, Any], ...] = (
    {"effect": "gravity_compensator", "joint": "joint_3", "lc_m": 0.3, "l2_m": 0.9},
    {"effect": "compensator_stiffness", "joint": "joint_3", "lc_m": 0.3, "l2_m": 0.9},
    {
        "effect": "point_spring",
        "first": "link_1",
        "first_x_m": 0.1,
        "first_y_m": 0.2,
        "first_z_m": 0.3,
        "second": "link_3",
        "second_x_m": 0.5,
        "second_y_m": 0.0,
        "second_z_m": 0.1,
    },
    {"effect": "joint_hardening", "joint": "joint_5", "knee_Nm": 500.0},
)


def _soft_effects() -> tuple[Effect, ...]:
    """Every built-in spring, law and parallel spring, at one place or two."""
    facts = campaign().robot.facts
    present = {e.name for e in campaign().robot.effects}
    out = {e.name: e for entry in ENTRIES for e in build_effects(entry, facts)}
    for cls in registry().values():
        if issubclass(cls, Spring | SpringLaw | ParallelSpring):
            found = [e for e in cls.places(facts, ("m1",)) if e.name not in present]
            out |= {e.name: e for e in (*found[:1], *found[-1:])}
    return tuple(out.values())


def _wide(effect: Effect) -> Model:
    model = campaign().model()
    markers = list(zip(model.marker_names, model.markers, strict=True))
    return make_model(model.facts, (*model.effects, effect), model.parameters, model.tip, markers, model.gravity)


def _stiffness(p: Parameter) -> bool:
    return p.null is not None and any(unit in p.unit for unit in ("N m)", "m/N", "N/m"))


@cache
def _cases() -> list[tuple[Effect, Parameter]]:
    return [(e, p) for e in _soft_effects() for p in e.parameters(campaign().robot.facts) if _stiffness(p)]


def _at(model: Model, name: str, value: float) -> Array:
    x = model.nominal
    x[model.index([name])] = value
    return x


def test_every_kind_of_spring_is_among_the_cases() -> None:
    kinds = {type(e) for e, _ in _cases()}
    assert len(kinds) >= 5
    assert {p.unit for _, p in _cases()} >= {"rad/(N m)", "m/N", "rad/(N m)^3", "N/m"}


@pytest.mark.parametrize(("linear", "rounding"), [(True, 1e-17), (False, 2e-15)])
def test_a_spring_vanishes_at_a_billionth_of_its_usual_size(linear: bool, rounding: float) -> None:
    """In proportion: a millionth does a millionth of what the usual size does, 1e-9 of it next to nothing.

    What is settled is a difference of positions of metres.
    """
    batch = replace(poses(campaign(), 5), wrench=np.tile([800.0, 1500.0, -4000.0, 200.0, 300.0, 100.0], (5, 1)))
    for effect, p in _cases():
        model = _wide(effect)
        assert p.null is not None
        nothing = model.predict(batch, _at(model, p.name, p.null), linear)

        def does(share: float, model: Model = model, p: Parameter = p, nothing: Array = nothing) -> float:
            return float(np.abs(model.predict(batch, _at(model, p.name, p.typical * share), linear) - nothing).max())

        assert does(1.0) > 0.0, p.name
        assert does(1e-6) == pytest.approx(1e-6 * does(1.0), rel=0.5, abs=rounding), p.name
        assert does(1e-9) <= 2e-9 * does(1.0) + rounding, p.name
        assert np.isfinite(model.sensitivity(batch, _at(model, p.name, p.typical * 1e-9), linear=linear)).all(), p.name


def test_any_size_is_finite_or_refused() -> None:
    batch, answered = poses(campaign(), 1), 0
    for effect, p in _cases():
        model = _wide(effect)
        for size in (1e-9, 1e9, 1e-9 * p.typical, 1e9 * p.typical):
            x = _at(model, p.name, size)
            for compute in (model.predict, model.sensitivity, partial(cartesian_compliance, model)):
                with contextlib.suppress(QsfError):  # numpy's warnings are errors here: nothing else gets through
                    values = compute(batch, x)
                    assert np.isfinite(values).all(), (p.name, size)
                    answered += 1
    assert answered > 8 * len(_cases())


@few(10)
@given(joint=st.integers(1, 6), power=st.floats(-4.0, 9.0))
def test_an_equilibrium_is_never_a_turn_away(joint: int, power: float) -> None:
    """A compliance far too large: no number that only looks settled."""
    model, batch = campaign().model(), poses(campaign(), 4)
    x = _at(model, f"joint_compliance[joint_{joint}]", 10.0**power)
    moved = None
    with contextlib.suppress(NotConverged):
        moved = np.abs(model.predict(batch, x)).max()
    assert moved is None or (power < -1.0 and 1e-3 < moved < 6.0)


def test_a_compliance_of_1e9_is_refused_and_not_settled_by_rounding() -> None:
    model, batch = campaign().model(), poses(campaign(), 2)
    with pytest.raises(NotConverged, match=r"no elastic arm gives so far: joint_compliance.joint_1.*units|settle"):
        model.predict(batch, _at(model, "joint_compliance[joint_1]", 1e9))


def test_rigid_gears_leave_the_rest() -> None:
    """All gears at 1e-9 of their compliance: a billionth of the deflection; at none: nothing at all."""
    model, batch = campaign().model(), poses(campaign(), 6)
    x = model.nominal
    gears = model.index([n for n in model.names if n.startswith("joint_compliance")])
    usual = np.abs(model.predict(batch, x)).max()
    x[gears] *= 1e-9
    assert np.abs(model.predict(batch, x)).max() == pytest.approx(1e-9 * usual, rel=0.02)
    x[gears] = 0.0
    assert np.abs(model.predict(batch, x)).max() == 0.0
    assert np.abs(model.predict(batch, x)).max() < 1e-15


@pytest.mark.parametrize("stiffness", [1e12, 1e15])
def test_a_balancer_without_end_locks_its_joint(stiffness: float) -> None:
    """K_eq to infinity: joint 2 does not turn, as with no compliance."""
    model, batch = campaign().model(), poses(campaign(), 6)
    locked = model.predict(batch, _at(model, "compensator_stiffness[joint_2].stiffness", stiffness))
    rigid = model.predict(batch, _at(model, "joint_compliance[joint_2]", 0.0))
    eta = 7e6 / (0.02 * stiffness)
    np.testing.assert_allclose(locked, rigid, atol=max(20 * eta * np.abs(rigid).max(), 1e-15))


def test_stiffnesses_1e18_apart_in_one_arm() -> None:
    """In the linear model springs in series add up whatever their sizes: the sum of what each does alone."""
    model, batch = campaign().model(), poses(campaign(), 6)
    zero = model.nominal
    gears = model.index([n for n in model.names if n.startswith("joint_compliance")])
    zero[gears] = 0.0
    zero[model.index(["gravity_compensator[joint_2].stiffness"])] = 0.0
    sizes = 10.0 ** np.array([-16.0, -7.0, -13.0, -4.0, -10.0, -7.0])
    total = zero.copy()
    total[gears] = sizes
    alone = []
    for gear, size in zip(gears, sizes, strict=True):
        x = zero.copy()
        x[gear] = size
        alone.append(model.predict(batch, x, linear=True))
    np.testing.assert_allclose(model.predict(batch, total, linear=True), np.sum(alone, axis=0), rtol=1e-12, atol=1e-18)
