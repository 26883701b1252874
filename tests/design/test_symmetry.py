"""Equivalent poses: found by their information, named by the kinematics, folded into one."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from qsframework.experiment import Constraints, Experiment, Plan, example, make_plan, read_plan
from qsframework.plans.constraints import joint_range
from qsframework.plans.symmetry import canonical, equivalent_poses, flips_wrist, fold, symmetry_name, wrist_flip
from qsframework.plugin import Poses
from qsframework.robot import load_robot


def plan_of(experiment: Experiment, pendant_deg: list[list[float]], wrench: np.ndarray | None = None) -> Plan:
    pendant = np.deg2rad(np.array(pendant_deg, dtype=float))
    q = experiment.robot.controller.to_joints(pendant)
    wrench = np.tile(experiment.loads[0].wrench, (len(q), 1)) if wrench is None else wrench
    return make_plan(Poses(pendant, q, wrench), ["weight"] * len(q))


def flange(experiment: Experiment, pendant: np.ndarray) -> np.ndarray:
    """Pinocchio's placement of the last joint."""
    model = experiment.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, experiment.robot.controller.to_joints(pendant[None])[0])
    return np.array(data.oMi[model.njoints - 1].homogeneous)


def found(experiment: Experiment, plan: Plan) -> list[tuple[str, str, str]]:
    return equivalent_poses(experiment, plan)


def test_table_5_has_two_wrist_flips(m900ib: Experiment) -> None:
    paper = read_plan(example("m900ib") / "table5.csv", m900ib)
    assert found(m900ib, paper) == [("row05", "row06", "wrist flip"), ("row07", "row08", "wrist flip")]


def test_symmetries_have_names(m900ib: Experiment) -> None:
    base = [10.0, 20.0, -30.0, 40.0, 50.0, 60.0]
    others = {
        "same pose": base,
        "turn of joint 6": [10, 20, -30, 40, 50, -300],
        "turn of joints 4, 6": [10, 20, -30, -320, 50, -300],
        "wrist flip": [10, 20, -30, 220, -50, 240],
        "axis 1": [80, 20, -30, 40, 50, 60],
        "axis 1 and wrist flip": [80, 20, -30, -140, -50, -120],
    }
    plan = plan_of(m900ib, [base, *others.values()])
    assert found(m900ib, plan) == [("p01", f"p{i + 2:02d}", name) for i, name in enumerate(others)]


def test_axis_1_is_no_symmetry_under_a_side_pull(m900ib: Experiment) -> None:
    """The same two poses, equivalent under the weight, tell different things under a pull along y."""
    poses = [[10.0, 20, -30, 40, 50, 60], [80.0, 20, -30, 40, 50, 60]]
    assert len(found(m900ib, plan_of(m900ib, poses))) == 1
    pulled = plan_of(m900ib, poses, np.tile(m900ib.loads[1].wrench, (2, 1)))
    assert found(m900ib, pulled) == []


def test_unrelated_poses_are_not_joined(m900ib: Experiment) -> None:
    lower, upper = joint_range(m900ib)
    pendant = np.random.default_rng(1).uniform(lower, upper, (200, 6))
    plan = plan_of(m900ib, np.rad2deg(pendant).tolist())
    assert found(m900ib, plan) == []
    assert symmetry_name(m900ib, pendant[0], pendant[1]) == "equal information"


@pytest.mark.parametrize("rtol", [1e-12, 1e-9, 1e-3])
def test_fold_agrees_with_all_pairs(rtol: float) -> None:
    rng = np.random.default_rng(2)
    roots = rng.normal(size=(40, 4, 3)) * np.array([1e-6, 1.0, 1e4])
    kinds = rng.integers(0, 40, 300)
    M = (roots.transpose(0, 2, 1) @ roots)[kinds] * (1 + rtol / 10 * rng.uniform(-1, 1, (300, 1, 1)))
    first, inverse = fold(M, rtol)
    assert np.array_equal(first, [int(np.flatnonzero(kinds == k)[0]) for k in kinds[np.sort(first)]])
    assert np.array_equal(inverse[:, None] == inverse[None], kinds[:, None] == kinds[None])
    assert np.all(first[inverse] <= np.arange(300))


def test_fold_tells_what_differs_by_more() -> None:
    M = np.eye(3)[None] * np.array([1.0, 1.0 + 1e-10, 1.0 + 1e-6, 1.0])[:, None, None]
    first, inverse = fold(M)
    assert first.tolist() == [0, 2]
    assert inverse.tolist() == [0, 0, 1, 0]
    assert len(fold(np.zeros((0, 2, 2)))[0]) == 0
    assert fold(np.zeros((5, 2, 2)))[0].tolist() == [0]


def test_only_spherical_wrists_flip(m900ib: Experiment, r2000ic: Experiment) -> None:
    assert flips_wrist(m900ib.robot.facts)
    assert flips_wrist(r2000ic.robot.facts)
    assert not flips_wrist(load_robot("ur10").facts)


def test_canonical_poses_are_the_same_flange_poses(m900ib: Experiment) -> None:
    lower, upper = joint_range(m900ib)
    pendant = np.random.default_rng(3).uniform(lower, upper, (300, 6))
    out = canonical(m900ib, pendant)
    for one, other in zip(pendant, out, strict=True):
        assert np.allclose(flange(m900ib, one), flange(m900ib, other), atol=1e-12)
    assert np.all(out >= lower)
    assert np.all(out <= upper)
    assert out[:, 4].min() >= 0.0, "all wrists can be flipped inside these limits"
    assert np.abs(out[:, [3, 5]]).max() <= np.pi + 1e-9
    assert np.array_equal(canonical(m900ib, out), out)
    q = m900ib.robot.controller.to_joints(pendant)
    flipped = m900ib.robot.controller.to_pendant(wrist_flip(q))
    assert np.allclose(canonical(m900ib, flipped), out, atol=1e-12), "one representative for both ways"


def test_canonical_poses_stay_inside_narrow_limits(m900ib: Experiment) -> None:
    narrow = m900ib.with_(constraints=Constraints(joint_limits={"joint_4": (-0.5, 0.5), "joint_5": (-1.0, -0.2)}))
    lower, upper = joint_range(narrow)
    pendant = np.random.default_rng(4).uniform(lower, upper, (100, 6))
    out = canonical(narrow, pendant)
    assert np.all((out >= lower) & (out <= upper))
    assert np.array_equal(out[:, :5], pendant[:, :5]), "no flip fits, joint 6 alone is unwound"
    assert np.any(out[:, 5] != pendant[:, 5])
