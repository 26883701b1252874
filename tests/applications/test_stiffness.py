"""`qsf stiffness`: shares add up, the numbers are the model's, wrong input is named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.elastostatics import make_model
from qsframework.elastostatics.so3 import rotation_vector
from qsframework.elastostatics.state import site_in
from qsframework.errors import InputError
from qsframework.experiment.frames import procrustes
from qsframework.plugin import Array, Poses
from qsframework.robot import Robot, load_robot
from qsframework.uses import stiffness_at

POSE = np.deg2rad([10.0, 20.0, -10.0, 30.0, 40.0, 0.0])
POINT = np.array([0.15, 0.0, 0.2])
WEIGHT = np.array([0.0, 0.0, -4000.0, 0.0, 0.0, 0.0])


def test_shares_add_up() -> None:
    result = stiffness_at(load_robot("fanuc_m900ib"), POSE, WEIGHT, POINT)
    assert np.allclose(result.shares.sum(axis=0), result.linear, rtol=1e-12, atol=1e-18)
    assert 0.0 < result.linear_error < 0.01
    K = result.stiffness()
    assert K is not None
    assert np.allclose(K @ result.compliance, np.eye(6), atol=1e-8)


def test_the_secant_agrees_with_the_tangent() -> None:
    """A hundredth of the load: displacement = compliance x load to second order."""
    result = stiffness_at(load_robot("fanuc_m900ib"), POSE, WEIGHT / 100, POINT)
    assert np.allclose(result.compliance[:3] @ WEIGHT / 100, result.full, rtol=1e-3, atol=1e-9)


def by_three_points(robot: Robot) -> tuple[Array, Array]:
    """How the tool moves, m, and turns, rad: from where three points on it stand unloaded and loaded."""
    points = POINT + np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.4, -0.1]])
    sites = [(f"m{k}", site_in(robot.flange, point)) for k, point in enumerate(points)]
    model = make_model(robot.facts, robot.effects, robot.parameters, sites[0][1], sites, robot.gravity)
    poses = Poses(POSE[None], robot.controller.to_joints(POSE[None]), WEIGHT[None])
    before, after = (model.positions(poses, None, loaded)[0] for loaded in (False, True))
    return after[0] - before[0], rotation_vector(procrustes(before, after).rotation)


def test_the_command(tmp_path: Path) -> None:
    arguments = [
        "stiffness",
        "fanuc_m900ib",
        "--pose",
        "10,20,-10,30,40,0",
        "--load",
        "0,0,-4000",
        "--point",
        "150,0,200",
    ]
    files = ["--json", str(tmp_path / "s.json"), "--report", str(tmp_path / "s.html")]
    run = CliRunner().invoke(app, [*arguments, *files], catch_exceptions=False)
    assert run.exit_code == 0
    for word in ("joint_compliance[joint_3]", "full equilibrium", "K_C", "Linearisation error: "):
        assert word in run.output
    content = json.loads((tmp_path / "s.json").read_text())
    result = stiffness_at(load_robot("fanuc_m900ib"), POSE, WEIGHT, POINT)
    assert np.allclose(content["deflection_mm"], result.full * 1e3)
    moved, turned = by_three_points(load_robot("fanuc_m900ib"))
    np.testing.assert_allclose(content["deflection_mm"], moved * 1e3, rtol=1e-8)
    np.testing.assert_allclose(content["rotation_mrad"], turned * 1e3, rtol=1e-4)
    size = f"{1e3 * np.linalg.norm(moved):.4f} mm and turns by {1e3 * np.linalg.norm(turned):.4f} mrad"
    assert size in " ".join(run.output.split())
    assert "K_C" in (tmp_path / "s.html").read_text()


def test_a_load_of_zero_asks_for_the_stiffness_under_the_own_weight(tmp_path: Path) -> None:
    """As that of a load which is next to none."""
    tables = []
    for load in ("0,0,0", "0,0,-1e-6"):
        line = [
            "stiffness",
            "fanuc_m900ib",
            "--pose=10,20,-10,30,40,0",
            f"--load={load}",
            "--json",
            str(tmp_path / "s"),
        ]
        done = CliRunner().invoke(app, line)
        assert done.exit_code == 0, done.exception
        assert ("No load: K_C is that of the arm under its own weight." in " ".join(done.output.split())) == (
            load[-1] == "0"
        )
        tables.append(json.loads((tmp_path / "s").read_text())["stiffness"])
    flat = [np.array([v for part in t.values() for v in np.ravel(part)] if isinstance(t, dict) else t) for t in tables]
    np.testing.assert_allclose(flat[0], flat[1], rtol=1e-6, atol=1.0)


@pytest.mark.parametrize(
    ("pose", "load", "words"),
    [
        ("10,20", "0,0,-1", "--pose: found 2 numbers"),
        ("10,20,-10,30,40,0", "0,0", "--load: found 2 numbers"),
        ("10,20,-10,30,40,x", "0,0,-1", "numbers with commas"),
        ("10,20,-10,30,nan,0", "0,0,-1", "finite numbers"),
        ("10,200,-10,30,40,0", "0,0,-1", "joint_2 is outside its limits; found 200 deg; allowed: -64 to 90 deg"),
    ],
)
def test_wrong_input(pose: str, load: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        CliRunner().invoke(
            app, ["stiffness", "fanuc_m900ib", f"--pose={pose}", f"--load={load}"], catch_exceptions=False
        )
