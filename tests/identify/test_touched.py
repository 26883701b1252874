"""A point of unknown place that the arm touches at many poses: read, predicted, fitted, simulated and diagnosed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import (
    Experiment,
    Readings,
    load_experiment,
    observation_model,
    read_readings,
    simulate_rows,
    write_readings,
)
from qsframework.experiment.columns import joint_cells
from qsframework.fits import Fit, identify
from qsframework.plugin import Array, Poses

TEXT = """robot: ur10
markers:
  tip: {xyz_mm: [0, 0, 120]}
noise: {sigma_mm: 0.02}
effects:
  - {effect: marker_offset, markers: all}
  - {effect: joint_offset, joints: all}
fit: [marker_offset, "joint_offset[joint_2]", "joint_offset[joint_3]", "joint_offset[joint_4]", "joint_offset[joint_5]"]
"""
POINTS = {"sphere": (0.75, 0.2, 0.3), "plate": (-0.2, -0.8, 0.15)}
EACH = 14
TRUTH = (4e-4, -3e-4, 5e-4, 1e-3, -2e-3, 1.5e-3, 8e-4)


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    file = tmp_path_factory.mktemp("touch") / "experiment.yaml"
    file.write_text(TEXT)
    return load_experiment(file)


def places(experiment: Experiment, pendant: Array, x: Array | None = None) -> Array:
    """Where the arm puts the tip (N, 3) m, unloaded."""
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), np.zeros((len(pendant), 6)))
    return experiment.model().positions(poses, x, loaded=False)[:, 0]


def reaching(experiment: Experiment, point: Array, rng: np.random.Generator) -> Array:
    """Angles (n,) at which the nominal arm touches a point, the nearest to some that are drawn."""
    start = rng.uniform(-1.8, 1.8, experiment.robot.controller.axes)

    def off(q: Array) -> Array:
        return np.concatenate([10.0 * (places(experiment, q[None])[0] - point), 0.01 * (q - start)])

    def slope(q: Array) -> Array:
        """By differences, of which one call knows all."""
        there, *stepped = places(experiment, np.vstack([q, q + 1e-7 * np.eye(len(q))]))
        return np.vstack([1e8 * (np.array(stepped) - there).T, 0.01 * np.eye(len(q))])

    return np.asarray(least_squares(off, start, slope).x)


@pytest.fixture(scope="module")
def angles(arm: Experiment) -> dict[str, Array]:
    """Angles (EACH, n) at which the nominal arm touches each point."""
    rng = np.random.default_rng(3)
    return {n: np.stack([reaching(arm, np.array(p), rng) for _ in range(EACH)]) for n, p in POINTS.items()}


def touch_table(experiment: Experiment, path: Path, angles: dict[str, Array], columns: bool = False) -> Path:
    """A table of touches; columns: with x, y, z, all zero."""
    units = experiment.robot.controller.units
    more = ["x_mm", "y_mm", "z_mm"] if columns else []
    lines = [",".join(["pose", *units.names(), "marker", "state", "point", *more])]
    for name, poses in angles.items():
        for k, own in enumerate(poses):
            lines.append(
                ",".join([f"{name}{k}", *joint_cells(own, units), "tip", "unloaded", name, *["0"] * len(more)])
            )
    path.write_text("\n".join(lines) + "\n")
    return path


def truth(experiment: Experiment) -> Array:
    model = experiment.model()
    x = np.array(model.nominal)
    x[model.index(experiment.fit_names())] += TRUTH
    return x


@pytest.fixture(scope="module")
def touched(arm: Experiment, angles: dict[str, Array], tmp_path_factory: pytest.TempPathFactory) -> Readings:
    table = touch_table(arm, tmp_path_factory.mktemp("table") / "touches.csv", angles)
    return simulate_rows(arm, read_readings(table, arm), truth(arm), seed=5).readings


def test_columns_may_be_left_out(arm: Experiment, angles: dict[str, Array], tmp_path: Path) -> None:
    short, full = (touch_table(arm, tmp_path / f"{c}.csv", angles, c) for c in (False, True))
    one, two = read_readings(short, arm), read_readings(full, arm)
    assert np.array_equal(one.value, two.value)
    assert one.frames == ("point:sphere", "point:plate")
    assert one.is_position.all()


def test_derivatives_are_those_of_differences(arm: Experiment, touched: Readings) -> None:
    seen = observation_model(arm, touched)
    assert [p.name for p in seen.parameters[:6]] == [f"point[{p}].{a}" for p in POINTS for a in "xyz"]
    z = seen.start + 1e-3 * np.random.default_rng(1).standard_normal(len(seen.start))
    J, h = seen.jacobian(z), 1e-6
    for k, step in enumerate(h * np.eye(len(z))):
        slope = (seen.predict(z + step) - seen.predict(z - step)) / (2.0 * h)
        assert np.abs(J[:, k] - slope).max() < 1e-8


def known_before(fit: Fit) -> Array:
    """What sds (4,) counted of the joints' zeros, 1 mrad or more; of marker, points and plates nothing is known."""
    known = [e for e in fit.estimates if e.counted_sd is not None]
    assert [e.name for e in known] == [f"joint_offset[joint_{k}]" for k in (2, 3, 4, 5)]
    sds = np.array([e.counted_sd for e in known], dtype=float)
    assert np.all(sds >= 1e-3)
    assert np.all(sds < 3e-3)
    return sds


