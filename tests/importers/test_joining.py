"""Points without names, joint logs and frames: joined by order, place and time, and back exactly."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import samples
from samples import DEGREES, FRAME, Campaign
from test_formats import equal, run, the_same

from qsf_day.protocol import ProtocolOptions, make_protocol, write_reading_file
from qsf_trackers import ImportOptions, import_readings
from qsframework.errors import InputError
from qsframework.experiment import Frame, read_readings


@pytest.fixture
def campaign(tmp_path: Path) -> Campaign:
    return samples.make_campaign(tmp_path)


def known_points(c: Campaign, places_mm: list[list[float]]) -> tuple[Path, str]:
    """A file of points on the floor in the base frame, and their rows in a tracker's export."""
    rows = [[f"B{k}", *(f"{v:.4f}" for v in p)] for k, p in enumerate(places_mm, start=1)]
    seen = 1e3 * FRAME.apply(1e-3 * np.array(places_mm))
    lines = samples.lines([[f"B{k}", *(f"{v:.4f}" for v in p)] for k, p in enumerate(seen.tolist(), start=1)])
    return c.write("known.csv", samples.lines([["name", "x_mm", "y_mm", "z_mm"], *rows])), lines


FLOOR = [[900.0, 800.0, 10.0], [900.0, -800.0, 5.0], [-700.0, 850.0, 0.0], [-650.0, -900.0, 200.0]]


def test_points_without_names_in_the_order_of_the_plan(campaign: Campaign) -> None:
    plan = str(campaign.folder / "plan.csv")
    run(campaign, str(samples.unnamed(campaign)), "-p", plan, "--match", "order")
    the_same(campaign)


def test_a_table_to_fill_in_says_the_order(campaign: Campaign) -> None:
    """Every state of every visit, half loads and repeats too, comes back where the table has it."""
    table = campaign.folder / "sheet.csv"
    protocol = make_protocol(campaign.experiment, campaign.plan, ProtocolOptions(repeat_share=0.4))
    write_reading_file(table, protocol)
    at = {(r.pose, r.marker, r.loaded): r.mm for r in campaign.readings}
    lines = table.read_text().splitlines()
    header = lines[1].split(",")
    rows = [dict(zip(header, line.split(","), strict=True)) for line in lines[2:]]
    found = [at[r["pose"], r["marker"], r["state"] == "loaded"] for r in rows]
    points = campaign.write(
        "xyz.csv", samples.lines([["X mm", "Y mm", "Z mm"], *([repr(v) for v in p] for p in found)])
    )
    run(campaign, str(points), "-p", str(table), "--match", "order")
    for row, place in zip(rows, found, strict=True):
        row |= dict(zip(("x_mm", "y_mm", "z_mm"), map(repr, place), strict=True))
    filled = campaign.write("filled.csv", samples.lines([header, *(list(r.values()) for r in rows)]))
    one, two = (read_readings(p, campaign.experiment, "positions") for p in (campaign.folder / "imported.csv", filled))
    equal(one, two)
    assert one.states.load_id == two.states.load_id
    assert one.drive_state == two.drive_state
    named = [f"{r['pose']} {r['marker']} {_state(r)} r{r['repeat']} c{r['cycle']}" for r in rows]
    head = [["name", "X mm", "Y mm", "Z mm"], *([n, *map(repr, p)] for n, p in zip(named, found, strict=True))]
    run(campaign, str(campaign.write("named.csv", samples.lines(head))), "-p", str(table))
    equal(read_readings(campaign.folder / "imported.csv", campaign.experiment, "positions"), two)


def _state(row: dict[str, str]) -> str:
    return "half" if row["load_id"].startswith("half") else row["load_id"] or "unloaded"


def test_points_nearest_to_what_is_predicted(campaign: Campaign) -> None:
    known, seen = known_points(campaign, FLOOR)
    files = [samples.half_named(campaign, s) for s in ("loaded", "unloaded")]
    files[1].write_text(files[1].read_text() + seen)
    out = campaign.folder / "found.json"
    stated = ("--match", "nearest", "--align", str(known), "--json", str(out))
    run(campaign, *map(str, files), "-p", str(campaign.folder / "plan.csv"), *stated)
    found = read_readings(campaign.folder / "imported.csv", campaign.experiment, "positions")
    told = {(r.pose, r.marker, r.loaded): r.mm for r in campaign.readings}
    assert len(found) == len(told)
    for i, s in enumerate(found.plus.tolist()):
        marker = campaign.experiment.markers[int(found.marker[i])].name
        assert 1e3 * found.value[i] == pytest.approx(
            told[found.pose[i], marker, bool(found.states.loaded[s])], abs=1e-9
        )
    (frame,) = json.loads(out.read_text())["frames"]
    assert np.abs(np.array(frame["rotation"]) - FRAME.rotation).max() < 1e-6
    assert np.abs(np.array(frame["origin"]) - FRAME.origin).max() < 1e-6


