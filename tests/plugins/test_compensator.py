"""The balancer's closed form against the energy of a spring between two points."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from qsf_plugins.spring_triangle import SpringTriangle
from qsframework.experiment.setup import expand_name
from qsframework.plugin import Array, InputError, TorqueTerm, build_effects
from qsframework.plugin.check import sample_context, sample_robot

LC, L2, S0, K = 0.235, 1.12, 0.70, 1.0e5
B = np.linspace(-2.5, 2.5, 41)
ROBOT = sample_robot()
ENTRY = {"effect": "gravity_compensator", "joint": "joint_2", "lc_m": LC, "l2_m": L2}


def energy(b: Array, x: tuple[float, ...] = (K, S0, LC, L2, 0.0)) -> Array:
    """K (s - s0)^2 / 2 of a spring from (lc, 0) to l2 (cos b, sin b): nothing but Pythagoras."""
    stiffness, free_length, lc, l2, zero = x
    s = np.hypot(l2 * np.cos(b + zero) - lc, l2 * np.sin(b + zero))
    return 0.5 * stiffness * (s - free_length) ** 2


def slope(function: Callable[[Array], Array], b: Array, h: float = 1e-4) -> Array:
    return (8 * (function(b + h) - function(b - h)) - (function(b + 2 * h) - function(b - 2 * h))) / (12 * h)


def compensator(free_length: float = S0, **more: float) -> Callable[[Array], TorqueTerm]:
    """The effect's own torque by the joint's angle."""
    (effect,) = build_effects({**ENTRY, **more}, ROBOT)
    x = np.array([p.nominal for p in effect.parameters(ROBOT)])
    x[:2] = K, free_length
    return lambda b: effect.torque(b[:, None], x, sample_context(ROBOT))  # type: ignore[attr-defined]


def test_moment_is_the_slope_of_the_energy() -> None:
    assert np.allclose(-compensator()(B).value[:, 0], slope(energy, B), rtol=1e-8, atol=1e-4)


def test_moment_is_equation_9() -> None:
    s = SpringTriangle(LC, L2).length(B)
    assert np.allclose(-compensator()(B).value[:, 0], K * LC * L2 * (1.0 - S0 / s) * np.sin(B), rtol=1e-12, atol=1e-9)


def test_eta_is_the_slope_of_the_moment() -> None:
    """Equation (11) with sin^2; as printed, with sin, it is off by several percent."""
    eta = -compensator()(B).dq[:, 0, 0] / K
    numeric = slope(lambda b: -compensator()(b).value[:, 0] / K, B)
    assert np.allclose(eta, numeric, rtol=1e-9, atol=1e-10)
    s = SpringTriangle(LC, L2).length(B)
    equation_11 = LC * L2 * (np.cos(B) + S0 * LC * L2 / s**3 * np.sin(B) ** 2 - S0 / s * np.cos(B))
    assert np.allclose(eta, equation_11, rtol=1e-12, atol=1e-12)
    printed = LC * L2 * (np.cos(B) + S0 * LC * L2 / s**3 * np.sin(B) - S0 / s * np.cos(B))
    assert np.abs(printed - numeric).max() > 0.05 * np.abs(numeric).max()


@pytest.mark.parametrize("free_length", [0.3, 0.7, 1.2])
def test_slopes_of_eta(free_length: float) -> None:
    law, h = compensator(free_length), 1e-5
    term = law(B)
    assert term.dqq is not None
    assert term.dqx is not None
    assert np.allclose(term.dqq[:, 0, 0, 0], slope(lambda b: law(b).dq[:, 0, 0], B), rtol=1e-7, atol=1e-3)
    by_length = (compensator(free_length + h)(B).dq - compensator(free_length - h)(B).dq)[:, 0, 0] / (2 * h)
    assert np.allclose(term.dqx[:, 0, 0, 1], by_length, rtol=1e-7, atol=1e-3)


@pytest.mark.parametrize("i", range(5))
def test_each_parameter_moves_the_torque_as_it_moves_the_energys_slope(i: int) -> None:
    """Stiffness, free length, lc, l2 and zero: both the torque and its slope, by differences of the energy alone."""
    (effect,) = build_effects({**ENTRY, "zero_deg": 20}, ROBOT)
    x = np.array([K, S0, LC, L2, np.deg2rad(20.0)])
    assert [p.name for p in effect.parameters(ROBOT)] == [
        f"gravity_compensator[joint_2].{n}" for n in ("stiffness", "free_length", "lc", "l2", "zero")
    ]
    term = effect.torque(B[:, None], x, sample_context(ROBOT))  # type: ignore[attr-defined]
    size = np.array([1e3, 1e-3, 1e-3, 1e-3, 1e-3])[i]

    def moved(t: float) -> Array:
        at = tuple(x + t * size * np.eye(5)[i])
        return -slope(lambda b: energy(b, at), B, 1e-3)

    by_x = (8 * (moved(1) - moved(-1)) - (moved(2) - moved(-2))) / (12 * size)
    assert np.allclose(term.dx[:, 0, i], by_x, rtol=1e-6, atol=1e-7 * np.abs(by_x).max())

    def bent(t: float) -> Array:
        at = tuple(x + t * size * np.eye(5)[i])
        h = 2e-3
        e = [energy(B + k * h, at) for k in (-2, -1, 0, 1, 2)]
        return -(-e[0] + 16 * e[1] - 30 * e[2] + 16 * e[3] - e[4]) / (12 * h * h)

    by_x = (8 * (bent(1) - bent(-1)) - (bent(2) - bent(-2))) / (12 * size)
    assert np.allclose(term.dqx[:, 0, 0, i], by_x, rtol=1e-5, atol=1e-5 * np.abs(by_x).max())


def test_the_geometry_has_its_nominal_value_from_the_spec_and_is_fitted_by_name_only() -> None:
    (effect,) = build_effects({**ENTRY, "zero_deg": 20}, ROBOT)
    own = effect.parameters(ROBOT)
    assert [p.nominal for p in own[2:]] == [LC, L2, np.deg2rad(20.0)]
    assert [p.by_name for p in own] == [False, False, True, True, True]
    assert all(0.0 < p.typical < 0.05 for p in own[2:])


@pytest.mark.parametrize("entry", ["gravity_compensator", "gravity_compensator[joint_2]"])
def test_the_effects_name_in_a_fit_stands_for_the_spring_alone(entry: str, m900ib: object) -> None:
    model = m900ib.model()  # type: ignore[attr-defined]
    assert expand_name(entry, model) == tuple(f"gravity_compensator[joint_2].{n}" for n in ("stiffness", "free_length"))
    for name in ("lc", "l2", "zero"):
        assert expand_name(f"gravity_compensator[joint_2].{name}", model) == (f"gravity_compensator[joint_2].{name}",)


LABELLED = ("gravity_compensator", "compensator_stiffness", "compensator_friction", "point_spring")


@pytest.mark.parametrize("name", LABELLED)
def test_a_label_is_part_of_the_name(name: str) -> None:
    entry = {
        "compensator_friction": {**ENTRY, "spring_stiffness_N/m": K, "free_length_m": S0},
        "point_spring": {f"{e}_{a}_m": 0.1 for e in ("first", "second") for a in "xyz"}
        | {"first": "link_1", "second": "link_2"},
    }.get(name, ENTRY) | {"effect": name}
    (plain,), (left,) = build_effects(entry, ROBOT), build_effects({**entry, "label": "left"}, ROBOT)
    where = plain.name.removeprefix(f"{name}[").removesuffix("]")
    assert left.name == f"{name}[{where}/left]"
    assert [p.name for p in left.parameters(ROBOT)] == [
        p.name.replace(f"[{where}]", f"[{where}/left]") for p in plain.parameters(ROBOT)
    ]
    for wrong in ("left side", "a/b", "x]"):
        with pytest.raises(InputError, match="a label is letters, digits, _ and -"):
            build_effects({**entry, "label": wrong}, ROBOT)


def test_friction_is_proposed_for_each_of_two_balancers_with_their_own_geometry() -> None:
    from qsf_plugins.compensator_friction import CompensatorFriction

    effects = [e for label in ("left", "right") for e in build_effects({**ENTRY, "label": label}, ROBOT)]
    values = {"stiffness": K, "lc": 0.25}
    parameters = [
        dataclasses.replace(p, nominal=values.get(p.name.rsplit(".", 1)[1], p.nominal))
        for e in effects
        for p in e.parameters(ROBOT)
    ]
    found = CompensatorFriction.beside(effects, parameters)
    assert [e.name for e in found] == [f"compensator_friction[joint_2/{s}]" for s in ("left", "right")]
    assert all((e.lc, e.l2, e.spring_stiffness) == (0.25, L2, K) for e in found)
