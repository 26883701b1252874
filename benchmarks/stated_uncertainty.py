"""How often stated expanded uncertainties hold, by an arm of another code: a table of docs/certificate.md.

    python benchmarks/stated_uncertainty.py             # print the table
    python benchmarks/stated_uncertainty.py --write     # and put it into the page

Each campaign is drawn, written as a user's files, identified, and used at 30 fresh targets. The true arm has springs,
zeros, joint placements and, where the tool is fitted, reflectors that its files know only to their stated sds. Of
`compensate`, the error is that of the tool point where it then stands, at the level of the held-out error: in the base
frame; where the frame is free, after the frame that suits best these and about as many other fresh poses; where the
tool is free too, after that and the tool. Of `certificate`, it is that of the reflectors as the fit predicts them,
at fresh poses, in the frame of the tracker. An error is covered where it is within U, k = 2.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from common import replace_between, table
from independent import Built, Campaign, Setting, built, forces, noisy, random_poses, write_campaign
from independent_arm import HEAVY, Array, Hidden, Visits, positions, still_visits

from qsframework.experiment import Experiment, load_experiment, read_readings
from qsframework.fits import identify
from qsframework.fits.fit import Fit
from qsframework.fits.record import COVERAGE
from qsframework.uses import compensate
from qsframework.uses.certificate import MetaSpec, certify
from qsframework.uses.inverse import arm_length, rigid_jacobian
from qsframework.uses.targets import joint_targets

PAGE = Path(__file__).resolve().parents[1] / "docs" / "certificate.md"
START, STOP = "<!-- table of benchmarks/stated_uncertainty.py -->", "<!-- end of the table of stated uncertainties -->"
TARGETS, SEEDS = 30, 40
_FRESH = 1_000_003
_REGULAR = 0.04
"""Smallest singular value of the Jacobian, lengths in arms, of a target that can be corrected."""
_ZERO, _LENGTH, _TURN = 5e-4, 3e-4, 3e-4
"""sds of zeros, rad, and of joint placements, m and rad."""


@dataclass(frozen=True)
class Kind:
    """A campaign: its readings, whether the instrument's frame is free, and whether the tool is."""

    name: str
    readings: str
    frame: bool = False
    tool: bool = False


KINDS = (
    Kind("displacements", "displacements"),
    Kind("positions, frame free", "positions", frame=True),
    Kind("positions, frame and tool free", "positions", frame=True, tool=True),
    Kind("positions, neither free", "positions"),
    Kind("displacements and positions, both free", "mixed", frame=True, tool=True),
)


@dataclass(frozen=True)
class Drawn:
    """A campaign of a kind as it was drawn: the true arm, its files, the fit."""

    kind: Kind
    campaign: Campaign
    true: Built
    experiment: Experiment
    fit: Fit


def drawn(kind: Kind, seed: int, folder: Path) -> Drawn:
    """The files of a campaign in a folder, and the fit to its readings."""
    campaign = Campaign(Setting(HEAVY, 40, seed, kind.readings))
    rng = np.random.default_rng([seed, 17])
    n = len(HEAVY.links)
    true = replace(
        built(campaign.setting),
        zeros=_ZERO * rng.standard_normal(n),
        frames=np.array([_LENGTH] * 3 + [_TURN] * 3) * rng.standard_normal((n, 6)),
        **({} if kind.tool else {"markers": np.array(HEAVY.markers)}),
    )
    path = write_campaign(campaign, noisy(campaign, campaign.clean(Hidden(), true)), folder)
    _state(kind, true, path)
    experiment = load_experiment(path)
    return Drawn(kind, campaign, true, experiment, identify(experiment, read_readings(experiment.data, experiment)))


def _state(kind: Kind, true: Built, path: Path) -> None:
    """What the experiment's file says of frame and tool, and how well zeros and placements are known beforehand."""
    text = path.read_text()
    if kind.readings == "displacements":
        text += "effects:\n  - {effect: joint_offset, joints: all}\n  - {effect: joint_placement, joints: all}\n"
        text += "fit: [joint_compliance]\n"
    elif not kind.tool:
        text = text.replace("effects:\n  - {effect: marker_offset, markers: all}\n", "").replace("marker_offset, ", "")
    if kind.readings == "positions" and not kind.frame:
        v, t = true.station[:3], (1e3 * true.station[3:]).tolist()
        angle = float(np.linalg.norm(v))
        quaternion = [float(np.cos(angle / 2)), *(np.sin(angle / 2) * v / angle).tolist()]
        text += f'frames: {{"": {{quat_wxyz: {quaternion}, xyz_mm: {t}}}}}\n'
    path.write_text(text + "nominal: known.yaml\n")
    lines = list[str]()
    for k in range(1, len(HEAVY.links) + 1):
        lines.append(f"joint_offset[j{k}]: {{value_mrad: 0, sd_mrad: {1e3 * _ZERO}}}")
        lines += [f"joint_placement[j{k}].{a}: {{value_mm: 0, sd_mm: {1e3 * _LENGTH}}}" for a in "xyz"]
        lines += [f"joint_placement[j{k}].r{a}: {{value_mrad: 0, sd_mrad: {1e3 * _TURN}}}" for a in "xyz"]
    (path.parent / "known.yaml").write_text("\n".join(lines) + "\n")


