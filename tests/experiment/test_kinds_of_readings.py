"""Displacements, positions and gauges in one campaign: what is read, and what each mistake is told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from qsframework.errors import InputError
from qsframework.experiment import (
    Experiment,
    differences,
    example,
    load_experiment,
    observation_model,
    observations,
    read_readings,
    write_readings,
)
from qsframework.experiment.readings_file import suggested
from qsframework.plugin import Poses

BASE = """robot: fanuc_m900ib
load: {point_mm: [150, 0, 200]}
markers:
  m1: {xyz_mm: [150, 0, 200]}
  m2: {xyz_mm: [150, 100, 0]}
  base: {xyz_mm: [0, 0, 0], link: base_link}
"""
Q = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg"
FORCE = "fx_N,fy_N,fz_N"
DISPLACED = f"pose,{Q},{FORCE},marker,dx_mm,dy_mm,dz_mm"
STATES = f"pose,{Q},{FORCE},marker,state,x_mm,y_mm,z_mm,series"
A, B, C = "0,20,-10,0,40,0", "30,0,-20,50,60,0", "-60,40,-30,-80,70,10"
PULL = "0,0,-4000"


def experiment(folder: Path, noise: str = "{sigma_mm: 0.03}", more: str = "") -> Experiment:
    file = folder / "experiment.yaml"
    file.write_text(f"{BASE}noise: {noise}\n{more}")
    return load_experiment(file)


def table(folder: Path, name: str, header: str, *rows: str) -> Path:
    file = folder / name
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


def displaced(folder: Path, *rows: str, more: str = "") -> Path:
    """Rows of displacements in line 2 and after."""
    rows = rows or (f"A,{A},{PULL},m1,0.1,0.2,-2", f"B,{B},{PULL},m2,0.1,0.2,-2")
    return table(folder, "moved.csv", DISPLACED + more, *rows)


def placed(of: Experiment, folder: Path, poses: str = "ABC", load: bool = True, series: str = "S") -> Path:
    """The rigid arm's positions of m1, 2 mm lower under load, as the tracker at the base sees them."""
    rows = []
    for name in poses:
        q = {"A": A, "B": B, "C": C}[name]
        pendant = np.deg2rad([[float(v) for v in q.split(",")]])
        at = Poses(pendant, of.robot.controller.to_joints(pendant), np.zeros((1, 6)))
        place = 1e3 * of.model().positions(at, loaded=False)[0, 0]
        for state in ("unloaded", "loaded") if load else ("unloaded",):
            down = 2.0 if state == "loaded" else 0.0
            xyz = ",".join(repr(v) for v in (place - [0.0, 0.0, down]).tolist())
            rows.append(f"{name},{q},{PULL if down else ',,'},m1,{state},{xyz},{series}")
    return table(folder, "states.csv", STATES, *rows)


def refused(paths: Path | list[Path], of: Experiment, *words: str, states: str | None = None) -> InputError:
    with pytest.raises(InputError) as caught:
        read_readings(paths, of, states)
    for word in words:
        assert word in str(caught.value), str(caught.value)
    return caught.value


# ------------------------------------------------------------------------------------------ gauges

GAUGED = DISPLACED + ",gauge_mm,ux,uy,uz,to_marker"
BAD_GAUGES: dict[str, tuple[str, tuple[str, ...]]] = {
    "no direction": (",,,0.5,,,,", ("line 2, column gauge_mm", "has no direction", "Give ux, uy, uz", "or to_marker")),
    "direction of no length": (",,,0.5,0,0,0,", ("line 2, column gauge_mm", "has no direction")),
    "direction and marker": (",,,0.5,0,0,1,base", ("line 2", "has a direction and a marker to which it measures")),
    "beside a vector": ("0.1,0.1,0.1,0.5,0,0,1,", ("line 2", "a gauge and a vector stand in one row", "of its own")),
    "to itself": (",,,0.5,,,,m1", ("line 2, column to_marker", "a distance is to another marker")),
    "to a stranger": (",,,0.5,,,,bas", ("line 2, column to_marker", "no such marker", "Did you mean 'base'?")),
    "nothing measured": (",,,,,,,", ("line 2, column dx_mm", "not filled in", "put 0 in the column use")),
    "marker without a gauge": ("0.1,0.1,0.1,,,,,base", ("line 2, column to_marker", "belongs to a gauge")),
    "direction without a gauge": ("0.1,0.1,0.1,,0,0,1,", ("line 2, column ux", "belongs to a gauge", "gauge_mm")),
    "in words": (",,,half,0,0,1,", ("line 2, column gauge_mm", "'half'", "a finite number")),
}


