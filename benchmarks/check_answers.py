"""What `qsf diagnose` says of examples/ur10 and examples/mixed, computed again without qsframework.

    python benchmarks/check_answers.py

Pinocchio reads the robot's URDF, everything else is numpy and scipy: other kinematics, other gravity, other fits, plain
folds over poses. docs/ur10.md holds what it prints; the tests hold the answers of the diagnosis to it.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import xacro
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parents[1]
WAVES, PER_TURN = (0, 1, 2, 3, 4), 17
"""Joints, from 0 on, whose angle may err so many times per turn."""
BENT = (1, 2)
"""Joints that give under the masses of the URDF."""
_SIGMA = 1.5e-4
"""m: what the whole model leaves; only the priors are measured by it."""
_PLACES = np.tile([1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 20e-3], 6)
"""Weak priors, m and rad, of how far joints stand from their places; about their own axes they hold the zeros too."""
_FOLDS = 10
Array = np.ndarray


@dataclass(frozen=True)
class Unloaded:
    """Positions (N, 3) m of one target in a tracker's frame, at joint angles (N, 6) rad; pose (N,): its number."""

    q: Array
    seen: Array
    pose: Array


@dataclass(frozen=True)
class Checked:
    """Held-out RMS per axis, m, without and with the waves of some joints; of all joints the two parts of their wave
    (5, 2) rad with their sds."""

    without: float
    with_waves: float
    waves: Array
    sd: Array


def read_unloaded(path: Path) -> Unloaded:
    """The rows of a table of one target."""
    rows = table(path)
    q = np.deg2rad([[float(r[f"q{k}_deg"]) for k in range(1, 7)] for r in rows])
    seen = np.array([[float(r[f"{a}_mm"]) for a in "xyz"] for r in rows]) / 1e3
    same = np.unique(np.round(np.rad2deg(q) / 0.5), axis=0, return_inverse=True)[1].ravel()
    return Unloaded(q, seen, same)


