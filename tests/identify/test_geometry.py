"""`fit: [geometry]`: zeros and placements of all joints, as far as absolute positions tell them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.errors import InputError, NotIdentifiable
from qsframework.estimation import FitOptions
from qsframework.experiment import (
    Experiment,
    Readings,
    load_experiment,
    make_plan,
    observation_model,
    read_readings,
    simulate,
)
from qsframework.experiment.prior import from_priors
from qsframework.fits import identify
from qsframework.fits.io import write_campaign
from qsframework.information.selection import identifiable_names
from qsframework.plugin import Array, Poses
from tests.identify.arm import position_readings, random_poses

LINEAR = FitOptions(linear=True, keep_all=True)

FILE = """
robot: ur10
rigid: true
markers:
  a: {xyz_mm: [0, 0, 93]}
  b: {xyz_mm: [80, 0, 60]}
noise: {sigma_mm: 0.03}
effects:
  - {effect: marker_offset, markers: all}
"""
LISTED = """
  - {effect: joint_offset, joints: all}
  - {effect: joint_placement, joints: all}
"""
PARTLY = """
  - {effect: joint_placement, joints: [joint_2]}
"""


def written(folder: Path, text: str) -> Experiment:
    file = folder / "experiment.yaml"
    file.write_text(text)
    return load_experiment(file)


def states(experiment: Experiment, q: Array, x: Array) -> Readings:
    poses = Poses(q, q, np.zeros((len(q), 6)))
    points = experiment.model().positions(poses, x)
    points = points + 3e-5 * np.random.default_rng(1).standard_normal(points.shape)
    return position_readings(poses, np.zeros(len(q), dtype=bool), points, 3e-5)


def spread(joints: slice = slice(None)) -> np.ndarray:
    q = np.tile([0.1, -1.0, 1.2, 0.4, 0.9, 0.2], (60, 1))
    q[:, joints] = np.random.default_rng(2).uniform(-2.5, 2.5, q[:, joints].shape)
    return q


def made(experiment: Experiment, q: np.ndarray) -> Readings:
    """Readings of an arm with errors in its rigid geometry."""
    model = experiment.model()
    x = model.nominal
    x[[i for i, n in enumerate(model.names) if n.startswith("joint_compliance")]] = 0.0
    index = model.index(["joint_offset[joint_3]", "joint_placement[joint_2].x", "joint_placement[joint_4].rx"])
    x[index] = 8e-4, 3e-4, -6e-4
    return states(experiment, q, x)


@pytest.mark.parametrize("more", ["", PARTLY, LISTED], ids=["no effects", "some effects", "all effects"])
def test_geometry_is_the_zeros_and_placements_of_all_joints(more: str, tmp_path: Path) -> None:
    experiment = written(tmp_path, FILE + more + "fit: [geometry]\n")
    names = experiment.fit_names()
    joints = experiment.robot.facts.joints
    assert set(names) == {f"joint_offset[{j}]" for j in joints} | {
        f"joint_placement[{j}].{axis}" for j in joints for axis in ("x", "y", "z", "rx", "ry", "rz")
    }
    assert len(names) == 42


def test_it_gives_what_the_effects_by_name_give(tmp_path: Path) -> None:
    long = written(tmp_path, FILE + LISTED + "fit: [marker_offset, joint_offset, joint_placement]\n")
    readings = made(long, spread())
    short = written(tmp_path, FILE + "fit: [marker_offset, geometry]\n")
    by_name, fit = identify(long, readings, options=LINEAR), identify(short, readings, options=LINEAR)
    assert fit.names == by_name.names
    assert np.allclose([e.value for e in fit.estimates], [e.value for e in by_name.estimates], rtol=1e-9, atol=1e-12)
    assert {e.name for e in fit.not_estimated} == {e.name for e in by_name.not_estimated}
    named = {e.name: e for e in fit.estimates}
    every = {n for n in short.fit_names() if not n.startswith("marker")}
    assert every == {e.name for e in fit.estimates if e.share is not None}, "arms are delivered with each of them"
    told = 4 * 6 + 6 - 6 - 6
    assert fit.directions == (told, 42), "4 numbers for each turning joint and 6, less the frame and two markers"
    freely, aside = told_alone(short, readings)
    assert len(freely) == told
    assert not freely & aside
    assert freely | aside == every
    with pytest.raises(NotIdentifiable, match=r"not identifiable: joint_offset\[joint_1\]: confounded with frame"):
        identify(short, readings, options=replace(LINEAR, free=True))
    estimate = named["joint_placement[joint_4].rx"]
    assert abs(estimate.value + 6e-4) < 4.0 * estimate.sd
    assert by_name.sigma_source == "stated"


def told_alone(experiment: Experiment, readings: Readings) -> tuple[set[str], set[str]]:
    """What of zeros and placements the readings tell without what is known before them, and what they do not."""
    seen = observation_model(experiment, readings, linear=True)
    told, left = identifiable_names(seen, LINEAR, known=False)
    return {n for n in told if not n.startswith("marker")}, {e.name for e in left if not e.name.startswith("marker")}


def test_geometry_can_be_asked_for_without_the_file(tmp_path: Path) -> None:
    plain = written(tmp_path, FILE)
    readings = made(plain.with_(fit=("geometry",)), spread())
    fit = identify(plain, readings, ["marker_offset", "geometry"], LINEAR)
    assert "joint_placement[joint_2].x" in fit.names


def test_what_no_pose_tells_stays_as_it_was_known(tmp_path: Path) -> None:
    """Only joint 1 moves: the frame and the markers absorb all that its poses show, and no number of 42 is told. Of the
    markers, of which nothing is known, what only they and the frame share is left aside."""
    experiment = written(tmp_path, FILE + "fit: [marker_offset, geometry]\n")
    readings = made(experiment, spread(slice(0, 1)))
    fit = identify(experiment, readings, options=LINEAR)
    known = [e for e in fit.estimates if e.share is not None]
    assert fit.directions == (0, 42)
    for e in known:
        assert e.share == pytest.approx(0.0, abs=1e-6)
        assert e.sd == pytest.approx(e.counted_sd, rel=1e-6)
        assert abs(e.value - e.initial) < 1e-6 * e.sd
    assert told_alone(experiment, readings) == (set(), {e.name for e in known})
    left = {e.name: e for e in fit.not_estimated}
    assert left
    assert all(n.startswith("marker_offset") for n in left)
    assert any("frame" in other for e in left.values() for other in e.correlated_with)
    assert all("confounded with" in e.words() for e in left.values())


def test_displacements_do_not_tell_it(m900ib: Experiment) -> None:
    readings = simulate(m900ib, make_plan(random_poses(m900ib, 1, 8), ["pull"] * 8)).readings
    for experiment, fit in ((m900ib.with_(fit=("geometry",)), None), (m900ib, ["geometry"])):
        with pytest.raises(InputError, match="geometry needs absolute positions"):
            identify(experiment, readings, fit)


def test_a_wrong_name_is_offered_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no parameter 'geometri'(.|\n)*geometry"):
        written(tmp_path, FILE + "fit: [geometri]\n")


def test_the_example_gives_the_same_by_either_name() -> None:
    folder = Path(__file__).parents[2] / "examples" / "ur10"
    experiment = load_experiment(folder / "experiment.yaml")
    readings = read_readings(folder / "series_d.csv", experiment, "positions")
    short = identify(experiment, readings, ["marker_offset", "geometry"], LINEAR)
    long = identify(experiment, readings, ["marker_offset", "joint_offset", "joint_placement"], LINEAR)
    assert short.names == long.names
    assert np.isclose(short.error_of(short.residuals), long.error_of(long.residuals), rtol=1e-12)


@pytest.mark.parametrize("more", ["", PARTLY, LISTED], ids=["no effects", "some effects", "all effects"])
def test_an_experiment_reads_values_of_the_geometry_that_it_only_names(more: str, tmp_path: Path) -> None:
    experiment = written(tmp_path, FILE + more + "fit: [marker_offset, geometry]\n")
    fit = identify(experiment, made(experiment, spread()), options=LINEAR)
    told = write_campaign(fit, tmp_path / "c.yaml", experiment.robot)
    assert any(n.startswith("joint_placement") for n in told)
    again = written(tmp_path, FILE + more + "fit: [marker_offset, geometry]\nnominal: c.yaml\n")
    assert [e.name for e in again.effects] == [e.name for e in experiment.effects]
    model = again.model()
    for e in fit.estimates[6:]:
        assert model.nominal[model.index([e.name])[0]] == pytest.approx(e.value, rel=1e-12)


@pytest.mark.parametrize(("off", "stops"), [(2e-3, ()), (9e-3, (False,)), (3.5e-2, (True,))])
def test_a_zero_far_from_what_is_known_may_be_a_column(off: float, stops: tuple[bool, ...], tmp_path: Path) -> None:
    """Readings of an arm whose fifth angle was written down wrong, or whose zero is off by as much."""
    experiment = written(tmp_path, FILE + "fit: [geometry, marker_offset]\n")
    q, model = spread(), experiment.model()
    x = np.where(np.char.startswith(np.array(model.names), "joint_compliance"), 0.0, model.nominal)
    x[model.index(["joint_offset[joint_5]"])] = off
    fit = identify(experiment, states(experiment, q, x))
    assert tuple(f.stops for f in fit.account.findings) == stops
    assert all(f.words.startswith("joint_offset[joint_5] by ") for f in fit.account.findings)


def test_a_zero_that_was_known_to_a_hair_moves_with_a_repair(tmp_path: Path) -> None:
    (tmp_path / "n.yaml").write_text("joint_offset[joint_5]: {value_rad: 0.0, sd_rad: 2.0e-5, source: last year}\n")
    experiment = written(tmp_path, FILE + LISTED + "fit: [geometry, marker_offset]\nnominal: n.yaml\n")
    readings, zero = states(experiment, spread()[:4], experiment.model().nominal), "joint_offset[joint_5]"
    far = from_priors(experiment.model(), readings, [zero], np.array([2e-3]))
    assert far[zero] == pytest.approx(2.0)
