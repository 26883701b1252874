"""`qsf compensate`: the loaded tool stands where it is wanted, and the error said to be left is the one that is."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.elastostatics import equilibrium, make_model
from qsframework.elastostatics.so3 import rotation_vector
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import (
    Experiment,
    LoadUncertainty,
    Readings,
    example,
    load_experiment,
    make_plan,
    simulate,
)
from qsframework.fits import FitRecord, identify, read_fit, write_fit
from qsframework.plugin import Array, Poses, build_effects
from qsframework.report.blocks import Figure, SceneView
from qsframework.report.compensation_section import target_view
from qsframework.uses.compensate import Compensation, compensate, tip_slope
from qsframework.uses.inverse import TipPose, pose_error, rigid_tip
from qsframework.uses.stiffness import spring_shares
from qsframework.uses.targets import Targets, flange_pose, joint_targets, read_targets
from qsframework.viz import Scene
from qsframework.viz.scenes import draw_targets
from tests.identify.records import record, with_values

MEASURED = np.array([0.0, 1500.0, -4000.0, 0.0, 0.0, 0.0])
WORK = np.array([300.0, 700.0, -5500.0, 50.0, 0.0, 100.0])
"""Wrenches of the readings and of the work."""


SPRINGS = tuple(f"joint_compliance[joint_{k}]" for k in (2, 3, 5))
"""What campaigns identify that are made many times."""


def angles(count: int, seed: int) -> Array:
    """Pendant angles (count, 6) rad that the M-900iB reaches, away from its wrist's singular pose."""
    rng = np.random.default_rng(seed)
    low, high = np.deg2rad([[-170, -30, -60, -170, 25, -170], [170, 60, 10, 170, 110, 170]])
    return rng.uniform(low, high, (count, 6))


def posed(experiment: Experiment, pendant: Array, wrench: Array) -> Poses:
    return Poses(pendant, experiment.robot.controller.to_joints(pendant), np.tile(wrench, (len(pendant), 1)))


def exact_fit(experiment: Experiment) -> FitRecord:
    """A fit that knows every parameter."""
    return record(experiment, experiment.model().nominal, {})


def known(fit: FitRecord) -> FitRecord:
    """The same values without their uncertainties, which are most of what a compensation computes."""
    return replace(fit, estimates=(), covariance=np.zeros((0, 0)), total_covariance=None, held=())


def stands(experiment: Experiment, result: Compensation, x: Array) -> TipPose:
    """Where the real arm's load point settles at the corrected angles."""
    q = experiment.robot.controller.to_joints(result.pendant)
    found = equilibrium(experiment.model(), Poses(result.pendant, q, result.targets.wrench), x)
    return TipPose(found.tip, found.tip_rotation)


@pytest.fixture(scope="module")
def targets(m900ib: Experiment) -> Targets:
    return joint_targets(m900ib, angles(8, 5), np.tile(WORK, (8, 1)))


def test_with_the_true_parameters_the_loaded_tool_stands_where_it_is_wanted(
    m900ib: Experiment, targets: Targets
) -> None:
    result = compensate(m900ib, exact_fit(m900ib), targets)
    error = pose_error(targets.wanted, stands(m900ib, result, m900ib.model().nominal))
    assert result.uncorrected.min() > 1e-3
    assert np.linalg.norm(error[:, :3], axis=1).max() < 1e-6 * result.uncorrected.min()
    assert np.linalg.norm(error[:, 3:], axis=1).max() < 1e-6 * np.linalg.norm(result.deflection[:, 3:], axis=1).min()
    told = rigid_tip(m900ib.robot, m900ib.load_site, m900ib.robot.controller.to_joints(result.pendant))
    assert np.allclose(result.command.position, told.position)


