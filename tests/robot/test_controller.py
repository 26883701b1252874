"""The map from the pendant's angles to the URDF's, its inverse and its limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from qsframework.errors import InputError
from qsframework.robot import load_robot
from qsframework.robot.controller import Drive, parse_expression

EXPRESSIONS = {
    "J3": ([0, 0, 1, 0], 0),
    "J3 + J2": ([0, 1, 1, 0], 0),
    "-J4": ([0, 0, 0, -1], 0),
    " - J1+2*J3 - 0.5 J2 ": ([-1, -0.5, 2, 0], 0),
    "J2 + 90 deg": ([0, 1, 0, 0], np.pi / 2),
    "J2 - 1.5 rad": ([0, 1, 0, 0], -1.5),
    "90deg-J1": ([-1, 0, 0, 0], np.pi / 2),
    "J1 + J1": ([2, 0, 0, 0], 0),
}


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_expressions(text):
    row, constant = parse_expression(text, [False] * 4)
    assert row.tolist() == EXPRESSIONS[text][0]
    assert constant == pytest.approx(EXPRESSIONS[text][1])


@pytest.mark.parametrize(
    "text",
    [
        "",
        "90 deg",
        "J5",
        "J0",
        "J2 J3",
        "J2 +",
        "+",
        "J2 * J3",
        "sin(J2)",
        "J2 + 90",
        "deg",
        "j2",
        "J2^2",
        "J2 + +",
        "1e",
        "J2 - J2",
        "__import__('os')",
        "J2\nJ3",
        "٣*J2",
        "J2 + 9" + "9" * 400 + " deg",
    ],
)
def test_wrong_expressions_say_what_is_allowed(text):
    with pytest.raises(InputError, match=r"J|its number"):
        parse_expression(text, [False] * 4)


@given(st.text(alphabet="J0123456789+-*. degrad", max_size=20))
def test_any_text_gives_numbers_or_an_input_error(text):
    try:
        row, constant = parse_expression(text, [False] * 3)
    except InputError:
        return
    assert np.isfinite(row).all()
    assert np.isfinite(constant)


def test_map_and_inverse():
    controller = load_robot("fanuc_m900ib").controller
    pendant = np.random.default_rng(1).uniform(-2, 2, (50, 6))
    q = controller.to_joints(pendant)
    expected = pendant.copy()
    expected[:, 2] += pendant[:, 1]
    np.testing.assert_allclose(q, expected, atol=1e-15)
    np.testing.assert_allclose(controller.to_pendant(q), pendant, atol=1e-14)


def test_map_with_offsets(small):
    small.edit("robot.yaml", ("J2 + J1", "-J2 + 0.5 J1 + 30 deg"))
    controller = small.load().controller
    q = controller.to_joints(np.array([[0.4, 0.1]]))
    np.testing.assert_allclose(q, [[0.4, -0.1 + 0.2 + np.pi / 6]])
    np.testing.assert_allclose(controller.to_pendant(q), [[0.4, 0.1]])


def test_limits_hold_for_the_pendant_with_a_tolerance():
    controller = load_robot("fanuc_m900ib").controller
    assert np.rad2deg(controller.tolerance) == pytest.approx(0.01)
    pendant = np.deg2rad([[0, 90, 30, 0, 0, 0], [180.009, 0, 0, 0, 0, 0], [180.02, -64.02, 30.02, 0, -122.1, np.nan]])
    outside = controller.outside(pendant)
    assert not outside[:2].any()
    assert outside[2].tolist() == [True, True, True, False, True, True]


def test_what_is_stated_of_the_drives(small):
    """An external axis, a motor's ratio and its encoder's counts; nothing where nothing is stated."""
    assert small.load().controller.external == ()
    small.edit(
        "robot.yaml", ("limits_deg: [", "motor_ratio: -121.5, counts_per_turn: 4096, external: true, limits_deg: [")
    )
    controller = small.load().controller
    assert (controller.external, controller.drives[0]) == ((0,), Drive(True, -121.5, 4096.0))
    small.edit("robot.yaml", ("motor_ratio: -121.5", "motor_ratio: 0"))
    with pytest.raises(InputError, match=r"robot.yaml, line \d+: \w+: motor_ratio must not be zero; found 0"):
        small.load()


def test_arrays_are_read_only():
    controller = load_robot("fanuc_m900ib").controller
    for array in (controller.matrix, controller.offset, controller.lower, controller.upper):
        assert not array.flags.writeable
