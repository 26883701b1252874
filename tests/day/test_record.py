"""Nothing that was read is lost, and nothing that cannot be right is stored."""

from __future__ import annotations

import errno
import os
import shutil
import sys
import time
from dataclasses import replace
from pathlib import Path

import day_cell as cell
import numpy as np
import pytest

from qsf_day import Day, Slot, begin, decide, enter
from qsf_day.entry import Unconfirmed, enter_file, enter_text, read_positions
from qsf_day.protocol import ProtocolOptions
from qsf_day.record import Entry, as_json, delivery, opened
from qsf_day.session import enter_floor, reread
from qsf_day.so_far import accepted, diagnosis_so_far, predicted_sd, so_far
from qsf_day.words import floor_words, so_far_words, spoilt_words
from qsframework.errors import InputError
from qsframework.experiment import Experiment, read_readings
from qsframework.plans import design


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
    assert np.allclose(again.record.at(Slot(4, 0))["m1"], xyz[1], atol=1e-7)
    assert not again.mistakes
    assert '"said": "corrected"' in (tmp_path / "day.jsonl").read_text()
    assert f"{xyz[0, 0]:.6f}"[:-1] in (tmp_path / "day.jsonl").read_text()  # what stood there is kept


def test_a_broken_end_is_cut_off_and_hides_nothing_that_follows(m900ib: Experiment, tmp_path: Path) -> None:
    """As a power cut leaves it: the state that lost its record comes next, and what is then said of it is kept."""
    day, arm = played(m900ib, tmp_path, 13)
    log, rng = tmp_path / "day.jsonl", np.random.default_rng(0)
    log.write_bytes(log.read_bytes()[:-20])
    day = begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT)
    assert day.next == Slot(4, 0)
    assert len(day.record.rows) == 36
    xyz = cell.exchanged(arm.read(day, Slot(4, 0), rng), arm, day, Slot(4, 0))
    enter(day, dict(zip(cell.MARKERS, xyz, strict=True)))
    again = begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT)
    assert again.record.doubtful == [Slot(4, 0)]
    assert len(read_readings(day.record.table, m900ib).use) == 12


def test_a_file_whose_record_was_cut_off_fills_its_own_state(m900ib: Experiment, tmp_path: Path) -> None:
    """Killed while it is stored: the file and its readings are there or are not, so it fills no other state."""
    day, arm = played(m900ib, tmp_path / "day", 3)
    path, log = tmp_path / "f.txt", tmp_path / "day" / "day.jsonl"
    path.write_text(lines(arm.read(day, Slot(1, 0), np.random.default_rng(0))))
    before = len(log.read_bytes())
    enter_file(day, path, Slot(1, 0))
    whole = log.read_bytes()
    for size in (before, before + 1, (before + len(whole)) // 2, len(whole) - 2, len(whole) - 1, len(whole)):
        log.write_bytes(whole[:size])
        day = begin(m900ib, cell.make_day_plan(m900ib), tmp_path / "day", cell.SHORT)
        day, judged = enter_file(day, path, Slot(1, 0))
        assert [j.slot for j in judged] == [Slot(1, 0)] * (size < len(whole) - 1)
        assert [row.slot for row in day.record.rows][9:] == [Slot(1, 0)] * 3


def test_two_writers_and_a_page_that_is_behind_fill_one_state(m900ib: Experiment, tmp_path: Path) -> None:
    day, arm = played(m900ib, tmp_path, 1)
    other = begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT)
    text = lines(arm.read(day, Slot(0, 1), np.random.default_rng(0)))
    enter_text(day, text)
    with pytest.raises(InputError, match=r"the day has moved on: next is pose 'p\d+', unloaded, cycle 2"):
        enter_text(other, text)
    with pytest.raises(InputError, match="the day has moved on"):
        enter_text(reread(other), text, Slot(0, 1))
    assert {row.slot for row in reread(other).record.rows} == {Slot(0, 0), Slot(0, 1)}


def test_a_decision_is_of_the_reading_that_was_seen(m900ib: Experiment, tmp_path: Path) -> None:
    day, arm = played(m900ib, tmp_path, 12)
    rng, slot = np.random.default_rng(0), Slot(4, 0)
    wrong = [cell.exchanged(arm.read(day, slot, rng), arm, day, slot) for _ in range(2)]
    behind, _ = enter(day, dict(zip(cell.MARKERS, wrong[0], strict=True)))
    enter(decide(behind, slot, "again"), dict(zip(cell.MARKERS, wrong[1], strict=True)))
    with pytest.raises(InputError, match="has moved on"):
        decide(behind, slot, "keep", behind.record.states[slot].time)
    assert reread(behind).record.doubtful == [slot]


