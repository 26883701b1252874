"""A plan can be driven: no loop passes flat on the way from one of its poses to another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qsframework.errors import InputError
from qsframework.experiment import Experiment, Plan, make_plan
from qsframework.plans import design
from qsframework.plans.constraints import check_poses, on_one_side
from qsframework.plans.programme import make_programme
from qsframework.plugin import Poses
from qsframework.robot import load_robot
from qsframework.uses.conformance import small_campaign


def campaign(name: str, folder: Path) -> Experiment:
    return small_campaign(load_robot(name), folder)


@pytest.mark.parametrize("name", ["abb_irb2400", "fanuc_m900ia_260l"])
def test_the_loops_of_a_plan_stand_on_one_side_of_flat(name: str, tmp_path: Path) -> None:
    experiment = campaign(name, tmp_path)
    plan = design(experiment, 30)
    assert on_one_side(experiment, plan.pendant).all()
    assert plan.certificate is not None
    assert any("candidates are left out: a loop would pass flat on the way" in n for n in plan.certificate.notes)
    assert len([move for move in make_programme(experiment, plan).moves if move.measured]) == 30


def two_sides(experiment: Experiment) -> Plan:
    """Two poses on one side and one on the other, each of which keeps its distance from flat."""
    pendant = np.zeros((3, experiment.robot.controller.axes))
    pendant[1, 2] = 0.2
    for lean in np.arange(0.0, 1.9, 0.02):
        for elevation in (-1.0, 1.1):
            pendant[2, 1:3] = lean, elevation
            poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), np.zeros((3, 6)))
            kept = check_poses(experiment, experiment.model(), pendant).values()
            if not on_one_side(experiment, pendant)[2] and all(ok.all() for ok in kept):
                return make_plan(poses, ["weight"] * 3)
    raise AssertionError("no such pose")


def test_export_names_the_pose_beyond_flat_before_it_looks_for_a_way(tmp_path: Path) -> None:
    experiment = campaign("abb_irb2400", tmp_path)
    with pytest.raises(InputError) as refused:
        make_programme(experiment, two_sides(experiment), file="plan.csv")
    (problem,) = refused.value.problems
    assert str(problem).startswith(
        "plan.csv: pose 'p03': breaks 'transmission angle' on the way: a loop would pass flat"
    )
    assert "design again" in str(problem)
