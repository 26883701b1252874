"""A reading is as expected, or the mistake has its name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import day_cell as cell
import numpy as np
import pytest

from qsf_day import Day, Slot, begin, decide, enter
from qsf_day.words import judged_words
from qsframework.experiment import Experiment


def test_of_756_clean_readings_hardly_one_is_to_be_looked_at(m900ib: Experiment, tmp_path: Path) -> None:
    """Arms with other springs, angles 0.03 deg off, a tool 1 mm off: 7 days of 36 states of 3 markers.

    Were one state in 25 accused, more than two of them would be in 99 of 100 such weeks; benchmarks/clean_days.py plays
    20 days and more.
    """
    said = [judged for seed in range(7) for judged in cell.play(m900ib, tmp_path / str(seed), seed)]
    assert 3 * len(said) == 756
    assert sum(judged.mistake is not None for judged in said) <= 0.01 * len(said)


KINDS: dict[str, tuple[cell.Explanation, int]] = {
    "markers": (cell.exchanged, 0),
    "sign": (cell.sign, 0),
    "unit": (cell.inches, 1),
    "angle": (cell.angle, 0),
    "load": (cell.ten_times, 1),
    "no load": (cell.no_load, 1),
    "pose": (cell.other_pose, 0),
    "decimal": (cell.decimal, 2),
    "marker": (cell.loose_nest, 1),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_mistake_has_its_name(m900ib: Experiment, tmp_path: Path, kind: str) -> None:
    """In the middle of a day and near its end, on two arms; nothing else is to be looked at."""
    wrong, state = KINDS[kind]
    for seed in (1, 2):
        said = cell.play(m900ib, tmp_path / str(seed), seed, {Slot(4, state): wrong, Slot(10, state): wrong})
        odd = [(j.slot, j.mistake.kind) for j in said if j.mistake is not None]
        assert odd == [(Slot(4, state), kind), (Slot(10, state), kind)]


def test_the_words_say_where_and_how_much(m900ib: Experiment, tmp_path: Path) -> None:
    day = begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT)
    arm, rng = cell.draw_arm(m900ib, 1)
    words: list[str] = []
    while len(words) < 13 and day.next is not None:
        slot = day.next
        xyz = arm.read(day, slot, rng) if len(words) < 12 else cell.angle(np.zeros(0), arm, day, slot)
        day, judged = enter(day, dict(zip(cell.MARKERS, xyz, strict=True)))
        words.append(judged_words(day, judged))
    assert all(w.endswith(": as expected.") for w in words[:12])
    assert "look again (the markers are" in words[12]
    assert "q3 is +2.0" in words[12]
    assert "(joint_3): look at the pendant." in words[12]


def test_a_tracker_that_was_moved_begins_a_new_series(m900ib: Experiment, tmp_path: Path) -> None:
    day = begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT)
    arm, rng = cell.draw_arm(m900ib, 5)
    kinds: list[str] = []
    while day.next is not None:
        slot = day.next
        if slot == Slot(5, 0):
            arm = arm.moved(np.array([0.04, -0.06, 0.02]))
        day, judged = enter(day, dict(zip(cell.MARKERS, arm.read(day, slot, rng), strict=True)))
        if judged.mistake is not None:
            kinds.append(judged.mistake.kind)
            day = decide(day, slot, "correct")
    assert kinds == ["tracker"]
    series = [row.series for row in day.record.rows]
    assert series == ["S1"] * 45 + ["S2"] * 63


def test_a_pose_visited_again_reads_what_it_read(m900ib: Experiment, tmp_path: Path) -> None:
    """A tracker that crept by a millimetre is seen where a pose comes again, long before the place alone would tell."""
    plan = cell.make_day_plan(m900ib, 6)
    again = replace(plan, repeats=(2,) * 6)
    for shift in (0.0, 1e-3):
        day = begin(m900ib, again, tmp_path / str(shift), replace(cell.SHORT, order="plan"))
        arm, rng = cell.draw_arm(m900ib, 8)
        odd: list[Slot] = []
        while day.next is not None:
            slot = day.next
            if slot == Slot(8, 0):
                arm = arm.moved(np.array([shift, 0.0, -shift]))
            day, judged = enter(day, dict(zip(cell.MARKERS, arm.read(day, slot, rng), strict=True)))
            if judged.mistake is not None:
                odd.append(slot)
                assert "from where they were at this pose before" in judged_words(day, judged)
                day = decide(day, slot, "keep")
        assert odd[:1] == ([Slot(8, 0)] if shift else [])


def test_marker_by_marker(m900ib: Experiment, tmp_path: Path) -> None:
    """A state may come in parts; what is there is judged, and a part that is wrong is named."""
    day = begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT)
    arm, rng = cell.draw_arm(m900ib, 6)
    for _ in range(9):
        assert day.next is not None
        slot = day.next
        for marker, xyz in zip(cell.MARKERS, arm.read(day, slot, rng), strict=True):
            assert day.next == slot
            day, judged = enter(day, {marker: xyz})
            assert judged.mistake is None
    assert day.next is not None
    xyz = arm.read(day, day.next, rng)
    day, judged = enter(day, {"m1": 1e-3 * xyz[0]})
    assert judged.mistake is not None
    assert judged.mistake.kind == "unit"
    assert day.next == judged.slot


def test_without_a_shape_or_a_frame_nothing_is_accused(m900ib: Experiment, tmp_path: Path) -> None:
    """One marker: no distances, and a frame only after some visits; clean readings stay clean."""
    one = m900ib.with_(markers=m900ib.markers[:1])
    day: Day = begin(one, cell.make_day_plan(one), tmp_path, cell.SHORT)
    arm, rng = cell.draw_arm(m900ib, 7)
    last = None
    while day.next is not None:
        slot = last = day.next
        day, judged = enter(day, {"m1": arm.read(day, slot, rng)[0]})
        assert judged.mistake is None
    assert last == Slot(11, 2)
