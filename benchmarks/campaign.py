"""A large campaign of absolute positions: a UR10 whose geometry, springs and sag are all to be found.

    python benchmarks/campaign.py FOLDER [--poses 1000] [--seed 0]

Made by Pinocchio alone, so that no tree of this repository has a hand in what it is measured on: joints stand beside
their places by tenths of a millimetre and of a milliradian, upper arm and forearm weigh more than the URDF says, and
each pose stands in the equilibrium of its springs under gravity and, in two poses of three, under a load.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import xacro
from common import ROOT

SIGMA = 0.03
MARKERS = {"m1": (0, 0, 90), "m2": (100, 0, 60), "m3": (-40, 80, 60)}
POINT = (80, 0, 60)
LOADS = ((0, 0, 0), (0, 0, -98), (80, 0, -20))
COMPLIANCE = np.array([25, 25, 50, 100, 100, 100]) * 1e-6
HEAVIER = {"joint_2": 1.15, "joint_3": 1.25}
"""True masses over those of the URDF: what gravity_sag has to find, for no spring tells a mass from itself."""
EXPERIMENT = """robot: ur10
data: readings.csv
load: {{point_mm: {point}}}
markers:
{markers}
noise: {{sigma_mm: {sigma:g}}}
effects:
  - {{effect: marker_offset, markers: all}}
  - {{effect: joint_offset, joints: all}}
  - {{effect: joint_placement, joints: all}}
  - {{effect: gravity_sag, joints: [joint_2, joint_3, joint_5]}}
fit: [marker_offset, joint_offset, joint_placement, joint_compliance, gravity_sag]
"""
_ROUNDS = 8
"""Of the fixed point q = commanded + c tau(q): each takes away all but a thousandth of what the last one left."""


def arm(rng: np.random.Generator) -> pin.Model:
    """The UR10 as it is built, not as it is drawn."""
    text = xacro.process_file(str(ROOT / "robots" / "ur10" / "ur10.urdf.xacro")).toxml()
    model = pin.buildModelFromXML(text)
    for joint in range(1, model.njoints):
        off = np.concatenate([rng.normal(0.0, 3e-4, 3), rng.normal(0.0, 3e-4, 3)])
        model.jointPlacements[joint] = model.jointPlacements[joint] * pin.exp6(off)
        model.inertias[joint].mass *= HEAVIER.get(model.names[joint], 1.0)
    return model


def settled(model: pin.Model, data: pin.Data, commanded: np.ndarray, c: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Joint angles at which the springs, of compliances c, hold the arm and the load; the wrist is placed there."""
    q = commanded
    for _ in range(_ROUNDS):
        torque = -pin.computeGeneralizedGravity(model, data, q)
        pin.computeJointJacobians(model, data, q)
        J = pin.getJointJacobian(model, data, model.njoints - 1, pin.LOCAL_WORLD_ALIGNED)
        lever = data.oMi[model.njoints - 1].rotation @ (np.array(POINT) / 1e3)
        q = commanded + c * (torque + J[:3].T @ force + J[3:].T @ np.cross(lever, force))
    pin.forwardKinematics(model, data, q)
    return q


def rows(poses: int, rng: np.random.Generator) -> Iterator[list[str]]:
    """Lines of readings.csv, in the frame of a tracker that stands 3 m away and is not quite level."""
    model = arm(rng)
    data = model.createData()
    compliance = COMPLIANCE * rng.uniform(0.7, 1.4, 6)
    zeros = rng.normal(0.0, 5e-4, 6)
    tool = {name: (np.array(xyz) + rng.normal(0.0, 1.0, 3)) / 1e3 for name, xyz in MARKERS.items()}
    tracker = pin.SE3(pin.exp3(np.array([0.004, -0.003, 0.7])), np.array([0.4, -3.2, 0.2]))
    for i in range(poses):
        shown = np.round(rng.uniform(-150.0, 150.0, 6), 3)
        force = LOADS[i % len(LOADS)]
        settled(model, data, np.deg2rad(shown) + zeros, compliance, np.array(force, dtype=float))
        hand = tracker * data.oMi[model.njoints - 1]
        for name, xyz in tool.items():
            position = hand.act(xyz) * 1e3 + rng.normal(0.0, SIGMA, 3)
            state = "loaded" if any(force) else "unloaded"
            yield [
                f"p{i + 1:04d}",
                *(f"{a:g}" for a in shown),
                *map(str, force),
                name,
                state,
                *(f"{p:.5f}" for p in position),
            ]


def write(folder: Path, poses: int, seed: int = 0) -> Path:
    """Write experiment.yaml and readings.csv into a folder; the path of the first."""
    folder.mkdir(parents=True, exist_ok=True)
    head = [
        "pose",
        *(f"q{k}_deg" for k in range(1, 7)),
        "fx_N",
        "fy_N",
        "fz_N",
        "marker",
        "state",
        "x_mm",
        "y_mm",
        "z_mm",
    ]
    lines = [",".join(line) for line in (head, *rows(poses, np.random.default_rng(seed)))]
    (folder / "readings.csv").write_text("# robot: ur10\n" + "\n".join(lines) + "\n")
    markers = "\n".join(f"  {name}: {{xyz_mm: {list(xyz)}}}" for name, xyz in MARKERS.items())
    path = folder / "experiment.yaml"
    path.write_text(EXPERIMENT.format(point=list(POINT), markers=markers, sigma=SIGMA))
    return path


def main() -> None:
    """Write the two files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--poses", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print(write(given.folder, given.poses, given.seed))


if __name__ == "__main__":
    main()
