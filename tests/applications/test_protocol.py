"""The protocol: what is measured when; and what the filled-in table says before any fit."""

from __future__ import annotations

import csv
import hashlib
import itertools
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from qsf_day.options import ProtocolOptions
from qsf_day.protocol import (
    Protocol,
    make_protocol,
    write_floor_file,
    write_reading_file,
)
from qsf_day.sheet import Commands, SheetFiles, write_sheet
from qsf_day.sketch import hull, sketches
from qsframework.cli.app import app
from qsframework.diagnoses import diagnose
from qsframework.elastostatics import Site
from qsframework.errors import InputError
from qsframework.experiment import (
    Experiment,
    Plan,
    Readings,
    differences,
    floor_file,
    load_experiment,
    make_plan,
    read_readings,
    write_plan,
)
from qsframework.fits import identify, read_fit, write_fit
from qsframework.fits.soundness import check_fit
from qsframework.plans.ordering import with_repeats
from qsframework.plans.programme import make_programme
from qsframework.plugin import Array, Poses
from qsframework.report.words.fit import first_words
from qsframework.report.words.headline import headline
from qsframework.robot import load_robot
from qsframework.screening.closure import ClosureCheck, check_states
from qsframework.uses.inverse import rigid_tip
from tests.headless import browser, open_page

PULL = np.array([0.0, 1500.0, -4000.0, 0.0, 0.0, 0.0])
SIGMA = 3e-5
"""sd of one coordinate of one position, m, as the experiment states it."""


@pytest.fixture(scope="module")
def plan(m900ib: Experiment) -> Plan:
    low, high = np.deg2rad([[-170, -30, -60, -170, 25, -170], [170, 60, 10, 170, 110, 170]])
    pendant = np.random.default_rng(1).uniform(low, high, (12, 6))
    wrench = np.tile(PULL, (12, 1))
    return make_plan(Poses(pendant, m900ib.robot.controller.to_joints(pendant), wrench), ["pull"] * 12)


@pytest.fixture(scope="module")
def protocol(m900ib: Experiment, plan: Plan) -> Protocol:
    return make_protocol(m900ib, plan)


Spoil = Callable[[dict[str, str], Array, Array, int], Array]
"""What a row of the file reads: from the row, its unloaded and its right position and its number."""


def right(row: dict[str, str], unloaded: Array, place: Array, number: int) -> Array:
    return place


