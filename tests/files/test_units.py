"""The units that are known without pint are those that pint knows."""

from __future__ import annotations

import pytest

from qsframework import units


@pytest.mark.parametrize("unit", units._OFTEN)
def test_pint_says_the_same(unit: str) -> None:
    assert units.conversion(unit) == units._ask_pint(unit)
