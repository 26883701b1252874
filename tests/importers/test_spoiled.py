"""Spoiled exports are refused with their file, their row where one row is wrong, and what to do; nothing is written."""

from __future__ import annotations

import datetime
import math
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import samples
from samples import Campaign, Reading, lines
from test_joining import FLOOR, known_points
from typer.testing import CliRunner

from qsf_trackers import import_readings
from qsframework.cli.app import app
from qsframework.cli.refusals import told
from qsframework.errors import InputError

Made = Sequence[str | Path]
CASES: list[tuple[str, Callable[[Campaign], Made], tuple[str, ...]]] = []


def spoiled(*said: str) -> Callable[[Callable[[Campaign], Made]], Callable[[Campaign], Made]]:
    """A case: the arguments beside experiment and plan, and what the message holds."""

    def keep(make: Callable[[Campaign], Made]) -> Callable[[Campaign], Made]:
        CASES.append((make.__name__, make, said))
        return make

    return keep


def table(
    c: Campaign, header: Sequence[str] = ("name", "x_mm", "y_mm", "z_mm"), separator: str = ",", **cells: str
) -> Path:
    """An ordinary point list in points.csv; cells: other text for cells, as r3c1 counted from 0 without the header."""
    rows = [[r.name, *(f"{v:.4f}" for v in r.mm)] for r in c.readings]
    for place, text in cells.items():
        row, column = place.lstrip("r").split("c")
        rows[int(row)][int(column)] = text
    return c.write("points.csv", lines([list(header), *rows], separator))


def rows_of(c: Campaign, keep: Callable[[Reading], bool] = lambda r: True) -> list[list[str]]:
    return [[r.name, *(f"{v:.4f}" for v in r.mm)] for r in c.readings if keep(r)]


HEAD = ("name", "x_mm", "y_mm", "z_mm")


@spoiled("points.csv, line 5, column name", "'P91_m2_loaded' says no pose", "Did you mean 'p01'?", "--word FOUND=POSE")
def a_name_that_matches_nothing(c: Campaign) -> Made:
    return [table(c, r3c0="P91_m2_loaded")]


@spoiled("line 2", "says no pose of the plan", "the same of all 24 points", "--word FOUND=POSE")
def names_that_all_match_nothing(c: Campaign) -> Made:
    rows = [[f"Station{i}_m1_loaded", *row[1:]] for i, row in enumerate(rows_of(c))]
    return [c.write("points.csv", lines([HEAD, *rows]))]


@spoiled("line 2", "a marker that the experiment has not", "m1, m2", "--word FOUND=MARKER")
def a_marker_that_is_not_there(c: Campaign) -> Made:
    head = ["pose", "marker", "state", "x_mm", "y_mm", "z_mm", "note"]
    rows = [[r.pose, "ball" if i == 0 else r.marker, r.state, *map(str, r.mm), ""] for i, r in enumerate(c.readings)]
    return [c.write("points.csv", lines([head, *rows]))]


@spoiled("line 2", "says no marker", "the same of all 24 points", "m1, m2")
def no_marker_in_any_name(c: Campaign) -> Made:
    return [c.write("points.csv", lines([HEAD, *([f"{r.pose}_{r.state}", *map(str, r.mm)] for r in c.readings)]))]


@spoiled("line 2", "nothing says whether 'p01_m1' was read loaded or unloaded", "--state unloaded")
def no_state_in_any_name(c: Campaign) -> Made:
    return [c.write("points.csv", lines([HEAD, *([f"{r.pose}_{r.marker}", *map(str, r.mm)] for r in c.readings)]))]


@spoiled("line 26, column name", "two points for one marker", "line 3", "mm apart", "r2")
def two_points_for_one_marker(c: Campaign) -> Made:
    rows = rows_of(c)
    return [c.write("points.csv", lines([HEAD, *rows, rows[1]]))]


@spoiled("points.csv, line", "most points do not lie", "They fit with the markers m1 and m2 exchanged")
def two_markers_exchanged_in_a_whole_export(c: Campaign) -> Made:
    other = {"m1": "m2", "m2": "m1"}
    rows = [[f"{r.pose}_{other[r.marker]}_{r.state}", *map(str, r.mm)] for r in c.readings]
    return [c.write("points.csv", lines([HEAD, *rows]))]