def test_a_fit_is_that_of_differences_from_the_mean_of_each_point(arm: Experiment, touched: Readings) -> None:
    """Least squares without the library's: each point's place is its rows' mean, whatever it is, so it drops out. The
    joints' zeros are readings too."""
    fit = identify(arm, touched, options=FitOptions(keep_all=True))
    known = known_before(fit)
    model, names = arm.model(), list(arm.fit_names())
    index = model.index(names)
    of = np.array([touched.frames.index(f"point:{name}") for name in POINTS for _ in range(EACH)])
    pendant = touched.poses.pendant[touched.plus]

    def error(v: Array) -> Array:
        x = np.array(model.nominal)
        x[index] = v
        off = touched.value - places(arm, pendant, x)
        centred = off - np.stack([off[of == p].mean(axis=0) for p in of])
        return np.concatenate([centred.ravel() / 2e-5, v[3:] / known])

    scale = np.full(len(index), 1e-3)
    found = least_squares(error, model.nominal[index], x_scale=scale, jac="3-point", xtol=1e-15, ftol=1e-15)
    own = {e.name: e for e in fit.estimates}
    ours, sd = (np.array([getattr(own[name], what) for name in names]) for what in ("value", "sd"))
    by_hand = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    assert np.abs((ours - found.x) / sd).max() < 5e-3, "the solver stops within a hundredth of an sd"
    for frame, (name, point) in zip(fit.frames, POINTS.items(), strict=True):
        place = np.array([own[f"point[{name}].{a}"].value for a in "xyz"])
        assert np.array_equal(place, -frame.origin)
        assert np.linalg.norm(place - point) < 3e-3
    assert sd == pytest.approx(by_hand, rel=1e-3)
    assert np.abs((ours - truth(arm)[index]) / sd).max() < 3.5
    assert fit.chi2 == pytest.approx(2.0 * found.cost, rel=1e-6)
    assert fit.dof == 3 * 2 * EACH - 3 - 3 * len(POINTS), "nothing is known of the marker and of the points"


def test_what_is_written_is_read_again(arm: Experiment, touched: Readings, tmp_path: Path) -> None:
    write_readings(tmp_path / "readings.csv", touched, arm)
    back = read_readings(tmp_path / "readings.csv", arm)
    assert np.abs(back.value - touched.value).max() < 1e-12
    assert back.frames == touched.frames


def test_a_wrong_touch_is_an_outlier(arm: Experiment, touched: Readings) -> None:
    value = np.array(touched.value)
    value[4] += [2e-3, -1e-3, 1e-3]
    fit = identify(arm, replace(touched, value=value))
    assert [line for one in fit.gross for line in one.rows] == [int(touched.line[4])]


