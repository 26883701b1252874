"""Forty layouts: each is read as it was meant, at once or by the advice of its refusals."""

from __future__ import annotations

import csv
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import samples
from layouts import LAYOUTS, cells, flat, points, vicon, visits
from samples import FORMATS, Campaign, lines
from test_formats import equal
from test_joining import FLOOR, known_points
from typer.testing import CliRunner

from qsf_day.protocol import ProtocolOptions, make_protocol, write_reading_file
from qsf_trackers import import_readings
from qsframework.cli.app import app
from qsframework.cli.refusals import told
from qsframework.errors import InputError
from qsframework.experiment import load_experiment, read_readings

PAGE = Path(__file__).parents[2] / "docs" / "records" / "import-layouts.csv"
MOST = 3
"""Refusals of one layout, each of them with advice that leads on."""


@pytest.fixture
def campaign(tmp_path: Path) -> Campaign:
    return samples.make_campaign(tmp_path)


def followed(c: Campaign, *stated: str | Path) -> tuple[str, list[str]]:
    """What the import says once every advice is followed, and the advice."""
    arguments = ["import", str(c.folder / "experiment.yaml"), *map(str, stated)]
    arguments += ["-p", str(c.folder / "plan.csv"), "-o", str(c.folder / "imported.csv")]
    advice: list[str] = []
    for _ in range(MOST + 1):
        done = CliRunner().invoke(app, [*arguments, *advice], env={"COLUMNS": "400"})
        if done.exit_code == 0:
            return done.output, advice
        assert isinstance(done.exception, InputError), f"{done.output}\n{done.exception!r}"
        problem = next((p for p in done.exception.problems if p.argument is not None), None)
        assert problem is not None, str(done.exception)
        assert problem.argument is not None
        assert problem.file
        advice += [f"--{problem.argument[0]}", *shlex.split(problem.argument[1])]
    raise AssertionError(f"the advice does not lead to an end: {advice}")


def the_same(c: Campaign) -> None:
    one, two = (read_readings(p, c.experiment, "positions") for p in (c.folder / "imported.csv", c.truth()))
    equal(one, two)


def stated(arguments: list[str]) -> str:
    """What the page says that must be stated."""
    return shlex.join(arguments)


@pytest.mark.parametrize("what", LAYOUTS)
def test_a_layout_is_read_as_it_was_meant(what: str, campaign: Campaign) -> None:
    made = LAYOUTS[what](campaign)
    _, advice = followed(campaign, *made)
    given = [str(a) for a in made if not isinstance(a, Path)] + advice
    assert given.count("--map") + given.count("--ignore") <= 1, given
    if what.startswith("one row a p"):  # the states of a marker beside one another
        own = sorted(campaign.readings, key=lambda r: (r.pose, r.marker, r.loaded))
        campaign = replace(campaign, readings=tuple(own))
    the_same(campaign)
    with PAGE.open() as lines:
        assert [what, stated(given)] in list(csv.reader(lines))


def test_there_are_forty() -> None:
    assert len(LAYOUTS) + len(FORMATS) >= 40


def without(c: Campaign, *lost: int) -> Campaign:
    """The campaign without some of its readings."""
    return replace(c, readings=tuple(r for i, r in enumerate(c.readings) if i not in lost))


def test_one_block_alone_is_of_the_marker_that_its_headings_name(tmp_path: Path) -> None:
    """A rigid body whose pivot is the only marker of the experiment."""
    c = samples.make_campaign(tmp_path)
    text = samples.EXPERIMENT.replace("  m2: {xyz_mm: [400, -150, 150]}\n", "")
    (tmp_path / "experiment.yaml").write_text(text)
    one = replace(
        c,
        experiment=load_experiment(tmp_path / "experiment.yaml"),
        readings=tuple(r for r in c.readings if r.marker == "m1"),
    )
    heads = [["", "", *["Rigid Body"] * 7], ["", "", *["flange"] * 7], ["", "", *["Rotation"] * 4, *["Position"] * 3]]
    heads.append(["Frame", "Time (Seconds)", *"XYZW", *"XYZ"])
    rows = [[str(i), "0.1", "0.1", "0.2", "0.3", "0.9", *cells(r)] for i, r in enumerate(one.readings)]
    path = one.write("body.csv", "Length Units,Millimeters\n\n" + lines([*heads, *rows]))
    _, advice = followed(one, path)
    assert advice == ["--match", "order"]
    the_same(one)


def refused(c: Campaign, path: Path) -> str:
    """What the terminal says of a refusal."""
    arguments = ["import", str(c.folder / "experiment.yaml"), str(path), "-p", str(c.folder / "plan.csv")]
    done = CliRunner().invoke(app, arguments)
    assert isinstance(done.exception, InputError)
    return "\n".join(told(done.exception))


