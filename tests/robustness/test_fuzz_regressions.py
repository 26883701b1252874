"""Spoiled files that once ended in a traceback, a warning, a hang or a number from garbage.

A file's name says its format, the good file whose place it takes (fuzzing.py), and what is wrong with it.
"""

from __future__ import annotations

from pathlib import Path

import fuzzing
import pytest

FILES = sorted((Path(__file__).parent / "regressions").iterdir())
TAKEN = {"no_springs"}
"""What is sound after all; everything else is refused."""


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_what_was_a_fault_is_none(corpus: dict[str, list[fuzzing.Good]], file: Path) -> None:
    kind, label, what = file.stem.split("--")
    good = next(g for g in corpus[kind] if g.label == label and g.path.suffix == file.suffix)
    assert file.read_bytes() != good.content
    found = fuzzing.try_file(good, file.read_bytes())
    expected = fuzzing.Outcome.VALUE if what in TAKEN else fuzzing.Outcome.REFUSED
    assert found.outcome is expected, found.words
    assert found.seconds < 2.0


def test_a_reader_that_fails_fails_the_fuzzing(
    corpus: dict[str, list[fuzzing.Good]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one reader broken on purpose, the seeds of the fuzzing find it."""

    def broken(*_: object) -> object:
        raise KeyError("broken on purpose")

    monkeypatch.setattr("qsframework.robot.loader.read_controller", broken)
    found = [fuzzing.try_seed(corpus["URDF"], seed) for seed in range(30)]
    assert any(f.outcome is fuzzing.Outcome.FAULT and "broken on purpose" in f.words for f in found)
