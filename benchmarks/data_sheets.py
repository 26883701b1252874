"""Arms of many makers by the lengths of their data sheets, as tables and as URDFs, through `qsf new`.

    python benchmarks/data_sheets.py [--write]

Seconds. Each is written as a table of Denavit and Hartenberg and as a URDF of the same arm with masses of its own,
every second axis turned over. The flange is held against the product of textbook matrices, gravity against plain
Pinocchio. `--write` writes benchmarks/data_sheets.md.
"""

from __future__ import annotations

import argparse
import csv
import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np
import numpy.typing as npt
from common import machine

from qsf_onboarding import new
from qsf_onboarding.options import Arm
from qsframework.errors import InputError
from qsframework.files import write_text
from qsframework.robot import load_robot
from qsframework.robot.agreement import kernel_statics
from qsframework.robot.reference import reference_flange

Array = npt.NDArray[np.float64]
PAGE = Path(__file__).with_suffix(".md")
HEAD = """# Arms by their data sheets

The lengths are those of public data sheets, from memory: they try `qsf new`, and describe no machine. Each arm goes in
as a table and as a URDF of the same joints. *Errors* are the largest differences from plain Pinocchio and from textbook
matrices at 20 poses: of the flange, m, and of the torques of gravity, as a share of the largest. Mass and stiffness are
what `qsf new` proposes for the table, which states no mass.

"""
POSES = 20


@dataclass(frozen=True, eq=False)
class Sheet:
    """An arm: its maker and name, payload in kg, Craig's convention or not, and rows (n, 4) mm and deg."""

    maker: str
    name: str
    payload: float
    modified: bool
    rows: Array


def sheets() -> list[Sheet]:
    """The arms of data_sheets.csv."""
    with PAGE.with_suffix(".csv").open(encoding="utf-8", newline="") as stream:
        lines = list(csv.reader(stream, delimiter=";"))[1:]
    rows = [np.array([[float(v) for v in row.split(",")] for row in line[4].split()]) for line in lines]
    return [Sheet(m, n, float(p), c == "modified", r) for (m, n, p, c, _), r in zip(lines, rows, strict=True)]


def about(axis: int, way: float, angle: float) -> Array:
    """Moved along and turned about x (0) or z (2), (4, 4)."""
    c, s, out = np.cos(angle), np.sin(angle), np.eye(4)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    out[[first, second, first, second], [first, second, second, first]] = c, c, -s, s
    out[axis, 3] = way
    return out


def frames(sheet: Sheet, q: Array) -> list[Array]:
    """The frames (4, 4) whose z each joint turns about, then the flange's, at joint angles (n,) rad."""
    out, at = list[Array](), np.eye(4)
    for (a, alpha, d, theta), angle in zip(sheet.rows, q, strict=True):
        across, turned = about(0, 1e-3 * a, np.deg2rad(alpha)), about(2, 1e-3 * d, np.deg2rad(theta) + angle)
        out.append(at @ across @ turned if sheet.modified else at @ about(2, 0.0, np.deg2rad(theta) + angle))
        at = at @ (across @ turned if sheet.modified else turned @ across)
    return [*out, at]


def urdf(sheet: Sheet) -> str:
    """The same arm as a URDF, with masses, and every second axis turned over."""
    n, places = len(sheet.rows), frames(sheet, np.zeros(len(sheet.rows)))
    text = ['<robot name="arm"><link name="base"/>']
    for k, (before, here) in enumerate(zip([np.eye(4), *places[:-1]], places, strict=True)):
        step = np.linalg.solve(before, here)
        yaw = np.arctan2(step[1, 0], step[0, 0])
        turned = about(2, 0.0, yaw).T[:3, :3] @ step[:3, :3]
        pitch, roll = np.arctan2(-turned[2, 0], turned[0, 0]), np.arctan2(-turned[1, 2], turned[1, 1])
        mass = 3.0 * sheet.payload / (k + 1)
        body = f'<inertial><origin xyz="0.0{k} 0.01 -0.02"/><mass value="{mass}"/>'
        body += f'<inertia ixx="{mass}" iyy="{mass}" izz="{mass}"/></inertial>'
        text.append(f'<link name="{f"link_{k}" if k < n else "flange"}">{body if k < n else ""}</link>')
        text.append(
            f'<joint name="joint_{k}" type="{"revolute" if k < n else "fixed"}">'
            f'<parent link="{f"link_{k - 1}" if k else "base"}"/><child link="{f"link_{k}" if k < n else "flange"}"/>'
            f'<origin xyz="{_words(step[:3, 3])}" rpy="{_words([roll, pitch, yaw])}"/><axis xyz="0 0 {(-1) ** k}"/>'
            '<limit lower="-3" upper="3" effort="0" velocity="1"/></joint>'
        )
    return "\n".join([*text, "</robot>\n"])


