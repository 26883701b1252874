"""The fitted rigid kinematics in other terms: every file moves as the fit does, or says by how much it does not."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.elastostatics import Site, make_model
from qsframework.elastostatics.so3 import exponential, from_quaternion
from qsframework.errors import InputError
from qsframework.experiment import Experiment, load_experiment
from qsframework.fits import FitRecord
from qsframework.plugin import Array, Poses
from qsframework.plugin.rotations import homogeneous, turns
from qsframework.robot import Drive, load_robot, robot_names
from qsframework.robot.denavit import Serial, denavit
from qsframework.uses.kinematics import (
    WRITERS,
    Fitted,
    fitted,
    offset_rows,
    read_table,
    read_ur,
    write_offsets,
    write_table,
    write_ur,
)
from tests.identify.records import record

TEXT = """
robot: {robot}
rigid: true
markers: {{m1: {{xyz_mm: [0, 0, 200]}}}}
noise: {{sigma_mm: 0.03}}
effects:
  - {{effect: marker_offset, markers: all}}
  - {{effect: joint_offset, joints: all}}
  - {{effect: joint_placement, joints: all}}
  - {{effect: encoder_eccentricity, joints: [joint_2], waves_per_turn: [17]}}
fit: [marker_offset, joint_offset, joint_placement, encoder_eccentricity, joint_compliance]
"""


def written(folder: Path, robot: str) -> Experiment:
    path = folder / "experiment.yaml"
    path.write_text(TEXT.format(robot=robot))
    return load_experiment(path)


def drawn(experiment: Experiment, size: float = 5e-4, offsets: bool = True) -> FitRecord:
    """A fit with drawn errors of geometry and an sd for each."""
    model = experiment.model()
    x, rng = model.nominal, np.random.default_rng(3)
    starts = ("joint_placement", *(("joint_offset",) if offsets else ()))
    for i, name in enumerate(model.names):
        if name.startswith(starts):
            x[i] = rng.normal() * size
        if name.startswith("encoder"):
            x[i] = 1e-4
    names = [n for n in model.names if n.startswith(("joint_", "encoder"))]
    return record(experiment, x, dict.fromkeys(names, 1e-5))


@pytest.fixture(scope="module")
def ur10(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return written(tmp_path_factory.mktemp("ur10"), "ur10")


@pytest.fixture(scope="module")
def fit(ur10: Experiment) -> FitRecord:
    return drawn(ur10)


@pytest.fixture(scope="module")
def one(ur10: Experiment, fit: FitRecord) -> Fitted:
    return fitted(ur10, fit)


def by_the_model(experiment: Experiment, fit: FitRecord, q: Array) -> Array:
    """Three points of the flange (N, 3, 3) by the model with its constant errors of geometry."""
    robot = experiment.robot
    effects = [e for e in experiment.effects if e.name.startswith(("joint_offset", "joint_placement"))]
    points = robot.flange.placement[:3, 3] + 0.3 * (robot.flange.placement[:3, :3].T)
    sites = [(f"p{i}", Site(robot.flange.link, xyz)) for i, xyz in enumerate(points)]
    model = make_model(robot.facts, effects, [], experiment.load_site, sites, np.zeros(3))
    return model.positions(Poses(q, q, np.zeros((len(q), 6))), np.array([fit.model_values[n] for n in model.names]))


def points(serial: Serial, q: Array) -> Array:
    """The same three points: 0.3 m along the flange's axes."""
    end = serial.forward(q)
    return end[:, None, :3, 3] + 0.3 * end[:, :3, :3].transpose(0, 2, 1)


def by_pinocchio(placements: Array, serial: Serial, q: Array) -> Array:
    """The same once more, by a `pin.Model` of these placements."""
    import pinocchio as pin

    model = pin.Model()
    for k, placement in enumerate(placements):
        joint = pin.JointModelRevoluteUnaligned(*serial.axes[k])
        model.addJoint(k, joint, pin.SE3(placement[:3, :3], placement[:3, 3]), f"joint_{k}")
    data, out = model.createData(), []
    for row in q:
        pin.forwardKinematics(model, data, row)
        end = data.oMi[model.njoints - 1].homogeneous @ serial.tool
        out.append(end[:3, 3] + 0.3 * end[:3, :3].T)
    return np.array(out)


def test_every_file_moves_as_the_fitted_model(ur10: Experiment, fit: FitRecord, one: Fitted, tmp_path: Path) -> None:
    """By three computations: the elastostatic model, Pinocchio, and the numbers of the file; to 1e-9 m."""
    q = np.random.default_rng(1).uniform(-3.0, 3.0, (60, 6))
    truth = by_the_model(ur10, fit, q)
    assert np.abs(truth - points(one.nominal, q)).max() > 1e-3
    assert np.abs(truth - by_pinocchio(one.serial.placements, one.serial, q)).max() < 1e-12
    for kind, write in WRITERS.items():
        file = tmp_path / f"{kind}.{'urdf' if kind == 'urdf' else 'yaml'}"
        said = write(one, file)
        assert said.away < 1e-9
        assert said.turned < 1e-9
        assert bool(said.far) == (kind in ("dh", "mdh")), "two pairs of axes of a UR10 are parallel"
        if kind in ("dh", "mdh", "hayati"):
            read = read_table(file).serial()
            assert np.abs(truth - points(read, q)).max() < 1e-9
            assert np.abs(truth - by_pinocchio(read.placements, read, q)).max() < 1e-9


