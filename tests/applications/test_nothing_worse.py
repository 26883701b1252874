"""`qsf compensate` makes no target worse: what a fit does not know keeps its commanded pose, of a path all or none."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from heavy_arm import at_levels, rms
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.elastostatics import Site, equilibrium
from qsframework.errors import InputError
from qsframework.experiment import Experiment, example, load_experiment, make_plan, simulate, write_readings
from qsframework.fits import FitRecord
from qsframework.plans import generate_candidates
from qsframework.plugin import Array, Poses, build_effects
from qsframework.uses.compensate import Compensation, compensate
from qsframework.uses.inverse import poses_at, rigid_tip
from qsframework.uses.targets import Targets, joint_targets
from tests.applications.test_compensate import angles
from tests.identify.records import record

LIGHT, HEAVY = np.array([0.0, 0.0, -20.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, -5000.0, 0.0, 0.0, 0.0])
NAME = "joint_compliance[joint_3]"


def vague(experiment: Experiment, share: float) -> FitRecord:
    """A fit that knows one spring to a share of its value."""
    x = experiment.model().nominal
    return record(experiment, x, {NAME: share * float(x[experiment.model().names.index(NAME)])})


def both(experiment: Experiment) -> Targets:
    """Two targets under next to no load, and two under a heavy one."""
    return joint_targets(experiment, angles(4, 5), np.array([LIGHT, LIGHT, HEAVY, HEAVY]))


def deflected(experiment: Experiment, fit: FitRecord, **more: bool) -> Compensation:
    return compensate(experiment, fit, both(experiment), "unloaded", **more)


def lacking(fit: FitRecord, held_out: float) -> FitRecord:
    """The same with residuals that exceed the noise, and with that error at held-out poses."""
    return replace(
        fit,
        chi2=100.0 * 200,
        dof=100,
        held_out_error=held_out,
        held_out_worst=held_out,
        held_out_nominal=10.0 * held_out,
    )


def moved(result: Compensation) -> Array:
    return np.abs(result.pendant - result.targets.pendant).max(axis=1)


def test_targets_that_the_fit_cannot_bring_nearer_keep_their_pose(m900ib: Experiment) -> None:
    fit = lacking(vague(m900ib, 0.001), 2e-4)
    result = deflected(m900ib, fit)
    assert result.kept.tolist() == [True, True, False, False]
    assert (moved(result) == 0.0).tolist() == [True, True, False, False]
    there = rigid_tip(m900ib.robot, m900ib.load_site, m900ib.robot.controller.to_joints(result.targets.pendant))
    np.testing.assert_array_equal(result.command.position[:2], there.position[:2])
    assert "not moved, since a correction would bring them no nearer to their places: t01, t02" in result.notes
    assert (result.sd[:2] >= result.uncorrected[:2]).all()
    assert (result.sd[2:] < result.uncorrected[2:]).all()


def test_of_a_path_all_points_are_moved_or_none(m900ib: Experiment) -> None:
    """The heavy points gain more than the light ones lose; where the fit knows less, nothing gains."""
    assert not deflected(m900ib, lacking(vague(m900ib, 0.001), 2e-4), path=True).kept.any()
    with pytest.raises(InputError, match="no correction: it would make the targets no better"):
        deflected(m900ib, lacking(vague(m900ib, 0.001), 0.02), path=True)


def test_nothing_is_written_where_nothing_gains(m900ib: Experiment) -> None:
    fit = vague(m900ib, 20.0)
    with pytest.raises(InputError, match=r"to be expected after it, .* mm without it.*Measure more poses"):
        deflected(m900ib, fit)
    result = deflected(m900ib, fit, anyway=True)
    assert not result.kept.any()
    assert (moved(result)[2:] > 0.0).all()


def test_expected_errors_hold_what_held_out_poses_are_off_beyond_the_noise(m900ib: Experiment) -> None:
    """Residuals of which 199 in 200 parts are not noise, and 0.2 mm at held-out poses."""
    fit = vague(m900ib, 1e-6)
    plain, wide = deflected(m900ib, fit), deflected(m900ib, lacking(fit, 2e-4), anyway=True)
    np.testing.assert_allclose(wide.sd[2:], 2e-4 * np.sqrt(199.0 / 200.0), rtol=1e-3)
    assert (plain.sd[2:] < 1e-6).all()


def test_load_and_own_weight_stand_apart(m900ib: Experiment) -> None:
    """Of the whole deflection: what the tip moves when the load is hung, and what it had sagged before."""
    targets = both(m900ib)
    result = compensate(m900ib, vague(m900ib, 1e-3), targets)
    alone = compensate(m900ib, vague(m900ib, 1e-3), targets, "unloaded")
    np.testing.assert_allclose(result.of_load, np.linalg.norm(alone.deflection[:, :3], axis=1), rtol=0.02, atol=1e-6)
    np.testing.assert_allclose(result.own + (result.deflection - result.own), result.deflection)
    assert (result.of_own > 1e-4).all()
    assert not alone.own.any()


def test_targets_beyond_the_readings_are_said(m900ib: Experiment) -> None:
    fit = vague(m900ib, 1e-3)
    low = tuple((-0.5, 0.5) if k == 0 else (-7.0, 7.0) for k in range(6))
    narrow = replace(fit, account=replace(fit.account, force=4000.0, angles=low))
    far = [name for name, q in zip(both(m900ib).name, both(m900ib).pendant[:, 0], strict=True) if abs(q) > 0.5]
    notes = deflected(m900ib, narrow).notes
    assert "beyond the force of the readings, 4000 N: 5000 N at t03, t04" in notes
    assert f"beyond the angles of the readings: joint_1 at {', '.join(far)}" in notes
    assert not any("beyond the" in note for note in deflected(m900ib, fit).notes)


def test_targets_beyond_the_measured_workspace_are_said(m900ib: Experiment) -> None:
    """The box of the flange's measured places, enlarged by a tenth of its diagonal."""
    fit, targets, robot = vague(m900ib, 1e-3), both(m900ib), m900ib.robot
    site = Site(robot.flange.link, robot.flange.placement[:3, 3])
    places = rigid_tip(robot, site, robot.controller.to_joints(targets.pendant)).position
    low, high = places.min(axis=0), places.max(axis=0)
    for beyond, said in ((0.09, False), (0.13, True)):  # of the diagonal, along x
        short = (high - low) - [beyond * float(np.linalg.norm(high - low)), 0.0, 0.0]
        box = tuple(zip(low.tolist(), (low + short).tolist(), strict=True))
        notes = deflected(m900ib, replace(fit, account=replace(fit.account, flange=box))).notes
        name = targets.name[int(np.argmax(places[:, 0]))]
        assert any(f"outside the box of its measured places: {name}" in note for note in notes) == said