def fresh(one: Drawn) -> Visits:
    """Loaded states at poses that the campaign has not, away from singular ones: the targets, and others."""
    setting = replace(one.campaign.setting, poses=2 * TARGETS, seed=one.campaign.setting.seed + _FRESH, loads="many")
    shown = random_poses(setting, np.random.default_rng([setting.seed, 5]))
    robot = one.experiment.robot
    J = rigid_jacobian(robot, one.experiment.load_site, robot.controller.to_joints(shown))
    J[:, :3] /= arm_length(robot)
    shown = shown[np.linalg.svd(J, compute_uv=False)[:, -1] > _REGULAR]
    return still_visits(shown, np.resize(forces(setting), (len(shown), 3)))


def _stands(one: Drawn, visits: Visits, points: Array) -> Array:
    """Where points (K, 3) m of the flange truly are (N, K, 3), base frame."""
    return positions(HEAVY, one.true.hidden, one.true.compliance, visits, points)


def of_targets(one: Drawn) -> tuple[Array, Array]:
    """True errors (N,) m of corrected targets at the level that is stated, and their stated U (N,) m."""
    there = fresh(one)
    wrench = np.concatenate([there.force, np.zeros_like(there.force)], axis=1)
    targets = joint_targets(one.experiment, there.shown, wrench)
    deflection = one.kind.readings == "displacements"
    found = compensate(one.experiment, one.fit, targets, "unloaded" if deflection else "commanded")
    tool = HEAVY.tool + np.vstack([np.zeros(3), np.eye(3)])
    stands = _stands(one, still_visits(found.pendant, there.force), tool)
    wanted = targets.wanted.position
    if deflection:
        wanted = _stands(one, still_visits(there.shown, 0.0 * there.force), tool)[:, 0]
    error = stands[:, 0] - wanted
    if one.kind.frame:
        error = _left(error, stands, one.kind.tool)
    return np.linalg.norm(error[:TARGETS], axis=1), COVERAGE * found.sd[:TARGETS]


def _left(error: Array, stands: Array, tool: bool) -> Array:
    """Errors (N, 3) m less the motion of the frame, and of the tool, that suits best; stands (N, 4, 3) m: the tool
    point, and points a metre from it along the axes of the flange."""
    along = (stands[:, 1:] - stands[:, :1]).transpose(0, 2, 1)
    turned = np.cross(np.eye(3), stands[:, :1]).transpose(0, 2, 1)
    moved = np.concatenate([np.broadcast_to(np.eye(3), turned.shape), turned, *([along] if tool else [])], axis=2)
    return np.asarray(error - moved @ np.linalg.lstsq(moved.reshape(error.size, -1), error.ravel(), rcond=None)[0])


def of_reflectors(one: Drawn, folder: Path, halves: int) -> tuple[Array, Array]:
    """True errors (N,) m of what the fit predicts of the reflectors at fresh poses, and the certificate's U (N,) m.

    halves: by which the certificate is made of the fit's own readings; 0: by those of another campaign of the arm
    """
    setting = replace(one.campaign.setting, seed=one.campaign.setting.seed + _FRESH)
    other = Campaign(setting)
    tables = other.clean(Hidden(), one.true)
    place = write_campaign(other, noisy(other, tables), folder)
    _state(one.kind, one.true, place)
    again = load_experiment(place)
    readings = read_readings(again.data, again)
    data = one.experiment.data if halves else again.data
    stated = certify(one.experiment, one.fit, read_readings(data, one.experiment), MetaSpec(), halves=max(halves, 1))
    predicted, measured = one.fit.predict(readings)
    true = np.concatenate([t.reshape(-1, 3) for t in tables])
    error = np.linalg.norm(predicted - true, axis=1)
    assert np.abs(measured - true).max() < 1e-3, "the rows stand in the order in which they were written"
    chosen = np.linspace(0, len(error) - 1, TARGETS).astype(int)
    return error[chosen], np.full(TARGETS, COVERAGE * stated.corrected)


def measured(kind: Kind, seeds: Sequence[int]) -> list[tuple[Array, Array]]:
    """Errors and U of targets, of reflectors by other readings, and by random halves, over seeds, m."""
    every: list[list[tuple[Array, Array]]] = []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            one = drawn(kind, seed, Path(folder) / "campaign")
            reflectors = [of_reflectors(one, Path(folder) / f"other{k}", k) for k in (0, 3)]
            every.append([of_targets(one), *reflectors])
    return [
        (np.concatenate([e for e, _ in own]), np.concatenate([U for _, U in own])) for own in zip(*every, strict=True)
    ]


def row(kind: Kind, seeds: Sequence[int]) -> list[str]:
    """One row of the table."""
    out = [kind.name]
    for errors, stated in measured(kind, seeds):
        rms = 1e3 * np.sqrt(np.mean(errors**2))
        out.append(f"{100 * np.mean(errors <= stated):.0f} % within U = {1e3 * np.median(stated):.3f} (RMS {rms:.3f})")
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="put the table into docs/certificate.md")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    chosen = parser.parse_args()
    head = ("readings", "corrected target", "certificate, other readings", "certificate, random halves")
    text = table(head, [row(kind, range(chosen.seeds)) for kind in KINDS])
    print(text)
    if chosen.write:
        replace_between(PAGE, START, STOP, text)


if __name__ == "__main__":
    main()
