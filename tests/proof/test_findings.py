"""What trials with strangers' positions found, each as a test: misfit is not gross, sizes suit the arm, words hold.

The readings are made here: a UR10 with markers, a tracker frame and noise of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.elastostatics.so3 import exponential
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Readings, load_experiment, read_readings
from qsframework.experiment.columns import write_table
from qsframework.fits import EstimateState, Fit, identify
from qsframework.plugin import Array, Poses
from qsframework.screening import find_mistakes

POSES, SIGMA = 60, 0.05
GEOMETRY = ("joint_offset", "joint_placement")
EXPERIMENT = """
robot: {robot}
markers:
  m1: {{xyz_mm: [120, 0, 60]}}
  m2: {{xyz_mm: [-80, 90, 60]}}
  m3: {{xyz_mm: [0, -110, 120]}}
  base: {{xyz_mm: [200, 150, 100], link: {base}}}
noise: {{sigma_mm: 0.05}}
rigid: true
effects:
  - {{effect: joint_offset, joints: all}}
  - {{effect: joint_placement, joints: all}}
  - {{effect: gravity_sag, joints: [joint_2, joint_3]}}
  - {{effect: link_mass, links: [link_3]}}
fit: [geometry]
"""


@dataclass(frozen=True, eq=False)
class Made:
    """Positions (N, K, 3) m of markers at poses q (N, n), base frame, before tracker and noise."""

    experiment: Experiment
    q: Array
    points: Array


def made(folder: Path, x: dict[str, float], seed: int = 1, count: int = POSES) -> Made:
    """Random poses of a UR10 with some parameters off."""
    from qsframework.robot import load_robot

    robot = load_robot("ur10")
    path = folder / "experiment.yaml"
    path.write_text(EXPERIMENT.format(robot="ur10", base=robot.facts.base))
    experiment = load_experiment(path)
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.9, 1.9, (count, 6))
    model = experiment.model()
    values = model.nominal
    values[model.index(experiment.spring_names())] = 0.0
    for name, value in x.items():
        values[model.index([name])] = value
    return Made(experiment, q, model.positions(Poses(q, q, np.zeros((count, 6))), values, loaded=False))


def read(data: Made, folder: Path, points: Array | None = None, q: Array | None = None, seed: int = 2) -> Readings:
    """The positions in a tracker's frame with noise, through a file; points: others than those of the data."""
    rng = np.random.default_rng(seed)
    points = data.points if points is None else points
    q = data.q if q is None else q
    seen = points @ exponential(np.array([0.2, -0.1, 1.3])).T + [2.5, -1.0, 0.4]
    seen = seen + 1e-3 * SIGMA * rng.standard_normal(seen.shape)
    names = [m.name for m in data.experiment.markers]
    rows = [
        [
            f"p{i:03d}",
            *(f"{v:.9f}" for v in np.rad2deg(q[i])),
            name,
            "unloaded",
            *(f"{1e3 * v:.6f}" for v in seen[i, k]),
        ]
        for i in range(len(q))
        for k, name in enumerate(names)
    ]
    header = ["pose", *(f"q{k + 1}_deg" for k in range(6)), "marker", "state", "x_mm", "y_mm", "z_mm"]
    path = folder / "positions.csv"
    write_table(path, header, rows, ["robot: ur10"])
    return read_readings(path, data.experiment)


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> tuple[Made, Readings, Path]:
    folder = tmp_path_factory.mktemp("clean")
    data = made(folder, {"joint_offset[joint_2]": 0.0024, "joint_offset[joint_5]": -0.001})
    return data, read(data, folder), folder


@pytest.fixture(scope="module")
def sagging(tmp_path_factory: pytest.TempPathFactory) -> tuple[Made, Readings]:
    """An arm that sags by millimetres, most where it is stretched."""
    folder = tmp_path_factory.mktemp("sagging")
    data = made(folder, {"gravity_sag[joint_2].link_3_x": 0.004, "gravity_sag[joint_3].link_3_x": 0.003})
    return data, read(data, folder)


def test_misfit_is_no_gross_error(sagging: tuple[Made, Readings]) -> None:
    """Geometry alone does not describe a sagging arm: no reading is at fault, and none is masked."""
    data, readings = sagging
    fit = identify(data.experiment, readings)
    assert fit.masked == ()
    assert len(fit.lines) == len(readings)
    whole = identify(data.experiment, readings, ["geometry", "gravity_sag"])
    assert whole.masked == ()
    assert whole.rms_left_out < 0.5 * fit.rms_left_out


def test_errors_at_unseen_poses_count_masked_rows(clean: tuple[Made, Readings, Path], tmp_path: Path) -> None:
    data, _, _ = clean
    points = data.points.copy()
    points[7, 1] += [0.004, 0.0, 0.003]
    readings = read(data, tmp_path, points)
    fit = identify(data.experiment, readings)
    assert len(fit.masked) == 1
    assert fit.rms_left_out > 2.0 * fit.rms_left_out_kept
    kept = identify(data.experiment, readings, options=FitOptions(keep_all=True))
    assert kept.masked == ()
    assert len(kept.lines) == len(readings)