def test_identified_from_noisy_readings_of_the_full_equilibrium(
    m900ib: Experiment, targets: Targets, tmp_path: Path
) -> None:
    """The readings come from the equilibrium (17) of an arm that differs; the tool errs by less than 1 %."""
    model = m900ib.model()
    plan = make_plan(posed(m900ib, angles(24, 1), MEASURED), ["pull"] * 24)
    drawn = simulate(m900ib, plan, truth="drawn", seed=4)
    moved = model.predict(plan.poses, drawn.x)
    noise = 3e-5 * np.random.default_rng(8).standard_normal(moved.shape)
    readings = drawn.readings.with_values((moved + noise).reshape(-1, 3))
    fit = stored(m900ib, readings, tmp_path)
    result = compensate(m900ib, fit, targets)
    error = np.linalg.norm((stands(m900ib, result, drawn.x).position - targets.wanted.position), axis=1)
    assert np.all(error < 0.01 * result.uncorrected)
    before = compensate(m900ib, exact_fit(m900ib), targets)
    uncalibrated = np.linalg.norm(stands(m900ib, before, drawn.x).position - targets.wanted.position, axis=1)
    assert uncalibrated.mean() > 10 * error.mean(), "the nominal values would have erred far more"


def stored(experiment: Experiment, readings: Readings, folder: Path, linear: bool = False) -> FitRecord:
    """A fit as its file holds it; the arms here are the nominal ones, so that what was held is known exactly."""
    fit = identify(experiment, readings, options=FitOptions(linear=linear))
    return replace(read_fit(write_fit(fit, folder / "fit.json")), held=())


@pytest.mark.parametrize("reference", ["commanded", "unloaded"])
def test_the_view_bends_the_arm_by_what_the_table_says(m900ib: Experiment, targets: Targets, reference: str) -> None:
    result = compensate(m900ib, exact_fit(m900ib), targets, reference)
    view = target_view(m900ib, result, m900ib.model().nominal).blocks[0]
    assert isinstance(view, SceneView)
    for size in result.uncorrected:
        assert f'"{1e3 * size:.3f} mm"' in view.page


def test_arrows_and_ellipsoids_have_the_size_of_what_they_stand_for() -> None:
    scene = Scene(title="")
    before, moved = np.array([[3e-3, 0.0, 0.0]]), np.array([[0.0, 0.0, -2e-3]])
    covariance = np.diag([4e-10, 1e-10, 0.25e-10])[None]
    enlarged = draw_targets(scene, np.array([[1.0, 2.0, 3.0]]), before, moved, covariance)
    assert np.allclose(scene.placed["targets/0/before/head"][:3, 3], [1.3, 2.0, 3.0])
    assert np.allclose(scene.placed["targets/0/command/head"][:3, 3], [1.0, 2.0, 2.8])
    half = np.sort(np.linalg.norm(scene.placed["targets/0/left"][:3, :3], axis=0))
    assert np.allclose(half, enlarged * 2.0 * np.array([0.5e-5, 1e-5, 2e-5]))
    assert half.max() == pytest.approx(0.12)


def test_the_springs_add_up_to_the_deflection(m900ib: Experiment, targets: Targets) -> None:
    x = m900ib.model().nominal
    result = compensate(m900ib, exact_fit(m900ib), targets)
    view, springs = target_view(m900ib, result, x).blocks
    assert isinstance(view, SceneView)
    assert isinstance(springs, Figure)
    poses = Poses(targets.pendant, m900ib.robot.controller.to_joints(targets.pendant), targets.wrench)
    whole = 1e3 * np.linalg.norm(spring_shares(m900ib.model(), poses, x).sum(axis=1), axis=1)
    drawn = np.sum([bar.y for bar in springs.figure.data], axis=0)
    assert drawn == pytest.approx(whole, rel=0.02)
    moved = 1e3 * (result.command.position - rigid_tip(m900ib.robot, m900ib.load_site, poses.q).position)
    rows = {row[0]: [float(cell) for cell in row[4:]] for row in view.table.rows}
    assert np.allclose([rows[name] for name in rows], moved[[targets.name.index(n) for n in rows]], atol=1e-4)


