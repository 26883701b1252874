"""The units that are known without pint are those that pint knows."""

from __future__ import annotations

import pytest

from qsframework import units


@pytest.mark.parametrize("unit", units._OFTEN)
def test_pint_says_the_same(unit: str) -> None:
    (factor, *rest), (asked, *others) = units.conversion(unit), units._ask_pint(unit)
    assert rest == others
    assert factor == pytest.approx(asked, rel=1e-15)


@pytest.mark.parametrize("unit", ["kgf", "kp", "daN", "lbf", "kN", "kg*m/s^2", "m*kg/s^2"])
def test_a_force_is_a_force_however_it_is_written(unit: str) -> None:
    assert units.same_dimension(unit, "N")