@pytest.mark.parametrize("make", [samples.kuka_log, samples.ros_log])
def test_a_log_is_joined_by_time(make, campaign: Campaign) -> None:
    points = samples.tracker_pilot(campaign)
    run(campaign, str(points), str(make(campaign)), "-p", str(campaign.folder / "plan.csv"), "--join", "time")
    the_same(campaign, "time_s", "temperature_degC")


def test_a_log_is_joined_by_its_names_without_a_plan(campaign: Campaign) -> None:
    """What hung there only a plan says: unloaded points need none."""
    own = [r for r in campaign.readings if not r.loaded]
    rows = [[f"{r.pose} {r.marker}", *map(repr, r.mm)] for r in own]
    points = campaign.write("points.csv", samples.lines([["point", "X/mm", "Y/mm", "Z/mm"], *rows]))
    printed = run(campaign, str(points), str(samples.fanuc_log(campaign)), "--state", "unloaded")
    assert "by the names of its rows" in printed
    found = read_readings(campaign.folder / "imported.csv", campaign.experiment, "positions")
    truth = read_readings(campaign.truth(), campaign.experiment, "positions")
    assert np.array_equal(found.value, truth.value[~truth.states.loaded[truth.plus]])
    assert np.abs(np.rad2deg(found.poses.pendant) - DEGREES).max() < 1e-11


@pytest.mark.parametrize("make", [samples.fanuc_positions, samples.kuka_positions])
def test_taught_positions_are_a_log(make: Callable[[Campaign], Path], campaign: Campaign) -> None:
    points = samples.polyworks(campaign)
    printed = run(campaign, str(points), str(make(campaign)), "-p", str(campaign.folder / "plan.csv"))
    assert "6 positions of a controller's programme" in printed
    the_same(campaign)


@pytest.mark.parametrize("to", ["fanuc-ls", "krl", "rapid", "urscript"])
def test_an_exported_programme_is_a_log(to: str, campaign: Campaign) -> None:
    points, plan = samples.polyworks(campaign), campaign.folder / "plan.csv"
    printed = run(campaign, str(points), str(samples.exported(campaign, to)), "-p", str(plan))
    assert "6 positions of a controller's programme" in printed
    found = read_readings(campaign.folder / "imported.csv", campaign.experiment, "positions")
    truth = read_readings(campaign.truth(), campaign.experiment, "positions")
    assert found.pose == truth.pose
    assert np.array_equal(found.value, truth.value)
    assert np.abs(np.rad2deg(found.poses.pendant - truth.poses.pendant)).max() < 1e-5


def test_a_log_is_joined_by_order(campaign: Campaign) -> None:
    rows = [[str(v) for v in d] for d in DEGREES]
    log = campaign.write("log.csv", samples.lines([["A1", "A2", "A3", "A4", "A5", "A6"], *rows]))
    stated = ("--join", "order", "--unit", "deg")
    run(campaign, str(samples.polyworks(campaign)), str(log), "-p", str(campaign.folder / "plan.csv"), *stated)
    the_same(campaign)


def test_angles_beside_the_points(campaign: Campaign) -> None:
    """One table of points and angles, as a script writes it, needs neither plan nor log."""
    own = [r for r in campaign.readings if not r.loaded]
    head = ["target", "x_m", "y_m", "z_m", *(f"joint_{k}_deg" for k in range(1, 7))]
    rows = [[f"{r.pose}-{r.marker}", *(repr(v / 1e3) for v in r.mm), *map(repr, r.degrees)] for r in own]
    points = campaign.write("all.csv", samples.lines([head, *rows], "\t"))
    run(campaign, str(points), "--state", "unloaded")
    found = read_readings(campaign.folder / "imported.csv", campaign.experiment, "positions")
    assert np.array_equal(np.round(1e3 * found.value, 9), np.array([r.mm for r in own]))
    assert set(found.pose) == {r.pose for r in own}