def test_the_slope_of_the_tip_agrees_with_the_models_own(m900ib: Experiment, targets: Targets) -> None:
    """Differences of the full equilibrium against analytic derivatives there, a marker at the tip; linear, about."""
    robot = m900ib.robot
    site = m900ib.load_site
    model = make_model(robot.facts, robot.effects, robot.parameters, site, [("tip", site)], robot.gravity)
    fit = record(m900ib, m900ib.model().nominal, dict.fromkeys(m900ib.fit_names(), 1.0))
    poses = Poses(targets.pendant, robot.controller.to_joints(targets.pendant), targets.wrench)

    def stand(x: Array) -> TipPose:
        found = equilibrium(m900ib.model(), poses, x)
        return TipPose(found.tip, found.tip_rotation)

    slope = tip_slope(m900ib.model(), fit.names, model.nominal, stand)[:, :3]
    for linear, share in ((True, 0.02), (False, 1e-8)):
        analytic = model.position_sensitivity(poses, names=fit.names, loaded=True, linear=linear)[:, 0]
        size = np.abs(analytic).max(axis=(0, 1))
        assert np.all(np.abs(slope - analytic) < share * size)


def test_the_uncertainty_of_the_load_counts(m900ib: Experiment, tmp_path: Path) -> None:
    """Campaigns whose load is wrong in size and direction: the true arm errs as said, far more than noise explains.

    Readings and fits of the linear model, which is quick.
    """
    stated = m900ib.with_(fit=SPRINGS, load_uncertainty=LoadUncertainty(0.02, np.deg2rad(0.5)))
    poses = posed(stated, angles(12, 1), MEASURED)
    work = joint_targets(stated, angles(2, 5), np.tile(WORK, (2, 1)))
    x, rng = stated.model().nominal, np.random.default_rng(6)
    error, said, noise = [], [], []
    days: list[Readings] = []
    results: list[Compensation] = []
    told = simulate(stated, make_plan(poses, ["pull"] * 12), linear=True).readings
    for seed in range(30):
        turn = np.eye(3) + np.cross(np.eye(3), np.deg2rad(0.5) * rng.standard_normal(3))
        wrong = (1.0 + 0.02 * rng.standard_normal()) * np.kron(np.eye(2), turn)
        acting = make_plan(replace(poses, wrench=poses.wrench @ wrong.T), ["pull"] * 12)
        days.append(told.with_values(simulate(stated, acting, seed=seed, linear=True).readings.value))
        fit = stored(stated, days[-1], tmp_path, linear=True)
        result = compensate(stated, fit if seed % 6 == 5 else known(fit), work, anyway=True)  # nominal values are true
        results.append(result)
        error.append(np.linalg.norm(stands(stated, result, x).position - work.wanted.position, axis=1))
        if seed % 6 == 5:  # they are much the same after every campaign
            said.append(result.sd)
            noise.append(result.noise_sd)
    ratio = np.sqrt(np.mean(np.square(error), axis=0)) / np.sqrt(np.mean(np.square(said), axis=0))
    assert np.all((ratio > 0.75) & (ratio < 1.25)), ratio
    assert np.all(np.mean(said, axis=0) > 2.0 * np.mean(noise, axis=0))
    assert "states no uncertainty of its load" not in " ".join(results[-1].notes)
    found = identify(stated, days[-1], options=FitOptions(linear=True))
    write_fit(found, tmp_path / "fit.json")
    again = replace(read_fit(tmp_path / "fit.json"), held=())
    np.testing.assert_allclose(compensate(stated, again, work).sd, results[-1].sd, rtol=1e-9)
    plain = replace(again, total_covariance=None)
    noise_and_lack = np.hypot(results[-1].noise_sd, again.lack)
    np.testing.assert_allclose(compensate(stated, plain, work).sd, noise_and_lack, rtol=1e-9)
    assert "states no uncertainty of its load" in " ".join(compensate(stated, plain, work).notes)


