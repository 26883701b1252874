"""A few of the kills, spoilt files and races of which `benchmarks/kills.py --days` runs hundreds."""

from __future__ import annotations

from pathlib import Path

import day_harm as harm
import pytest

from qsframework.experiment import Experiment


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path / "place"


def test_a_watched_day_that_is_killed_goes_on(place: Path) -> None:
    one = harm.watched(place)
    assert [harm.kill_watched(one, share)[1] for share in (0.55, 0.8, 0.95)] == [[], [], []]


def test_a_day_by_the_page_that_is_killed_goes_on(place: Path) -> None:
    assert harm.kill_paged(place, 1, 3) == (3, [])


def test_two_writers_fill_no_state_that_they_did_not_name(m900ib: Experiment, place: Path) -> None:
    assert harm.two_writers(m900ib, place, 1) == (24, [])


def test_spoilt_bytes_cost_no_whole_record(place: Path) -> None:
    one = harm.spoilt(place)
    assert [harm.spoil_journal(one, seed) for seed in range(15)] == [[]] * 15
    assert [harm.spoil_table(one, seed) for seed in range(5)] == [[]] * 5