def fill(
    experiment: Experiment, protocol: Protocol, folder: Path, spoil: Spoil = right, seed: int = 0, text: str = ""
) -> Path:
    """The table filled in by a simulated day."""
    path = folder / "readings.csv"
    write_reading_file(path, protocol)
    lines = path.read_text().splitlines()
    table = list(csv.DictReader(lines[1:]))
    rng = np.random.default_rng(seed)
    pendant = np.deg2rad([[float(r[f"q{k}_deg"]) for k in range(1, 7)] for r in table])
    forces = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
    wrench = np.array([[float(r[f] or 0.0) for f in forces] for r in table])
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench)
    names = [m.name for m in experiment.markers]
    marker = [names.index(r["marker"]) for r in table]
    model, every = experiment.model(), np.arange(len(table))
    unloaded, loaded = (model.positions(poses, loaded=state)[every, marker] for state in (False, True))
    for i, row in enumerate(table):
        place = loaded[i] if row["state"] == "loaded" else unloaded[i]
        place = spoil(row, unloaded[i], place, i) + SIGMA * rng.standard_normal(3)
        row["x_mm"], row["y_mm"], row["z_mm"] = (repr(float(v) * 1e3) for v in place)
    with path.open("w") as stream:
        stream.write(lines[0] + "\n")
        writer = csv.DictWriter(stream, table[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)
    return path


def read_states(path: Path, experiment: Experiment) -> Readings:
    return read_readings(path, experiment, states="positions")


def checks(experiment: Experiment, path: Path) -> dict[str, ClosureCheck]:
    found = check_states(experiment, read_states(path, experiment))
    return {f"{c.kind} {c.words.split(':')[0]}" if c.kind == "hysteresis" else c.kind: c for c in found}


def test_the_order_of_the_day(m900ib: Experiment, plan: Plan, protocol: Protocol) -> None:
    assert len(protocol.repeated) == 3, "20 % of twelve, rounded up"
    assert len(protocol.visits) == 15
    assert all(a.pose != b.pose for a, b in itertools.pairwise(protocol.visits))
    for visit in protocol.visits:
        kinds = [(s.cycle, s.load_id) for s in visit.states]
        plain = [(1, ""), (1, "pull"), (2, ""), (2, "pull"), (3, "")]
        halves = [(1, ""), (1, "half of pull"), (1, "pull"), (2, ""), (2, "half of pull"), (2, "pull"), (3, "")]
        assert kinds == (halves if visit.pose in protocol.repeated else plain)
    order = [v.pose for v in protocol.visits]
    assert [v.pose for v in make_protocol(m900ib, plan).visits] == order
    assert [v.pose for v in make_protocol(m900ib, plan, ProtocolOptions(seed=1)).visits] != order
    kept = make_protocol(m900ib, replace(plan, repeats=(3,) * 4 + (1,) * 8))
    assert len(kept.visits) == 4 * 3 + 8, "the plan has its own repeats"


@pytest.mark.parametrize("order", ["random", "plan", "shortest"])
def test_the_exported_programme_drives_in_the_order_of_the_sheet(m900ib: Experiment, plan: Plan, order: str) -> None:
    options = ProtocolOptions(order=order, seed=3)
    programme = make_programme(m900ib, with_repeats(plan, options.repeat_share, 3), order, 3)
    stops = [(m.pose, m.repeat) for m in programme.moves if m.measured]
    assert stops == [(v.pose, v.repeat) for v in make_protocol(m900ib, plan, options).visits]


def test_the_table_is_in_the_measured_order(protocol: Protocol, tmp_path: Path) -> None:
    write_reading_file(tmp_path / "r.csv", protocol)
    lines = (tmp_path / "r.csv").read_text().splitlines()
    table = list(csv.DictReader(lines[1:]))
    assert lines[0] == "# robot: fanuc_m900ib"
    assert len(table) == protocol.readings
    said = [
        (v.pose, str(v.repeat), str(s.cycle), s.load_id, m)
        for v in protocol.visits
        for s in v.states
        for m in protocol.markers
    ]
    assert [(r["pose"], r["repeat"], r["cycle"], r["load_id"], r["marker"]) for r in table] == said
    assert all(r["x_mm"] == r["y_mm"] == r["z_mm"] == r["time_s"] == "" for r in table)
    assert {r["drive_state"] for r in table} == {"servo"}
    floor = floor_file(tmp_path / "r.csv")
    write_floor_file(floor, protocol)
    assert floor.name == "r_floor.csv"
    assert len(floor.read_text().splitlines()) == 2 + 3 * len(protocol.visits)


def test_a_good_day_is_read_and_fitted(m900ib: Experiment, protocol: Protocol, tmp_path: Path) -> None:
    """Columns that nobody filled in count as absent; the differences give the parameters back."""
    path = fill(m900ib, protocol, tmp_path)
    states = read_states(path, m900ib)
    assert states.poses.loaded.time is None
    readings = differences(states, m900ib)
    assert len(readings.use) == sum(sum(s.loaded for s in v.states) for v in protocol.visits) * 3
    fit = identify(m900ib, readings)
    x = dict(zip(m900ib.model().names, m900ib.model().nominal, strict=True))
    assert all(abs(e.value - x[e.name]) < 4.5 * e.sd for e in fit.estimates)
    found = checks(m900ib, path)
    missing = found.pop("floor")
    assert missing.good is None
    assert missing.words == "no readings_floor.csv beside the readings, with the reflectors on the floor"
    assert set(found) == {
        "repeatability",
        "closure",
        "hysteresis first cycle",
        "hysteresis later cycles",
        "linearity",
        "drive state",
    }
    assert all(c.good for c in found.values())


def test_good_days_are_hardly_ever_blamed(m900ib: Experiment, protocol: Protocol, tmp_path: Path) -> None:
    """Forty days with nothing but the stated noise; each test may blame one in a thousand."""
    blamed = 0
    for seed in range(40):
        found = checks(m900ib, fill(m900ib, protocol, tmp_path, seed=seed))
        blamed += sum(c.good is False for c in found.values())
        sd = found["repeatability"].numbers["sd_mm between cycles of a visit"]
        assert sd == pytest.approx(0.03 * np.sqrt(2.0), rel=0.25)
    assert blamed <= 1


def drifting(row: dict[str, str], unloaded: Array, place: Array, number: int) -> Array:
    """The tracker creeps by five micrometres from one reading to the next."""
    return place + np.array([0.0, 0.0, 5e-6 * number])


def sticking(row: dict[str, str], unloaded: Array, place: Array, number: int) -> Array:
    """Five percent of about 2 mm stay after the first unloading."""
    return place + (np.array([0.0, 0.0, -1e-4]) if int(row["cycle"]) > 1 else 0.0)


def hardening(row: dict[str, str], unloaded: Array, place: Array, number: int) -> Array:
    """Half the load gives a tenth more than half the deflection."""
    return unloaded + (1.1 if row["load_id"].startswith("half") else 1.0) * (place - unloaded)


def loose(row: dict[str, str], unloaded: Array, place: Array, number: int) -> Array:
    """The weight swings: every loaded reading errs on its own."""
    moved = 1e-4 * np.random.default_rng(number).standard_normal(3)
    return place + (moved if row["state"] == "loaded" else 0.0)


@pytest.mark.parametrize(
    ("spoil", "blamed", "words"),
    [
        (drifting, "closure", "the tracker or the base drifts"),
        (sticking, "hysteresis first cycle", "of the deflection stays after unloading. Preload once more"),
        (hardening, "linearity", "% more than 50 % of the deflection .*not linear"),
        (loose, "repeatability", "between cycles of a visit .*the noise alone gives 0.0424 mm.*settle longer"),
    ],
)
def test_a_bad_day_is_told(
    m900ib: Experiment, protocol: Protocol, tmp_path: Path, spoil: Spoil, blamed: str, words: str
) -> None:
    found = checks(m900ib, fill(m900ib, protocol, tmp_path, spoil))
    assert found[blamed].good is False
    assert re.search(words, found[blamed].said)
    if spoil is hardening:
        numbers = found["linearity"].numbers
        assert numbers["share"] == pytest.approx(0.1, abs=4 * numbers["sd"])
        assert found["closure"].good
    if spoil is sticking:
        assert found["hysteresis later cycles"].good


def test_a_bad_day_travels_with_the_fit_as_a_note(m900ib: Experiment, protocol: Protocol, tmp_path: Path) -> None:
    """identify and diagnose begin with it, whatever uses the fit repeats it and goes on; it cannot be taken out."""
    path = fill(m900ib, protocol, tmp_path, sticking)
    readings = read_readings(path, m900ib)
    assert not readings.is_position.any(), "read as differences, which hold no return to zero"
    fit = identify(m900ib, readings)
    notes = [f for f in fit.account.findings if f.name == "hysteresis"]
    assert [f.words.partition(":")[0] for f in notes] == ["first cycle"]
    assert not fit.account.stopping
    assert any(line.startswith("Look at hysteresis: first cycle") for line in first_words(fit))
    found = diagnose(m900ib, readings, largest=0, repeats=1)
    assert headline(found).startswith("Look first at the ")
    assert "hysteresis: first cycle" in headline(found)
    kept = read_fit(write_fit(fit, tmp_path / "fit.json"))
    assert any(note.startswith("hysteresis: first cycle") for note in check_fit(kept, m900ib.robot, m900ib, readings))
    without = replace(kept, account=replace(kept.account, findings=()))
    with pytest.raises(InputError, match="what was found wrong in its readings and files"):
        check_fit(without, m900ib.robot, m900ib, readings)


def test_the_hysteresis_is_the_share_that_stays(m900ib: Experiment, protocol: Protocol, tmp_path: Path) -> None:
    """Three percent of each load's own deflection stay after it, in every cycle."""

    def stays(row: dict[str, str], unloaded: Array, place: Array, number: int) -> Array:
        if row["state"] == "loaded":
            deflection[row["pose"], row["marker"]] = place - unloaded  # the full load is the last one
        left = deflection.get((row["pose"], row["marker"]), np.zeros(3))
        return place + 0.03 * (int(row["cycle"]) - 1) * left

    deflection: dict[tuple[str, str], Array] = {}
    found = checks(m900ib, fill(m900ib, protocol, tmp_path, stays))
    for name in ("hysteresis first cycle", "hysteresis later cycles"):
        numbers = found[name].numbers
        assert numbers["share"] == pytest.approx(0.03, abs=4 * numbers["sd"])
        assert numbers["sd"] < 0.01
        assert found[name].good is False


def test_the_floor(m900ib: Experiment, protocol: Protocol, tmp_path: Path) -> None:
    """A tripod that was kicked between two visits shows in the reflectors on the floor, and only there."""
    path = fill(m900ib, protocol, tmp_path)
    places = {f"floor_{k}": 1e3 * np.array([k, 2.0 - k, 0.0]) for k in (1, 2, 3)}
    for kick, good in ((0.0, True), (0.3, False)):
        rng = np.random.default_rng(2)
        write_floor_file(floor_file(path), protocol)
        lines = floor_file(path).read_text().splitlines()
        table = list(csv.DictReader(lines[1:]))
        for row in table:
            place = places[row["reflector"]] + 1e3 * SIGMA * rng.standard_normal(3)
            place[0] += kick if int(row["visit"]) > 9 else 0.0
            row["x_mm"], row["y_mm"], row["z_mm"] = map(repr, place.tolist())
        body = [",".join(table[0]), *(",".join(row.values()) for row in table)]
        floor_file(path).write_text("\n".join([lines[0], *body]) + "\n")
        floor = checks(m900ib, path)["floor"]
        assert floor.good is good
    assert "start a new series there" in floor.said
    assert floor.numbers["largest_mm"] == pytest.approx(0.3, abs=0.15)
    floor_file(path).write_text("visit,reflector,x_mm,y_mm,z_mm\n1,floor_1,1,2,oops\n")
    with pytest.raises(InputError, match=r"readings_floor.csv, line 2, column z_mm: cannot be used; found 'oops'"):
        checks(m900ib, path)


def test_drive_states(m900ib: Experiment, protocol: Protocol, tmp_path: Path) -> None:
    """Two arms in one reading are an error; two arms on one day are told."""
    path = fill(m900ib, protocol, tmp_path)
    lines = path.read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if ",loaded," in line)
    wrong = [*lines]
    wrong[first] = wrong[first].replace("servo", "brake")
    path.write_text("\n".join(wrong))
    words = rf"line {first + 1}, column drive_state: the loaded state was read .* 'brake', .*line 3\) in 'servo'"
    for look in (lambda s: check_states(m900ib, s), lambda s: differences(s, m900ib)):
        with pytest.raises(InputError, match=words):
            look(read_states(path, m900ib))
    pose = protocol.visits[0].pose
    path.write_text("\n".join(x.replace("servo", "brake") if x.startswith(f"{pose},") else x for x in lines))
    found = checks(m900ib, path)["drive state"]
    assert found.good is False
    assert "fit them apart" in found.said
    path.write_text("\n".join(x.replace("servo", "") for x in lines))
    assert checks(m900ib, path)["drive state"].good is None