def test_from_the_command_line(arm: Experiment, angles: dict[str, Array], tmp_path: Path) -> None:
    """Simulated, checked, identified and diagnosed; the fit of other touches is validated."""
    table = touch_table(arm, tmp_path / "touches.csv", angles)
    file = tmp_path / "experiment.yaml"
    file.write_text(TEXT + f"data: {tmp_path / 'r.csv'}\n")
    for command in (
        ["simulate", str(file), str(table), "-o", str(tmp_path / "r.csv"), "--seed", "2"],
        ["simulate", str(file), str(table), "-o", str(tmp_path / "s.csv"), "--seed", "9"],
        ["check", str(file)],
        ["identify", str(file), str(tmp_path / "r.csv"), "--json", str(tmp_path / "fit.json")],
        ["validate", str(file), str(tmp_path / "fit.json"), str(tmp_path / "s.csv")],
        ["diagnose", str(file), str(tmp_path / "r.csv")],
    ):
        done = CliRunner().invoke(app, command)
        assert done.exit_code == 0, f"{command}: {done.output}\n{done.exception!r}"


def test_a_touch_is_a_reading_that_is_zero(arm: Experiment, angles: dict[str, Array], tmp_path: Path) -> None:
    """Where x, y, z are left out the marker is at the point: that is no reading which nobody took."""
    table, file = touch_table(arm, tmp_path / "touches.csv", angles), tmp_path / "experiment.yaml"
    file.write_text(TEXT)
    for command in (["check"], ["identify", "--clean"]):
        done = CliRunner().invoke(app, [command[0], str(file), str(table), *command[1:]])
        assert "nothing was read" not in done.output
        assert ("28 readings" if command[0] == "check" else "no row is masked") in done.output
        assert done.exit_code <= (command[0] == "check"), f"{done.output}\n{done.exception!r}"


