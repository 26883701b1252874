"""YAML that is written is read back as the same numbers and words."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from qsframework.files import read_yaml, write_text, yaml_text

WORDS = st.text(st.characters(blacklist_categories=["Cs", "Cc"], whitelist_characters="\n\t"), max_size=30)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(10**15), 10**15) | st.booleans()
VALUES = st.recursive(WORDS | NUMBERS, lambda inner: st.lists(inner, max_size=3), max_leaves=5)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(WORDS, VALUES, min_size=1, max_size=4), WORDS)
def test_any_mapping_survives(tmp_path: Path, data: dict[str, object], comment: str) -> None:
    path = write_text(tmp_path / "a.yaml", yaml_text(data, comment))
    assert read_yaml(path).data == data


@pytest.mark.parametrize(
    "text", ["1e5", "010", "1:30", "2026-01-01", "yes", "null", "~", "- x", "# no", "", " ", "0x1F"]
)
def test_text_that_looks_like_something_else_stays_text(text: str, tmp_path: Path) -> None:
    found = read_yaml(write_text(tmp_path / "a.yaml", yaml_text({"a": text, "b": {"c": [text]}}))).data
    assert found == {"a": text, "b": {"c": [text]}}


def test_all_digits_of_a_number_survive(tmp_path: Path) -> None:
    values = [math.pi, 1e-16 / 3, -1.2e300, 5e-324, 0.1 + 0.2]
    assert read_yaml(write_text(tmp_path / "a.yaml", yaml_text({"a": values}))).data["a"] == values


def test_one_list_used_twice_is_written_twice(tmp_path: Path) -> None:
    row = [1, 2]
    path = write_text(tmp_path / "a.yaml", yaml_text({"a": row, "b": row}, "one\n\n two\x85three"))
    assert read_yaml(path).data == {"a": row, "b": row}
    assert path.read_text().startswith("# one\n# two\n# three\n")