def test_what_was_not_measured_is_said(m900ib: Experiment, plan: Plan, tmp_path: Path) -> None:
    bare = make_protocol(m900ib, plan, ProtocolOptions(cycles=1, repeat_share=0.0, half=False))
    path = fill(m900ib, bare, tmp_path)
    lines = path.read_text().splitlines()
    keep = [i for i, row in enumerate(csv.DictReader(lines[1:]), start=2) if row["cycle"] == "1"]
    path.write_text("\n".join([*lines[:2], *(lines[i] for i in keep)]))
    found = checks(m900ib, path)
    for kind in ("repeatability", "closure", "linearity"):
        assert found[kind].good is None
    assert "end each visit unloaded" in found["closure"].words


def test_wrong_wishes(m900ib: Experiment, plan: Plan) -> None:
    with pytest.raises(InputError, match=r"unknown drive 'off'; allowed: servo, brake"):
        make_protocol(m900ib, plan, ProtocolOptions(drive="off"))
    with pytest.raises(InputError, match=r"repeat share; found 1.5; allowed: 0 to 1"):
        make_protocol(m900ib, plan, ProtocolOptions(repeat_share=1.5))
    with pytest.raises(InputError, match=r"F: no load at p01, p02"):
        make_protocol(m900ib, replace(plan, wrench=np.zeros((12, 6))), file="F")
    with pytest.raises(InputError, match=r"pose 'p01': the load is above the wrist's payload"):
        make_protocol(m900ib, replace(plan, wrench=2 * plan.wrench))