BAD = {
    "touched once": (0, "point", "cone", "the point 'cone' is touched once", "two poses or more"),
    "another point": (0, "point", "plate", "mm from where the others touch 'plate'", "another pose"),
    "of a series too": (1, "series", "day", "touches the point 'sphere' and is of a series too", "a row of its own"),
    "a name of ours": (2, "series", "point:a", "does not begin with 'point:'", "point:a"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_is_named(case: str, arm: Experiment, angles: dict[str, Array], tmp_path: Path) -> None:
    row, column, text, *words = BAD[case]
    path = touch_table(arm, tmp_path / "touches.csv", angles)
    header, *rows = [line.split(",") for line in path.read_text().splitlines()]
    if column not in header:
        header, rows = [*header, column], [[*r, ""] for r in rows]
    rows[row][header.index(column)] = text
    if case == "a name of ours":
        rows[row][header.index("point")] = ""
    path.write_text("\n".join(",".join(r) for r in (header, *rows)) + "\n")
    with pytest.raises(InputError) as caught:
        read_readings(path, arm)
    assert f"line {row + 2}, column {column}" in str(caught.value)
    for word in words:
        assert word in str(caught.value)


NORMAL = np.array([0.1, -0.2, 1.0])
PLATE = 20


@pytest.fixture(scope="module")
def plate(arm: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Readings:
    """Touches all over a plate 250 mm from the base, along its normal, beside those of one point."""
    rng, units = np.random.default_rng(8), arm.robot.controller.units
    u = NORMAL / np.linalg.norm(NORMAL)
    across = np.linalg.svd(u[None])[2][1:]
    lines = [",".join(["pose", *units.names(), "marker", "state", "point", "ux", "uy", "uz"])]
    for k in range(PLATE):
        there = 0.25 * u + rng.uniform(0.35, 0.6) * across[0] + rng.uniform(-0.5, 0.5) * across[1]
        cells = joint_cells(reaching(arm, there, rng), units)
        lines.append(",".join([f"p{k}", *cells, "tip", "unloaded", "table", *map(str, NORMAL.tolist())]))
    for k in range(6):
        cells = joint_cells(reaching(arm, np.array(POINTS["sphere"]), rng), units)
        lines.append(",".join([f"s{k}", *cells, "tip", "unloaded", "sphere", "", "", ""]))
    path = tmp_path_factory.mktemp("plate") / "plate.csv"
    path.write_text("\n".join(lines) + "\n")
    return simulate_rows(arm, read_readings(path, arm), truth(arm), seed=4).readings


def test_derivatives_of_a_plate_are_those_of_differences(arm: Experiment, plate: Readings) -> None:
    seen = observation_model(arm, plate)
    assert [p.name for p in seen.parameters[:4]] == ["plane[table].distance", *(f"point[sphere].{a}" for a in "xyz")]
    z = seen.start + 1e-3 * np.random.default_rng(1).standard_normal(len(seen.start))
    J, h = seen.jacobian(z), 1e-6
    for k, step in enumerate(h * np.eye(len(z))):
        slope = (seen.predict(z + step) - seen.predict(z - step)) / (2.0 * h)
        assert np.abs(J[:, k] - slope).max() < 1e-8


def test_a_fit_to_a_plate_is_that_of_differences_from_the_mean(arm: Experiment, plate: Readings) -> None:
    """Along the normal only, whatever the plate's distance; the rows of the point and of the zeros as before."""
    fit = identify(arm, plate, options=FitOptions(keep_all=True))
    known = known_before(fit)
    model, names = arm.model(), list(arm.fit_names())
    index, u = model.index(names), NORMAL / np.linalg.norm(NORMAL)
    pendant, flat = plate.poses.pendant[plate.plus], np.arange(len(plate)) < PLATE

    def error(v: Array) -> Array:
        x = np.array(model.nominal)
        x[index] = v
        there = places(arm, pendant, x)
        along = plate.value[flat, 0] - there[flat] @ u
        off = plate.value[~flat] - there[~flat]
        centred = np.concatenate([along - along.mean(), (off - off.mean(axis=0)).ravel()]) / 2e-5
        return np.concatenate([centred, v[3:] / known])

    found = least_squares(error, model.nominal[index], x_scale=np.full(len(index), 1e-3), jac="3-point", xtol=1e-15)
    own = {e.name: e for e in fit.estimates}
    ours, sd = (np.array([getattr(own[name], what) for name in names]) for what in ("value", "sd"))
    assert np.abs((ours - found.x) / sd).max() < 5e-3
    assert sd == pytest.approx(np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac))), rel=1e-3)
    assert fit.dof == PLATE + 3 * 6 - 3 - 4
    assert own["plane[table].distance"].value == pytest.approx(0.25, abs=3e-3)


def test_plates_are_written_and_read_again(arm: Experiment, plate: Readings, tmp_path: Path) -> None:
    write_readings(tmp_path / "readings.csv", plate, arm)
    back = read_readings(tmp_path / "readings.csv", arm)
    assert np.nanmax(np.abs(back.value - plate.value)) < 1e-12
    assert np.array_equal(np.isnan(back.value), np.isnan(plate.value))
    assert back.frames == plate.frames == ("plane:table", "point:sphere")
    one, two = observation_model(arm, back), observation_model(arm, plate)
    assert one.predict(one.start) == pytest.approx(two.predict(two.start), abs=1e-12)


def test_a_plate_has_one_normal(arm: Experiment, plate: Readings, tmp_path: Path) -> None:
    write_readings(tmp_path / "readings.csv", plate, arm)
    comment, *text = (tmp_path / "readings.csv").read_text().splitlines()
    rows = [line.split(",") for line in text]
    rows[4][rows[0].index("uz")] = "0.9"
    (tmp_path / "readings.csv").write_text("\n".join([comment, *(",".join(r) for r in rows)]) + "\n")
    with pytest.raises(InputError, match=r"line 6, column ux: the plane 'table' has another normal than in line 3"):
        read_readings(tmp_path / "readings.csv", arm)
