"""Spoiled files of every format: a sound value or a refusal that says what is wrong, never anything else.

The long run of the same is `benchmarks/fuzz.py`; its record stands in docs/results.md.
"""

from __future__ import annotations

from pathlib import Path

import fuzzing
import pytest

REGRESSIONS = Path(__file__).parent / "regressions"
COUNTS = {
    "robot.yaml": 90,
    "nominal.yaml": 70,
    "URDF": 120,
    "xacro": 40,
    "a stranger's URDF": 40,
    "a stranger's table": 40,
    "experiment.yaml": 150,
    "plan.csv": 200,
    "plan.json": 150,
    "readings.csv": 200,
    "states.csv": 60,
    "targets.csv": 80,
    "fit.json": 150,
    "task.yaml": 120,
    "controller programmes": 200,
}
"""How many inputs of each format a test run tries."""


@pytest.mark.parametrize("name", COUNTS)
def test_no_spoiled_file_is_a_fault(corpus: dict[str, list[fuzzing.Good]], name: str) -> None:
    found = [fuzzing.try_seed(corpus[name], seed) for seed in range(COUNTS[name])]
    faults = {seed: f.words for seed, f in enumerate(found) if f.outcome is fuzzing.Outcome.FAULT}
    assert not faults, "\n".join(f"seed {seed}: {words}" for seed, words in faults.items())
    outcomes = {f.outcome for f in found}
    assert outcomes == {fuzzing.Outcome.VALUE, fuzzing.Outcome.REFUSED}, "the spoiling is too hard or too soft"


def test_all_formats_are_tried(corpus: dict[str, list[fuzzing.Good]]) -> None:
    assert corpus.keys() == COUNTS.keys()
    assert sum(COUNTS.values()) >= 1500


def test_a_seed_is_one_input(corpus: dict[str, list[fuzzing.Good]]) -> None:
    for goods in corpus.values():
        assert fuzzing.spoiled(goods, 5) == fuzzing.spoiled(goods, 5)
    assert len({fuzzing.spoiled(corpus["URDF"], seed)[1] for seed in range(50)}) > 45