def test_a_card_for_each_visit(m900ib: Experiment, plan: Plan, tmp_path: Path) -> None:
    """In the order of the day, with its picture, angles, force and states; names of files and loads are escaped."""
    named = replace(plan, load=tuple("<b>pull" for _ in plan.load))
    protocol = make_protocol(m900ib, named)
    page = sheet_of(m900ib, protocol, tmp_path)
    cards = re.findall(r'<div class="visit">(.*?)</table>\n</div>\n</div>', page, re.DOTALL)
    assert len(cards) == len(protocol.visits) == page.count("<svg ")
    assert "<b>pull" not in page
    for card, visit in zip(cards, protocol.visits, strict=True):
        assert f"Visit {visit.number}: {visit.pose}" in card
        assert [f"{a:.2f}" for a in np.rad2deg(visit.pendant)] == re.findall(r"<td>(-?[\d.]+)</td>", card)
        assert "&lt;b&gt;pull" in card
        assert "0, 1500, -4000 N" in card
        states = re.findall(r"<td>((?:unloaded|loaded|half load) \d)</td>", card)
        assert [s.partition(" ")[0] == "unloaded" for s in states] == [not s.loaded for s in visit.states]
    loads = re.findall(r"(src|href)=", page)
    assert loads == [], "nothing is loaded"