def test_blocks_in_two_units_are_refused(campaign: Campaign) -> None:
    head = ["pose", "state", "m1 X [mm]", "m1 Y [mm]", "m1 Z [mm]", "m2 X [in]", "m2 Y [in]", "m2 Z [in]"]
    rows = [[v[0].pose, v[0].state, *flat(v)] for v in visits(campaign)]
    path = campaign.write("visits.csv", lines([head, *rows]))
    assert "line 2, column X: two units in one column: mm, and here inch" in refused(campaign, path)


@pytest.mark.parametrize("cells_left", [3, 5, 6])
def test_a_cut_row_of_blocks_is_named(cells_left: int, campaign: Campaign) -> None:
    """Also where it is by chance as wide as a row of the table that is made of the blocks."""
    head = ["pose", "state", *(f"{m} {a} [mm]" for m in ("m1", "m2") for a in "XYZ")]
    rows = [[v[0].pose, v[0].state, *flat(v)] for v in visits(campaign)]
    rows[4] = rows[4][:cells_left]
    path = campaign.write("visits.csv", lines([head, *rows]))
    assert f"line 6: wrong number of columns; found {cells_left}; allowed: 8" in refused(campaign, path)


def test_a_known_point_may_be_the_origin(campaign: Campaign) -> None:
    known, seen = known_points(campaign, [[0.0, 0.0, 0.0], *FLOOR])
    path = points(campaign)
    path.write_text(path.read_text() + seen)
    followed(campaign, path, "--align", known)
    the_same(campaign)


def test_a_comment_below_the_table_is_no_heading(campaign: Campaign) -> None:
    rows = [[r.name, *cells(r)] for r in campaign.readings]
    path = campaign.write("points.txt", lines(rows, " ") + "# end of the list\n")
    assert "--map name=1,x=2,y=3,z=4" in refused(campaign, path)


def test_a_lost_beam_in_the_second_row_is_named(campaign: Campaign) -> None:
    rows = [[r.name, *cells(r)] for r in campaign.readings]
    rows[1][1:] = ["lost", "lost", "lost"]
    path = campaign.write("points.csv", lines([["name", "x_mm", "y_mm", "z_mm"], *rows]))
    assert "line 3, column x_mm: is no number; found 'lost'" in refused(campaign, path)


def test_a_unit_over_the_coordinates_is_of_no_other_column(campaign: Campaign) -> None:
    heads = [["", "Position [mm]", "", ""], ["Name", "X", "Y", "Z", "Temperature"]]
    path = campaign.write("points.csv", lines([*heads, *([r.name, *cells(r), "21.5"] for r in campaign.readings)]))
    _, advice = followed(campaign, path)
    assert not advice
    the_same(campaign)


def test_a_cut_line_of_a_report_is_named(campaign: Campaign) -> None:
    """Its only number is the nominal one."""
    (path,) = LAYOUTS["PC-DMIS report: a dimension with one axis a line"](campaign)
    text = Path(path).read_text().splitlines()
    text[10] = text[10][:12]
    Path(path).write_text("\n".join(text) + "\n")
    assert "line 11: wrong number of columns; found 2; allowed: 7" in refused(campaign, Path(path))


def test_points_without_names_that_are_too_few_are_not_sent_on_a_way_that_ends(campaign: Campaign) -> None:
    rows = [[f"{v:.4f}" for v in r.mm] for r in campaign.readings[:-1]]
    said = refused(campaign, campaign.write("xyz.csv", lines([["X mm", "Y mm", "Z mm"], *rows])))
    assert "23 points have no names" in said
    assert "found 23 points; allowed: 24 readings of the plan, to be taken in its order" in said
    assert "--match" not in said


def test_an_order_is_shown_before_it_is_taken(campaign: Campaign) -> None:
    said = refused(campaign, samples.unnamed(campaign))
    assert "line 2 is pose p01, marker m1, unloaded; line 3 is pose p01, marker m2, unloaded; line 4" in said
    assert "--match order" in said


LOST = {"empty cells": ["", "", ""], "no numbers": ["NaN", "nan", "NaN"], "zeros": ["0.000", "0.000", "0.000"]}


@pytest.mark.parametrize("kind", [*LOST, "far beyond"])
def test_rows_without_sight_are_left_out_and_counted(kind: str, campaign: Campaign) -> None:
    """Of blocks in the order of the plan, where the others keep their places."""
    rows = [[str(i), "0", *flat(v)] for i, v in enumerate(visits(campaign), start=1)]
    blind = LOST.get(kind, ["-3.697314e+28"] * 3)
    rows[0][5:8] = blind
    rows[7][2:5] = blind
    printed, advice = followed(campaign, vicon(campaign, rows))
    assert advice == ["--match", "order"]
    assert (
        "2 points with no line of sight are not used: vicon.csv, line 6 (arm:m2); vicon.csv, line 13 (arm:m1)"
        in printed
    )
    assert "2 readings of the plan have no point" in printed
    the_same(without(campaign, 1, 14))


