"""Structural alternatives: whole robots, each simulated, fitted, and told from the robot as it is described."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.elastostatics import Model, Site, actuator_torques, make_model
from qsframework.experiment import Experiment, as_shown, make_plan, on_robot, simulate
from qsframework.fits import identify
from qsframework.plugin import Poses, build_effects
from qsframework.robot import Alternative, Robot, StructuralChange, alternatives, load_robot, robot_names
from qsframework.uses.conformance import small_campaign

ROOT = Path(__file__).resolve().parents[2]
MACHINES = [str(folder) for folder in sorted((ROOT / "tests" / "robots" / "machines").iterdir())]
SHIPPED = [n for n in robot_names() if (ROOT / "robots" / n).is_dir()]


def ids(robot: Robot) -> list[str]:
    return [a.id for a in alternatives(robot)]


def campaign(robot: Robot, folder: Path) -> Experiment:
    """Of a tenth of a micrometre, so that what a balancer's spring adds is seen."""
    found = small_campaign(robot, folder)
    return found.with_(noise=replace(found.noise, sigma=1e-7))


def poses_of(experiment: Experiment, count: int = 12) -> Poses:
    rng, control = np.random.default_rng(1), experiment.robot.controller
    pendant = rng.uniform(control.lower, control.upper, (30 * count, control.axes))
    wrench = np.stack([experiment.loads[i % 2].wrench for i in range(30 * count)])
    every = Poses(pendant, control.to_joints(pendant), wrench)
    return every.take(np.flatnonzero(experiment.model().transmission_margin(every) >= 0.3)[:count])


@pytest.mark.parametrize("name", [*SHIPPED, *MACHINES])
def test_every_alternative_is_simulated_and_fits_its_own_readings_best(name: str, tmp_path: Path) -> None:
    described = campaign(load_robot(name), tmp_path)
    found = alternatives(described.robot)
    assert len({a.id for a in found}) == len(found) >= 2
    for alternative in found:
        other = on_robot(described, alternative.robot)
        poses = poses_of(other)
        readings = simulate(other, make_plan(poses, [""] * len(poses)), seed=3).readings
        own, wrong = identify(other, readings), identify(described, as_shown(readings, described))
        assert 0.5 < own.chi2 / own.dof < 2.0, alternative.id
        assert wrong.chi2 > 2.0 * own.chi2 or idle(described, alternative), alternative.id


def idle(described: Experiment, alternative: Alternative) -> bool:
    """Whether the file gives a balancer no spring, so that it is there in name only."""
    if alternative.kind is not StructuralChange.BALANCER_ABSENT:
        return False
    return not any(p.nominal for p in described.robot.parameters if re.search(r"\.stiffness$", p.name))


def test_the_alternatives_of_the_papers_robot() -> None:
    robot = load_robot("fanuc_m900ib")
    assert ids(robot) == [
        "loop absent: parallelogram[joint_3]",
        "balancer absent: gravity_compensator[joint_2] + compensator_stiffness[joint_2]",
        "angle relative: joint_3",
    ]
    serial, bare, relative = (a.robot for a in alternatives(robot))
    assert not any(p.name.startswith("parallelogram") for p in serial.parameters)
    assert {e.effect_name() for e in bare.effects} == {"parallelogram", "joint_compliance", "counterweight"}
    assert not serial.facts.branches
    assert [e.name for e in serial.effects if e.effect_name() == "counterweight"] == ["counterweight[link_3]"]
    shown = np.deg2rad([[10.0, 20.0, -30.0, 40.0, 50.0, 60.0]])
    np.testing.assert_allclose(robot.controller.to_joints(shown)[0, 2], np.deg2rad(-10.0))
    np.testing.assert_allclose(relative.controller.to_joints(shown), shown)


def test_an_alternative_of_an_alternative_is_the_robot_again() -> None:
    """Relative and absolute, loop taken out and put in: the same angles and the same statics."""
    robot = load_robot("fanuc_m900ib")
    relative = next(a.robot for a in alternatives(robot) if a.kind is StructuralChange.ANGLE_RELATIVE)
    back = next(a.robot for a in alternatives(relative) if a.kind is StructuralChange.ANGLE_ABSOLUTE)
    np.testing.assert_allclose(back.controller.matrix, robot.controller.matrix, atol=1e-15)
    assert back.facts.limits is not None
    np.testing.assert_allclose(back.facts.limits, robot.facts.limits, atol=1e-12)
    serial = next(a.robot for a in alternatives(robot) if a.kind is StructuralChange.LOOP_ABSENT)
    again = next(a.robot for a in alternatives(serial) if a.kind is StructuralChange.LOOP_PRESENT)
    assert "loop present: parallelogram[joint_3]" in ids(serial)
    q = np.random.default_rng(0).uniform(-0.5, 0.5, (5, 6))
    poses = Poses(q, robot.controller.to_joints(q), np.tile([0, 0, -3e3, 0, 0, 0], (5, 1)))
    one, other = (model_of(r).predict(poses, linear=True) for r in (robot, again))
    np.testing.assert_allclose(one, other, atol=1e-12)


def model_of(robot: Robot) -> Model:
    tip = Site(6, np.array([0.1, 0.2, 0.3]))
    return make_model(robot.facts, robot.effects, robot.parameters, tip, [("m", tip)], robot.gravity)


def test_what_hangs_on_a_loop_goes_with_it(tmp_path: Path) -> None:
    """Lever, bar and the mass on the lever; a bar's compliance; the housing is the balancer's and stays."""
    robot = load_robot(MACHINES[0])
    (soft,) = build_effects({"effect": "bar_compliance", "driven": "joint_3"}, robot.facts)
    robot = replace(robot, effects=(*robot.effects, soft))
    serial = next(a.robot for a in alternatives(robot) if a.kind is StructuralChange.LOOP_ABSENT)
    assert [b.link for b in serial.facts.branches] == ["housing"]
    assert [s.link for s in serial.branch_shapes] == [serial.facts.bodies.index("housing")]
    gone = {e.effect_name() for e in robot.effects} - {e.effect_name() for e in serial.effects}
    assert gone == {"parallelogram", "bar_compliance", "counterweight"}
    experiment = on_robot(campaign(robot, tmp_path), serial)
    assert np.isfinite(actuator_torques(experiment.model(), poses_of(experiment))).all()


def test_a_coupling_is_absent_only_where_its_joints_have_actuators() -> None:
    palletizer, arm = load_robot(MACHINES[1]), load_robot("kuka_kr500_r2800_2")
    assert not any("coupling" in name for name in ids(palletizer))
    wrist = {"effect": "coupling", "tied": ["joint_5", "joint_6"], "matrix": [[1, 0], [0.5, 1]]}
    (loop,) = build_effects(wrist, arm.facts)
    assert "coupling absent: coupling[joint_5+joint_6]" in ids(replace(arm, effects=(*arm.effects, loop)))


def test_a_fit_keeps_what_the_other_robot_has(tmp_path: Path) -> None:
    robot = load_robot("fanuc_m900ib")
    described = campaign(robot, tmp_path).with_(fit=("joint_compliance", "compensator_stiffness[joint_2].stiffness"))
    bare = next(a.robot for a in alternatives(robot) if a.kind is StructuralChange.BALANCER_ABSENT)
    assert on_robot(described, bare).fit == ("joint_compliance",)
    assert on_robot(described, robot).fit == described.fit