@pytest.mark.parametrize("columns", ["states", "displacements"])
def test_a_table_of_ours_that_a_spreadsheet_saved(columns: str, campaign: Campaign) -> None:
    truth = campaign.truth()
    if columns == "displacements":
        head = [
            "pose",
            *(f"q{k}_deg" for k in range(1, 7)),
            "fx_N",
            "fy_N",
            "fz_N",
            "marker",
            "dx_mm",
            "dy_mm",
            "dz_mm",
        ]
        rows = [
            [p, *map(str, d), "0", "0", "-4000", "m1", "0.125", "0.01", "-2.5"]
            for p, d in zip(campaign.plan.pose, DEGREES, strict=True)
        ]
        truth.write_text(samples.lines([head, *rows]))
    kept = read_readings(truth, campaign.experiment, "positions")
    text = truth.read_text().replace(",", ";").replace(".", ",")
    spoiled = campaign.write("excel.csv", text, "cp1252")
    with pytest.raises(InputError, match="qsf import"):
        read_readings(spoiled, campaign.experiment)
    run(campaign, str(spoiled))
    found = read_readings(campaign.folder / "imported.csv", campaign.experiment, "positions")
    assert np.array_equal(found.value, kept.value)


def test_the_frame_of_the_unloaded_readings_is_as_sure_as_it_says(campaign: Campaign) -> None:
    """Shift and turn lie within their standard deviations, over campaigns of other noise."""
    rng, pulls = np.random.default_rng(0), []
    points = samples.polyworks(campaign)
    text = points.read_text().splitlines()
    for _ in range(60):
        rows = [row.split("\t") for row in text[3:]]
        for row in rows:
            row[4:7] = [f"{float(v) + 0.03 * e:.5f}" for v, e in zip(row[4:7], rng.standard_normal(3), strict=True)]
        points.write_text("\n".join([*text[:3], *("\t".join(row) for row in rows)]) + "\n")
        options = ImportOptions(columns={}, names={}, align="unloaded")
        (found,) = import_readings(campaign.experiment, [points], campaign.folder / "plan.csv", options).aligned
        shift = found.frame.origin - FRAME.origin
        pulls.append(shift / found.sd[:3])
    spread = float(np.sqrt(np.mean(np.square(np.array(pulls) - np.mean(pulls, axis=0)))))
    assert 0.5 < spread < 1.1, "the noise of the samples themselves is drawn once, that added here every time"


def test_what_was_taken_is_shown_before_anything_is_written(campaign: Campaign) -> None:
    out = campaign.folder / "found.json"
    plan = str(campaign.folder / "plan.csv")
    printed = run(campaign, str(samples.polyworks(campaign)), "-p", plan, "--look", "--json", str(out))
    assert not (campaign.folder / "imported.csv").exists()
    for words in (
        "Measured X",
        "Nominal X",
        "not used",
        "P01_m1_unloaded",
        "as the text above says",
        "angles as planned",
    ):
        assert words in printed
    told = json.loads(out.read_text())
    assert told["files"][0]["not_used"] == ["Nominal X", "Nominal Y", "Nominal Z", "Dev 3D"]
    assert len(told["points"]) == 24
    assert told["points"][0]["line"] == 4
    assert told["placed"][0]["rms"] < 2e-3


def test_what_has_no_point_or_is_left_out_is_said(campaign: Campaign) -> None:
    points = samples.half_named(campaign, "unloaded")
    rows = [[r.name, *map(str, r.mm)] for r in campaign.readings[:22]] + [["Floor1", "1", "2", "3"]]
    points.write_text(samples.lines([["name", "x_mm", "y_mm", "z_mm"], *rows]))
    printed = run(campaign, str(points), "-p", str(campaign.folder / "plan.csv"), "--ignore", "Floor*")
    assert "2 readings of the plan have no point: pose p06, marker m1, loaded; pose p06, marker m2, loaded" in printed
    assert "ignored as requested: Floor1" in printed


def test_a_stray_tab_or_blank_is_none_of_the_table(campaign: Campaign) -> None:
    """As numpy.loadtxt reads it."""
    rows = [["name", "x_mm", "y_mm", "z_mm"], *([r.name, *map(str, r.mm)] for r in campaign.readings)]
    text = ["\t".join(row) for row in rows]
    text[0] += "\t"
    text[3] += " \t"
    text[5] = "\t\t".join(rows[5])
    text[6] = " ".join(rows[6])
    points = campaign.write("points.txt", "\n".join(text) + "\n")
    run(campaign, str(points), "-p", str(campaign.folder / "plan.csv"))
    the_same(campaign)