@spoiled("line 4", "says more than one thing", "pose p01 or p02", "columns say pose and marker")
def a_name_with_two_poses(c: Campaign) -> Made:
    return [table(c, r2c0="P01_P02_m1_loaded")]


@spoiled("points.csv, line 1, column x", "nothing says the unit", "if it is mm", "--unit mm")
def no_unit_anywhere(c: Campaign) -> Made:
    return [table(c, header=["name", "x", "y", "z"])]


@spoiled("points.csv, line 1", "nothing says the unit", "if it is inch", "--unit inch")
def inches_that_nobody_states(c: Campaign) -> Made:
    rows = [[r.name, *(repr(v / 25.4) for v in r.mm)] for r in c.readings]
    return [c.write("points.csv", lines([["name", "x", "y", "z"], *rows]))]


@spoiled("points.csv, line 1", "said to be in mm", "if they are in inch", "Correct the unit")
def inches_called_millimetres(c: Campaign) -> Made:
    rows = [[r.name, *(repr(v / 25.4) for v in r.mm)] for r in c.readings]
    return [c.write("points.csv", lines([HEAD, *rows]))]


@spoiled("line 12, column x_mm", "It would be right in inch", "one unit")
def one_row_in_inches(c: Campaign) -> Made:
    rows = rows_of(c)
    rows[10][1:] = [repr(v / 25.4) for v in c.readings[10].mm]
    return [c.write("points.csv", lines([HEAD, *rows]))]


@spoiled("line 1", "in several units", "x_mm in mm, y_in in inch", "Export them in one unit")
def columns_in_two_units(c: Campaign) -> Made:
    return [table(c, header=["name", "x_mm", "y_in", "z_mm"])]


@spoiled("line 3, column X", "two units in one column: mm, and here inch", "one unit")
def cells_in_two_units(c: Campaign) -> Made:
    rows = [[r.name, *(f"{v} {'in' if i == 1 else 'mm'}" for v in r.mm)] for i, r in enumerate(c.readings)]
    return [c.write("points.csv", lines([["Name", "X", "Y", "Z"], *rows]))]


@spoiled("points.xlsx", "holds several sheets", "Monday, Tuesday", "--sheet 'Monday'")
def a_workbook_with_several_sheets(c: Campaign) -> Made:
    return [samples.workbook(c, ("Monday", "Tuesday"))]


@spoiled("points.xlsx", "has no such sheet", "Did you mean 'Points'?")
def a_sheet_that_is_not_there(c: Campaign) -> Made:
    return [samples.workbook(c), "--sheet", "Point"]


@spoiled("points.xlsx", "cannot be read as an Excel workbook", "save it again")
def a_workbook_that_is_cut(c: Campaign) -> Made:
    path = samples.workbook(c)
    path.write_bytes(path.read_bytes()[:2000])
    return [path]


@spoiled("points.xlsx", "XML that no workbook holds")
def a_workbook_that_defines_entities(c: Campaign) -> Made:
    path = c.folder / "points.xlsx"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("xl/workbook.xml", '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>')
    return [path]


@spoiled("points.xlsx", "unpacks to more than 50 MB")
def a_workbook_that_swells(c: Campaign) -> Made:
    path = samples.workbook(c)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/media/image1.xml", bytes(210_000_000))
    return [path]


@spoiled("points.xlsx, line", "the workbook is larger than that", "Split it")
def a_workbook_with_a_cell_far_away(c: Campaign) -> Made:
    import openpyxl

    path = samples.workbook(c)
    book = openpyxl.load_workbook(path)
    book["Points"].cell(row=900_000, column=2, value=1.0)
    book.save(path)
    return [path]


@spoiled("points.xlsx", "holds a part of more than 5 MB")
def a_workbook_of_styles(c: Campaign) -> Made:
    path = samples.workbook(c)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/more.xml", b"<a>" + b"<b/>" * 2_000_000 + b"</a>")
    return [path]


@spoiled("points.xls", "old Excel format", "Save it as .xlsx")
def an_old_workbook(c: Campaign) -> Made:
    path = c.folder / "points.xls"
    path.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600))
    return [path]


@spoiled("sa_points.txt, line 4", "columns have no names", "--map collection=1,group=2,name=3,x=4,y=5,z=6")
def no_heading(c: Campaign) -> Made:
    return [samples.spatial_analyzer(c)]