def killed(*_: object) -> None:
    """What a signal does."""
    raise KeyboardInterrupt


def test_what_nobody_judged_is_judged_when_the_day_is_opened(
    m900ib: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    day, arm = played(m900ib, tmp_path, 12)
    slot, module = Slot(4, 0), sys.modules[begin.__module__]
    xyz = cell.exchanged(arm.read(day, slot, np.random.default_rng(0)), arm, day, slot)
    readings = {str(m): p for m, p in zip(cell.MARKERS, xyz, strict=True)}
    with monkeypatch.context() as patch:  # killed before it is judged: it is not stored
        patch.setattr(module, "judge", killed)
        with pytest.raises(KeyboardInterrupt):
            enter(day, readings)
    assert begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT).next == slot
    bare = Entry(slot=slot, xyz=readings, pendant=day.record.visit(slot).pendant, wrench=np.zeros(6), series="S1")
    with opened(tmp_path, day.record.protocol) as journal:  # stored by something else
        journal.append(delivery(day.record, states=[as_json(day.record.protocol, bare)]))
    again = begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT)
    assert [m.kind for m in again.mistakes.values()] == ["markers"]
    assert begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT).record.doubtful == [slot]
    assert len(accepted(again)) == 12  # the state that waits is out of use


@pytest.mark.parametrize("name", ["day.jsonl", "readings.csv"])
def test_one_spoilt_byte_costs_one_record_at_most(m900ib: Experiment, tmp_path: Path, name: str) -> None:
    played(m900ib, tmp_path, 5)
    path = tmp_path / name
    content = path.read_bytes()
    for place in (0, 60, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:place] + b"\xff" + content[place + 1 :])
        day = begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT)
        assert len(day.record.rows) >= 12
        said = [] if len(day.record.rows) == 15 else ["day.jsonl: spoilt and not used: line"]
        assert [spoilt_words(day)[: len(s)] for s in said] == said
        assert (tmp_path / "readings_before.csv").exists() == bool(day.record.spoilt)
        (tmp_path / "readings_before.csv").unlink(missing_ok=True)


def test_a_clock_that_was_set_back_is_said(m900ib: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for first, words in ((0.0, ""), (-3600.0, "This machine's clock was set back by 359")):
        now = iter(range(1_000_000))
        monkeypatch.setattr(time, "time", lambda now=now, first=first: 1e9 + (k := next(now)) + first * (k > 3))
        folder = tmp_path / str(first)
        played(m900ib, folder, 5)
        said = spoilt_words(begin(m900ib, cell.make_day_plan(m900ib), folder, cell.SHORT))
        assert said[:40] == words


def test_a_table_without_its_journal_is_not_overwritten(m900ib: Experiment, tmp_path: Path) -> None:
    day, _ = played(m900ib, tmp_path, 2)
    (tmp_path / "day.jsonl").unlink()
    before = day.record.table.read_bytes()
    said = r"stands there without day\.jsonl, or with an empty one, and is not overwritten\. Put day\.jsonl back"
    with pytest.raises(InputError, match=said):
        begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT)
    with pytest.raises(InputError, match="without day"):
        enter(day, {"m1": np.ones(3)})
    assert not (tmp_path / "day.jsonl").exists()
    (tmp_path / "day.jsonl").touch()
    for _ in range(2):
        with pytest.raises(InputError, match="with an empty one"):
            begin(m900ib, cell.make_day_plan(m900ib), tmp_path, cell.SHORT)
    assert day.record.table.read_bytes() == before


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
    with pytest.raises(
        InputError, match=r"No space left on device\. All earlier records are kept: make room and try again"
    ):
        enter(day, dict(zip(cell.MARKERS, xyz, strict=True)))
    assert day.record.table.read_bytes() == before
    monkeypatch.setattr(os, "fsync", sync)
    day, judged = enter(day, dict(zip(cell.MARKERS, xyz, strict=True)))
    assert judged.mistake is None
    assert len(day.record.rows) == 15