def table(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file, without its comments."""
    return list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))


def model_of(robot: str) -> pin.Model:
    """A robot of this repository, by Pinocchio."""
    (urdf,) = (ROOT / "robots" / robot).glob("*.urdf.xacro")
    return pin.buildModelFromXML(xacro.process_file(str(urdf)).toxml())


def ur10(readings: Unloaded) -> Callable[[Array], Array]:
    """Where the target should stand (N, 3), from 57 numbers.

    Of the tracker (6) and the target (3), how far six joints stand from their places (36), what joints 2 and 3 give
    (2), and two parts of each wave (10).
    """
    arm = model_of("ur10")
    base = [(p.rotation, p.translation) for p in arm.jointPlacements[1:]]
    weights = [(i.mass, i.lever) for i in arm.inertias[1:]]
    flange = arm.frames[arm.getFrameId("link_6")].placement

    def chain(places: Array, q: Array) -> tuple[list[Array], list[Array]]:
        R, o = np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3))
        turns, origins = [], []
        for k, (drawn, at) in enumerate(base):
            o = o + R @ (at + drawn @ places[k, :3])
            R = R @ drawn @ Rotation.from_rotvec(places[k, 3:]).as_matrix()
            R = R @ Rotation.from_rotvec(q[:, k, None] * [0.0, 0.0, 1.0]).as_matrix()
            turns.append(R)
            origins.append(o)
        return turns, origins

    turns, origins = chain(np.zeros((6, 6)), readings.q)
    centres = [o + R @ lever for R, o, (_, lever) in zip(turns, origins, weights, strict=True)]
    torque = [
        sum(
            (np.cross(centres[j] - origins[k], [0.0, 0.0, -9.81 * weights[j][0]]) * turns[k][:, :, 2]).sum(axis=1)
            for j in range(k, 6)
        )
        for k in BENT
    ]

    def predicted(x: Array) -> Array:
        frame, target, places, give, wave = np.split(x, [6, 9, 45, 47])
        q = readings.q.copy()
        for k, T, c in zip(BENT, torque, give, strict=True):
            q[:, k] += 1e-6 * c * T
        for k, (a, b) in zip(WAVES, wave.reshape(-1, 2), strict=True):
            q[:, k] += a * np.sin(PER_TURN * readings.q[:, k]) + b * np.cos(PER_TURN * readings.q[:, k])
        turns, origins = chain(places.reshape(6, 6), q)
        hand = origins[-1] + turns[-1] @ (flange.translation + flange.rotation @ target)
        return hand @ Rotation.from_rotvec(frame[3:]).as_matrix().T + frame[:3]

    return predicted


def waves(path: Path, named: Sequence[int] = (0, 1, 2)) -> Checked:
    """The waves of all five joints, and what those of the named ones gain at poses that are left out."""
    readings = read_unloaded(path)
    predicted = ur10(readings)
    x = np.zeros(57)
    x[8] = 0.093
    at, shown = predicted(x), readings.seen
    turn = Rotation.align_vectors(shown - shown.mean(axis=0), at - at.mean(axis=0))[0]
    x[:6] = np.concatenate([shown.mean(axis=0) - turn.apply(at.mean(axis=0)), turn.as_rotvec()])
    priors = np.concatenate([np.full(9, np.inf), _PLACES, np.full(12, np.inf)])
    every, (J, left) = np.arange(57), (np.zeros(0), np.zeros(0))
    for _ in range(4):
        J, left = slopes(predicted, x), (shown - predicted(x)).ravel()
        x = x + step(J, left, x, priors, every)
    J, left = slopes(predicted, x), (shown - predicted(x)).ravel()
    free = left @ left / (len(left) - 57)
    sd = np.sqrt(np.diag(np.linalg.inv(J.T @ J / free + np.diag(priors**-2.0))))[47:]
    some = np.concatenate([every[:47], *([47 + 2 * k, 48 + 2 * k] for k in named)])
    without, beside = (held_out(J, left + J @ x, x, priors, c, readings.pose) for c in (every[:47], some))
    return Checked(without, beside, x[47:].reshape(-1, 2), sd.reshape(-1, 2))


def slopes(predicted: Callable[[Array], Array], x: Array, h: float = 1e-6) -> Array:
    """Central differences (3 N, p)."""
    return np.stack([(predicted(x + h * u) - predicted(x - h * u)).ravel() / (2 * h) for u in np.eye(len(x))], axis=1)


def step(J: Array, left: Array, x: Array, priors: Array, chosen: Array) -> Array:
    """Change of the chosen numbers that fits what is left, beside what was known of them."""
    out = np.zeros(len(x))
    wide = np.concatenate([J[:, chosen] / _SIGMA, np.diag(1.0 / priors[chosen])])
    wanted = np.concatenate([left / _SIGMA, -x[chosen] / priors[chosen]])
    size = np.linalg.norm(wide, axis=0)
    out[chosen] = np.linalg.lstsq(wide / size, wanted, rcond=1e-12)[0] / size
    return out


def held_out(J: Array, wanted: Array, x: Array, priors: Array, chosen: Array, pose: Array) -> float:
    """RMS per axis of folds over poses, each predicted by the others, in the model linearised at x."""
    fold = np.random.default_rng(0).permutation(pose.max() + 1)[pose] % _FOLDS
    left = np.zeros_like(wanted)
    for k in range(_FOLDS):
        test = np.repeat(fold == k, 3)
        told = step(J[~test], wanted[~test], np.zeros(len(x)), priors, chosen)
        left[test] = wanted[test] - J[test] @ told
    return float(np.sqrt(np.mean(left**2)))


def pedestal(folder: Path) -> tuple[float, float]:
    """How far the pedestal of examples/mixed gives about the base's y, rad/(N m), with its sd.

    Six springs and the pedestal are fitted to the displacements and to the gauge alone, in equilibrium under gravity
    and the load; the arm stands where its URDF says.
    """
    from make_mixed_example import NOMINAL, POINT, built, moved

    arm = built(np.random.default_rng(0), 0.0)
    drawn = model_of("fanuc_r2000ic")
    for k in range(1, drawn.njoints):
        arm.model.jointPlacements[k + 1] = drawn.jointPlacements[k]
    arm.zeros[:] = 0.0
    nominal = {"m1": (50, 200, 250), "m2": (250, -150, 150), "tip": POINT}
    arm.markers.update({name: np.array(xyz) / 1e3 for name, xyz in nominal.items()})
    weights, gauge = table(folder / "weights.csv"), table(folder / "gauge.csv")
    scale = np.array([1e-8, *NOMINAL])

    def of(row: Mapping[str, str]) -> Array:
        shown = [float(row[f"q{k}_deg"]) for k in range(1, 7)]
        return moved(arm, shown, [float(row[f"f{a}_N"]) for a in "xyz"], row["marker"])

    def white(y: Array) -> Array:
        arm.compliance[:] = scale * y
        first = [(of(r) - np.array([float(r[f"d{a}_mm"]) for a in "xyz"]) / 1e3) / 3e-5 for r in weights]
        second = [[(of(r)[2] - float(r["gauge_mm"]) / 1e3) / 2e-5] for r in gauge]
        return np.concatenate([*first, *second])

    fit = least_squares(white, np.array([0.0, *np.ones(6)]))
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    return float(fit.x[0] * scale[0]), float(np.sqrt(covariance[0, 0]) * scale[0])


def main() -> None:
    """Say what both computations find."""
    found = waves(ROOT / "examples" / "ur10" / "series_d.csv")
    print(f"UR10, series D: held out {1e3 * found.without:.3f} -> {1e3 * found.with_waves:.3f} mm per axis")
    for k, (size, sd) in enumerate(zip(found.waves, found.sd, strict=True)):
        said = ", ".join(f"{np.rad2deg(v) * 60:.3f} +- {np.rad2deg(s) * 60:.3f}" for v, s in zip(size, sd, strict=True))
        print(f"  joint {k + 1}: {said} arcmin, {1e3 * np.hypot(*size):.2f} mrad high")
    value, sd = pedestal(ROOT / "examples" / "mixed")
    print(f"mixed: the pedestal gives {1e6 * value:.4f} +- {1e6 * sd:.4f} urad/(N m) about y")


if __name__ == "__main__":
    main()