@spoiled("points.csv, line 1", "no column says that it is x, y, z", "--map name=Label1,x=Ost,y=Nord,z=Up")
def headings_in_other_words(c: Campaign) -> Made:
    return [table(c, header=["Label1", "Ost", "Nord", "Up"])]


@spoiled("points.csv, line 1", "no column says that it is x, y, z", "--map name=tool,x=p.t.x,y=p.t.y,z=p.t.z")
def headings_alike_but_for_the_axes(c: Campaign) -> Made:
    rows = [[row[0], "0.5", "0.5", "0.5", *row[1:]] for row in rows_of(c)]
    return [c.write("points.csv", lines([["tool", *(f"p.{o}.{a}" for o in ("rot", "t") for a in "xyz")], *rows]))]


@spoiled("points.csv, line 1", "several columns could be x", "'X', 'Measured X'", "--map x='X'")
def two_columns_for_x(c: Campaign) -> Made:
    rows = [[*row, row[1]] for row in rows_of(c)]
    return [c.write("points.csv", lines([["name", "X", "Y", "Z", "Measured X"], *rows]))]


@spoiled("points.csv", "no column is called 'Xcoord'", "name, x_mm, y_mm, z_mm")
def a_stated_column_that_is_not_there(c: Campaign) -> Made:
    return [table(c), "--map", "x=Xcoord"]


@spoiled("points.csv, line 6, column x_mm", "another decimal sign than in line 2", "'3555,1'")
def two_decimal_signs(c: Campaign) -> Made:
    return [table(c, separator=";", r4c1="3555,1")]


@spoiled("points.csv, lines 2 to 25", "wrong number of columns", "found 7; allowed: 4", "';' or a tab")
def a_comma_for_columns_and_decimals(c: Campaign) -> Made:
    return [table(c, **{f"r{i}c{k}": samples.comma(c.readings[i].mm[k - 1]) for i in range(24) for k in (1, 2, 3)})]


@spoiled("points.csv, line 7, column y_mm", "is no number", "'1.234,5'", "no sign between thousands")
def a_sign_between_thousands(c: Campaign) -> Made:
    return [table(c, separator=";", r5c2="1.234,5")]


@spoiled("points.csv, line 9, column z_mm", "is no number", "'lost'")
def a_beam_that_was_lost(c: Campaign) -> Made:
    return [table(c, r7c3="lost")]


@spoiled("points.csv, line 9, column z_mm", "this cell is empty")
def an_empty_coordinate(c: Campaign) -> Made:
    return [table(c, r7c3="")]


@spoiled("points.csv, line 10", "wrong number of columns", "found 2; allowed: 4. Leave one table")
def a_row_that_is_cut(c: Campaign) -> Made:
    rows = rows_of(c)
    rows[8] = rows[8][:2]
    return [c.write("points.csv", lines([HEAD, *rows]))]


@spoiled("notes.txt", "holds no rows of numbers", "export of points")
def no_points_at_all(c: Campaign) -> Made:
    return [c.write("notes.txt", "We measured on Monday.\nIt rained.\n")]


@spoiled("points.csv", "is no text that can be read", "Export it")
def no_text_at_all(c: Campaign) -> Made:
    (c.folder / "points.csv").write_bytes(bytes(range(256)))
    return [c.folder / "points.csv"]


@spoiled("points.csv, line 8", "mm from where that marker is", "It lies where marker m2 is at pose p02", "--ignore")
def two_markers_exchanged(c: Campaign) -> Made:
    rows = rows_of(c)
    rows[6][0], rows[7][0] = rows[7][0], rows[6][0]
    return [c.write("points.csv", lines([HEAD, *rows]))]


@spoiled(
    "xyz.csv", "not as many as the readings of the plan", "found 23 points; allowed: 24 readings", "--ignore PATTERN"
)
def one_point_too_few_for_the_order(c: Campaign) -> Made:
    path = samples.unnamed(c)
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-1]))
    return [path, "--match", "order"]


@spoiled("xyz.csv, line", "most points do not lie where", "too many or missing")
def another_order_than_that_of_the_plan(c: Campaign) -> Made:
    path = samples.unnamed(c)
    head, *rows = path.read_text().splitlines(keepends=True)
    path.write_text("".join([head, *rows[5:], *rows[:5]]))
    return [path, "--match", "order"]