def test_markers_on_the_still_base_do_not_set_the_noise_of_the_tool(
    clean: tuple[Made, Readings, Path], tmp_path: Path
) -> None:
    """The base marker scatters ten times less: the tool's readings are right all the same."""
    data, _, _ = clean
    rng = np.random.default_rng(3)
    points = data.points + 3e-4 * rng.standard_normal(data.points.shape)
    points[:, 3] = data.points[:, 3]
    assert identify(data.experiment, read(data, tmp_path, points)).masked == ()


def test_rows_of_another_setting_are_one_block(clean: tuple[Made, Readings, Path], tmp_path: Path) -> None:
    data, _, _ = clean
    points = data.points.copy()
    points[20:40] += [0.015, -0.02, 0.01]
    readings = read(data, tmp_path, points)
    fit = identify(data.experiment, readings)
    assert fit.masked == ()
    (block,) = [one for one in fit.gross if one.kind == "block"]
    assert "lines 83 to 162" in block.words


def test_a_few_gross_rows_do_not_hide_the_geometry(clean: tuple[Made, Readings, Path], tmp_path: Path) -> None:
    data, readings, _ = clean
    points = data.points.copy()
    points[::8, 0] += [3.0, -2.0, 1.5]
    spoiled = identify(data.experiment, read(data, tmp_path, points))
    assert len(spoiled.masked) == 8
    assert len(spoiled.estimates) == len(identify(data.experiment, readings).estimates)


def test_angles_logged_wrongly_are_told_from_wrong_readings(clean: tuple[Made, Readings, Path], tmp_path: Path) -> None:
    """A fifth of the poses has angles that are wrong by 0.3 deg: the angles are named, not 48 readings."""
    data, _, _ = clean
    q = data.q.copy()
    q[::5] += np.deg2rad(0.3) * np.random.default_rng(4).standard_normal(q[::5].shape)
    found = find_mistakes(data.experiment, read(data, tmp_path, q=q))
    (angles,) = [one for one in found if one.name == "angles"]
    told = float(angles.words.split("wrong by ")[1].split(" deg")[0])
    assert 0.1 < told < 0.9
    points = data.points.copy()
    points[::5] += 5e-3 * np.random.default_rng(5).standard_normal(points[::5].shape)
    assert "angles" not in {one.name for one in find_mistakes(data.experiment, read(data, tmp_path, points))}


def test_sag_that_dominates_is_estimated_on_a_small_arm(sagging: tuple[Made, Readings]) -> None:
    """And is said to be far more than an arm of this mass has."""
    data, readings = sagging
    fit = identify(data.experiment, readings, ["geometry", "gravity_sag"])
    assert not [entry for entry in fit.not_estimated if entry.name.startswith("gravity_sag[joint_2].link_3")]
    value = next(e for e in fit.estimates if e.name == "gravity_sag[joint_2].link_3_x")
    assert value.value == pytest.approx(0.004, abs=4.0 * value.sd)
    assert value.state is EstimateState.OUTSIDE_PRIOR


def test_states_of_estimates(clean: tuple[Made, Readings, Path]) -> None:
    """A value many sds from zero is told; one that is zero has an upper limit."""
    data, readings, _ = clean
    fit = identify(data.experiment, readings)
    states = {e.name: e for e in fit.estimates}
    assert states["joint_offset[joint_2]"].state is EstimateState.FINE
    limits = [e for e in fit.estimates if e.state is EstimateState.UPPER_LIMIT]
    assert limits
    assert all(e.limit is not None and abs(e.value) < e.limit and e.state.value == "may be 0" for e in limits)


def test_a_mass_that_the_arm_cannot_have_is_implausible() -> None:
    """18 kg of unknown mass on an arm for 3 kg."""
    from qsframework.fits.estimate import estimate_of
    from qsframework.plugin import Parameter

    mass = Parameter("link_mass[link_3].mass", "kg", typical=0.03 * 3.0)
    assert estimate_of(mass, 18.0, 0.4, 0.4).state is EstimateState.IMPLAUSIBLE
    assert estimate_of(mass, 0.8, 0.1, 0.1).state is EstimateState.FINE


def test_a_value_twelve_sds_from_zero_is_told_whatever_was_expected() -> None:
    from qsframework.fits.estimate import estimate_of
    from qsframework.plugin import Parameter

    soft = Parameter("joint_compliance[joint_2]", "rad/(N m)", nominal=1e-6, typical=1e-6)
    assert estimate_of(soft, 24.79e-6, 2.1e-6, 2.1e-6).state is EstimateState.FINE


def test_a_fit_predicts_in_the_frames_that_it_found(clean: tuple[Made, Readings, Path]) -> None:
    data, readings, _ = clean
    half = np.arange(len(readings)) % 8 < 4
    fit: Fit = identify(data.experiment, replace(readings, use=half))
    predicted, measured = fit.predict(replace(readings, use=~half))
    assert float(np.sqrt(np.mean((measured - predicted) ** 2))) < 2.0e-3 * SIGMA