def test_a_scale_of_the_load_that_is_fitted_counts_as_a_stated_one(m900ib: Experiment, tmp_path: Path) -> None:
    """The readings tell no scale of a load from softer springs: what is known of it before is the error at the work."""
    every = ("joint_compliance",)
    stated = m900ib.with_(fit=every, load_uncertainty=LoadUncertainty(0.05, 0.0))
    (scale,) = build_effects({"effect": "load_scale"}, m900ib.robot.facts)
    (own,) = scale.parameters(m900ib.robot.facts)
    fitted = m900ib.with_(
        effects=(*m900ib.effects, scale),
        parameters=(*m900ib.parameters, replace(own, sd=0.05)),
        fit=(*every, scale.name),
    )
    plan = make_plan(posed(stated, angles(12, 1), MEASURED), ["pull"] * 12)
    work = joint_targets(stated, angles(2, 5), np.tile(WORK, (2, 1)))
    told = [compensate(arm, stored(arm, simulate(arm, plan).readings, tmp_path), work) for arm in (stated, fitted)]
    np.testing.assert_allclose(told[1].sd, told[0].sd, rtol=0.05)
    assert np.all(told[1].sd > 3.0 * told[0].noise_sd)
    assert "load_scale is of the campaign's load" in " ".join(told[1].notes)


def test_an_arm_that_warms_up_is_corrected_at_the_reference_temperature(m900ib: Experiment) -> None:
    (warm,) = build_effects({"effect": "thermal_expansion"}, m900ib.robot.facts)
    arm = m900ib.with_(
        effects=(*m900ib.effects, warm), parameters=(*m900ib.parameters, *warm.parameters(m900ib.robot.facts))
    )
    work = [joint_targets(e, angles(2, 5), np.tile(WORK, (2, 1))) for e in (m900ib, arm)]
    plain, grown = compensate(m900ib, exact_fit(m900ib), work[0]), compensate(arm, exact_fit(arm), work[1])
    np.testing.assert_allclose(grown.pendant, plain.pendant, atol=1e-12)
    assert "count at 20 degC" in " ".join(grown.notes)
    assert "20 degC" not in " ".join(plain.notes)


def test_unloaded_reference(m900ib: Experiment, targets: Targets) -> None:
    """LearnedLaw with an empty hand: the loaded arm stands where the unloaded one stood at the learned angles."""
    result = compensate(m900ib, exact_fit(m900ib), targets, "unloaded")
    x = m900ib.model().nominal
    q = m900ib.robot.controller.to_joints(targets.pendant)
    empty = equilibrium(m900ib.model(), Poses(targets.pendant, q, targets.wrench), x, loaded=False)
    error = stands(m900ib, result, x).position - empty.tip
    assert np.abs(error).max() < 1e-9
    with pytest.raises(InputError, match="unknown reference 'learned'"):
        compensate(m900ib, exact_fit(m900ib), targets, "learned")


def write_csv(path: Path, header: list[str], rows: Array) -> Path:
    lines = [",".join(header), *(",".join(map(repr, row)) for row in rows.tolist())]
    path.write_text("\n".join(lines) + "\n")
    return path


FORCES = ["fx_N", "fy_N", "fz_N"]
JOINTS = [f"q{k}_deg" for k in range(1, 7)]
PLACE = ["x_mm", "y_mm", "z_mm"]
TURNS = ["rx_deg", "ry_deg", "rz_deg"]


@pytest.mark.parametrize("quaternion", [False, True])
def test_cartesian_targets_are_the_joint_targets_they_came_from(
    m900ib: Experiment, targets: Targets, tmp_path: Path, quaternion: bool
) -> None:
    from scipy.spatial.transform import Rotation

    place, turn = flange_pose(targets.wanted)
    columns, names = [place * 1e3], list(PLACE)
    if quaternion:
        x, y, z, w = Rotation.from_euler("xyz", turn).as_quat().T
        columns.append(np.stack([w, x, y, z], axis=1))
        names += ["quat_w", "quat_x", "quat_y", "quat_z"]
    else:
        columns.append(np.rad2deg(turn))
        names += TURNS
    start = np.rad2deg(targets.pendant) + 3.0
    columns += [start, targets.wrench[:, :3]]
    path = write_csv(tmp_path / "t.csv", [*names, *JOINTS, *FORCES], np.hstack(columns))
    read = read_targets(path, m900ib)
    assert read.cartesian
    assert np.allclose(read.pendant, targets.pendant, atol=1e-6), "near the start there is one solution"
    assert np.abs(pose_error(read.wanted, targets.wanted)).max() < 1e-8