@spoiled("points.csv, line", "most points do not lie where", "They fit as mirror images", "two axes")
def two_axes_exchanged(c: Campaign) -> Made:
    return [c.write("points.csv", lines([HEAD, *([name, x, z, y] for name, x, y, z in rows_of(c))]))]


def other_plan(c: Campaign, change: Callable[[list[float]], list[float]]) -> Made:
    """The points with a plan that holds other angles; the option replaces the right plan."""
    head = ["pose", *(f"q{k}_deg" for k in range(1, 7)), "fx_N", "fy_N", "fz_N"]
    poses = {r.pose: r.degrees for r in c.readings}
    rows = [[pose, *map(str, change(list(own))), "0", "0", "-4000"] for pose, own in poses.items()]
    return [table(c), "--plan", c.write("plan.csv", lines([head, *rows]))]


@spoiled("points.csv, line", "most points do not lie where", "They fit with angles in rad, not in deg")
def angles_in_radians(c: Campaign) -> Made:
    return other_plan(c, lambda q: [math.radians(v) for v in q])


@spoiled("points.csv, line", "most points do not lie where", "They fit with q3 + q2 in place of q3")
def a_coupled_third_angle(c: Campaign) -> Made:
    return other_plan(c, lambda q: [*q[:2], q[2] - q[1], *q[3:]])


@spoiled("points.csv, line 1", "cylindrical or spherical", "Theta [deg]", "Cartesian")
def cylindrical_coordinates(c: Campaign) -> Made:
    polar = [
        [name, math.hypot(float(x), float(y)), math.degrees(math.atan2(float(y), float(x))), z]
        for name, x, y, z in rows_of(c)
    ]
    return [
        c.write("points.csv", lines([["name", "R [mm]", "Theta [deg]", "Z [mm]"], *([*map(str, r)] for r in polar)]))
    ]


@spoiled("points.csv, line 3, column Unit", "is no unit of length", "found 'furlong'")
def a_unit_of_a_row_that_is_none(c: Campaign) -> Made:
    rows = [[*row, "furlong" if k == 1 else "mm"] for k, row in enumerate(rows_of(c))]
    return [c.write("points.csv", lines([["name", "x", "y", "z", "Unit"], *rows]))]


@spoiled("xyz.csv, line 2", "24 points have no names", "--match order")
def points_without_names(c: Campaign) -> Made:
    return [samples.unnamed(c)]


@spoiled("points.csv, line 3", "by the order this is pose p01, marker m2", "named 'P01_m1_loaded'", "--match names")
def names_against_the_order(c: Campaign) -> Made:
    rows = rows_of(c)
    rows[1], rows[2] = rows[2], rows[1]
    return [c.write("points.csv", lines([HEAD, *rows])), "--match", "order"]


@spoiled("experiment.yaml", "the nearest prediction needs the tracker's frame", "--align known.csv")
def the_nearest_without_a_frame(c: Campaign) -> Made:
    return [samples.half_named(c, "loaded"), "--match", "nearest"]


@spoiled("known.csv", "lie in a line", "mm across", "one more point away")
def known_points_in_a_line(c: Campaign) -> Made:
    known, seen = known_points(c, [[800.0, k * 300.0, 0.0] for k in range(-2, 3)])
    path = table(c)
    path.write_text(path.read_text() + seen)
    return [path, "--align", known]


@spoiled("known.csv", "a frame needs three points", "found 2: B1, B2")
def too_few_known_points(c: Campaign) -> Made:
    known, seen = known_points(c, FLOOR[:2])
    path = table(c)
    path.write_text(path.read_text() + seen)
    return [path, "--align", known]


@spoiled("points.csv, line 2", "does not lie where it should beside the others", "Look at its name")
def known_points_with_exchanged_names(c: Campaign) -> Made:
    known, seen = known_points(c, FLOOR)
    first, *others, last = seen.splitlines()
    first, last = f"B4,{first.partition(',')[2]}", f"B1,{last.partition(',')[2]}"
    path = table(c)
    path.write_text(path.read_text() + "\n".join([last, *others, first]) + "\n")
    return [path, "--align", known]


