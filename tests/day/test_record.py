"""Nothing that was read is lost, and nothing that cannot be right is stored."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import day_cell as cell
import numpy as np
import pytest

from qsframework.applications.day import Day, Slot, begin, decide, enter
from qsframework.applications.day.entry import enter_file, enter_text, read_positions
from qsframework.applications.day.floor import enter_floor
from qsframework.applications.day.so_far import accepted, diagnosis_so_far, promised_sd, so_far
from qsframework.applications.protocol import ProtocolWish
from qsframework.design import design
from qsframework.errors import InputError
from qsframework.experiment import Experiment, read_readings
from qsframework.report.words.day import floor_words, so_far_words


def played(experiment: Experiment, folder: Path, states: int, seed: int = 1) -> tuple[Day, cell.Arm]:
    """A day after some states."""
    day = begin(experiment, cell.make_day_plan(experiment), folder, cell.SHORT)
    arm, rng = cell.draw_arm(experiment, seed)
    for _ in range(states):
        assert day.next is not None
        day, _ = enter(day, dict(zip(cell.MARKERS, arm.read(day, day.next, rng), strict=True)))
    return day, arm


def lines(xyz: np.ndarray) -> str:
    return "\n".join(f"{m} " + " ".join(f"{1e3 * v:.4f}" for v in p) for m, p in zip(cell.MARKERS, xyz, strict=True))


def test_the_table_is_the_ordinary_one(m900ib: Experiment, tmp_path: Path) -> None:
    day, _ = played(m900ib, tmp_path, 9)
    readings = read_readings(day.record.table, m900ib)
    assert len(readings) == 9  # three poses, each loaded minus unloaded, three markers
    assert readings.use.all()
    assert set(readings.kind) == {"displacement"}


def test_the_day_goes_on_where_it_was(m900ib: Experiment, tmp_path: Path) -> None:
    day, arm = played(m900ib, tmp_path, 8)
    again = begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT)
    assert again.next == day.next == Slot(2, 2)
    assert [(r.slot, r.marker) for r in again.record.rows] == [(r.slot, r.marker) for r in day.record.rows]
    assert np.allclose([r.xyz for r in again.record.rows], [r.xyz for r in day.record.rows], atol=1e-7)
    rng = np.random.default_rng(0)
    _, judged = enter(again, dict(zip(cell.MARKERS, arm.read(again, Slot(2, 2), rng), strict=True)))
    assert judged.mistake is None


def test_what_waits_for_a_decision_waits_after_a_restart(m900ib: Experiment, tmp_path: Path) -> None:
    day, arm = played(m900ib, tmp_path, 12)
    rng = np.random.default_rng(0)
    xyz = cell.exchanged(arm.read(day, Slot(4, 0), rng), arm, day, Slot(4, 0))
    day, _ = enter(day, dict(zip(cell.MARKERS, xyz, strict=True)))
    again = begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT)
    assert [m.kind for m in again.mistakes.values()] == ["markers"]
    again = decide(again, Slot(4, 0), "correct")
    assert np.allclose(again.record.at(Slot(4, 0))["m1"].xyz, xyz[1], atol=1e-7)
    assert not again.mistakes
    assert '"event": "corrected"' in (tmp_path / "day.jsonl").read_text()
    assert f"{1e3 * xyz[0, 0]:.3f}"[:-1] in (tmp_path / "day.jsonl").read_text()  # what stood there is kept


def test_half_a_line_goes_to_the_log(m900ib: Experiment, tmp_path: Path) -> None:
    """As a power cut leaves it; the whole readings before it are there."""
    day, _ = played(m900ib, tmp_path, 5)
    with day.record.table.open("ab") as file:
        file.write(b"p03,10,20,30,40,50,60,,,,,")
    again = begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT)
    assert len(again.record.rows) == 15
    assert "p03,10,20,30" in (tmp_path / "day.jsonl").read_text()


def test_a_full_disk_stores_nothing_and_says_so(
    m900ib: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    day, arm = played(m900ib, tmp_path, 4)
    before = day.record.table.read_bytes()
    sync = os.fsync

    def full(number: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    xyz = arm.read(day, Slot(1, 1), np.random.default_rng(0))
    with pytest.raises(InputError, match=r"is not stored: No space left on device\. Make room, then enter it again"):
        enter(day, dict(zip(cell.MARKERS, xyz, strict=True)))
    assert day.record.table.read_bytes() == before
    monkeypatch.setattr(os, "fsync", sync)
    day, judged = enter(day, dict(zip(cell.MARKERS, xyz, strict=True)))
    assert judged.mistake is None
    assert len(day.record.rows) == 15


def test_a_table_that_was_edited_meanwhile_is_read_again(m900ib: Experiment, tmp_path: Path) -> None:
    day, arm = played(m900ib, tmp_path, 7)
    text = day.record.table.read_text().splitlines(keepends=True)
    day.record.table.write_text("".join(text[:-3]))  # somebody deletes the last state
    xyz = arm.read(day, Slot(2, 0), np.random.default_rng(0))
    day, judged = enter(day, dict(zip(cell.MARKERS, xyz, strict=True)))
    assert judged.slot == Slot(2, 0)
    assert len(day.record.rows) == 21
    day.record.table.write_text(day.record.table.read_text().replace("unloaded", "hanging"))
    edited = day.record.table.read_bytes()
    with pytest.raises(InputError, match=r"readings\.csv.*state 'hanging'"):
        enter(day, dict(zip(cell.MARKERS, xyz, strict=True)))
    assert day.record.table.read_bytes() == edited


def test_a_folder_of_another_plan_is_refused(m900ib: Experiment, tmp_path: Path) -> None:
    played(m900ib, tmp_path, 3)
    with pytest.raises(InputError, match=r"is no reading of this plan; found pose 'p\d+'.*Name another folder with -o"):
        begin(m900ib, cell.make_day_plan(m900ib, 2), tmp_path, ProtocolWish(cycles=1, repeat_share=0.0, seed=1))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no reading was given"),
        ("m1 1 2", "line 1: no reading; found 'm1 1 2'; allowed: one of m1, m2, m3, and x y z in mm"),
        ("m9 1 2 3", "no reading; found 'm9 1 2 3'"),
        ("m1 1 2 3\nm1 1 2 3", "line 2: no reading"),
        ("m1 1 2 nan", "no reading"),
        ("m1 1 2 1e9", r"no position; found 1, 2, 1e\+09 mm"),
        ("1 2 3\n4 5 6\n7 8 9\n1 2 3", "line 4: no reading"),
    ],
)
def test_text_that_is_no_reading_is_refused_whole(m900ib: Experiment, tmp_path: Path, text: str, said: str) -> None:
    day, _ = played(m900ib, tmp_path, 1)
    with pytest.raises(InputError, match=said):
        enter_text(day, text)
    assert len(begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT).record.rows) == 3


def test_lines_may_be_separated_as_people_do(m900ib: Experiment) -> None:
    names = ("m1", "m2", "m3")
    found = read_positions("m2;1.5;-2;3\n 4,5 , 6\n# a word\nm3\t7 8 9", names)
    assert {k: (1e3 * v).round(6).tolist() for k, v in found.items()} == {
        "m2": [1.5, -2.0, 3.0],
        "m1": [4.0, 5.0, 6.0],
        "m3": [7.0, 8.0, 9.0],
    }


def test_a_file_is_taken_once_and_a_state_once(m900ib: Experiment, tmp_path: Path) -> None:
    day, arm = played(m900ib, tmp_path / "day", 6)
    rng = np.random.default_rng(0)
    first, second = tmp_path / "points1.txt", tmp_path / "points2.csv"
    assert day.next is not None
    first.write_text(lines(arm.read(day, day.next, rng)))
    day, judged = enter_file(day, first)
    assert [j.mistake for j in judged] == [None]
    with pytest.raises(InputError, match="was taken in before"):
        enter_file(day, first)
    # A table of ours, of the state that was just read, with other numbers: the state is there already.
    table = day.record.table.read_text().splitlines()
    second.write_text("\n".join([table[1], *table[-3:]]) + "\n")
    with pytest.raises(InputError, match=r"was read already\. Decide to read it again first"):
        enter_file(day, second)
    assert len(day.record.rows) == 21


def test_rows_that_say_another_angle_or_load_are_looked_at(m900ib: Experiment, tmp_path: Path) -> None:
    """A pasted table brings angles and forces of its own: they are kept, and the difference is named."""
    day, _ = played(m900ib, tmp_path / "day", 7)
    whole, _ = played(m900ib, tmp_path / "whole", 8)
    table = whole.record.table.read_text().splitlines()
    header, rows = table[1], table[-3:]
    turned = [row.replace(row.split(",")[3], f"{float(row.split(',')[3]) + 2:g}", 1) for row in rows]
    found, judged = enter_text(day, "\n".join([header, *turned]))
    assert judged[0].mistake is not None
    assert judged[0].mistake.kind == "angle"
    day = decide(found, judged[0].slot, "again")
    ten = ["-40000" if cell_ == "-4000" else cell_ for cell_ in rows[0].split(",")]
    heavy = [",".join([*row.split(",")[:7], *ten[7:13], *row.split(",")[13:]]) for row in rows]
    _, judged = enter_text(day, "\n".join([header, *heavy]))
    assert judged[0].mistake is not None
    assert judged[0].mistake.kind == "force"


def test_a_trackers_export_goes_through_the_importers(m900ib: Experiment, tmp_path: Path) -> None:
    day, arm = played(m900ib, tmp_path / "day", 3)
    rng = np.random.default_rng(0)
    pose = day.record.protocol.visits[1].pose
    rows = ["Name,X [mm],Y [mm],Z [mm]"]
    for k, state in enumerate(("unloaded_1", "loaded_1")):
        for marker, xyz in zip(cell.MARKERS, arm.read(day, Slot(1, k), rng), strict=True):
            rows.append(f"{pose}_{state}_{marker}," + ",".join(f"{1e3 * v:.4f}" for v in xyz))
    path = tmp_path / "export.csv"
    path.write_text("\n".join(rows) + "\n")
    day, judged = enter_file(day, path)
    assert [(j.slot, j.mistake) for j in judged] == [(Slot(1, 0), None), (Slot(1, 1), None)]


def test_the_floor_tells_a_tracker_that_was_moved(m900ib: Experiment, tmp_path: Path) -> None:
    day, _ = played(m900ib, tmp_path, 3)
    rng = np.random.default_rng(0)
    floor = {f"floor_{k}": rng.uniform(-3, 3, 3) for k in range(3)}
    noise = lambda: {n: p + 3e-5 * rng.standard_normal(3) for n, p in floor.items()}  # noqa: E731
    assert enter_floor(day, noise()).kind == "first"
    assert enter_floor(day, noise()).kind == "still"
    assert "the tracker stands" in floor_words(enter_floor(day, noise()))
    one = noise()
    one["floor_1"] = one["floor_1"] + 0.001
    alone = enter_floor(day, one)
    assert (alone.kind, alone.reflector) == ("reflector", "floor_1")
    assert enter_floor(day, {n: p + np.array([4e-4, 0.0, -2e-4]) for n, p in noise().items()}).kind == "tracker"


def test_what_the_readings_tell_so_far(m900ib: Experiment, tmp_path: Path) -> None:
    """Sds shrink towards what the plan promised, and at its end are there."""
    plan = design(m900ib, 8, candidates=200, seed=0)
    day = begin(m900ib, plan, tmp_path, cell.SHORT)
    arm, rng = cell.draw_arm(m900ib, 3)
    assert so_far(day).fit is None
    worst: list[float] = []
    while day.next is not None:
        day, _ = enter(day, dict(zip(cell.MARKERS, arm.read(day, day.next, rng), strict=True)))
        if day.next is None or (day.next.visit in (4, 6) and day.next.state == 0):
            found = so_far(day)
            worst.append(max(t.sd / t.promised for t in found.told))
            assert found.enough == (day.next is None)
            assert found.help is not None
            assert len(found.help.pose) == 3
    assert worst[0] > worst[1] > worst[2] == pytest.approx(1.0, abs=0.1)
    assert "enough" in so_far_words(so_far(day))
    truth = dict(zip(m900ib.model().names, arm.x, strict=True))
    for told in so_far(day).told:
        assert abs(told.value - truth[told.name]) < 5.0 * told.sd
    assert set(promised_sd(day)) == set(m900ib.fit_names())
    assert len(accepted(day)) == 24
    seen = diagnosis_so_far(day)
    assert seen is None or seen.verdict == "none"
