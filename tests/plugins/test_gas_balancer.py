"""A gas balancer against the work of its gas, integrated numerically, and against a spring of the same slope."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from qsf_plugins.gas_balancer import AMBIENT, GasBalancer
from qsframework.plugin import Array, InputError, TorqueTerm, build_effects
from qsframework.plugin.check import sample_context, sample_robot

ROBOT = sample_robot()
ENTRY: dict[str, Any] = {
    "effect": "gas_balancer",
    "joint": "joint_2",
    "lc_mm": 235,
    "l2_m": 1.12,
    "length_mm": 885,
    "pressure_bar": 90,
    "volume_l": 12,
    "piston_area_cm^2": 60,
    "rod_area_cm^2": 12,
    "exponent": 1.2,
    "zero_deg": 10,
}
SIDES = {"rod side": 48e-4, "piston side": -60e-4, "both sides": -12e-4}
B = np.linspace(-2.2, 2.2, 9)


def balancer(**more: object) -> GasBalancer:
    (effect,) = build_effects({**ENTRY, **more}, ROBOT)
    assert isinstance(effect, GasBalancer)
    return effect


def values(effect: GasBalancer) -> Array:
    return np.array([p.nominal for p in effect.parameters(ROBOT)])


def torque(effect: GasBalancer, q: Array, x: Array) -> TorqueTerm:
    return effect.torque(q[:, None], x, sample_context(ROBOT))


def work(q: float, x: Mapping[str, float], area: float) -> float:
    """Energy of the gas and of the air outside at a joint angle: the integral of -(p - p_a) dV, step by step."""
    b = q + x["zero"]
    s = np.hypot(x["l2"] * np.cos(b) - x["lc"], x["l2"] * np.sin(b))
    end = x["volume"] - area * (s - 0.885)
    pressure = lambda V: (x["pressure"] + AMBIENT) * (x["volume"] / V) ** x["exponent"] - AMBIENT  # noqa: E731
    return -quad(pressure, x["volume"], end, epsabs=0.0, epsrel=1e-13)[0]


@pytest.mark.parametrize("gas", SIDES)
def test_the_torque_is_the_slope_of_the_gas_work(gas: str) -> None:
    """Virtual work: T = -dU/dq, on all three sides of the piston."""
    effect = balancer(gas=gas)
    x = {p.name.rsplit(".", 1)[1]: p.nominal for p in effect.parameters(ROBOT)}
    U = lambda q: np.array([work(v, x, SIDES[gas]) for v in q])  # noqa: E731
    h = 1e-3
    slope = (8 * (U(B + h) - U(B - h)) - (U(B + 2 * h) - U(B - 2 * h))) / (12 * h)
    found = torque(effect, B, values(effect))
    assert np.allclose(found.value[:, 0], -slope, rtol=1e-8, atol=1e-6 * np.abs(slope).max())
    bend = (-U(B + 2 * h) + 16 * U(B + h) - 30 * U(B) + 16 * U(B - h) - U(B - 2 * h)) / (12 * h * h)
    assert np.allclose(found.dq[:, 0, 0], -bend, rtol=1e-6, atol=1e-6 * np.abs(bend).max())


@pytest.mark.parametrize("gas", SIDES)
@pytest.mark.parametrize("i", range(6))
def test_each_parameter_moves_the_torque_as_it_moves_the_work(gas: str, i: int) -> None:
    effect = balancer(gas=gas)
    names = [p.name.rsplit(".", 1)[1] for p in effect.parameters(ROBOT)]
    assert names == ["pressure", "volume", "exponent", "lc", "l2", "zero"]
    x, size = values(effect), 1e-3 * np.array([1e7, 1e-2, 1.0, 0.2, 1.0, 1.0])[i]

    def moved(t: float) -> Array:
        at = dict(zip(names, x + t * size * np.eye(6)[i], strict=True))
        h = 1e-3
        U = lambda q: np.array([work(v, at, SIDES[gas]) for v in q])  # noqa: E731
        return -(8 * (U(B + h) - U(B - h)) - (U(B + 2 * h) - U(B - 2 * h))) / (12 * h)

    by_x = (8 * (moved(1) - moved(-1)) - (moved(2) - moved(-2))) / (12 * size)
    assert np.allclose(torque(effect, B, x).dx[:, 0, i], by_x, rtol=1e-5, atol=1e-6 * np.abs(by_x).max())


def test_gas_on_the_rods_side_balances_as_a_spring_does() -> None:
    """It pulls the pivots together; on the other side it pushes, and so turns the joint the other way."""
    q = np.array([0.5])
    pulls, pushes = (torque(e, q, values(e)).value[0, 0] for e in (balancer(), balancer(gas="piston side")))
    assert pulls < 0.0 < pushes


def test_a_large_volume_is_a_constant_pull() -> None:
    """Gas that hardly changes: F = A p at every length."""
    effect = balancer(volume_l=1e6)
    s = np.array([0.9, 1.2])
    x = values(effect)
    assert np.allclose(effect.pull(x[0], x[1], x[2])(s).value, 48e-4 * 90e5, rtol=1e-5)


def test_an_effects_name_in_a_fit_stands_for_the_pressure() -> None:
    assert [p.name for p in balancer().parameters(ROBOT) if not p.by_name] == ["gas_balancer[joint_2].pressure"]


def test_values_of_a_fit_that_leave_no_volume_are_refused() -> None:
    effect = balancer()
    x = values(effect)
    x[1] = 1e-3
    with pytest.raises(InputError, match=r"gas_balancer\[joint_2\]: the gas has no volume left at a length of 1.[0-9]"):
        torque(effect, B, x)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"gas": "oil side"}, "allowed: rod side, piston side, both sides"),
        ({"pressure_bar": 0}, "pressure must be above 0"),
        ({"volume_l": -3}, "volume must be above 0"),
        ({"exponent": 0}, "exponent must be above 0"),
        ({"length_mm": 0}, "length must be above 0"),
        ({"piston_area_cm^2": 10}, "area must be above the rod's"),
        ({"rod_area_cm^2": -1}, "area must be above the rod's"),
        ({"rod_area_cm^2": 0, "gas": "both sides"}, "pushes with the rod's area"),
        ({"lc_mm": 1120}, "lc and l2 must be above 0 and differ"),
        ({"pressure_mm": 3}, "does not end in a unit of Pa"),
        ({"label": "a b"}, "a label is letters"),
    ],
)
def test_what_no_balancer_can_be(wrong: dict[str, object], words: str) -> None:
    entry = {**ENTRY, **wrong}
    if "pressure_mm" in wrong:
        del entry["pressure_bar"]
    with pytest.raises(InputError) as error:
        build_effects(entry, ROBOT)
    assert words in str(error.value)
