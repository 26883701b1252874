"""Table 5 of the source paper against a designed plan, and section 5.1's side pull, with the M-900iB's model.

Sensitivities are those of the linear model, as the paper's equations have them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np

from qsframework.elastostatics import Model, make_model
from qsframework.estimation import rank_test, scales
from qsframework.experiment import Experiment, LoadCase, Plan, example, load_experiment, make_plan, read_plan
from qsframework.information import information, information_rows
from qsframework.plans import CRITERIA, check_poses
from qsframework.plans.candidates import joint_range, reference_point
from qsframework.plugin import Array, Poses

JOINTS = tuple(f"joint_compliance[joint_{k}]" for k in range(1, 7))
SIDE_PULL = np.array([0.0, 1500.0, 0.0, 0.0, 0.0, 0.0])
"""N along the base's y axis."""


@cache
def vertical() -> Experiment:
    """The M-900iB's example with its weight alone and the compliances of joints 2 to 6, as Table 5 has it; the table
    keeps no margin to the joints' limits."""
    whole = load_experiment(example("m900ib") / "experiment.yaml")
    limits = replace(whole.constraints, joint_margin=0.0)
    return whole.with_(loads=(replace(whole.loads[0], poses=None),), fit=JOINTS[1:], constraints=limits)


@cache
def side_pull(all_joints: bool) -> Experiment:
    """The same arm pulled sideways, with the compliance of joint 1 alone or of all joints."""
    case = LoadCase("side_pull", SIDE_PULL, None)
    return vertical().with_(loads=(case,), fit=JOINTS if all_joints else JOINTS[:1])


def plan_of(experiment: Experiment, pendant_deg: Array) -> Plan:
    """A plan of these pendant angles (n, 6) deg under the experiment's one load."""
    pendant = np.deg2rad(pendant_deg)
    (load,) = experiment.loads
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), np.tile(load.wrench, (len(pendant), 1)))
    return make_plan(poses, [load.name] * len(pendant))


def table_5(q6_of_row_2: float = 135.0) -> Array:
    """The paper's twelve poses, pendant angles (12, 6) deg, with this q6 in row 2."""
    pendant = np.rad2deg(read_plan(example("m900ib") / "table5.csv", vertical()).pendant)
    pendant[1, 5] = q6_of_row_2
    return pendant


def sd_share(pendant_deg: Array, experiment: Experiment | None = None) -> Array:
    """sd of the experiment's compliances over their nominal values."""
    experiment = experiment or vertical()
    sigma = experiment.noise.sigma
    assert sigma is not None
    return sds(experiment.model(), plan_of(experiment, pendant_deg).poses, experiment.fit_names(), sigma)


def sds(model: Model, poses: Poses, names: Sequence[str], sigma: float) -> Array:
    """sd (p,) of parameters over their nominal values."""
    M = information(information_rows(model, poses, names, sigma, linear=True)).sum(axis=0)
    index = model.index(names)
    return np.sqrt(np.diag(np.linalg.inv(M))) * scales([model.parameters[i] for i in index]) / model.nominal[index]


def criterion(name: str, pendant_deg: Array) -> float:
    """A, D or O3 of the compliances of joints 2 to 6, each over its nominal value."""
    return float(CRITERIA[name].value(each_information(pendant_deg).sum(axis=0)))


def each_information(pendant_deg: Array) -> Array:
    """Information (n, 5, 5) of every pose on the scaled compliances of joints 2 to 6."""
    experiment = vertical()
    sigma = experiment.noise.sigma
    assert sigma is not None
    poses = plan_of(experiment, pendant_deg).poses
    return information(information_rows(experiment.model(), poses, JOINTS[1:], sigma, linear=True))


def twins(pendant_deg: Array) -> list[tuple[int, int]]:
    """Pairs of rows, counted from 1, that tell the same to the last digit."""
    M = each_information(pendant_deg)
    pairs = combinations(range(len(M)), 2)
    return [(i + 1, j + 1) for i, j in pairs if np.abs(M[i] - M[j]).max() < 1e-9 * np.abs(M[i]).max()]


def flange_difference(pendant_deg: Array, first: int, second: int) -> float:
    """Largest difference of two rows' flange placements, m and direction cosines."""
    import pinocchio as pin

    robot = vertical().robot
    data, placements = robot.model.createData(), []
    for row in (first, second):
        pin.forwardKinematics(robot.model, data, robot.controller.to_joints(np.deg2rad(pendant_deg[row - 1 : row]))[0])
        placements.append(data.oMi[6].homogeneous.copy())
    return float(np.abs(placements[0] - placements[1]).max())


def broken(pendant_deg: Array) -> dict[str, list[int]]:
    """Rows, counted from 1, that break a limit of the experiment, by the limit's name."""
    experiment = vertical()
    found = check_poses(experiment, experiment.model(), np.deg2rad(pendant_deg))
    return {name: [int(i) + 1 for i in np.flatnonzero(~ok)] for name, ok in found.items() if not ok.all()}