@pytest.mark.parametrize("case", BAD_GAUGES)
def test_a_wrong_gauge_is_named(case: str, tmp_path: Path) -> None:
    cells, words = BAD_GAUGES[case]
    rows = (f"A,{A},{PULL},m1,{cells}", f"B,{B},{PULL},m1,,,,0.5,0,0,2,")
    refused(table(tmp_path, "moved.csv", GAUGED, *rows), experiment(tmp_path, "estimate"), "moved.csv", *words)


def test_a_gauge_is_read_along_its_direction_or_to_its_marker(tmp_path: Path) -> None:
    rows = (f"A,{A},{PULL},m1,,,,0.5,0,3,4,", f"A,{A},{PULL},m1,,,,-0.7,,,,base")
    found = read_readings(table(tmp_path, "g.csv", GAUGED, *rows), experiment(tmp_path))
    assert found.value[:, 0].tolist() == pytest.approx([5e-4, -7e-4])
    assert np.isnan(found.value[:, 1:]).all()
    assert found.axes is not None
    assert found.axes[0, 0] == pytest.approx([0.0, 0.6, 0.8])
    assert found.to.tolist() == [-1, 2]
    assert found.is_gauge.all()
    assert len(found.states) == 2, "two instruments at one visit: one loaded and one unloaded state"


def test_a_gauge_in_positions_needs_a_zero(tmp_path: Path) -> None:
    """Read at one state it says nothing; as differences it does, and a distance has a zero of its own."""
    of = experiment(tmp_path)
    head = f"pose,{Q},{FORCE},marker,state,gauge_mm,ux,uy,uz,to_marker"
    rows = (f"A,{A},,,,m1,unloaded,1.5,0,0,1,", f"A,{A},{PULL},m1,loaded,-0.5,0,0,1,")
    path = table(tmp_path, "gauge.csv", head, *rows)
    error = refused(path, of, f"{path}, line 2", "no zero", "states: differences", "to_marker", states="positions")
    assert [p.line for p in error.problems] == [2, 3], "each row, not the first alone"
    assert read_readings(path, of, "differences").value[0, 0] == pytest.approx(-2e-3)
    assert read_readings(path, of).value[0, 0] == pytest.approx(-2e-3), "both states, springs alone: differences"
    rows = (f"A,{A},,,,m1,unloaded,900,,,,base",)
    assert read_readings(table(tmp_path, "wire.csv", head, *rows), of).value[0, 0] == pytest.approx(0.9)


# ------------------------------------------------------------------------------------ single axes, frames


def test_single_axes_may_be_missing(tmp_path: Path) -> None:
    """A column or a cell; a row of which nothing is left is not filled in."""
    of = experiment(tmp_path)
    found = read_readings(displaced(tmp_path, f"A,{A},{PULL},m1,,0.2,-2", f"B,{B},{PULL},m1,,,-2"), of)
    assert np.isfinite(found.value).tolist() == [[False, True, True], [False, False, True]]
    assert len(observation_model(of, found).observations().measured) == 3
    refused(
        displaced(tmp_path, f"A,{A},{PULL},m1,,0.2,-2", f"B,{B},{PULL},m1,,,"),
        of,
        "moved.csv, line 3, column dx_mm",
        "this row is not filled in",
    )
    masked = displaced(tmp_path, f"A,{A},{PULL},m1,,0.2,-2,1", f"B,{B},{PULL},m1,,,,0", more=",use")
    assert read_readings(masked, of).use.tolist() == [True, False]


