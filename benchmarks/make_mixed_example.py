"""Make examples/mixed: an R-2000iC read by a tracker, under weights, and by a dial gauge, on a pedestal that gives.

    python benchmarks/make_mixed_example.py [--folder examples/mixed]

Made by Pinocchio alone, so that the model has no hand in what it is fitted to: joints stand beside their places, zeros
are off, and every state is the equilibrium of seven springs under gravity and the load, by a fixed point. The seventh
spring is the pedestal's, and experiment.yaml says nothing of it; README.md says what was hidden.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import xacro
from common import ROOT

SEED = 5
PEDESTAL = 3e-8
"""rad/(N m) about the base's y axis: 33 MN m/rad."""
NOMINAL = np.array([0.26, 0.15, 0.26, 1.8, 1.5, 2.1]) * 1e-6
MARKERS = {"m1": (50, 200, 250), "m2": (250, -150, 150)}
POINT = (100, 0, 200)
WEIGHT, PULL = (0, 0, -1500), (0, 600, -1500)
SIGMA = {"position": 0.05, "displacement": 0.03, "gauge": 0.02}
COUNTS = {"tracker": 60, "weights": 30, "gauge": 12}
LIMITS = ((-150, 150), (-50, 70), (-110, 60), (-180, 180), (-120, 120), (-180, 180))
_LOWEST, _NEAREST = 0.4, 0.8
"""m: of the flange above the floor, and from axis 1."""
_ROUNDS = 8
"""Of the fixed point: each takes away all but a thousandth of what the last one left."""
Line = list[str]


@dataclass(frozen=True, eq=False)
class Arm:
    """The robot as it is built: seven joints, the first of them the pedestal's; zeros (6,), compliances (7,), markers
    and load point in the flange frame."""

    model: pin.Model
    data: pin.Data
    flange: int
    zeros: np.ndarray
    compliance: np.ndarray
    markers: dict[str, np.ndarray]

    def joints(self, shown: Sequence[float]) -> np.ndarray:
        """Joint angles (7,) of what the pendant shows, deg: J3 is the elevation of the forearm."""
        j1, j2, j3, *wrist = np.deg2rad(shown)
        return np.concatenate([[0.0], np.array([j1, j2, j3 + j2, *wrist]) + self.zeros])

    def settled(self, commanded: np.ndarray, force: Sequence[float]) -> np.ndarray:
        """Joint angles (7,) at which the springs hold the arm and the load."""
        f = np.array(force, dtype=float)
        q = commanded
        for _ in range(_ROUNDS):
            weight = pin.computeGeneralizedGravity(self.model, self.data, q)
            pin.computeJointJacobians(self.model, self.data, q)
            at = pin.updateFramePlacement(self.model, self.data, self.flange)
            J = pin.getFrameJacobian(self.model, self.data, self.flange, pin.LOCAL_WORLD_ALIGNED)
            lever = at.rotation @ (np.array(POINT) / 1e3)
            q = commanded + self.compliance * (J[:3].T @ f + J[3:].T @ np.cross(lever, f) - weight)
        return q

    def place(self, commanded: np.ndarray, force: Sequence[float] = (0, 0, 0)) -> pin.SE3:
        """The flange, there."""
        pin.forwardKinematics(self.model, self.data, self.settled(commanded, force))
        return pin.SE3(pin.updateFramePlacement(self.model, self.data, self.flange))