def _words(values: Sequence[float] | Array) -> str:
    return " ".join(f"{float(value):.17g}" for value in values)


def errors(sheet: Sheet, folder: Path, senses: Array) -> tuple[float, float]:
    """Largest differences of the flange, m, and of the torques of gravity, as a share of the largest."""
    import pinocchio as pin

    robot, rng = load_robot(folder), np.random.default_rng(0)
    model = pin.buildModelFromUrdf(str(folder / "arm.urdf"))
    data, away, torque = model.createData(), 0.0, 0.0
    for q in rng.uniform(-2.5, 2.5, (POSES, len(sheet.rows))):
        away = max(away, float(np.abs(reference_flange(robot, q[None])[0] - frames(sheet, senses * q)[-1]).max()))
        turns = [[np.cos(v), np.sin(v)] if model.joints[k + 1].nq == 2 else [v] for k, v in enumerate(q)]
        wanted = pin.computeGeneralizedGravity(model, data, np.concatenate(turns))
        found = kernel_statics(robot, q[None]).torque[:, 0]
        torque = max(torque, float(np.abs(found + wanted).max() / max(np.abs(wanted).max(), 1.0)))
    return away, torque


def tried(sheet: Sheet) -> Iterator[str]:
    """The cells of a line: what became of the table and of the URDF."""
    n = len(sheet.rows)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        table = ["a_mm,alpha_deg,d_mm,theta_deg", *(",".join(map(repr, row)) for row in sheet.rows.tolist())]
        files = {"dh": write_text(folder / "arm.csv", "\n".join(table) + "\n")}
        files["urdf"] = write_text(folder / "given.urdf", urdf(sheet))
        for form, senses in (("dh", np.ones(n)), ("urdf", (-1.0) ** np.arange(n))):
            arm = Arm(payload=sheet.payload, modified=sheet.modified and form == "dh")
            try:
                made = new("arm", folder=folder / form, arm=arm, **{form: files[form]})
            except InputError as error:
                yield f"refused: {error}"
                continue
            away, torque = errors(sheet, folder / form, senses)
            good = max(away, torque) < 1e-9 and all(check.good for check in made.checks)
            yield f"{away:.0e}, {torque:.0e}" if good else f"**wrong**: {away:.0e}, {torque:.0e}"
            if form == "dh":
                text = {name: (folder / form / name).read_text() for name in ("arm.urdf", "nominal.yaml")}
                masses = re.findall(r'mass value="([^"]+)', text["arm.urdf"])
                yield f"{float(f'{sum(map(float, masses)):.3g}'):g}"
                found = re.findall(r"K = (\S+) MN m/rad", text["nominal.yaml"])
                yield f"{found[0]}, {found[-1]}"


def main() -> None:
    """Print the table, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write benchmarks/data_sheets.md")
    write = parser.parse_args().write
    every = sheets()
    head = "| arm | joints | payload, kg | table: errors | mass, kg | K of first and last, MN m/rad | URDF: errors |"
    lines = [head, "|---|---|---|---|---|---|---|"]
    for sheet in every:
        cells = [f"{sheet.maker} {sheet.name}", str(len(sheet.rows)), f"{sheet.payload:g}", *tried(sheet)]
        lines.append(f"| {' | '.join(cells)} |")
        print(lines[-1], flush=True)
    if write:
        makers = len({sheet.maker for sheet in every})
        wrong = sum("wrong" in line or "refused" in line for line in lines)
        made = f"\n{len(every)} arms of {makers} makers, each in two forms; wrong or refused: {wrong}. "
        made += f"Made on {date.today():%Y-%m-%d}, {machine()}, by `python benchmarks/data_sheets.py --write`.\n"
        write_text(PAGE, HEAD + "\n".join(lines) + "\n" + made)


if __name__ == "__main__":
    main()
