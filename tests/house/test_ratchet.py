"""No count of what a reader must hold in mind exceeds its bound, and what has fallen is written down."""

from __future__ import annotations

import pytest
import sheet


def test_counts_of_the_tree() -> None:
    assert not sheet.complaints(sheet.static_counts())


@pytest.mark.parametrize("name", sheet.WALKS)
def test_what_a_command_enters(name: str) -> None:
    assert not sheet.complaints(sheet.walk_counts(name))
