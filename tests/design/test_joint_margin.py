"""Plans keep off the joints' limits, as a cell's engineer does, unless they are told otherwise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.errors import InputError
from qsframework.experiment import Experiment, load_experiment, make_plan
from qsframework.plans import broken_constraints, check_poses, design
from qsframework.plans.constraints import allowed_range, joint_range
from qsframework.plans.ordering import turning, visits, way_length
from qsframework.plugin import Poses
from qsframework.robot import load_robot


def test_a_plan_keeps_two_percent_and_two_degrees(m900ib: Experiment) -> None:
    """Before, 13 angles of 11 of 12 poses of a plan lay within 0.05 deg of a limit."""
    plan = design(m900ib, 12, candidates=300, seed=0)
    controller = m900ib.robot.controller
    low, high = np.rad2deg(controller.lower), np.rad2deg(controller.upper)
    margin = np.maximum(2.0, 0.02 * (high - low))
    pendant = np.rad2deg(plan.pendant)
    assert np.all(pendant >= low + margin - 1e-6)
    assert np.all(pendant <= high - margin + 1e-6)
    assert broken_constraints(m900ib, plan) == {}


def test_the_margin_is_stated_or_switched_off(m900ib: Experiment) -> None:
    ends = np.array(allowed_range(m900ib))
    wide = m900ib.with_(constraints=replace(m900ib.constraints, joint_margin=np.deg2rad(10.0)))
    assert np.allclose(np.rad2deg(np.array(joint_range(wide)) - ends), [[10.0] * 6, [-10.0] * 6])
    none = m900ib.with_(constraints=replace(m900ib.constraints, joint_margin=0.0))
    assert np.array_equal(joint_range(none), ends)
    with pytest.raises(InputError, match="the margin of 90 deg to the limits of joint_2 leaves no range"):
        joint_range(m900ib.with_(constraints=replace(m900ib.constraints, joint_margin=np.deg2rad(90.0))))


def test_limits_and_angles_that_are_stated_are_taken_at_their_word(m900ib: Experiment) -> None:
    limits = replace(
        m900ib.constraints, joint_limits={"joint_1": (-np.pi, 0.0)}, joint_values={"joint_2": (np.deg2rad(90.0),)}
    )
    lower, upper = np.rad2deg(joint_range(m900ib.with_(constraints=limits)))
    assert (lower[0], upper[0], lower[1], upper[1]) == pytest.approx((-180.0, 0.0, -64.0, 90.0))
    assert lower[2] > -130.0


def test_a_track_keeps_its_share(tmp_path: Path) -> None:
    robot = load_robot("kuka_kr500_on_kl4000")
    (tmp_path / "experiment.yaml").write_text(
        "robot: kuka_kr500_on_kl4000\nmarkers: {m1: {xyz_mm: [100, 0, 100]}}\nnoise: {sigma_mm: 0.03}\n"
        "constraints: {joint_margin_deg: 5}\n"
    )
    lower, upper = joint_range(load_experiment(tmp_path / "experiment.yaml"))
    travel = robot.controller.upper[0] - robot.controller.lower[0]
    assert lower[0] == pytest.approx(robot.controller.lower[0] + 0.02 * travel)
    assert upper[1] == pytest.approx(robot.controller.upper[1] - np.deg2rad(5.0))


def test_a_pose_within_the_margin_is_named_so(m900ib: Experiment) -> None:
    controller = m900ib.robot.controller
    pendant = np.deg2rad([[0.0, 20, -10, 0, 40, 0], [179.0, 20, -10, 0, 40, 0], [181.0, 20, -10, 0, 40, 0]])
    found = check_poses(m900ib, m900ib.model(), pendant)
    assert found["joint limits"].tolist() == [True, True, False]
    assert found["joint_margin"].tolist() == [True, False, False]
    wrench = np.tile([0.0, 0, -4000, 0, 0, 0], (3, 1))
    plan = make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["weight"] * 3)
    assert broken_constraints(m900ib, plan)["joint_margin"] == ("p02", "p03")


def test_of_ways_as_long_the_one_that_spares_the_cables() -> None:
    """Five poses that are 100 deg apart each: all orders take as long; a sixth joint is not turned to and fro."""
    rng = np.random.default_rng(1)
    for _ in range(5):
        wrist = np.deg2rad(rng.permutation([0.0, 20.0, 40.0, 60.0, 80.0]))
        pendant = np.column_stack([np.deg2rad(100.0) * np.eye(5), wrist])
        plan = make_plan(Poses(pendant, pendant, np.ones((5, 6))), ["a"] * 5)
        order = visits(plan, "shortest")
        assert way_length(pendant, order) == pytest.approx(np.deg2rad(400.0))
        assert turning(pendant, order)[5] == pytest.approx(np.deg2rad(80.0))