def one_reflector() -> Model:
    """The model with the first reflector only."""
    experiment = vertical()
    robot, marker = experiment.robot, experiment.markers[0]
    site = experiment.site(marker.link, marker.xyz)
    return make_model(robot.facts, robot.effects, robot.parameters, experiment.load_site, [("m1", site)], robot.gravity)


def joint_4_share(q6_of_row_2: float) -> float:
    """sd of joint 4's compliance over its nominal value: one reflector, 2.5 kN, 0.03 mm, Table 5."""
    plan, model = plan_of(vertical(), table_5(q6_of_row_2)), one_reflector()
    poses = Poses(plan.pendant, plan.q, np.tile([0.0, 0.0, -2500.0, 0.0, 0.0, 0.0], (len(plan.pendant), 1)))
    return float(sds(model, poses, JOINTS[1:], 3e-5)[2])


def unseen_under_weight() -> str:
    """What Table 5 says on all six joints, in words."""
    experiment = vertical()
    poses = plan_of(experiment, table_5()).poses
    rows = information_rows(experiment.model(), poses, JOINTS, 3e-5, linear=True)
    return rank_test(rows.reshape(-1, len(JOINTS)), JOINTS).words()


def reach(pendant_deg: Array) -> Array:
    """Horizontal distance (n,) m of the load point from axis 1."""
    experiment = vertical()
    at_load = experiment.with_(constraints=replace(experiment.constraints, of="load_point"))
    q = experiment.robot.controller.to_joints(np.deg2rad(pendant_deg))
    return np.hypot(*reference_point(at_load, experiment.model(), q)[:, :2].T)


def lever(pendant_deg: Array) -> Array:
    """Lever (n,) m of the side pull about axis 1: the load point's distance across the force."""
    experiment = vertical()
    at_load = experiment.with_(constraints=replace(experiment.constraints, of="load_point"))
    q = experiment.robot.controller.to_joints(np.deg2rad(pendant_deg))
    return np.abs(reference_point(at_load, experiment.model(), q)[:, 0])


def wrist_angle(pendant_deg: Array, force: Array) -> Array:
    """Angle (n,) deg between axis 6 and a force (3,), 0 to 90."""
    import pinocchio as pin

    robot, out = vertical().robot, []
    data = robot.model.createData()
    for q in robot.controller.to_joints(np.deg2rad(pendant_deg)):
        pin.forwardKinematics(robot.model, data, q)
        axis = data.oMi[6].rotation[:, 0]
        out.append(np.arccos(min(abs(float(axis @ force)) / float(np.linalg.norm(force)), 1.0)))
    return np.rad2deg(np.array(out))


def wrist_torques(pendant_deg: Array) -> Array:
    """Torques (n, 3) N m that the side pull puts on joints 4, 5 and 6."""
    import pinocchio as pin

    experiment, out = vertical(), []
    robot, point = experiment.robot, experiment.load_site.xyz
    data = robot.model.createData()
    for q in robot.controller.to_joints(np.deg2rad(pendant_deg)):
        pin.computeJointJacobians(robot.model, data, q)
        lever = pin.getJointJacobian(robot.model, data, 6, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        arm = data.oMi[6].rotation @ point
        moved = lever[:3] + np.cross(lever[3:].T, arm).T
        out.append(moved[:, 3:].T @ SIDE_PULL[:3])
    return np.array(out)


def told_of_joint_1(pendant_deg: Array) -> Array:
    """What one reading (n,) under the side pull tells of joint 1 while all other compliances are unknown, 1/scale^2."""
    experiment = side_pull(True)
    sigma = experiment.noise.sigma
    assert sigma is not None
    poses = plan_of(experiment, pendant_deg).poses
    rows = information_rows(experiment.model(), poses, JOINTS, sigma, linear=True)
    basis, size, _ = np.linalg.svd(rows[:, :, 1:], full_matrices=False)
    basis = basis * (size > 1e-9 * size[:, :1])[:, None, :]  # an unloaded joint hides nothing
    own = rows[:, :, :1]
    return ((own - basis @ (np.swapaxes(basis, 1, 2) @ own)) ** 2).sum(axis=(1, 2))


def climb(value: Callable[[Array], Array], seed: int = 0) -> Array:
    """An allowed pose (1, 6) deg of a large value, by random search around the best so far in ever smaller steps.

    No solver of the library takes part; value maps pendant angles (n, 6) deg to (n,).
    """
    experiment, rng = vertical(), np.random.default_rng(seed)
    lower, upper = joint_range(experiment)
    best, most, width = lower, -np.inf, upper - lower
    for turn in range(80):
        tried = lower + width * rng.random((4096, 6)) if turn == 0 else best + width * rng.normal(size=(256, 6))
        tried = np.clip(tried, lower, upper)
        tried = tried[np.all(list(check_poses(experiment, experiment.model(), tried).values()), axis=0)]
        found = value(np.rad2deg(tried)) if len(tried) else np.array([-np.inf])
        if found.max() > most:
            best, most = tried[found.argmax()], float(found.max())
        width = width * 0.9 if turn else width
    return np.rad2deg(best)[None]


@cache
def largest_reach() -> float:
    """The largest horizontal reach of the load point that the limits allow, m."""
    return float(reach(climb(reach))[0])