def sheet_of(experiment: Experiment, protocol: Protocol, folder: Path) -> str:
    pendant = np.stack([v.pendant for v in protocol.visits])
    force = np.stack([v.wrench[:3] for v in protocol.visits])
    pictures = sketches(experiment.robot, experiment.load_site, pendant, force)
    files = SheetFiles("r.csv", "f.csv", (experiment.path,))
    return write_sheet(folder / "s.html", protocol, pictures, files, Commands("a", "b", "c")).read_text()


def test_pages_break_between_loads(m900ib: Experiment, plan: Plan, tmp_path: Path) -> None:
    """Loads that come in blocks begin a page each; mixed ones, as in a random order, fill the pages."""
    two = replace(plan, load=("a",) * 8 + ("b",) * 4)
    day = make_protocol(m900ib, two, ProtocolOptions(order="plan", repeat_share=0.0))
    page = sheet_of(m900ib, day, tmp_path)
    sections = re.findall(r'<section[^>]* class="load( new-page)?">\n<h2>Load: (\w)</h2>', page)
    assert sections == [(" new-page", "a"), (" new-page", "b")]
    mixed = replace(plan, load=("a", "b") * 6)
    day = make_protocol(m900ib, mixed, ProtocolOptions(order="plan", repeat_share=0.0))
    sections = re.findall(r'<section[^>]* class="load( new-page)?">', sheet_of(m900ib, day, tmp_path))
    assert sections == [" new-page", *[""] * 11]


