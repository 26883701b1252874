"""All derivatives by the geometry at once are those that the chain rule takes one at a time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_chain_rule import MODELS

from qsframework.elastostatics import Model, direct, tangents
from qsframework.experiment import load_experiment
from qsframework.plugin import Poses

EVERYTHING = """
robot: {robot}
markers:
  far: {{xyz_mm: [30, -40, 120]}}
  near: {{xyz_mm: [10, 60, 5], link: {link}}}
noise: estimate
effects:
  - {{effect: marker_offset, markers: all}}
  - {{effect: joint_offset, joints: all}}
  - {{effect: encoder_eccentricity, joint: joint_2}}
  - {{effect: joint_placement, joints: all}}
  - {{effect: gravity_sag, joints: [joint_2, joint_3]}}
  - {{effect: offaxis_compliance, joint: joint_3, axis: x}}
  - {{effect: link_mass, link: link_3}}
  - {{effect: load_point_offset}}
  - {{effect: joint_hardening, joint: joint_3}}
"""
POINTS = """
  - effect: point_spring
    first: link_1
    second: link_3
    first_x_mm: 200
    first_y_mm: 0
    first_z_mm: 0
    second_x_mm: 0
    second_y_mm: 50
    second_z_mm: 300
"""


def made(folder: Path, robot: str, link: str, more: str = "") -> Model:
    file = folder / "experiment.yaml"
    file.write_text(EVERYTHING.format(robot=robot, link=link) + more)
    return load_experiment(file).model()


def both_ways(monkeypatch: pytest.MonkeyPatch, ask: Callable[[], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """By all elements at once, and with a pass for each parameter."""
    asked: list[bool] = []
    known = direct.element_readings

    def seen(*given: Any) -> np.ndarray:
        asked.append(True)
        return known(*given)

    monkeypatch.setattr(tangents, "element_readings", seen)
    fast = ask()
    assert asked
    asked.clear()
    monkeypatch.setattr(direct, "_FEW", 10**9)
    slow = ask()
    assert not asked
    return fast, slow


@pytest.mark.parametrize(
    ("robot", "link"), [("ur10", "link_4"), ("fanuc_r2000ic", "link_3"), ("fanuc_m900ib", "link_3")]
)
@pytest.mark.parametrize("springs", ["all", "one", "none"])
@MODELS
@pytest.mark.parametrize("reading", ["unloaded", "loaded", "displacement"])
def test_the_same_as_the_chain_rule(
    robot: str, link: str, springs: str, reading: str, linear: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of arms with and without loops, balancers, laws of springs and loads that turn with the flange."""
    model, rng = made(tmp_path, robot, link), np.random.default_rng(1)
    sizes = np.array([p.typical for p in model.parameters])
    x = model.nominal + sizes * rng.standard_normal(len(sizes))
    compliances = [i for i, name in enumerate(model.names) if "compliance" in name]
    x[compliances] = np.abs(x[compliances])
    x[compliances[{"all": len(compliances), "one": 1, "none": 0}[springs] :]] = 0.0
    q = rng.uniform(-0.7, 0.7, (40, 6))
    most = 0.1 if robot == "ur10" and not linear else 1.0  # of so much load no UR10 stands
    poses = Poses(q, q, most * rng.standard_normal((40, 6)) * np.array([1e3] * 3 + [1e2] * 3))
    names = [model.names[i] for i in rng.permutation(len(sizes))[:-3]]
    if reading == "displacement":
        fast, slow = both_ways(monkeypatch, lambda: model.sensitivity(poses, x, names, linear))
    else:
        loaded = reading == "loaded"
        fast, slow = both_ways(monkeypatch, lambda: model.position_sensitivity(poses, x, names, loaded, linear))
    largest = np.abs(slow).max(axis=(0, 1, 2))
    assert np.abs(fast - slow).max(axis=(0, 1, 2)) == pytest.approx(0.0, abs=1e-12 * max(largest))
    assert (largest > 0).sum() > 40 or (springs == "none" and reading == "displacement")


@MODELS
def test_few_parameters_and_a_spring_between_two_points_go_the_long_way(
    linear: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: Any) -> np.ndarray:
        raise AssertionError("all elements were asked for")

    monkeypatch.setattr(tangents, "element_readings", refused)
    q = np.full((2, 6), 0.4)
    poses = Poses(q, q, np.zeros((2, 6)))
    ur10 = made(tmp_path, "ur10", "link_4")
    x = ur10.nominal
    few = ["joint_offset[joint_2]", "joint_offset[joint_3]"]
    assert np.isfinite(ur10.position_sensitivity(poses, x, few, linear=linear)).all()
    pulled = made(tmp_path, "ur10", "link_4", POINTS)
    x = pulled.nominal
    x[pulled.index(["point_spring[link_1/link_3].stiffness"])] = 1e4
    assert np.isfinite(pulled.position_sensitivity(poses, x, linear=linear)).all()
