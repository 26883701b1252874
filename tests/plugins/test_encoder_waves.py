"""Errors of encoders that come several times per turn."""

from __future__ import annotations

import numpy as np
import pytest

from qsframework.errors import InputError
from qsframework.plugin import Context, Poses, build_effects, check_effect
from qsframework.robot import load_robot


def effect(waves):
    robot = load_robot("ur10")
    entry = {"effect": "encoder_eccentricity", "joint": "joint_2", "waves_per_turn": waves}
    return build_effects(entry, robot.facts)[0]


def test_waves_add_up():
    robot = load_robot("ur10")
    several = effect([1, 8, 17])
    names = [p.name.removeprefix("encoder_eccentricity[joint_2].") for p in several.parameters(robot.facts)]
    assert names == ["sin", "cos", "sin8", "cos8", "sin17", "cos17"]
    q = np.random.default_rng(0).uniform(-3, 3, (9, 6))
    x = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) * 1e-4
    found = several.errors(x, Context(robot.facts, Poses(q, q, np.zeros((9, 6)))))
    a = q[:, 1]
    expected = 1e-4 * (
        np.sin(a) + 2 * np.cos(a) + 3 * np.sin(8 * a) + 4 * np.cos(8 * a) + 5 * np.sin(17 * a) + 6 * np.cos(17 * a)
    )
    np.testing.assert_allclose(found.angles[:, 1], expected, atol=1e-18)
    assert not np.delete(found.angles, 1, axis=1).any()


def test_it_is_an_effect_like_any_other():
    check_effect(effect([1, 17]), load_robot("ur10").facts)
    assert hash(effect([1, 17])) == hash(effect([1, 17]))


@pytest.mark.parametrize("waves", [[], [0], [1, 1], [1.5], [True], 17, "17", [10**6], [None], {}])
def test_bad_waves_are_refused(waves):
    with pytest.raises(InputError, match=r"waves_per_turn must be a list of whole numbers .* such as \[1, 17\]"):
        effect(waves)