FRAME = "frames: {S: {xyz_mm: [100, 0, 0], quat_wxyz: [0.7071067811865476, 0, 0, 0.7071067811865476]}}\n"


def test_a_stated_frame_is_not_estimated(tmp_path: Path) -> None:
    """The same file: six unknowns of its frame, or none; and displacements are turned by it."""
    free, held = experiment(tmp_path), experiment(tmp_path, more=FRAME)
    path = placed(free, tmp_path)
    seen = observation_model(free, read_readings(path, free, "positions"))
    assert [f.series for f in seen.frames] == ["S"]
    known = observation_model(held, read_readings(path, held, "positions"))
    assert known.frames == ()
    assert [p.name for p in known.parameters] == list(held.fit_names())
    (frame,) = (f for f in known.rows.readings.known if f is not None)
    x = known.start
    there = known.rows.positions(known.model, known.values(x), linear=False)[known.rows._used[1], known.rows.marker]
    assert known.predict(x).reshape(-1, 3) == pytest.approx(frame.apply(there), abs=1e-12)
    assert frame.apply(np.array([1.0, 0.0, 0.0])) == pytest.approx([0.1, 1.0, 0.0])
    turned = read_readings(path, held, "differences")
    assert turned.alignments[0].turned
    assert turned.frame.tolist() == [0, 0, 0]
    other = placed(free, tmp_path, series="T")
    assert [f.series for f in observation_model(held, read_readings(other, held, "positions")).frames] == ["T"]


