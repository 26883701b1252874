# ruff: noqa: E402 - threads are set before numpy is imported
"""Batch kinematics, predictions and equilibrium against the plain Pinocchio loop and the memory.

Run: python benchmarks/kinematics.py [--quick] [--write]. The jobs of a ratio take turns in one
run; times are medians of CPU seconds, one thread.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np
from common import RUNS, memory, show, table, turns

from qsframework.elastostatics import Model, Site, make_model
from qsframework.elastostatics.loads import gravity_torque
from qsframework.elastostatics.motion import move, nominal_actuators
from qsframework.elastostatics.state import place
from qsframework.elastostatics.structure import CHUNK
from qsframework.plugin import Context, Poses, find
from qsframework.robot import Robot, load_robot

TIP = Site(6, np.array([0.15, 0.0, 0.2]))
STEPS = (
    "closing the loops of controller and arm",
    "placing links and tip",
    "Jacobians",
    "gravity torques",
    "writing the results",
)


def sample(robot: Robot, count: int) -> Poses:
    rng = np.random.default_rng(0)
    pendant = rng.uniform(robot.controller.lower, robot.controller.upper, (count, 6))
    wrench = rng.normal(size=(count, 6)) * np.array([3e3] * 3 + [300.0] * 3)
    return Poses(pendant, robot.controller.to_joints(pendant), wrench)


def model(robot: Robot, extra: int = 0) -> Model:
    """The robot's effects and `extra` off-axis springs and base springs."""
    offaxis = find("offaxis_compliance").places(robot.facts)
    effects = [*robot.effects, *offaxis[:extra]]
    parameters = [*robot.parameters, *(p for e in offaxis[:extra] for p in e.parameters(robot.facts))]
    return make_model(robot.facts, effects, parameters, TIP, [("tip", TIP)], robot.gravity)


def pinocchio_loop(robot: Robot, poses: Poses) -> None:
    """Position, Jacobian and gravity of each pose, stored: what the batch kernel does."""
    import pinocchio as pin

    data = robot.model.createData()
    frame = (
        robot.model.addFrame(pin.Frame("bench_tip", 6, 0, pin.SE3(np.eye(3), TIP.xyz), pin.FrameType.OP_FRAME))
        if not robot.model.existFrame("bench_tip")
        else robot.model.getFrameId("bench_tip")
    )
    data = robot.model.createData()
    count = len(poses)
    positions, jacobians, gravity = np.empty((count, 3)), np.empty((count, 6, 6)), np.empty((count, 6))
    for i, q in enumerate(poses.q):
        jacobians[i] = pin.computeFrameJacobian(robot.model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
        positions[i] = data.oMf[frame].translation
        gravity[i] = pin.computeGeneralizedGravity(robot.model, data, q)


def batch(m: Model, poses: Poses) -> dict[str, float]:
    """The same by the batch kernel, stored. CPU seconds of its steps."""
    count, spent, clock = len(poses), dict.fromkeys(STEPS, 0.0), time.process_time()
    positions, jacobians, gravity = np.empty((3, count)), np.empty((6, 6, count)), np.empty((6, count))
    moments, layout = m.facts.moments, m.layout

    def done(step: str) -> None:
        nonlocal clock
        now = time.process_time()
        spent[step] += now - clock
        clock = now

    for start in range(0, count, CHUNK):
        part = slice(start, start + CHUNK)
        q = np.ascontiguousarray(poses.q[part].T)
        phi, context = nominal_actuators(layout, q), Context(m.facts, poses.take(part))
        motion = move(layout, context, phi, np.zeros((layout.bars, q.shape[1])))
        done("closing the loops of controller and arm")
        state = place(motion, TIP, ())
        done("placing links and tip")
        linear, angular = state.tip.elements.linear, state.tip.elements.angular
        done("Jacobians")
        torque = gravity_torque(state, moments, m.gravity)
        done("gravity torques")
        positions[:, part], gravity[:, part] = state.tip.position, torque
        jacobians[:, :3, part], jacobians[:, 3:, part] = linear, angular
        done("writing the results")
    return spent


def sensitivities(m: Model, poses: Poses, names: list[str], block: int = 100_000) -> None:
    """Predictions with sensitivities of the linear model, in blocks, so that memory stays bounded."""
    for start in range(0, len(poses), block):
        m.rates(poses.take(slice(start, start + block)), m.nominal, names, linear=True)


def writing(count: int, *shapes: tuple[int, ...], block: int = 100_000) -> Callable[[], None]:
    """The time to write arrays of these shapes for all poses: the bound set by memory."""

    def write() -> None:
        for _ in range(0, count, block):
            for shape in shapes:
                np.full((min(block, count), *shape), 1.0)

    return write


def tables(count: int, runs: int) -> str:
    """All comparisons as Markdown."""
    robot = load_robot("fanuc_m900ib")
    poses = sample(robot, count)
    few = poses.take(slice(0, count // 10))
    plain, wide = model(robot), model(robot, 12)
    names = [p.name for p in wide.parameters if "compliance" in p.name or p.name.endswith(".stiffness")]
    steps = list[dict[str, float]]()
    kinematics = turns(
        {
            "ours": lambda: steps.append(batch(plain, poses)),
            "loop": lambda: pinocchio_loop(robot, few),
            "writing": writing(count, (3,), (6, 6), (6,)),
        },
        runs,
    )
    loop = kinematics["loop"] * len(poses) / len(few)
    both = turns(
        {
            "ours": lambda: sensitivities(wide, poses, names),
            "writing": writing(count, (1, 3, len(names)), (1, 3)),
        },
        runs,
    )
    states = turns({"full": lambda: plain.predict(few), "linear": lambda: plain.predict(few, linear=True)}, runs)
    rows = [
        (
            f"positions, Jacobians, gravity torques of {count:.0e} poses",
            kinematics["ours"],
            f"Pinocchio, pose by pose ({len(few):.0e} of them, scaled up)",
            loop,
        ),
        ("the same", kinematics["ours"], "writing these arrays", kinematics["writing"]),
        (
            f"predictions and {len(names)} sensitivities of {count:.0e} poses",
            both["ours"],
            "writing these arrays",
            both["writing"],
        ),
        (f"full equilibrium of {len(few):.0e} poses", states["full"], "linear prediction", states["linear"]),
    ]
    text = [[what, f"{ours:.3f}", against, f"{other:.3f}", _ratio(ours, other)] for what, ours, against, other in rows]
    head = ["what", "CPU s", "against", "CPU s", "ratio"]
    middle = {step: statistics.median(each[step] for each in steps) for step in STEPS}
    shares = [[step, f"{middle[step]:.3f}", f"{100.0 * middle[step] / loop:.1f} %"] for step in STEPS]
    return "\n\n".join(
        [
            table(head, text),
            f"Peak memory of all of this {memory() / 1024:.2f} GB.",
            "### Steps of the kernel",
            table(["step", "CPU s", "of Pinocchio's loop, which closes none"], shares),
        ]
    )


def _ratio(ours: float, other: float) -> str:
    return f"{other / ours:.1f} times faster" if other > ours else f"{ours / other:.1f} times it"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="a tenth of the poses, one run")
    parser.add_argument("--write", action="store_true", help="write the table to docs/results.md")
    given = parser.parse_args()
    text = tables(100_000 if given.quick else 1_000_000, 1 if given.quick else RUNS)
    show("kinematics", text, given.write, given.quick)


if __name__ == "__main__":
    main()