def test_the_formula_of_each_table(one: Fitted, tmp_path: Path) -> None:
    """The product that the head of the file states, from its rows alone."""

    def turn(axis: int, degrees: float) -> Array:
        return homogeneous(turns(np.eye(3)[axis], np.deg2rad(degrees)), np.zeros(3))

    def move(axis: int, mm: float) -> Array:
        return homogeneous(np.eye(3), 1e-3 * mm * np.eye(3)[axis])

    def pose(p: dict[str, float]) -> Array:
        place = move(0, p["x_mm"]) @ move(1, p["y_mm"]) @ move(2, p["z_mm"])
        turned = from_quaternion(np.array([p[f"quat_{k}"] for k in "wxyz"]))
        return place @ homogeneous(turned, np.zeros(3))

    q = np.random.default_rng(2).uniform(-3.0, 3.0, 6)
    for convention in ("dh", "mdh", "hayati"):
        write_table(one, convention, tmp_path / "t.yaml")
        table = yaml.safe_load((tmp_path / "t.yaml").read_text())
        here = pose(table["base"])
        for row, angle in zip(table["joints"], np.rad2deg(q), strict=True):
            screw = turn(2, row["theta_deg"] + angle) @ move(2, row["d_mm"])
            between = move(0, row["a_mm"]) @ turn(0, row["alpha_deg"])
            here = here @ between @ screw if convention == "mdh" else here @ screw @ between
            here = here @ turn(1, row.get("beta_deg", 0.0))
        assert np.abs(here @ pose(table["tool"]) - one.serial.forward(q[None])[0]).max() < 1e-9
    nominal = [row["d_mm"] for row in table["nominal"]]
    assert np.allclose(nominal, [127.3, 0.0, 0.0, 163.941, 115.7, 92.2])


@pytest.mark.parametrize("name", robot_names())
@pytest.mark.parametrize("size", [0.0, 1e-4, 1e-2])
def test_tables_of_every_robot(name: str, size: float) -> None:
    """To 1e-9 m with errors of 0.1 mrad and more; the table with Hayati's number to rounding whatever they are."""
    robot, rng = load_robot(name), np.random.default_rng(0)
    placements = robot.facts.placements.copy()
    for placement in placements:
        placement[:] = placement @ homogeneous(exponential(size * rng.normal(size=3)), size * rng.normal(size=3))
    serial = Serial(placements, robot.facts.axes, robot.flange.placement)
    q = rng.uniform(-3.0, 3.0, (50, robot.facts.n))
    for hayati, most in ((False, 1e-9), (True, 1e-13)):
        table = denavit(serial, hayati)
        assert np.abs(table.serial().forward(q) - serial.forward(q)).max() < most
        assert not (hayati and np.abs(table.d).max() > 3.0)


def test_offsets_in_the_controllers_terms(ur10: Experiment, fit: FitRecord, one: Fitted, tmp_path: Path) -> None:
    true = np.rad2deg([fit.model_values[f"joint_offset[joint_{k}]"] for k in range(1, 7)])
    rows = offset_rows(one)
    assert np.allclose([float(r["add_deg"]) for r in rows], true, atol=1e-6)
    assert {r["sd_deg"] for r in rows} == {f"{np.rad2deg(1e-5):.6f}"}
    assert {r["counts"] + r["motor_deg"] for r in rows} == {""}, "no ratio is stated"
    own = np.rad2deg([fit.model_values[f"joint_placement[joint_{k}].rz"] for k in range(1, 7)])
    assert np.allclose([float(r["in_placement_deg"]) for r in rows], own, atol=1e-6)
    stated = replace(ur10.robot.controller, drives=(Drive(False, -101.0, 4096.0), Drive(False, 50.0), *[Drive()] * 4))
    rows = offset_rows(replace(one, experiment=ur10.with_(robot=replace(ur10.robot, controller=stated))))
    assert float(rows[0]["counts"]) == pytest.approx(-true[0] / 360.0 * 101.0 * 4096.0, abs=0.06)
    assert float(rows[1]["motor_deg"]) == pytest.approx(50.0 * true[1], abs=1e-4)
    assert (rows[1]["counts"], rows[2]["motor_deg"]) == ("", "")
    lines = write_offsets(one, tmp_path / "o.csv").read_text().splitlines()
    assert list(csv.DictReader(lines[5:])) == offset_rows(one)