@pytest.mark.parametrize("series", ["S", ""])
@pytest.mark.parametrize("stated", [True, False])
def test_differences_of_a_turned_series_are_read_back_as_they_were(stated: bool, series: str, tmp_path: Path) -> None:
    """In the stated frame by its name; in one that was found, in the axes of the base."""
    of = experiment(tmp_path, more=FRAME if stated else "")
    seen = read_readings(placed(of, tmp_path, series=series), of, "positions")
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    found = differences(seen.with_values(seen.value @ turn.T + [0.1, 0.0, 0.0]), of)
    assert found.frame.tolist() == [0, 0, 0]
    write_readings(tmp_path / "back.csv", found, of)
    back = read_readings(tmp_path / "back.csv", of)
    named = stated and series == "S"
    assert back.frames == (("S",) if named else ())
    (frame,) = (f for f in found.known if f is not None)
    expected = found.value if named else found.value @ frame.rotation
    assert back.value == pytest.approx(expected, abs=1e-12)
    assert back.value == pytest.approx(np.tile([0.0, 0.0, -2e-3], (3, 1)), abs=2e-6)  # the rigid arm sags a little
    names = of.fit_names()
    one, other = (observation_model(of, r, names) for r in (found, back))
    said = [b.predict(b.start) for b in (one, other)]
    if not named:
        said[0] = (said[0].reshape(-1, 3) @ frame.rotation).ravel()
    assert said[1] == pytest.approx(said[0], abs=1e-12)
    if not named:
        partly = found.with_values(np.where([True, False, True], found.value, np.nan))
        with pytest.raises(InputError, match="cannot be written in those of the base; state its frame"):
            write_readings(tmp_path / "partly.csv", partly, of)


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        ("{xyz_mm: [0, 0, 0], quat_wxyz: [1, 1, 0, 0]}", "quat_wxyz needs four numbers w, x, y, z, of length 1"),
        ("{xyz_mm: [0, 0, 0], quat_wxyz: [1, 0, 0]}", "quat_wxyz needs four numbers"),
        ("{xyz_mm: [0, 0], quat_wxyz: [1, 0, 0, 0]}", "xyz needs three numbers"),
        ("{xyz: [0, 0, 0], quat_wxyz: [1, 0, 0, 0]}", "xyz_mm"),
        ("{quat_wxyz: [1, 0, 0, 0]}", "'xyz_mm, xyz_m, xyz_um' is missing"),
        ("{xyz_mm: [0, 0, 0], quat_wxyz: [1, 0, 0, .nan]}", "frames.S.quat_wxyz.3: "),
    ],
)
def test_a_wrong_frame_is_named(frame: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        experiment(tmp_path, more=f"frames:\n  S: {frame}\n")
    assert "experiment.yaml, line 9" in str(caught.value)
    assert words in str(caught.value)


@pytest.mark.parametrize("poses", ["A", "AB"])
def test_too_few_points_hold_no_frame(poses: str, tmp_path: Path) -> None:
    of = experiment(tmp_path)
    path = placed(of, tmp_path, poses, load=False)
    found = read_readings(path, of, "positions")
    with pytest.raises(InputError) as caught:
        observation_model(of, found)
    for word in (
        str(path),
        "frame cannot be found",
        f"{len(poses)} poses of series 'S'",
        "in all directions",
        "frames: in the",
    ):
        assert word in str(caught.value), str(caught.value)
    assert (
        observation_model(
            experiment(tmp_path, more=FRAME), read_readings(path, experiment(tmp_path, more=FRAME))
        ).frames
        == ()
    )


def test_points_on_one_line_hold_no_frame(tmp_path: Path) -> None:
    """Axis 6 turned: a marker on it stays where it is, and one copied along a line leaves a turn about it open."""
    of = experiment(tmp_path)
    rows = [f"P{k},0,20,-10,0,0,{k},,,,m1,unloaded,{900 + k},0,1000,S" for k in range(4)]
    path = table(tmp_path, "line.csv", STATES, *rows)
    with pytest.raises(InputError, match=r"4 .* of series 'S' lie at one point or on one line"):
        observation_model(of, read_readings(path, of))


# ------------------------------------------------------------------------------------------ noise


def apart(folder: Path, *kinds: str) -> Experiment:
    return experiment(folder, "{" + ", ".join(f"{k}_sigma_mm: 0.0{i + 2}" for i, k in enumerate(kinds)) + "}")


def test_one_sigma_does_not_stand_for_two_kinds(tmp_path: Path) -> None:
    of = experiment(tmp_path)
    files = [displaced(tmp_path), placed(of, tmp_path)]
    refused(
        files,
        of,
        "experiment.yaml",
        "does not say of which kind",
        "found displacement, position",
        "allowed: displacement_sigma_mm, position_sigma_mm",
        states="positions",
    )
    both = read_readings(files, apart(tmp_path, "displacement", "position"), "positions")
    assert both.sigma[:, 0].tolist() == pytest.approx([2e-5] * 2 + [3e-5] * 6)
    assert both.stated
    own = displaced(tmp_path, f"A,{A},{PULL},m1,0.1,0.2,-2,0.05", more=",sigma_mm")
    of = experiment(tmp_path)
    found = read_readings([own, files[1]], of, "positions")
    assert found.sigma[:, 0].tolist() == pytest.approx([5e-5] + [3e-5] * 6), "sigma_mm is then of the other kind"


def test_two_kinds_in_one_file_are_weighed_by_stated_noise(tmp_path: Path) -> None:
    rows = (f"A,{A},{PULL},m1,0.1,0.2,-2,,,,,", f"A,{A},{PULL},m1,,,,0.5,0,0,1,")
    path = table(tmp_path, "g.csv", GAUGED, *rows)
    refused(path, experiment(tmp_path), "allowed: displacement_sigma_mm, gauge_sigma_mm")
    refused(
        path,
        experiment(tmp_path, "estimate"),
        "g.csv",
        "displacements and gauges is not stated",
        "State noise: {displacement_sigma_mm: ..., gauge_sigma_mm: ...} in the experiment",
    )
    found = read_readings(path, apart(tmp_path, "displacement", "gauge"))
    assert found.sigma[:, 0].tolist() == pytest.approx([2e-5, 3e-5])
    refused(
        path,
        apart(tmp_path, "displacement"),
        "line 3, column sigma",
        "1 readings have no sigma_mm",
        "Give all of them or none",
    )


def test_files_of_which_one_states_its_noise_are_not_mixed(tmp_path: Path) -> None:
    """An unstated sigma of a millimetre would else silently count a thousand times less."""
    of = apart(tmp_path, "displacement")
    path = placed(of, tmp_path)
    refused([displaced(tmp_path), path], of, str(path), "nobody states the sd", "position_sigma_mm", states="positions")
    silent = experiment(tmp_path, "estimate")
    refused([displaced(tmp_path), path], silent, "displacements and positions is not stated", states="positions")
    own = table(tmp_path, "own.csv", DISPLACED + ",sigma_mm", f"A,{A},{PULL},m2,0.1,0.2,-2,0.05")
    error = refused([own, displaced(tmp_path)], silent, "moved.csv", "displacement_sigma_mm")
    assert "own.csv" not in str(error)
    alone = read_readings(displaced(tmp_path), silent)
    assert not alone.stated


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        ("{sigma_mm: 0.03, gauge_sigma_mm: 0.01}", "give sigma_mm, or position_sigma_mm .*, displacement_sigma_mm and"),
        ("{repeatability_mm: 0.01}", "needs sigma_mm"),
        ("{gauge_sigma_mm: 0}", "the noise must be positive"),
        ("{position_sigma: 0.1}", "position_sigma_mm"),
    ],
)
def test_a_wrong_noise_is_named(noise: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        experiment(tmp_path, noise)


# ------------------------------------------------------------------------------------------ several files


def test_files_of_two_robots(tmp_path: Path) -> None:
    of = experiment(tmp_path)
    own, other = displaced(tmp_path), tmp_path / "other.csv"
    other.write_text("# robot: ur10\n" + own.read_text())
    error = refused([own, other], of, "other.csv", "another robot", "ur10", "fanuc_m900ib")
    assert len(error.problems) == 1
    own.write_text(own.read_text().replace("dz_mm", "dz"))
    error = refused([own, other], of, "moved.csv, line 1, column dz", "other.csv")
    assert len(error.problems) == 2, "the problems of every file at once"


def test_files_are_joined_with_their_lines_series_and_frames(tmp_path: Path) -> None:
    of = apart(tmp_path, "displacement", "position")
    first = placed(of, tmp_path)
    second = tmp_path / "second.csv"
    second.write_text(first.read_text().replace(",S\n", ",T\n"))
    third = tmp_path / "third.csv"
    third.write_text(first.read_text())
    moved = displaced(tmp_path)
    whole = read_readings([moved, first, second, third], of, "positions")
    assert whole.sources == (moved, first, second, third)
    assert whole.where == f"{moved}, {first}, {second}, {third}"
    assert whole.file.tolist() == [0] * 2 + [1] * 6 + [2] * 6 + [3] * 6
    assert whole.line.tolist() == [2, 3, *list(range(2, 8)) * 3]
    assert whole.frames == ("S", "T")
    assert whole.frame.tolist() == [-1] * 2 + [0] * 6 + [1] * 6 + [0] * 6, "series of one name are in one frame"
    assert len(whole.states) == 4 + 3 * 6
    parts = [read_readings(p, of, "positions") for p in whole.sources]
    for i, part in enumerate(parts):
        rows = whole.file == i
        for side in ("plus", "minus"):
            a, b = getattr(whole, side)[rows], getattr(part, side)
            assert np.array_equal(a < 0, b < 0)
            kept = b >= 0
            assert np.array_equal(whole.poses.wrench[a[kept]], part.poses.wrench[b[kept]])
            assert [whole.states.pose[s] for s in a[kept]] == [part.states.pose[s] for s in b[kept]]
        assert np.array_equal(whole.value[rows], part.value)


def test_displacements_and_positions_that_contradict_each_other(tmp_path: Path) -> None:
    """A displacement of 2 mm, and positions of the same marker at the same pose that are 1.4 m apart."""
    of = apart(tmp_path, "displacement", "position")
    moved, path = displaced(tmp_path), placed(of, tmp_path)
    assert len(read_readings([moved, path], of, "positions")) == 8
    lines = path.read_text().splitlines()
    spoilt = lines[2].split(",")
    assert spoilt[11] == "loaded"
    spoilt[13] = repr(float(spoilt[13]) + 1400.0)
    path.write_text("\n".join([*lines[:2], ",".join(spoilt), *lines[3:]]) + "\n")
    refused(
        [moved, path],
        of,
        f"{path}, line 3",
        "loaded and unloaded (line 2) are 1.4 m apart",
        f"its displacement ({moved}, line 2) is 0.002",
        "not of one arm",
        "use of the wrong row",
        states="positions",
    )
    elsewhere = displaced(tmp_path, f"A,{B},{PULL},m1,0.1,0.2,-2", f"A,{A},{PULL},m2,0.1,0.2,-2,", more="")
    elsewhere.write_text(elsewhere.read_text().replace("-2,\n", "-2\n").replace(f"A,{A}", f"A2,{A}"))
    assert len(read_readings([elsewhere, path], of, "positions")) == 8, "another pose of this name, another marker"


# ------------------------------------------------------------------------------------------ states


@pytest.mark.parametrize(
    ("load", "more", "wanted"),
    [
        (True, "", "differences"),
        (False, "", "positions"),
        (True, "fit: [joint_compliance]\n", "differences"),
        (True, "fit: [joint_compliance, joint_offset]\neffects: [{effect: joint_offset, joints: all}]\n", "positions"),
        (True, "fit: [joint_compliance]\neffects: [{effect: joint_offset, joints: all}]\n", "differences"),
        (True, "fit: [geometry]\n", "positions"),
        (True, "states: positions\n", "positions"),
        (True, "fit: [geometry]\nstates: differences\n", "differences"),
    ],
)
def test_how_states_are_read(load: bool, more: str, wanted: str, tmp_path: Path) -> None:
    """As the experiment says; else differences where both states are there and nothing of place is fitted."""
    of = experiment(tmp_path, more=more)
    path = placed(of, tmp_path, load=load)
    found = read_readings(path, of)
    assert found.is_position.all() == (wanted == "positions")
    assert len(found) == (3 if not load or wanted == "differences" else 6)
    raw = read_readings(path, of, "positions")
    assert raw.is_position.all(), "an argument says more than the experiment"
    if "states:" not in more:
        assert suggested(of, raw) == wanted
    if wanted == "differences":
        assert np.array_equal(differences(raw, of).value, found.value)


def test_an_unknown_way_to_read_states(tmp_path: Path) -> None:
    of = experiment(tmp_path)
    refused(
        placed(of, tmp_path),
        of,
        "unknown states 'position'",
        "differences, positions",
        "Did you mean 'positions'?",
        states="position",
    )
    with pytest.raises(InputError, match="states"):
        experiment(tmp_path, more="states: both\n")


def test_differences_without_a_partner_name_each_row(tmp_path: Path) -> None:
    of = experiment(tmp_path)
    path = placed(of, tmp_path)
    keep: Callable[[str], bool] = lambda line: not line.startswith(("B,", "C,")) or ",loaded," in line  # noqa: E731
    path.write_text("\n".join(filter(keep, path.read_text().splitlines())) + "\n")
    error = refused(path, of, "pose 'B'", "pose 'C'", "has no unloaded one", "Measure the marker unloaded")
    assert [p.line for p in error.problems] == [4, 5]


@pytest.mark.parametrize("name", ["mixed", "ur10"])
def test_derivatives_of_a_long_campaign_are_taken_in_parts(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Positions in several unknown frames, displacements and gauges beside them: the same numbers."""
    of = load_experiment(example(name) / "experiment.yaml")
    seen = observation_model(of, read_readings(of.data, of))
    whole, slopes = seen.rates(seen.start)
    monkeypatch.setattr(observations, "_TOGETHER", 5_000)
    parts, again = seen.rates(seen.start)
    assert np.allclose(parts, whole, rtol=0.0, atol=1e-12)
    assert np.allclose(again, slopes, rtol=1e-9, atol=1e-12 * np.abs(slopes).max())
