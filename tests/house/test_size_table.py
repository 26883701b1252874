"""What `make size` counts."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from size_table import CodeSize, python_size, sizes, table, text_size

MODULE = '''"""A module.

Of several lines.
"""

import os  # counted


class A:
    """A docstring."""

    # a comment
    name = """text
    that is code"""
    """Words of a field."""
'''


def test_blanks_comments_and_docstrings_are_no_code() -> None:
    found = python_size(MODULE)
    assert found == CodeSize(lines=4, characters=65, tokens=8, files=1)


def test_code_after_a_string_on_its_line_counts() -> None:
    assert python_size("x = 'a'\n").lines == 1
    assert python_size("").mean_line == 0.0


def test_every_line_of_a_template_that_is_not_blank() -> None:
    assert text_size("<p>\n\n  a b\n") == CodeSize(lines=2, characters=8, tokens=3, files=1)


def test_the_tree_is_counted() -> None:
    found = sizes()
    assert all(size.files for size in found.values())
    assert found["qsframework"].lines > 10_000
    assert "plotly" not in table(found)