def test_an_offset_of_coupled_angles(tmp_path: Path) -> None:
    """J3 of the M-900iB is what the lower arm is turned by: an offset of joint 2 changes two angles of the pendant."""
    experiment = written(tmp_path, "fanuc_m900ib")
    one = fitted(experiment, drawn(experiment))
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (1, 6))
    pendant = experiment.robot.controller.to_pendant(q)[0]
    moved = experiment.robot.controller.to_joints((pendant + one.offsets)[None])[0]
    model = experiment.model()
    angles = np.array([one.x[model.index([f"joint_offset[joint_{k}]"])[0]] for k in range(1, 7)])
    assert np.allclose(moved - q[0], angles, atol=1e-12)
    with pytest.raises(InputError, match="passes through a closed loop"):
        write_table(one, "dh", tmp_path / "dh.yaml")
    assert write_table(fitted(experiment, drawn(experiment, offsets=False)), "dh", tmp_path / "dh.yaml").away < 1e-9
    with pytest.raises(InputError, match="fanuc_m900ib is not built as a Universal Robots arm"):
        write_ur(fitted(experiment, drawn(experiment, offsets=False)), tmp_path / "ur.yaml")


def test_the_file_of_the_ur_driver(one: Fitted, ur10: Experiment, tmp_path: Path) -> None:
    """Of the nominal arm it holds the maker's numbers, in the driver's frames; of another it is read back."""
    nominal = replace(one, serial=one.nominal, x=ur10.model().nominal)
    assert write_ur(nominal, tmp_path / "n.yaml").away < 1e-12
    data = yaml.safe_load((tmp_path / "n.yaml").read_text())["kinematics"]
    expected = {
        "shoulder": (0, 0, 0.1273, 0, 0, 0),
        "upper_arm": (0, 0, 0, np.pi / 2, 0, 0),
        "forearm": (-0.612, 0, 0, 0, 0, 0),
        "wrist_1": (-0.5723, 0, 0.163941, 0, 0, 0),
        "wrist_2": (0, -0.1157, 0, np.pi / 2, 0, 0),
        "wrist_3": (0, 0.0922, 0, -np.pi / 2, 0, 0),
    }
    for link, values in expected.items():
        assert np.allclose([data[link][n] for n in ("x", "y", "z", "roll", "pitch", "yaw")], values, atol=1e-12)
    assert data["hash"].startswith("calib_")
    write_ur(one, tmp_path / "f.yaml")
    text = (tmp_path / "f.yaml").read_text()
    (tmp_path / "f.yaml").write_text(text.replace("pitch:", "pitsch:", 1))
    with pytest.raises(InputError, match=r"f.yaml, line 2: no finite number for pitch"):
        read_ur(tmp_path / "f.yaml", np.eye(4), np.eye(4))


def test_spoiled_tables(one: Fitted, tmp_path: Path) -> None:
    path = tmp_path / "dh.yaml"
    write_table(one, "dh", path)
    good = path.read_text()
    for old, new, words in (
        ("convention: dh", "convention: tree", "line 4: is no table of Denavit and Hartenberg"),
        ("{joint: joint_2, theta_deg: ", "{joint: joint_2, theta_deg: x", "line 8: no finite number for theta_deg"),
        ("base: {x_mm", "base: {y", "line 5: no finite number for x_mm"),
    ):
        assert old in good
        path.write_text(good.replace(old, new, 1))
        with pytest.raises(InputError, match=words):
            read_table(path)


def test_the_command(one: Fitted, tmp_path: Path) -> None:
    """From simulated readings of positions to the files."""
    folder = tmp_path / "c"
    folder.mkdir()
    source = Path(__file__).resolve().parents[2] / "examples" / "ur10"
    for name in ("experiment.yaml", "series_d.csv"):
        shutil.copy(source / name, folder)
    told = folder / "fit.json"
    run = CliRunner().invoke(app, ["identify", str(folder / "experiment.yaml"), "--json", str(told)])
    assert run.exit_code == 0
    files = {k: folder / f"{k}.yaml" for k in ("dh", "mdh", "hayati", "ur")} | {"urdf": folder / "ur10.urdf"}
    line = ["kinematics", str(folder / "experiment.yaml"), str(told), "--json", str(folder / "out.json")]
    line += ["--offsets", str(folder / "offsets.csv")]
    for kind, path in files.items():
        line += [f"--{kind}", str(path)]
    run = CliRunner().invoke(app, line, catch_exceptions=False)
    assert run.exit_code == 0
    said = " ".join(run.output.split())
    assert "or of the campaign): frame[D].x, frame[D].y" in said
    assert "gravity_sag" in said
    assert "nearly parallel" in said
    content = json.loads((folder / "out.json").read_text())
    assert set(content["files"]) == set(files)
    assert max(f["away_m"] for f in content["files"].values()) < 1e-9
    assert len(content["offsets"]) == 6
    assert not set(content["held"]) & set(content["missing"])