@spoiled("points.csv", "a frame needs three points", "found 2")
def one_unloaded_pose_for_a_frame(c: Campaign) -> Made:
    rows = rows_of(c, lambda r: r.pose == "p01" and not r.loaded)
    return [c.write("points.csv", lines([HEAD, *rows])), "--align", "unloaded"]


@spoiled("joint_states.csv", "ahead of the tracker's", "every point falls into a stop", "--clock 103.750")
def clocks_that_are_set_differently(c: Campaign) -> Made:
    return [samples.tracker_pilot(c), samples.ros_log(c, ahead=100.0), "--join", "time"]


@spoiled("joint_states.csv", "the clocks of tracker and controller run apart", "at the last", "--join order")
def clocks_that_run_apart(c: Campaign) -> Made:
    return [samples.tracker_pilot(c), samples.ros_log(c, rate=1.2), "--join", "time"]


@spoiled("api.csv, line 4, column Time", "the arm moves at")
def a_point_read_on_the_way(c: Campaign) -> Made:
    late = [
        r if i != 2 else Reading(r.pose, r.marker, r.loaded, r.mm, 50.2, r.degrees) for i, r in enumerate(c.readings)
    ]
    one = Campaign(c.folder, c.experiment, c.plan, tuple(late))
    return [samples.api(one), samples.kuka_log(c), "--join", "time"]


@spoiled("points.csv", "the points have no column of times", "--join order")
def no_times_to_join_by(c: Campaign) -> Made:
    return [table(c), samples.ros_log(c), "--join", "time"]


@spoiled("fanuc_log.csv", "the log has no column of times", "--join order")
def no_times_in_the_log(c: Campaign) -> Made:
    return [samples.api(c), samples.fanuc_log(c), "--join", "time"]


@spoiled("joint_states.csv, line 1", "it names no pose", "--join order")
def a_log_that_names_no_pose(c: Campaign) -> Made:
    return [table(c), samples.ros_log(c)]


@spoiled("fanuc_log.csv", "another number of rows", "found 5 rows", "24, one for each point, or 6, one for each visit")
def a_log_with_a_row_too_few(c: Campaign) -> Made:
    path = samples.fanuc_log(c)
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-1]))
    return [table(c), path, "--join", "order"]


@spoiled("points.csv, lines 18 to 21", "the joint log has no row of this pose", "p05")
def a_log_without_one_pose(c: Campaign) -> Made:
    path = samples.fanuc_log(c)
    path.write_text("".join(x for x in path.read_text().splitlines(keepends=True) if not x.startswith("p05")))
    return [table(c), path]


@spoiled("log.csv, line 1, column A1", "the unit of the angles", "--unit deg")
def angles_without_a_unit(c: Campaign) -> Made:
    rows = [["A1", "A2", "A3", "A4", "A5", "A6"], *([str(v) for v in d] for d in samples.DEGREES)]
    return [table(c), c.write("log.csv", lines(rows)), "--join", "order"]


@spoiled("points.csv, line 2", "deg from where the plan puts it", "in this unit?")
def angles_of_another_campaign(c: Campaign) -> Made:
    path = samples.fanuc_log(c)
    path.write_text(path.read_text().replace("p01,0,", "p01,25,"))
    return [table(c), path]


@spoiled("points.csv, lines 2 to 25, column time", "no time that can be read in one way", "2026-03-09 13:45:01.5")
def a_date_that_can_be_read_in_two_ways(c: Campaign) -> Made:
    rows = [[*row, f"03/04/2026 10:{i:02d}:00"] for i, row in enumerate(rows_of(c))]
    return [c.write("points.csv", lines([[*HEAD, "time"], *rows]))]


@spoiled("points.csv, line 2, column time", "nothing says the unit of these times", "--unit s")
def times_without_a_unit(c: Campaign) -> Made:
    rows = [[*row, str(i)] for i, row in enumerate(rows_of(c))]
    return [c.write("points.csv", lines([[*HEAD, "time"], *rows])), "--map", "time=time"]


@spoiled("the word 'ball' cannot mean this", "'m9'")
def a_word_for_what_there_is_not(c: Campaign) -> Made:
    return [table(c), "--word", "ball=m9"]


