"""`check_robot`: does a robot work with everything? From its files to a small campaign that ends in a diagnosis."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import get_args

import numpy as np

from qsframework.diagnoses import diagnose
from qsframework.diagnoses.result import Verdict
from qsframework.errors import QsfError
from qsframework.experiment import Experiment, Plan, load_experiment, simulate
from qsframework.files import write_text
from qsframework.fits import identify
from qsframework.plans import DesignOptions, design
from qsframework.plugin import Array, Poses
from qsframework.plugin.registry import with_role
from qsframework.robot import Robot, load_robot
from qsframework.robot.findings import robot_findings
from qsframework.robot.statics import GravityCheck, check_gravity, check_kinematics
from qsframework.uses.first_campaign import first_campaign
from qsframework.uses.inverse import poses_at

POSES = 8
_TRIED = 20
_SDS = 4.0
Progress = Callable[[str, int, int], None]
STEPS = ("kinematics", "gravity", "model", "derivatives", "design", "identify", "diagnose")


@dataclass
class _Run:
    """The robot, its small campaign, and what has been found so far."""

    robot: Robot
    experiment: Experiment
    seed: int
    plan: Plan | None = None
    checks: list[GravityCheck] = field(default_factory=list[GravityCheck])

    def angles(self, count: int) -> Array:
        """Pendant angles (count, n) rad inside the limits, no loop flat."""
        control, rng = self.robot.controller, np.random.default_rng(self.seed)
        pendant = rng.uniform(control.lower, control.upper, (50 * count, len(control.lower)))
        poses = self.poses(pendant)
        return pendant[self.experiment.model().transmission_margin(poses) >= 0.0][:count]

    def poses(self, pendant: Array) -> Poses:
        """The pendant angles under the campaign's last load, which pulls to the side too."""
        wrench = np.tile(self.experiment.loads[-1].wrench, (len(pendant), 1))
        return poses_at(self.robot, pendant, wrench)


def check_robot(robot: Robot | str | Path, seed: int = 0, progress: Progress | None = None) -> tuple[GravityCheck, ...]:
    """Try a robot: kinematics and gravity against Pinocchio, derivatives against finite differences, then a campaign
    in small - eight poses designed, simulated, identified, diagnosed.

    A robot whose files are wrong raises InputError, as `load_robot` does; what fails later is a Check that is not good.
    """
    loaded = robot if isinstance(robot, Robot) else load_robot(robot)
    with tempfile.TemporaryDirectory() as folder:
        run = _Run(loaded, small_campaign(loaded, Path(folder)), seed)
        tests = (_kinematics, _gravity, _model, _derivatives, _design, _identify, _diagnose)
        for i, (name, test) in enumerate(zip(STEPS, tests, strict=True)):
            if progress is not None:
                progress(name, i, len(STEPS))
            failed = next((c.name for c in run.checks if not c.good), None)
            if failed:
                run.checks.append(GravityCheck(name, False, f"not tried, because {failed} failed"))
                continue
            try:
                good, words = test(run)
            except QsfError as error:
                good, words = False, str(error)
            run.checks.append(GravityCheck(name, good, words))
    return (*run.checks, *robot_findings(loaded))


def small_campaign(robot: Robot, folder: Path) -> Experiment:
    """The first campaign on the robot, in a folder."""
    return load_experiment(write_text(folder / "experiment.yaml", first_campaign(robot, json.dumps(str(robot.folder)))))


def _kinematics(run: _Run) -> tuple[bool, str]:
    q = run.robot.controller.to_joints(run.angles(_TRIED))
    if not len(q):
        return False, "no pose inside the limits closes the loops: look at the limits, margin and zero of the loop"
    return check_kinematics(run.robot, q)


def _gravity(run: _Run) -> tuple[bool, str]:
    return check_gravity(run.robot, run.robot.controller.to_joints(run.angles(_TRIED)))


def _model(run: _Run) -> tuple[bool, str]:
    """A load does work on what it bends: never the other way round."""
    experiment, poses = run.experiment, run.poses(run.angles(_TRIED))
    model, names = experiment.model(), experiment.fit_names()
    if not names:
        gear = with_role("gear")[0].effect_name()
        return False, f"no compliance: add {{effect: {gear}, joints: all}} to the effects"
    rigid = [n for n in names if not model.nominal[model.index([n])[0]] > 0.0]
    if rigid:
        return False, f"without a nominal value, so that the simulated arm is rigid there: {', '.join(rigid)}"
    load_point = replace(experiment.markers[0], name="load", xyz=experiment.load_point)
    deflection = experiment.with_(markers=(load_point,)).model().predict(poses)[:, 0]
    work = np.einsum("ij,ij->i", deflection, poses.wrench[:, :3])
    size = 1e3 * float(np.median(np.linalg.norm(deflection, axis=1)))
    against = int((work <= 0.0).sum())
    way = "always along the load" if not against else f"but not along the load at {against} of {len(work)} poses"
    return not against, f"the load point gives by {size:.2g} mm (median), {way}"


def _derivatives(run: _Run) -> tuple[bool, str]:
    """d reading / d parameter of every parameter against central differences, relative to its largest entry."""
    model, poses = run.experiment.model(), run.poses(run.angles(5))
    x = np.array(model.nominal)
    exact, worst, where = model.sensitivity(poses, x), 0.0, ""
    for i, parameter in enumerate(model.parameters):
        h = 1e-4 * (abs(x[i]) or parameter.typical)
        up, down = x.copy(), x.copy()
        up[i] += h
        down[i] -= h if x[i] - h >= parameter.lower else 0.0
        slope = (model.predict(poses, up) - model.predict(poses, down)) / (up[i] - down[i])
        one_sided = down[i] == x[i]
        size = float(np.abs(exact[..., i]).max())
        floor = 1e-13 / h + 1e-6 * size + (1e-3 * size if one_sided else 0.0)
        error = float(np.abs(slope - exact[..., i]).max()) / floor
        worst, where = max((worst, where), (error, parameter.name))
    words = f"{len(model.parameters)} parameters against finite differences"
    return worst < 10.0, words if worst < 10.0 else f"{words}: {where} differs"


def _design(run: _Run) -> tuple[bool, str]:
    options = DesignOptions(criterion="D", efficiency=0.5, polish=False)
    run.plan = design(run.experiment, POSES, candidates=200, seed=run.seed, options=options)
    outside = run.robot.controller.outside(run.plan.pendant)
    return not outside.any(), f"{POSES} poses inside the limits"


def _identify(run: _Run) -> tuple[bool, str]:
    """Values drawn within their sds come back within four sds of the fit."""
    assert run.plan is not None
    result = simulate(run.experiment, run.plan, truth="drawn", seed=run.seed)
    truth = result.truth_by_name()
    fit = identify(run.experiment, result.readings)
    off = {e.name: abs(e.value - truth[e.name]) / e.sd for e in fit.estimates}
    name = max(off, key=lambda n: off[n])
    return off[name] < _SDS, f"{len(off)} values recovered from {len(fit.lines)} readings, worst {off[name]:.1f} sd"


def _diagnose(run: _Run) -> tuple[bool, str]:
    """Of an arm that settles in its full equilibrium: the linear model's error would look like an effect."""
    assert run.plan is not None
    readings = simulate(run.experiment, run.plan, truth="drawn", seed=run.seed).readings
    found = diagnose(run.experiment, readings, seed=run.seed, largest=1, repeats=1)
    return found.verdict in get_args(Verdict), f"ran to its end: {found.verdict}"