def test_cartesian_targets_without_a_start(m900ib: Experiment, targets: Targets, tmp_path: Path) -> None:
    """Any joint angles will do, within the limits, that put the load point there."""
    place, turn = flange_pose(targets.wanted)
    rows = np.hstack([place * 1e3, np.rad2deg(turn), targets.wrench[:, :3]])
    read = read_targets(write_csv(tmp_path / "t.csv", [*PLACE, *TURNS, *FORCES], rows), m900ib)
    assert not m900ib.robot.controller.outside(read.pendant).any()
    reached = rigid_tip(m900ib.robot, m900ib.load_site, m900ib.robot.controller.to_joints(read.pendant))
    assert np.abs(pose_error(targets.wanted, reached)).max() < 1e-6


@pytest.mark.parametrize(
    ("header", "row", "words"),
    [
        ([*JOINTS, *FORCES], [0, 95, 0, 0, 40, 0, 0, 0, -1000], "line 2, column q2_deg: joint_2 is outside its limits"),
        ([*JOINTS, *FORCES], [0, 0, 0, 0, 40, 0, 0, 0, -8000], "line 2, column fx_N: the force is more than .*700 kg"),
        ([*PLACE, *TURNS, *FORCES], [9000, 0, 0, 0, 0, 0, 0, 0, -1], "line 2: target 't01': no joint angles .*mm and"),
        ([*JOINTS[:5], *FORCES], [0, 0, 0, 0, 40, 0, 0, -1000], "missing: q6.* Targets are joint angles"),
        ([*PLACE, *FORCES], [2000, 0, 1000, 0, 0, -1000], "missing: rx_deg, ry_deg, rz_deg or quat_w"),
        (
            [*PLACE, "quat_w", "quat_x", "quat_y", "quat_z", *FORCES],
            [2000, 0, 1000, 1, 1, 0, 0, 0, 0, -1],
            "column quat_w: a quaternion of a rotation has length 1; found 1.414",
        ),
        ([*PLACE, *TURNS, "quat_w", *FORCES], [2000, 0, 1000, 1, 1, 0, 1, 0, 0, -1], "the rotation is given twice"),
        ([*JOINTS, "fx_N", "fy_N"], [0, 0, 0, 0, 40, 0, 0, 0], "column fz: this column is missing"),
    ],
)
def test_wrong_targets(m900ib: Experiment, tmp_path: Path, header: list[str], row: list[float], words: str) -> None:
    path = write_csv(tmp_path / "targets.csv", header, np.array([row], dtype=float))
    with pytest.raises(InputError, match=words) as caught:
        read_targets(path, m900ib)
    assert "targets.csv" in str(caught.value)


def test_two_targets_of_one_name(m900ib: Experiment, tmp_path: Path) -> None:
    path = tmp_path / "targets.csv"
    rows = [f"{name},0,{20 + i},0,0,40,0,0,0,-1000" for i, name in enumerate(["hole", "", "hole", ""])]
    path.write_text("\n".join([",".join(["target", *JOINTS, *FORCES]), *rows]) + "\n")
    with pytest.raises(InputError, match="line 4, column target: target 'hole' stands here twice; first in line 2"):
        read_targets(path, m900ib)


def test_a_target_at_a_joint_limit(m900ib: Experiment, tmp_path: Path) -> None:
    """Joint 3 at its upper limit: the arm sags, so the correction goes on beyond it; at the lower one it comes back."""
    rows = np.array([[0, 20, 30, 0, 60, 0, 0, 0, -5000], [0, 0, -90, 0, 60, 0, 0, 0, -5000]], dtype=float)
    read = read_targets(write_csv(tmp_path / "t.csv", [*JOINTS, *FORCES], rows), m900ib)
    words = "t.csv, line 2: target 't01': the target is at the limit of joint_3 .*30 deg. Move the target by 0.0"
    with pytest.raises(InputError, match=words) as caught:
        compensate(m900ib, exact_fit(m900ib), read)
    assert len(caught.value.problems) == 1