def test_the_table_says_what_it_is_made_from_and_is_made_anew(m900ib: Experiment, tmp_path: Path) -> None:
    day, arm = played(m900ib, tmp_path, 7)
    text = day.record.table.read_text()
    assert text.splitlines()[1] == "# made from day.jsonl: what is changed here is overwritten"
    day.record.table.write_text("".join(text.splitlines(keepends=True)[:-3]))
    xyz = arm.read(day, Slot(2, 1), np.random.default_rng(0))
    day, judged = enter(day, dict(zip(cell.MARKERS, xyz, strict=True)))
    assert judged.slot == Slot(2, 1)
    assert day.record.table.read_text().startswith(text)


def test_a_folder_of_another_plan_is_refused(m900ib: Experiment, tmp_path: Path) -> None:
    played(m900ib, tmp_path, 3)
    with pytest.raises(InputError, match=r"this is a journal of .*, not of .*\. Name another folder with -o"):
        begin(m900ib, cell.make_day_plan(m900ib, 2), tmp_path, ProtocolOptions(cycles=1, repeat_share=0.0, seed=1))


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
    with pytest.raises(Unconfirmed, match=r"points1\.txt: holds points without a pose\. Confirm the state"):
        enter_file(day, first)
    day, judged = enter_file(day, first, day.next)
    assert [j.mistake for j in judged] == [None]
    copy = Path(shutil.copy(first, tmp_path / "copy.txt"))
    assert [enter_file(day, path, day.next)[1] for path in (first, copy)] == [[], []]  # a note, no reading
    # A table of ours, of the state that was just read: a note; with other numbers: the state is there already.
    table = day.record.table.read_text().splitlines()
    second.write_text("\n".join([table[2], *table[-3:]]) + "\n")
    assert enter_file(day, second)[1] == []
    other = [row.replace(row.split(",")[16], "1234.5") for row in table[-3:]]
    second.write_text("\n".join([table[2], *other]) + "\n")
    with pytest.raises(InputError, match=r"was read already\. Decide to read it again first"):
        enter_file(day, second)
    assert len(day.record.rows) == 21


def test_rows_that_say_another_angle_or_load_are_looked_at(m900ib: Experiment, tmp_path: Path) -> None:
    """A pasted table brings angles and forces of its own: they are kept, and the difference is named."""
    day, _ = played(m900ib, tmp_path / "day", 7)
    whole, _ = played(m900ib, tmp_path / "whole", 8)
    table = whole.record.table.read_text().splitlines()
    header, rows = table[2], table[-3:]
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
    assert enter_floor(day, noise())[1].kind == "first"
    assert enter_floor(day, noise())[1].kind == "still"
    assert "the tracker stands" in floor_words(enter_floor(day, noise())[1])
    one = noise()
    one["floor_1"] = one["floor_1"] + 0.001
    _, alone = enter_floor(day, one)
    assert (alone.kind, alone.reflector) == ("reflector", "floor_1")
    _, moved = enter_floor(day, {n: p + np.array([4e-4, 0.0, -2e-4]) for n, p in noise().items()})
    assert moved.kind == "tracker"
    assert len((tmp_path / "readings_floor.csv").read_text().splitlines()) == 3 + 5 * 3


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
            worst.append(max(t.sd / t.predicted for t in found.told))
            assert found.enough == (day.next is None)
            assert found.help is not None
            assert len(found.help.pose) == 3
    assert worst[0] > worst[1] > worst[2] == pytest.approx(1.0, abs=0.1)
    assert [visits for visits, _ in found.history] == list(range(1, 9))
    sds = np.array([sds for _, sds in found.history])
    assert (sds[1:] <= sds[:-1] * (1.0 + 1e-9)).all(), "more readings tell no less"
    assert sds[-1] == pytest.approx([t.predicted for t in found.told], rel=0.05)
    assert "enough" in so_far_words(found)
    open_ = replace(found, causes=("offaxis_compliance[joint_1/x]",))
    assert not open_.enough, "never beside a named cause"
    assert ": enough" not in so_far_words(open_)
    assert "a model without offaxis_compliance[joint_1/x], which the readings name" in so_far_words(open_)
    truth = dict(zip(m900ib.model().names, arm.x, strict=True))
    for told in found.told:
        assert abs(told.value - truth[told.name]) < 5.0 * told.sd
    assert set(predicted_sd(day)) == set(m900ib.fit_names())
    assert len(accepted(day)) == 24
    seen = diagnosis_so_far(day)
    assert seen is None or seen.verdict == "none"
