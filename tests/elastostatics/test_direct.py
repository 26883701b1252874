"""All derivatives by the geometry at once are those that the chain rule takes one at a time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from qsframework.elastostatics import Model, positions
from qsframework.experiment import load_experiment
from qsframework.plugin import Poses

EVERYTHING = """
robot: {robot}
markers:
  far: {{xyz_mm: [30, -40, 120]}}
  near: {{xyz_mm: [10, 60, 5], link: {link}}}
noise: estimate
effects:
  - {{effect: tool_offset, markers: all}}
  - {{effect: joint_offset, joints: all}}
  - {{effect: encoder_eccentricity, joint: joint_2}}
  - {{effect: joint_placement, joints: all}}
  - {{effect: gravity_sag, joints: [joint_2, joint_3]}}
  - {{effect: offaxis_compliance, joint: joint_3, axis: x}}
  - {{effect: link_mass, link: link_3}}
"""


def made(folder: Path, robot: str, link: str) -> Model:
    file = folder / "experiment.yaml"
    file.write_text(EVERYTHING.format(robot=robot, link=link))
    return load_experiment(file).model()


@pytest.mark.parametrize(("robot", "link"), [("ur10", "link_4"), ("fanuc_r2000ic", "link_3")])
@pytest.mark.parametrize("springs", ["all", "one", "none"])
def test_the_same_as_the_chain_rule(
    robot: str, link: str, springs: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, rng = made(tmp_path, robot, link), np.random.default_rng(1)
    sizes = np.array([p.typical for p in model.parameters])
    x = model.nominal + 3.0 * sizes * rng.standard_normal(len(sizes))
    compliances = [i for i, name in enumerate(model.names) if "compliance" in name]
    x[compliances] = np.abs(x[compliances])
    x[compliances[{"all": len(compliances), "one": 1, "none": 0}[springs] :]] = 0.0
    q = rng.uniform(-3.0, 3.0, (40, 6))
    poses = Poses(q, q, np.zeros((40, 6)))
    names = [model.names[i] for i in rng.permutation(len(sizes))[:-3]]
    ran: list[bool] = []
    known: Callable[..., bool] = positions.is_direct
    monkeypatch.setattr(positions, "is_direct", lambda ev, loaded: ran.append(known(ev, loaded)) or ran[-1])
    fast = model.position_sensitivity(poses, x, names)
    assert ran == [True]
    monkeypatch.setattr(positions, "is_direct", lambda ev, loaded: False)
    slow = model.position_sensitivity(poses, x, names)
    largest = np.abs(slow).max(axis=(0, 1, 2))
    assert np.abs(fast - slow).max(axis=(0, 1, 2)) == pytest.approx(0.0, abs=1e-12 * max(largest))
    assert (largest > 0).sum() > 40


def test_a_load_and_a_loop_go_the_long_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[bool] = []
    known: Callable[..., bool] = positions.is_direct
    monkeypatch.setattr(positions, "is_direct", lambda ev, loaded: ran.append(known(ev, loaded)) or ran[-1])
    q = np.full((2, 6), 0.4)
    poses = Poses(q, q, np.zeros((2, 6)))
    made(tmp_path, "fanuc_r2000ic", "link_3").position_sensitivity(poses, loaded=True)
    made(tmp_path, "fanuc_m900ib", "link_3").position_sensitivity(poses)
    assert ran == [False, False]