@pytest.mark.parametrize(("make", "said"), [pytest.param(m, s, id=n) for n, m, s in CASES])
def test_a_spoiled_export_is_refused(make: Callable[[Campaign], Made], said: Sequence[str], tmp_path: Path) -> None:
    c = samples.make_campaign(tmp_path)
    out = tmp_path / "imported.csv"
    files = [str(f) for f in make(c)]
    arguments = ["import", str(tmp_path / "experiment.yaml"), *files, "-p", str(tmp_path / "plan.csv"), "-o", str(out)]
    done = CliRunner().invoke(app, arguments)
    assert isinstance(done.exception, InputError), f"{done.output}\n{done.exception!r}"
    text = "\n".join(told(done.exception))
    for words in said:
        assert words in text, text
    assert not out.exists()


def test_there_are_at_least_thirty() -> None:
    assert len(CASES) >= 30


def test_nothing_is_said_of_a_file_without_a_plan(tmp_path: Path) -> None:
    """Not which angles, so the plan is asked for."""
    c = samples.make_campaign(tmp_path)
    done = CliRunner().invoke(app, ["import", str(tmp_path / "experiment.yaml"), str(table(c))])
    assert isinstance(done.exception, InputError)
    assert "--plan plan.csv" in "\n".join(told(done.exception))


def test_a_proposed_difference_of_the_clocks_is_right(tmp_path: Path) -> None:
    c = samples.make_campaign(tmp_path)
    files = [str(samples.tracker_pilot(c)), str(samples.ros_log(c, ahead=100.0)), "-p", str(tmp_path / "plan.csv")]
    arguments = ["import", str(tmp_path / "experiment.yaml"), *files, "--join", "time", "-o", str(tmp_path / "r.csv")]
    done = CliRunner().invoke(app, arguments)
    assert isinstance(done.exception, InputError)
    proposed = next(p.argument for p in done.exception.problems if p.argument is not None)
    assert proposed[0] == "clock"
    assert CliRunner().invoke(app, [*arguments, "--clock", proposed[1]]).exit_code == 0
    assert (tmp_path / "r.csv").is_file()


def test_tracker_files_in_place_of_readings_name_the_import(tmp_path: Path) -> None:
    """Every command that reads tables says one thing of such a file, not one of each column."""
    c = samples.make_campaign(tmp_path)
    for name, (make, *_) in samples.FORMATS.items():
        experiment = tmp_path / "experiment.yaml"
        path = make(c)
        experiment.write_text(samples.EXPERIMENT + f"data: {path.name}\n")
        plan = ["simulate", str(experiment), str(path), "-o", str(tmp_path / "simulated.csv")]
        taken = ["design", str(experiment), "--taken", str(path), "-o", str(tmp_path / "other.csv")]
        for command in (["check", str(experiment)], ["identify", str(experiment)], plan, taken):
            done = CliRunner().invoke(app, command)
            assert isinstance(done.exception, InputError), name
            (problem,) = done.exception.problems
            assert "qsf import" in str(problem), name
            assert path.name in str(problem)


def test_times_are_read_in_one_way_only() -> None:
    from qsf_trackers.vocabulary import moment

    noon = datetime.datetime(2026, 3, 9, 12, tzinfo=datetime.UTC).timestamp()
    assert moment("2026-03-09T12:00:00Z", "") == (noon, "date")
    assert moment("09.03.2026 12:00:00", "") == (noon, "date")
    assert moment("12:00:00,5 PM", "") == (43200.5, "day")
    assert moment("1500", "ms") == (1.5, "count")
    assert moment(f"{noon * 1e9:.0f}", "ns") == (pytest.approx(noon), "date")
    for unclear in ("03/04/2026 12:00:00", "noon", "25:00:00", "1500"):
        assert moment(unclear, "") is None


def test_a_column_of_units_holds_row_by_row(tmp_path: Path) -> None:
    c = samples.make_campaign(tmp_path)
    rows = [
        [name, *(f"{float(v) / 25.4:.6f}" for v in xyz), "in"] if k % 2 else [name, *xyz, "mm"]
        for k, (name, *xyz) in enumerate(rows_of(c))
    ]
    path = c.write("points.csv", lines([["name", "x", "y", "z", "Unit"], *rows]))
    found = import_readings(c.experiment, [path], c.folder / "plan.csv")
    assert np.allclose(found.readings.value, [r.mm for r in c.readings] * np.array(1e-3), atol=1e-7)
