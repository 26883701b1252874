"""An arm that is not the nominal one, a tracker somewhere in the cell, and an operator who makes mistakes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from qsf_day import Day, Judged, Slot, begin, decide, enter
from qsf_day.protocol import ProtocolOptions
from qsframework.elastostatics.so3 import exponential
from qsframework.experiment import Experiment, Plan, make_plan
from qsframework.experiment.simulate import prior_draws
from qsframework.plugin import Array, Poses

SHORT = ProtocolOptions(cycles=1, half=False, repeat_share=0.0)
"""Unloaded, loaded, unloaded at every pose."""
MARKERS = ("m1", "m2", "m3")
SIGMA = 3e-5


@dataclass(frozen=True, eq=False)
class Arm:
    """The true arm: springs x (p,), errors of the angles (n,) rad and of the tool (3,) m, the tracker's frame."""

    experiment: Experiment
    x: Array
    angles: Array
    tool: Array
    rotation: Array
    origin: Array

    def read(self, day: Day, slot: Slot, rng: np.random.Generator) -> Array:
        """What the tracker says of the markers (K, 3) m at a state."""
        visit, state = day.record.visit(slot), day.record.state(slot)
        return self.at(visit.pendant, state.wrench, state.loaded) + SIGMA * rng.standard_normal((len(MARKERS), 3))

    def at(self, pendant: Array, wrench: Array, loaded: bool) -> Array:
        pendant = pendant + self.angles
        poses = Poses(pendant[None], self.experiment.robot.controller.to_joints(pendant[None]), wrench[None])
        there = self.experiment.model().positions(poses, self.x, loaded)[0]
        return (there + self.tool) @ self.rotation.T + self.origin

    def moved(self, shift: Array) -> Arm:
        """The same arm, its tracker elsewhere."""
        return replace(self, origin=self.origin + shift)


def draw_arm(experiment: Experiment, seed: int) -> tuple[Arm, np.random.Generator]:
    rng = np.random.default_rng(seed)
    x = prior_draws(experiment.model(), 1, rng)[0]
    n = experiment.robot.controller.axes
    arm = Arm(
        experiment,
        x,
        5e-4 * rng.standard_normal(n),
        1e-3 * rng.standard_normal(3),
        exponential(rng.uniform(-1.5, 1.5, 3)),
        rng.uniform(-3.0, 3.0, 3),
    )
    return arm, rng


def make_day_plan(experiment: Experiment, poses: int = 12, seed: int = 3, loads: int = 1) -> Plan:
    """Poses far from each other, each under one load or, one after the other, under two."""
    rng = np.random.default_rng(seed)
    controller = experiment.robot.controller
    ends = np.deg2rad(np.array([[-150.0, 0, -60, -120, -90, -150], [150.0, 60, 0, 120, 90, 150]]))
    pendant = np.round(np.rad2deg(rng.uniform(*ends, (poses, 6))))
    pendant = np.deg2rad(np.concatenate([pendant] * loads))
    wrench = np.zeros((len(pendant), 6))
    wrench[:, 2] = -4000.0
    wrench[::2, 1] = 1500.0
    wrench[poses:, 1] = np.where(wrench[:poses, 1][: len(wrench) - poses] > 0.0, 0.0, 1500.0)
    names = ["weight" if w[1] == 0.0 else "weight_and_side_pull" for w in wrench]
    return make_plan(Poses(pendant, controller.to_joints(pendant), wrench), names)


Explanation = Callable[[Array, Arm, Day, Slot], Array]


def exchanged(xyz: Array, arm: Arm, day: Day, slot: Slot) -> Array:
    return xyz[[1, 0, 2]]


def sign(xyz: Array, arm: Arm, day: Day, slot: Slot) -> Array:
    return xyz * [-1.0, 1.0, 1.0]


def inches(xyz: Array, arm: Arm, day: Day, slot: Slot) -> Array:
    return xyz / 25.4


def _other(arm: Arm, day: Day, slot: Slot, turn: Array, share: float) -> Array:
    visit, state = day.record.visit(slot), day.record.state(slot)
    return arm.at(visit.pendant + turn, share * state.wrench, state.loaded)


def angle(xyz: Array, arm: Arm, day: Day, slot: Slot) -> Array:
    return _other(arm, day, slot, np.deg2rad([0.0, 0, 2, 0, 0, 0]), 1.0)


def ten_times(xyz: Array, arm: Arm, day: Day, slot: Slot) -> Array:
    return _other(arm, day, slot, np.zeros(6), 10.0)


def no_load(xyz: Array, arm: Arm, day: Day, slot: Slot) -> Array:
    return _other(arm, day, slot, np.zeros(6), 0.0)


def other_pose(xyz: Array, arm: Arm, day: Day, slot: Slot) -> Array:
    visits = day.record.protocol.visits
    here = visits[slot.visit].pose
    far = [v for v in visits if np.abs(v.pendant - visits[slot.visit].pendant).max() > 0.1 and v.pose != here]
    return arm.at(far[0].pendant, np.zeros(6), False)


def decimal(xyz: Array, arm: Arm, day: Day, slot: Slot) -> Array:
    out = xyz.copy()
    out[1, 2] *= 10.0
    return out


def loose_nest(xyz: Array, arm: Arm, day: Day, slot: Slot) -> Array:
    out, way = xyz.copy(), xyz[0] - xyz[2]
    out[2] += 1e-3 * way / np.linalg.norm(way)
    return out


def play(
    experiment: Experiment, folder: Path, seed: int, planted: dict[Slot, Explanation] | None = None, poses: int = 12
) -> list[Judged]:
    """A day with some mistakes; the operator reads again what is to be looked at."""
    day = begin(experiment, make_day_plan(experiment, poses), folder, SHORT)
    arm, rng = draw_arm(experiment, seed)
    said: list[Judged] = []
    planted = dict(planted or {})
    while day.next is not None:
        slot = day.next
        xyz = arm.read(day, slot, rng)
        wrong = planted.pop(slot, None)
        day, judged = enter(day, dict(zip(MARKERS, wrong(xyz, arm, day, slot) if wrong else xyz, strict=True)))
        said.append(judged)
        if judged.mistake is not None:
            day = decide(day, slot, "again" if wrong else "keep")
    return said


def write_experiment(folder: Path, noise: str = "{sigma_mm: 0.03}") -> Path:
    """A campaign of the M-900iB with its plan beside it."""
    path = folder / "experiment.yaml"
    text = (Path(__file__).parents[2] / "examples" / "m900ib" / "experiment.yaml").read_text()
    path.write_text(text.replace("noise: {sigma_mm: 0.03}", f"noise: {noise}"))
    return path