def test_a_singular_target(m900ib: Experiment, tmp_path: Path) -> None:
    """What joint springs give, joints can take back, at any pose; a base that tilts needs all six directions."""
    straight = np.deg2rad([[0.0, 20.0, -20.0, 10.0, 0.0, 5.0]])
    at = joint_targets(m900ib, straight, WORK[None])
    result = compensate(m900ib, exact_fit(m900ib), at)
    assert np.abs(result.left).max() < 1e-8
    text = m900ib.path.read_text() + "\neffects: [{effect: base_compliance, directions: [rx]}]\nnominal: nominal.yaml\n"
    (tmp_path / "experiment.yaml").write_text(text)
    (tmp_path / "nominal.yaml").write_text("base_compliance[rx]: {value_urad/(N m): 0.05}\n")
    soft = load_experiment(tmp_path / "experiment.yaml")
    with pytest.raises(InputError, match=r"'t01': no small correction .*singular pose"):
        compensate(soft, exact_fit(soft), at)
    bent = joint_targets(soft, straight + np.deg2rad([0, 0, 0, 0, 40, 0]), WORK[None])
    assert np.abs(compensate(soft, exact_fit(soft), bent).left).max() < 1e-8


def test_errors_of_geometry_are_corrected_too(m900ib: Experiment, targets: Targets, tmp_path: Path) -> None:
    """A fit of positions knows joint zeros, and has parameters of the tracker's frame, which move no tip."""
    text = m900ib.path.read_text() + "\neffects: [{effect: joint_offset, joints: [joint_2, joint_5]}]\n"
    (tmp_path / "experiment.yaml").write_text(text)
    bent = load_experiment(tmp_path / "experiment.yaml")
    model, offsets = bent.model(), ("joint_offset[joint_2]", "joint_offset[joint_5]")
    x = model.nominal
    x[model.index(offsets)] = 3e-3, -2e-3
    sd = (1e-4, 2e-4)
    fit = record(bent, x, {**dict(zip(offsets, sd, strict=True)), "frame[s].x": 1.0}, {"frame[s].x": 1.0})
    result = compensate(bent, fit, targets)
    assert result.uncorrected.max() > 6e-3, "3 mrad at two metres and more"
    assert np.abs(pose_error(targets.wanted, stands(bent, result, x))).max() < 1e-8
    squared = np.zeros(len(targets))
    for k, name in enumerate(offsets):
        y = x.copy()
        y[model.index([name])] += sd[k]
        squared += np.sum((stands(bent, result, y).position - targets.wanted.position) ** 2, axis=1)
    assert np.allclose(result.sd, np.sqrt(squared), rtol=0.01)


def test_a_fit_of_another_robot(m900ib: Experiment, r2000ic: Experiment, targets: Targets) -> None:
    with pytest.raises(InputError, match=r"fit.json: the fit is of another robot; found fanuc_r2000ic; allowed"):
        compensate(m900ib, exact_fit(r2000ic), targets)
    with pytest.raises(InputError, match=r"another model than experiment.yaml: only one has compensator_stiffness"):
        compensate(m900ib, replace(exact_fit(r2000ic), robot=m900ib.robot.name), targets)


