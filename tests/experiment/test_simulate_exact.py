"""`simulate`: readings of an arm that settles in its full equilibrium, as a real one does; or of the tangent model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qsframework.elastostatics import equilibrium
from qsframework.experiment import Experiment, load_experiment, make_plan, simulate
from qsframework.experiment.readings import Made
from qsframework.plugin import Poses

HEAVY = np.array([0.0, 2000.0, -5000.0, 0.0, 0.0, 0.0])


def placed(experiment: Experiment) -> Poses:
    low, high = np.deg2rad([[-170, -30, -60, -170, 25, -170], [170, 60, 10, 170, 110, 170]])
    pendant = np.random.default_rng(3).uniform(low, high, (6, 6))
    return Poses(pendant, experiment.robot.controller.to_joints(pendant), np.tile(HEAVY, (6, 1)))


def moved(experiment: Experiment, linear: bool = False) -> np.ndarray:
    plan = make_plan(placed(experiment), ["heavy"] * 6)
    readings = simulate(experiment, plan, seed=5, linear=linear).readings
    assert readings.made == Made("linear" if linear else "equilibrium", 5)
    return readings.value


def test_the_tip_moves_as_the_two_equilibria_do(m900ib: Experiment, tmp_path: Path) -> None:
    """A marker at the load point: the difference of the loaded and the unloaded equilibrium, the same noise on both."""
    point = "[150, 0, 200]"
    text = f"robot: fanuc_m900ib\nload: {{point_mm: {point}}}\nmarkers: {{m: {{xyz_mm: {point}}}}}\n"
    (tmp_path / "experiment.yaml").write_text(text + "noise: {sigma_mm: 1.0e-6}\n")
    one = load_experiment(tmp_path / "experiment.yaml")
    poses, model = placed(one), one.model()
    tips = equilibrium(model, poses).tip - equilibrium(model, poses, loaded=False).tip
    np.testing.assert_allclose(moved(one), tips, atol=1e-8)
    bent = np.abs(moved(one, linear=True) - tips).max()
    assert 1e-6 < bent < 0.01 * np.abs(tips).max(), "second order in the deflection"


def test_sensors_still_act(m900ib: Experiment, tmp_path: Path) -> None:
    """A tracker whose scale is 1 % off."""
    base = m900ib.path.read_text()
    (tmp_path / "experiment.yaml").write_text(base + "\neffects: [{effect: tracker_scale}]\nnominal: n.yaml\n")
    (tmp_path / "n.yaml").write_text("tracker_scale: {value_percent: 1}\n")
    scaled = load_experiment(tmp_path / "experiment.yaml")
    assert scaled.model().names[-1].startswith("tracker_scale")
    more = moved(scaled) - moved(m900ib)
    assert np.abs(more).max() == pytest.approx(0.01 * np.abs(moved(m900ib)).max(), rel=0.05)