def test_nests_that_are_guessed_are_allowed_for(campaign: Campaign) -> None:
    """A marker that lies nowhere else is not said to be where it is; the way that is named works."""
    rng, rows = np.random.default_rng(0), [["name", "x_mm", "y_mm", "z_mm"]]
    for r in campaign.readings:
        off = rng.normal(size=3) * (r.marker == "m2" and r.pose in ("p02", "p03"))
        rows.append([r.name, *(f"{v:.4f}" for v in np.add(r.mm, 60.0 * off / (np.linalg.norm(off) or 1.0)))])
    points, plan = str(campaign.write("points.csv", samples.lines(rows))), str(campaign.folder / "plan.csv")
    with pytest.raises(AssertionError, match=r"allow for it") as refused:
        run(campaign, points, "-p", plan)
    assert "It lies where" not in str(refused.value)
    run(campaign, points, "-p", plan, "--within", "80")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("columns: {x: Ost}\nunits: [mm, furlong]\n", "mapping.yaml, line 2: two units of one kind are stated"),
        ("units: [mm]\ncolumns:\n  x: Nowhere\n", r"mapping.yaml, line 3: no column is called 'Nowhere' \(.*points"),
        ("units: [mm]\ncolumns:\n  foo: Ost\n", "mapping.yaml, line 3: no column can be taken as this; found 'foo'"),
        ("units: [mm]\nnames:\n  WITH: heavy\n", "mapping.yaml, line 3: the word 'WITH' cannot mean this"),
    ],
)
def test_what_is_wrong_in_a_mapping_is_placed(campaign: Campaign, text: str, words: str) -> None:
    points = campaign.write("points.txt", "name;x;y;z\np01 m1;1;2;3\n")
    mapping = campaign.write("mapping.yaml", text)
    plan = str(campaign.folder / "plan.csv")
    with pytest.raises(AssertionError, match=words):
        run(campaign, str(points), "-p", plan, "--mapping", str(mapping))


def test_a_mapping_is_kept_in_a_file(campaign: Campaign) -> None:
    mapping = campaign.write(
        "mapping.yaml", "columns: {name: Label1, x: Ost, y: Nord, z: Up}\nunits: [mm]\nnames: {WITH: loaded}\n"
    )
    rows = [[f"{r.pose} {r.marker} {'with' if r.loaded else 'free'}", *map(str, r.mm)] for r in campaign.readings]
    points = campaign.write("points.csv", samples.lines([["Label1", "Ost", "Nord", "Up"], *rows]))
    run(campaign, str(points), "-p", str(campaign.folder / "plan.csv"), "--mapping", str(mapping))
    the_same(campaign)


def test_a_workbook_without_openpyxl_says_what_to_install(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    path = samples.workbook(campaign)
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(InputError, match=r"pip install '\.\[excel\]'"):
        import_readings(campaign.experiment, [path], campaign.folder / "plan.csv")


def test_what_somebody_changed_is_not_replaced(campaign: Campaign) -> None:
    points, plan = str(samples.polyworks(campaign)), str(campaign.folder / "plan.csv")
    run(campaign, points, "-p", plan)
    run(campaign, points, "-p", plan)
    written = campaign.folder / "imported.csv"
    written.write_text(written.read_text().replace("m2", "m1", 1))
    with pytest.raises(AssertionError, match="holds readings"):
        run(campaign, points, "-p", plan)


def test_two_stations_have_two_frames(campaign: Campaign) -> None:
    """A column of stations makes series; each is held against the arm by itself."""
    moved = Frame("B", FRAME.rotation @ FRAME.rotation, FRAME.origin + 1.0)
    rows = []
    for r in campaign.readings:
        first = r.pose in ("p01", "p02", "p03")
        base = (np.array(r.mm) / 1e3 - FRAME.origin) @ FRAME.rotation
        mm = r.mm if first else tuple((1e3 * moved.apply(base)).tolist())
        rows.append([r.name, "A" if first else "B", *map(repr, mm)])
    points = campaign.write("points.csv", samples.lines([["name", "Station", "x_mm", "y_mm", "z_mm"], *rows]))
    options = ImportOptions(columns={}, names={}, align="unloaded")
    found = import_readings(campaign.experiment, [points], campaign.folder / "plan.csv", options)
    assert found.readings.frames == ("A", "B")
    assert [p.count for p in found.placed] == [12, 12]
    assert [a.frame.series for a in found.aligned] == ["A", "B"]
    assert np.abs(found.aligned[1].frame.origin - moved.origin).max() < 5e-4
