"""A new robot's folder from a URDF, a xacro or a table of Denavit and Hartenberg, and what is still to be looked up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from qsf_onboarding.dh_table import read_denavit
from qsf_onboarding.joints import ChainJoint
from qsf_onboarding.options import Arm
from qsf_onboarding.proposal import propose
from qsframework.arguments import checked
from qsframework.errors import InputError, Problem
from qsframework.files import write_folder, write_text
from qsframework.plausible import RANGES
from qsframework.robot import Robot, load_robot
from qsframework.robot.packages import Sources
from qsframework.robot.search import ROBOT_NAME
from qsframework.robot.statics import GravityCheck, check_statics


@dataclass(frozen=True, kw_only=True)
class NewRobot:
    """A folder that was written: its files, what became of the joints from base to flange and of those beside them,
    what is to be looked up, and how its kinematics and gravity were tried."""

    folder: Path
    files: tuple[str, ...]
    chain: tuple[ChainJoint, ...]
    checklist: tuple[str, ...]
    checks: tuple[GravityCheck, ...]


@checked
def new(
    name: str,
    urdf: str | Path | None = None,
    dh: str | Path | None = None,
    folder: str | Path | None = None,
    arm: Arm | None = None,
    campaign: Callable[[Robot], str] | None = None,
) -> NewRobot:
    """Write the folder of a new robot, from a URDF or xacro or from a table, and test it.

    Args:
        name: the robot's name.
        urdf: its URDF or xacro.
        dh: instead of it a Denavit-Hartenberg table.
        folder: to make, the name if None; an empty one may be there.
        arm: base, flange, payload and the like.
        campaign: makes the text of the folder's experiment.yaml, of a robot whose kinematics and gravity are right.

    Returns:
        The robot, and what is missing in its data.

    Raises:
        InputError: with every problem, where the name is none, the file is missing, the folder holds something, or the
            description is no arm.
    """
    arm, folder = arm or Arm(), Path(folder or name)
    if not ROBOT_NAME.fullmatch(name):
        raise InputError(Problem(f"name: use letters, digits, _ . and - only, found {name!r}"))
    if arm.payload is not None and not 0.01 <= arm.payload <= RANGES["kg"].most:
        allowed, argument = f"0.01 to {RANGES['kg'].most:g} kg", ("payload", "KG")
        raise InputError(
            Problem("no payload of a robot", found=f"{arm.payload:g} kg", allowed=allowed, argument=argument)
        )
    file = Path(urdf or dh or "")
    if (urdf is None) == (dh is None):
        raise InputError(Problem("give a URDF or a table of Denavit and Hartenberg", argument=("urdf", "FILE")))
    if arm.modified and dh is None:
        raise InputError(
            Problem("only a table of Denavit and Hartenberg can be a modified one", argument=("dh", "TABLE"))
        )
    if arm.bearing is not None and not abs(arm.bearing) <= RANGES["m"].most:
        message, argument = "no height of a bearing", ("bearing", "M")
        raise InputError(Problem(message, found=f"{arm.bearing:g} m", allowed="up to 100 m", argument=argument))
    if not file.is_file():
        raise InputError(Problem("no such file", file=str(file), hint="A URDF, a xacro or a table is needed."))
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        message = "exists already, and nothing is overwritten"
        raise InputError(Problem(message, file=str(folder), argument=("output", "FOLDER")))
    missing = [
        Problem("no such folder", str(path), argument=("package", f"{key}=FOLDER"))
        for key, path in arm.packages.items()
        if not path.is_dir()
    ]
    if missing:
        raise InputError(missing)
    packages = {key: path.absolute() for key, path in arm.packages.items()}  # as seen from where the user stands
    sources = Sources(packages, arm.arguments, nearby=True)
    description = file if dh is None else read_denavit(file, arm.modified)
    flange = arm.flange or (None if dh is None else "flange")
    proposal = propose(name, description, arm.base, flange, sources, arm.payload, arm.bearing)
    checks: list[GravityCheck] = []

    def tried(made: Path) -> None:
        robot = load_robot(made)
        checks.extend(check_statics(robot))
        if campaign is not None and all(check.good for check in checks):
            write_text(made / "experiment.yaml", campaign(robot))

    write_folder(folder, proposal.files, tried)
    return NewRobot(
        folder=folder,
        files=tuple(proposal.files),
        chain=proposal.chain,
        checklist=proposal.checklist,
        checks=tuple(checks),
    )