@browser
def test_the_sheet_on_paper(m900ib: Experiment, plan: Plan, tmp_path: Path) -> None:
    """A4; the instructions on one page, four or five visits on each of the others, then what comes after."""
    sheet_of(m900ib, make_protocol(m900ib, plan), tmp_path)
    printed = tmp_path / "sheet.pdf"
    open_page(tmp_path / "s.html", tmp_path, "--no-pdf-header-footer", f"--print-to-pdf={printed}")
    pages = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", printed.read_bytes())
    assert {(round(float(w)), round(float(h))) for w, h in pages} == {(595, 842)}
    assert 4 <= len(pages) <= 7


def test_the_pictures_show_the_pose(m900ib: Experiment, protocol: Protocol) -> None:
    """The arrow begins where the load point is: seen from the same side, at the same scale for all poses."""
    robot, site = m900ib.robot, m900ib.load_site
    pendant = np.stack([v.pendant for v in protocol.visits])
    force = np.tile([0.0, 0.0, -4000.0], (len(pendant), 1))
    drawn = sketches(robot, site, pendant, force)
    assert len({re.search(r'viewBox="[^"]*"', d)[0] for d in drawn}) == 1
    tip = rigid_tip(robot, site, robot.controller.to_joints(pendant)).position
    azimuth, elevation = np.deg2rad([-55.0, 18.0])
    towards = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    seen = np.stack([tip @ right, tip @ np.cross(towards, right)], axis=1)
    ends, origins = [], []
    for picture in drawn:
        lines = re.findall(r'<polyline points="([-\d., ]+)" style="([^"]*)"', picture)
        arrow = next(p for p, style in lines if "#b00" in style)
        ends.append([float(v) for v in arrow.split()[0].split(",")])
        origins.append([float(v) for v in lines[0][0].split()[0].split(",")])
    away = (np.array(ends) - np.array(origins)) * [1.0, -1.0]
    scale = float((away * seen).sum() / (seen * seen).sum())
    assert np.abs(away - scale * seen).max() < 0.3, "units of a picture of 200"
    bare = sketches(load_robot("ur10"), Site(6, np.zeros(3)), np.zeros((1, 6)), np.zeros((1, 3)))
    assert "#b00" not in bare[0], "no load, no arrow"


@pytest.mark.parametrize("seed", range(5))
def test_the_outline_of_a_solid(seed: int) -> None:
    """Every point lies inside it, and it has no more corners than it needs."""
    points = np.random.default_rng(seed).normal(size=(30, 2))
    outline = hull(points)
    for a, b in itertools.pairwise([*outline, outline[0]]):
        side = (b[0] - a[0]) * (points[:, 1] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0])
        assert side.min() > -1e-12
    assert {tuple(p) for p in outline} <= {tuple(p) for p in points}


def test_the_commands(m900ib: Experiment, plan: Plan, tmp_path: Path) -> None:
    write_plan(tmp_path / "plan.csv", plan, m900ib)
    sheet, readings = tmp_path / "sheet.html", tmp_path / "readings.csv"
    experiment = tmp_path / "experiment.yaml"
    experiment.write_text(m900ib.path.read_text() + "\ndata: readings.csv\n")
    arguments = ["protocol", str(experiment), str(tmp_path / "plan.csv"), "-o", str(sheet), "--readings", str(readings)]
    run = CliRunner().invoke(app, [*arguments, "--drive", "brake"], catch_exceptions=False)
    assert run.exit_code == 0
    assert "15 visits" in run.output
    page = sheet.read_text()
    words = "Warm-up: 30 min|Preload: at pose|Drive state while reading: brake|Wait 30 s|People clear|3 reflectors|"
    words += (
        "The weight never travels with the arm|The order is random|repeat 2|half load 1|\u2610|Nobody stands in the"
    )
    for word in words.split("|"):
        assert word in page, word
    assert "How this was computed" not in page
    for file in (experiment, tmp_path / "plan.csv"):
        assert f"{file.name} {hashlib.sha256(file.read_bytes()).hexdigest()[:12]}" in page
    assert "seed 0" in page
    assert floor_file(readings).is_file()
    unfilled = CliRunner().invoke(app, ["check", str(experiment)])
    assert isinstance(unfilled.exception, InputError)
    (problem,) = unfilled.exception.problems
    assert (problem.line, problem.column) == (3, "x_mm")
    assert re.search(r"\d+ rows are not filled in, of which this is the first", problem.message)
    assert "put 0 in the column use" in str(problem)
    campaign = load_experiment(experiment)
    floor_file(readings).unlink()
    fill(campaign, make_protocol(campaign, plan), tmp_path, hardening)
    told = CliRunner().invoke(app, ["check", str(experiment)], catch_exceptions=False)
    assert "look at what is marked with !" in told.output
    assert "! linearity: 50 % of a load gives" in told.output