def built(rng: np.random.Generator, pedestal: float = PEDESTAL) -> Arm:
    """An arm that is not quite as it is drawn."""
    urdf = ROOT / "robots" / "fanuc_r2000ic" / "r2000ic.urdf.xacro"
    drawn = pin.buildModelFromXML(xacro.process_file(str(urdf)).toxml())
    ground = pin.Model()
    ground.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "pedestal")
    ground.addFrame(pin.Frame("top", 1, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model = pin.appendModel(ground, drawn, ground.getFrameId("top"), pin.SE3.Identity())
    for joint in range(2, model.njoints):
        off = np.concatenate([rng.normal(0.0, 2e-4, 3), rng.normal(0.0, 2e-4, 3)])
        model.jointPlacements[joint] = model.jointPlacements[joint] * pin.exp6(off)
    compliance = np.concatenate([[pedestal], NOMINAL * rng.uniform(0.7, 1.4, 6)])
    markers = {name: (np.array(xyz) + rng.normal(0.0, 0.8, 3)) / 1e3 for name, xyz in MARKERS.items()}
    tip = {"tip": np.array(POINT) / 1e3}
    return Arm(
        model, model.createData(), model.getFrameId("flange"), rng.normal(0.0, 4e-4, 6), compliance, markers | tip
    )


def poses(arm: Arm, count: int, rng: np.random.Generator) -> list[list[float]]:
    """What the pendant shows at poses in the open, deg."""
    out: list[list[float]] = []
    while len(out) < count:
        shown = [round(float(rng.uniform(*limits)), 3) for limits in LIMITS]
        x, y, z = arm.place(arm.joints(shown)).translation
        if z > _LOWEST and np.hypot(x, y) > _NEAREST:
            out.append(shown)
    return out


def shown_mm(values: np.ndarray, sigma: float, rng: np.random.Generator) -> Line:
    """Lengths in m as an instrument shows them."""
    return [f"{v:.4f}" for v in 1e3 * values + rng.normal(0.0, sigma, values.shape)]


def tracked(arm: Arm, rng: np.random.Generator) -> list[Line]:
    """Unloaded positions in the frame of a tracker that stands 4 m away and is not quite level."""
    tracker = pin.SE3(pin.exp3(np.array([0.003, -0.004, 2.1])), np.array([1.3, 3.9, -0.4]))
    lines: list[Line] = []
    for i, shown in enumerate(poses(arm, COUNTS["tracker"], rng)):
        hand = tracker * arm.place(arm.joints(shown))
        for name in MARKERS:
            position = shown_mm(hand.act(arm.markers[name]), SIGMA["position"], rng)
            lines.append([f"t{i + 1:02d}", *(f"{a:g}" for a in shown), name, "unloaded", *position])
    return lines


def moved(arm: Arm, shown: Sequence[float], force: Sequence[float], marker: str) -> np.ndarray:
    """What a marker does under a force, m, base frame."""
    q, at = arm.joints(shown), arm.markers[marker]
    return arm.place(q, force).act(at) - arm.place(q).act(at)


def weighed(arm: Arm, rng: np.random.Generator) -> list[Line]:
    """Displacements of the reflectors under a weight, with a side pull at every second pose."""
    lines: list[Line] = []
    for i, shown in enumerate(poses(arm, COUNTS["weights"], rng)):
        force = PULL if i % 2 else WEIGHT
        head = [f"w{i + 1:02d}", *(f"{a:g}" for a in shown), *map(str, force)]
        lines += [[*head, m, *shown_mm(moved(arm, shown, force, m), SIGMA["displacement"], rng)] for m in MARKERS]
    return lines


def gauged(arm: Arm, rng: np.random.Generator) -> list[Line]:
    """A dial gauge on a stand, upright below the load point."""
    lines: list[Line] = []
    for i, shown in enumerate(poses(arm, COUNTS["gauge"], rng)):
        down = shown_mm(moved(arm, shown, WEIGHT, "tip")[2:], SIGMA["gauge"], rng)
        lines.append([f"g{i + 1:02d}", *(f"{a:g}" for a in shown), *map(str, WEIGHT), "tip", *down, "0", "0", "1"])
    return lines


def write(folder: Path, seed: int = SEED, pedestal: float = PEDESTAL) -> Arm:
    """Write the three files of readings; the arm that made them."""
    rng = np.random.default_rng(seed)
    arm = built(rng, pedestal)
    folder.mkdir(parents=True, exist_ok=True)
    head = ["pose", *(f"q{k}_deg" for k in range(1, 7))]
    force = ["fx_N", "fy_N", "fz_N", "marker"]
    files = {
        "tracker": ([*head, "marker", "state", "x_mm", "y_mm", "z_mm"], tracked(arm, rng)),
        "weights": ([*head, *force, "dx_mm", "dy_mm", "dz_mm"], weighed(arm, rng)),
        "gauge": ([*head, *force, "gauge_mm", "ux", "uy", "uz"], gauged(arm, rng)),
    }
    for name, (columns, lines) in files.items():
        text = "\n".join(",".join(line) for line in (columns, *lines))
        (folder / f"{name}.csv").write_text(f"# robot: fanuc_r2000ic\n{text}\n")
    return arm


def main() -> None:
    """Write the files, and say what is in them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=ROOT / "examples" / "mixed")
    parser.add_argument("--seed", type=int, default=SEED)
    given = parser.parse_args()
    arm = write(given.folder, given.seed)
    springs = ", ".join(f"{1e6 * c:.3f}" for c in arm.compliance[1:])
    print(f"{given.folder}: springs of joints 1 to 6 {springs} urad/(N m); pedestal {1e6 * PEDESTAL:g}")


if __name__ == "__main__":
    main()