def test_a_point_that_was_lost_and_read_again_is_one(campaign: Campaign) -> None:
    path = points(campaign)
    head, first, *others = path.read_text().splitlines(keepends=True)
    path.write_text("".join([head, f"{campaign.readings[0].name},---,---,---\n", first, *others]))
    printed, _ = followed(campaign, path)
    assert "1 points with no line of sight are not used: points.csv, line 2" in printed
    the_same(campaign)


def test_half_of_a_coordinate_is_no_lost_sight(campaign: Campaign) -> None:
    path = points(campaign)
    text = path.read_text().splitlines(keepends=True)
    text[3] = ",".join([*text[3].split(",")[:3], "NaN"]) + "\n"
    path.write_text("".join(text))
    done = CliRunner().invoke(app, ["import", str(campaign.folder / "experiment.yaml"), str(path), "-p", "plan.csv"])
    assert isinstance(done.exception, InputError)
    assert "line 4, column z_mm: is no number; found 'NaN'" in str(done.exception)


def test_a_proposal_shows_the_first_rows_as_it_reads_them(campaign: Campaign) -> None:
    rows = [[r.name, *cells(r)] for r in campaign.readings]
    path = campaign.write("other.csv", lines([["Label1", "East", "North", "Up"], *rows]))
    done = CliRunner().invoke(app, ["import", str(campaign.folder / "experiment.yaml"), str(path)])
    assert isinstance(done.exception, InputError)
    for row in rows[:3]:
        name, x, y, z = row
        assert f"name {name}, x {x}, y {y}, z {z}" in str(done.exception)
    assert rows[3][0] not in str(done.exception)


def test_a_column_is_left_aside_by_its_name(campaign: Campaign) -> None:
    rows = [[r.name, *cells(r), *cells(r)] for r in campaign.readings]
    head = ["name", "X [mm]", "Y [mm]", "Z [mm]", "Actual X [mm]", "Y coord [mm]", "Z value [mm]"]
    path = campaign.write("points.csv", lines([head, *rows]))
    leave = [arg for name in head[4:] for arg in ("--ignore", name)]
    printed, advice = followed(campaign, path, *leave)
    assert not advice
    assert "Actual X [mm]" in printed
    the_same(campaign)


def test_a_spoilt_line_of_json_is_named(campaign: Campaign) -> None:
    path = campaign.write("points.jsonl", '{"name": "a", "x_mm": 1, "y_mm": 2, "z_mm": 3}\n{"name": "b", "x_mm": }\n')
    done = CliRunner().invoke(app, ["import", str(campaign.folder / "experiment.yaml"), str(path)])
    assert isinstance(done.exception, InputError)
    assert "points.jsonl, line 2: is no JSON" in str(done.exception)


@pytest.mark.parametrize("words", ["loaded", "weight", "full load", "half of weight", "half_loaded", "half load"])
def test_loads_are_named_as_the_sheet_of_the_day_writes_them(words: str, campaign: Campaign) -> None:
    """Where a pose is measured under half the load too, loaded is the full load."""
    repeats = np.array([2, 1, 1, 1, 1, 1])
    plan = replace(campaign.plan, repeats=repeats)
    made = make_protocol(campaign.experiment, plan, ProtocolOptions(cycles=1, repeat_share=0.0))
    write_reading_file(campaign.folder / "table.csv", made)
    full = [r for r in campaign.readings if r.loaded and r.pose == "p01"]
    rows = [[f"{r.pose}_{words}_{r.marker}", *cells(r)] for r in full]
    path = campaign.write("points.csv", lines([["Name", "X [mm]", "Y [mm]", "Z [mm]"], *rows]))
    found = import_readings(campaign.experiment, [path], campaign.folder / "table.csv")
    half = "half" in words
    assert {row[found.header.index("load_id")] for row in found.rows} == {"half of weight" if half else "weight"}
    assert {row[found.header.index("fz_N")] for row in found.rows} == {"-2000" if half else "-4000"}


@pytest.mark.parametrize("words", ["r2_c1", "repeat 2, cycle 1", "cycle 01 repeat 02", "Repeat2"])
def test_repeats_are_counted_in_words_too(words: str, campaign: Campaign) -> None:
    rows = [[f"{r.pose} {r.marker} {r.state} {words}", *cells(r)] for r in campaign.readings]
    path = campaign.write("points.tsv", lines([["Name", "X [mm]", "Y [mm]", "Z [mm]"], *rows], "\t"))
    found = import_readings(campaign.experiment, [path], campaign.folder / "plan.csv")
    assert {row[found.header.index("repeat")] for row in found.rows} == {"2"}