def typed(file: Path, column: str, value: str, separator: str = ",") -> str:
    """Type a value into the first row of a table, as a spreadsheet saves it; the text."""
    lines = file.read_text().splitlines()
    comments, (header, first, *rest) = [s for s in lines if s[0] == "#"], [s for s in lines if s[0] != "#"]
    cells = first.split(",")
    cells[header.split(",").index(column)] = value
    file.write_text("\n".join([*comments, *(s.replace(",", separator) for s in (header, ",".join(cells), *rest)), ""]))
    return file.read_text()


def refused(arguments: list[str]) -> str:
    run = CliRunner().invoke(app, arguments)
    assert isinstance(run.exception, InputError)
    return str(run.exception)


def test_a_filled_day_is_never_replaced(m900ib: Experiment, plan: Plan, tmp_path: Path) -> None:
    """An untouched table is made anew; one position or one time, and it stays, and so does the sheet."""
    write_plan(tmp_path / "plan.csv", plan, m900ib)
    sheet, readings, named = tmp_path / "sheet.html", tmp_path / "readings.csv", str(m900ib.path)
    made = ["protocol", named, str(tmp_path / "plan.csv"), "-o", str(sheet), "--readings", str(readings)]
    for _ in range(2):
        assert CliRunner().invoke(app, made, catch_exceptions=False).exit_code == 0
    sheet.write_text("old")
    for file in (readings, floor_file(readings)):
        empty = file.read_text()
        for column, separator in (("x_mm", ","), ("z_mm", ";"), ("time_s", ",")):
            filled = typed(file, column, "12.5", separator)
            words = f"{file}: would be replaced, but holds readings; found 1 row with a position or a time filled in"
            assert refused(made) == f"{words}. Move it away, or name another file with --readings."
            assert (file.read_text(), sheet.read_text()) == (filled, "old")
            file.write_text(empty)
    readings.write_bytes(b"PK\x03\x04\xff")
    assert "would be replaced, and cannot be read as a table" in refused(made)
    readings.unlink()
    assert CliRunner().invoke(app, made, catch_exceptions=False).exit_code == 0


def test_a_simulation_replaces_only_simulated_readings(m900ib: Experiment, plan: Plan, tmp_path: Path) -> None:
    write_plan(tmp_path / "plan.csv", plan, m900ib)
    readings = tmp_path / "readings.csv"
    simulated = ["simulate", str(m900ib.path), str(tmp_path / "plan.csv"), "-o", str(readings)]
    for seed in ("1", "2"):
        assert CliRunner().invoke(app, [*simulated, "--seed", seed], catch_exceptions=False).exit_code == 0
    measured = typed(readings, "dx_mm", "1.25")
    assert "found 36 rows with a position or a time filled in. Move it away, or name another file with -o" in refused(
        simulated
    )
    assert readings.read_text() == measured
    filled = fill(m900ib, make_protocol(m900ib, plan), tmp_path).read_text()
    assert "holds readings" in refused(simulated)
    assert readings.read_text() == filled
