"""Shared by the tests of bad input: good files of every format, made once."""

from __future__ import annotations

import fuzzing
import pytest


@pytest.fixture(scope="session")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[fuzzing.Good]]:
    """Good files by format; `fuzzing.try_file` spoils one and puts it back."""
    return fuzzing.corpus(tmp_path_factory.mktemp("fuzz"))