def campaign(share: float, count: int, folder: Path) -> tuple[Experiment, Array]:
    """The arm of examples/geometry with this share of errors drawn by their typical size, measured at some poses."""
    experiment = load_experiment(example("geometry") / "experiment.yaml")
    plan = make_plan(posed(experiment, count, 0), [""] * count, station=["front"] * count)
    nominal, drawn = (simulate(experiment, plan, truth=truth, seed=1).x for truth in ("nominal", "drawn"))
    x = nominal + share * (drawn - nominal)
    write_readings(folder / "readings.csv", simulate(experiment, plan, x, seed=1).readings, experiment)
    return experiment, x


def posed(experiment: Experiment, count: int, seed: int) -> Poses:
    pendant = generate_candidates(experiment, count, seed=seed).pendant
    return Poses(pendant, experiment.robot.controller.to_joints(pendant), np.zeros((count, 6)))


def compensated(share: float, count: int, folder: Path, *more: str) -> tuple[str, list[Array]]:
    """What `qsf compensate` says of 30 targets, and the real errors of the arm there (30,) m, after the best frame and
    tool, before and, where it corrects, after it."""
    experiment, x = campaign(share, count, folder)
    poses, joints = posed(experiment, 30, 7), [f"q{k}_deg" for k in range(1, 7)]
    fit, targets, corrected = folder / "fit.json", folder / "targets.csv", folder / "corrected.csv"
    np.savetxt(targets, np.rad2deg(poses.pendant), delimiter=",", header=",".join(joints), comments="")
    run = CliRunner().invoke(app, ["identify", str(experiment.path), str(folder / "readings.csv"), "--json", str(fit)])
    assert run.exit_code == 0
    names = [experiment.path, fit, targets, "-o", corrected, "--json", f"{fit}.json", *more]
    run = CliRunner().invoke(app, ["compensate", *map(str, names)])
    commanded = [poses.pendant]
    if run.exit_code == 0:
        rows = [line for line in corrected.read_text().splitlines() if not line.startswith("#")]
        commanded.append(np.deg2rad([[float(row[j]) for j in joints] for row in csv.DictReader(rows)]))
    wanted, errors = rigid_tip(experiment.robot, experiment.load_site, poses.q).position, list[Array]()
    for pendant in commanded:
        q = experiment.robot.controller.to_joints(pendant)
        found = equilibrium(experiment.model(), Poses(pendant, q, poses.wrench), x, loaded=False)
        errors.append(at_levels(found.tip, found.tip_rotation, wanted)["tool"])
    assert corrected.exists() == (len(errors) == 2)
    return " ".join(f"{run.output} {run.exception}".split()), errors


def test_the_real_error_falls_at_the_level_of_the_held_out_error(tmp_path: Path) -> None:
    """The places of the reflectors were estimated: what is compared, and said, is after the best frame and tool."""
    words, (before, after) = compensated(0.5, 45, tmp_path)
    result = json.loads((tmp_path / "fit.json.json").read_text())
    assert result["level"] == "after the best frame and tool"
    assert "(largest, predicted; after the best frame and tool; before: " in words
    assert "in the base frame up to 1." in words
    expected, uncorrected = (
        1e-3 * np.array([row[name] for row in result["targets"]]) for name in ("expected_error_mm", "uncorrected_mm")
    )
    assert rms(after) < 0.1 * rms(before)
    assert 0.5 < rms(after) / rms(expected) < 1.3
    assert 0.7 < rms(before) / rms(uncorrected) < 1.3
    assert all(row["expected_error_base_mm"] > 1.0 > row["expected_error_frame_mm"] for row in result["targets"])


def test_six_poses_make_a_good_arm_no_better(tmp_path: Path) -> None:
    """A twentieth of the errors: what is expected after it is not below what is uncorrected, and nothing is written."""
    words, errors = compensated(0.05, 6, tmp_path)
    assert "no correction: it would make the targets no better" in words
    assert len(errors) == 1
    _, (before, after) = compensated(0.05, 6, tmp_path, "--anyway")
    assert rms(after) > rms(before)


def test_what_is_driven_is_the_arm_as_its_last_readings_found_it(m900ib: Experiment) -> None:
    """A link that grew by .2 mm between the first and the last reading has grown."""
    grown = m900ib.with_effects(build_effects({"effect": "link_growth", "link": "link_2"}, m900ib.robot.facts))
    model, pendant = grown.model(), angles(3, 5)
    x = model.nominal
    x[model.index(["link_growth[link_2].drift"])] = 2e-4
    poses = poses_at(m900ib.robot, pendant, np.tile(LIGHT, (3, 1)))
    moved = equilibrium(model, poses, x).tip - equilibrium(model, poses, model.nominal).tip
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 2e-4, rtol=0.02)