def test_the_command(m900ib: Experiment, targets: Targets, tmp_path: Path) -> None:
    plan = make_plan(posed(m900ib, angles(12, 1), MEASURED), ["pull"] * 12)
    write_fit(identify(m900ib, simulate(m900ib, plan).readings), tmp_path / "fit.json")
    assert read_fit(tmp_path / "fit.json").robot == "fanuc_m900ib"
    rows = np.hstack([np.rad2deg(targets.pendant), targets.wrench[:, :3]])
    path = write_csv(tmp_path / "t.csv", [*JOINTS, *FORCES], rows)
    out = {name: tmp_path / name for name in ("c.csv", "c.json", "c.html")}
    arguments = [str(m900ib.path), str(tmp_path / "fit.json"), str(path), "-o", str(out["c.csv"])]
    arguments += ["--json", str(out["c.json"]), "--report", str(out["c.html"])]
    run = CliRunner().invoke(app, ["compensate", *arguments], catch_exceptions=False)
    assert run.exit_code == 0
    assert "The largest expected error is" in run.output
    lines = [line for line in out["c.csv"].read_text().splitlines() if not line.startswith("#")]
    table = list(csv.DictReader(lines))
    content = json.loads(out["c.json"].read_text())
    assert [row["target"] for row in table] == [t["target"] for t in content["targets"]]
    pendant = np.deg2rad([[float(row[j]) for j in JOINTS] for row in table])
    model, forces = m900ib.model(), np.hstack([targets.wrench[:, :3], np.zeros((8, 3))])
    settled = equilibrium(model, replace(posed(m900ib, pendant, WORK), wrench=forces))
    wanted = targets.wanted.position
    assert np.linalg.norm(settled.tip - wanted, axis=1).max() < 1e-4
    assert max(t["expected_error_mm"] for t in content["targets"]) == content["largest"]["expected_error_mm"] < 0.1
    uncorrected = equilibrium(model, replace(posed(m900ib, targets.pendant, WORK), wrench=forces))
    turn = uncorrected.tip_rotation @ targets.wanted.rotation.transpose(0, 2, 1)
    for t, place, R in zip(content["targets"], uncorrected.tip - wanted, turn, strict=True):
        for found, moved in ((t["deflection_mm"], 1e3 * place), (t["rotation_mrad"], 1e3 * rotation_vector(R))):
            assert np.linalg.norm(np.array(found) - moved) < 0.1 * np.linalg.norm(moved)
    page = out["c.html"].read_text()
    assert "Corrected targets" in page
    assert "Look for targets" in page
    again = CliRunner().invoke(app, ["compensate", *arguments[:3], "-o", str(path)])
    assert isinstance(again.exception, InputError)
    assert "would overwrite an input" in str(again.exception)


def test_forces_on_a_model_in_which_nothing_gives(tmp_path: Path) -> None:
    """`rigid: true` with a load: the forces would be passed over, so they are refused; without them it compensates."""
    text = (example("ur10") / "experiment.yaml").read_text()
    (tmp_path / "experiment.yaml").write_text(text + "load: {point_mm: [0, 0, 100]}\n")
    for file in example("ur10").glob("*.csv"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    rigid, told = load_experiment(tmp_path / "experiment.yaml"), tmp_path / "fit.json"
    run = CliRunner().invoke(app, ["identify", str(rigid.path), "--json", str(told)], catch_exceptions=False)
    assert run.exit_code == 0
    fit = read_fit(told)
    pendant = np.deg2rad([[0.0, -70.0, 60.0, -80.0, -90.0, 0.0], [10.0, -70.0, 60.0, -80.0, -90.0, 0.0]])
    wrench = np.zeros((2, 6))
    assert compensate(rigid, fit, joint_targets(rigid, pendant, wrench), anyway=True).uncorrected.min() > 1e-5
    wrench[1, 2] = -50.0
    words = r"target 't02': nothing in the fitted model gives under this force.*Leave the forces .* without rigid: true"
    with pytest.raises(InputError, match=words):
        compensate(rigid, fit, joint_targets(rigid, pendant, wrench))
    one_spring = with_values(fit, {"joint_compliance[joint_2]": 25e-6})
    pulled, bare = (
        compensate(rigid, one_spring, joint_targets(rigid, pendant, w), anyway=True).deflection[1, 2]
        for w in (wrench, 0 * wrench)
    )
    assert pulled - bare < -1e-4, "with a spring the force counts"
