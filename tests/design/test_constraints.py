"""Each constraint against a computation of its own, its counts, and what its keys refuse."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from qsframework.elastostatics import actuator_torques
from qsframework.errors import InputError
from qsframework.experiment import Constraints, Experiment, Sight, load_experiment
from qsframework.plans import check_poses, generate_candidates
from qsframework.plans.candidates import filter_candidates
from qsframework.plans.constraints import Removal, collider_of, count_removed, joint_range, singularity_margin
from qsframework.plugin import Poses
from qsframework.robot import Robot
from qsframework.robot.kinematics import joint_frames

BASE = """robot: {robot}
load: {{point_mm: [150, 0, 200]}}
markers:
  m1: {{xyz_mm: [150, 250, 250]}}
  m2: {{xyz_mm: [400, -150, 150]}}
noise: {{sigma_mm: 0.03}}
loads:
  - {{name: weight, fz_N: {force}}}
constraints: {constraints}
"""


def write(folder: Path, constraints: str, robot: str = "fanuc_m900ib", force: float = -4000) -> Path:
    path = folder / "experiment.yaml"
    path.write_text(BASE.format(robot=robot, constraints=constraints, force=force))
    return path


def sample(experiment: Experiment, count: int, seed: int = 0) -> np.ndarray:
    lower, upper = joint_range(experiment)
    return np.random.default_rng(seed).uniform(lower, upper, (count, len(lower)))


def checked(experiment: Experiment, constraints: Constraints, pendant: np.ndarray) -> dict[str, np.ndarray]:
    limited = experiment.with_(constraints=constraints)
    return check_poses(limited, limited.model(), pendant)


def placements(robot: Robot, q: np.ndarray):  # type: ignore[no-untyped-def]
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    return data


def test_the_box_of_the_load_point(m900ib: Experiment) -> None:
    limits = Constraints(x_min=-1, x_max=2, y_min=-1.5, y_max=1.2, z_min=0.4, z_max=2.5, of="load_point")
    pendant = sample(m900ib, 200)
    found = checked(m900ib, limits, pendant)
    for k, q in enumerate(m900ib.robot.controller.to_joints(pendant)):
        point = placements(m900ib.robot, q).oMi[6].act(m900ib.load_point)
        for axis, value in zip("xyz", point, strict=True):
            assert found[f"{axis}_min"][k] == (value >= getattr(limits, f"{axis}_min"))
            assert found[f"{axis}_max"][k] == (value <= getattr(limits, f"{axis}_max"))
    for name in ("x_min", "x_max", "y_min", "y_max", "z_min", "z_max"):
        assert 0 < found[name].sum() < 200


def test_the_singularity_margin_is_pinocchios(m900ib: Experiment) -> None:
    robot = m900ib.robot
    pendant = sample(m900ib, 100)
    q = robot.controller.to_joints(pendant)
    margin = singularity_margin(robot, joint_frames(robot.facts, q))
    length = 1.120 + 0.250 + 1.285
    for k in range(len(q)):
        data = placements(robot, q[k])
        pin.computeJointJacobians(robot.model, data, q[k])
        J = pin.getJointJacobian(robot.model, data, 6, pin.LOCAL_WORLD_ALIGNED)
        back = data.oMi[5].translation - data.oMi[6].translation
        J = np.concatenate([(J[:3] + np.cross(J[3:].T, back).T) / length, J[3:]])
        assert np.isclose(margin[k], np.linalg.svd(J, compute_uv=False)[-1], atol=1e-12)
    assert np.array_equal(
        checked(m900ib, Constraints(singularity_margin=0.1), pendant)["singularity_margin"], margin >= 0.1
    )
    straight = robot.controller.to_joints(np.deg2rad([[10.0, 20, -30, 40, 0, 60]]))
    assert singularity_margin(robot, joint_frames(robot.facts, straight))[0] < 1e-12, "axes 4 and 6 fall together"


def test_each_marker_that_counts_must_be_seen(m900ib: Experiment) -> None:
    pendant, station = sample(m900ib, 300), np.array([3.5, 0.5, 1.0])
    single = [checked(m900ib, Constraints(sight=Sight(station, (m.name,))), pendant)["sight"] for m in m900ib.markers]
    every = checked(m900ib, Constraints(sight=Sight(station)), pendant)["sight"]
    assert np.array_equal(every, np.all(single, axis=0))
    assert 10 < every.sum() < min(s.sum() for s in single)


def test_a_reflector_is_seen_from_its_front(m900ib: Experiment) -> None:
    normal, station = np.array([0.6, 0.0, 0.8]), np.array([3.5, 0.5, 1.0])
    one = m900ib.with_(markers=(replace(m900ib.markers[0], normal=normal),))
    pendant = sample(one, 200)
    free = checked(one, Constraints(sight=Sight(station)), pendant)["sight"]
    found = checked(one, Constraints(sight=Sight(station, incidence_max=np.deg2rad(60))), pendant)["sight"]
    front = np.empty(200, dtype=bool)
    for k, q in enumerate(one.robot.controller.to_joints(pendant)):
        last = placements(one.robot, q).oMi[6]
        way = station - last.act(one.markers[0].xyz)
        front[k] = np.arccos(last.rotation @ normal @ way / np.linalg.norm(way)) <= np.deg2rad(60)
    assert np.array_equal(found, free & front)
    assert 5 < found.sum() < free.sum() - 5


def test_normals_of_a_file_have_length_one(tmp_path: Path) -> None:
    path = write(tmp_path, "{sight: {station_m: [4, 0, 1], incidence_max_deg: 60}}")
    with pytest.raises(InputError, match="incidence_max needs a marker with a normal"):
        load_experiment(path)
    text = path.read_text()
    path.write_text(text.replace("250, 250]}", "250, 250], normal: [0, 3, 4]}"))
    experiment = load_experiment(path)
    assert experiment.markers[0].normal is not None
    assert np.allclose(experiment.markers[0].normal, [0, 0.6, 0.8])
    assert experiment.constraints.sight is not None
    assert np.isclose(experiment.constraints.sight.incidence_max or 0, np.pi / 3)
    path.write_text(text.replace("250, 250]}", "250, 250], normal: [0, 0, 0]}"))
    with pytest.raises(InputError, match="not all zero"):
        load_experiment(path)


def test_the_tool_is_kept_off_the_arm_and_the_floor(m900ib: Experiment) -> None:
    pendant = sample(m900ib, 400)
    bare = checked(m900ib, Constraints(collision=True, floor=0.0), pendant)
    tool = checked(m900ib, Constraints(collision=True, floor=0.0, tool_radius=0.4), pendant)
    wide = checked(m900ib, Constraints(collision=True, clearance=0.05), pendant)
    for name in ("collision", "floor"):
        assert not np.any(tool[name] & ~bare[name])
        assert tool[name].sum() < bare[name].sum()
    assert not np.any(wide["collision"] & ~bare["collision"])
    assert wide["collision"].sum() < bare["collision"].sum()
    low = np.array(
        [
            placements(m900ib.robot, q).oMi[6].act(m900ib.load_point)[2] < 0.4
            for q in m900ib.robot.controller.to_joints(pendant)
        ]
    )
    assert np.array_equal(tool["floor"], bare["floor"] & ~low)


def test_counts_in_order_alone_and_only() -> None:
    allowed = {
        "a": np.array([True, True, False, False, True, True]),
        "b": np.array([True, False, False, True, True, False]),
        "c": np.array([True, True, False, True, False, True]),
    }
    assert count_removed(allowed) == {"a": Removal(2, 2, 1), "b": Removal(2, 3, 2), "c": Removal(1, 2, 1)}
    assert count_removed({}) == {}


def test_contact_is_asked_last_of_all_that_keep_the_rest(m900ib: Experiment) -> None:
    """What is kept is what a check of everything keeps; contact is counted among poses that keep all else."""
    tight = m900ib.with_(constraints=Constraints(z_min=0.8, collision=True))
    pendant = sample(m900ib, 2000, seed=5)
    allowed = check_poses(tight, tight.model(), pendant)
    clear = allowed.pop("collision")
    rest = np.logical_and.reduce(list(allowed.values()))
    found = filter_candidates(tight, pendant)
    assert np.array_equal(found.pendant, pendant[rest & clear])
    assert found.alone["collision"] == int((rest & ~clear).sum()) > 0
    assert f"collision, asked last, excludes {found.alone['collision']}" in found.words()
    assert "of which keep all others but contact" in found.words()


def test_every_constraint_is_counted_and_kept(m900ib: Experiment) -> None:
    limits = Constraints(
        x_max=2.4,
        y_min=-2.4,
        z_min=0.3,
        z_max=3.0,
        axis1_distance_min=0.8,
        flip_margin=100.0,
        collision=True,
        floor=0.0,
        sight=Sight(np.array([4.0, 0.0, 1.5])),
        singularity_margin=0.05,
        joint_limits={"joint_1": (-2.0, 2.0)},
    )
    tight = m900ib.with_(constraints=limits)
    found = generate_candidates(tight, 60, seed=3)
    names = {
        "x_max",
        "y_min",
        "z_min",
        "z_max",
        "axis1_distance_min",
        "flip_margin",
        "collision",
        "floor",
        "sight",
        "singularity_margin",
    }
    assert names < set(found.removed)
    for name, allowed in check_poses(tight, tight.model(), found.pendant).items():
        assert allowed.all(), name
    nowhere = m900ib.with_(constraints=Constraints(floor=3.0))
    with pytest.raises(InputError, match=r"floor excludes \d+"):
        generate_candidates(nowhere, 10)


def test_actuator_torques_are_pinocchios(r2000ic: Experiment) -> None:
    """An arm without loops: gravity by Pinocchio, the load by its Jacobian."""
    robot, rng = r2000ic.robot, np.random.default_rng(5)
    pendant = sample(r2000ic, 60)
    q, wrench = robot.controller.to_joints(pendant), rng.normal(size=(60, 6)) * 1e3
    found = actuator_torques(r2000ic.model(), Poses(pendant, q, wrench))
    for k in range(len(q)):
        assert np.allclose(found[k], joint_torques(r2000ic, q[k], wrench[k]), atol=1e-7)


def joint_torques(experiment: Experiment, q: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    model = experiment.robot.model
    data = placements(experiment.robot, q)
    own = -pin.computeGeneralizedGravity(model, data, q)
    pin.computeJointJacobians(model, data, q)
    site = experiment.load_site
    J = pin.getJointJacobian(model, data, site.link, pin.LOCAL_WORLD_ALIGNED)
    moment = wrench[3:] + np.cross(data.oMi[site.link].rotation @ site.xyz, wrench[:3])
    return np.asarray(own + J.T @ np.concatenate([wrench[:3], moment]))


def test_a_loop_brings_the_load_to_its_actuators(m900ib: Experiment) -> None:
    """Virtual work: the pendant's angles are the actuators', q = M pendant, so the torques are M' tau."""
    robot, rng = m900ib.robot, np.random.default_rng(6)
    pendant = sample(m900ib, 60)
    q, wrench = robot.controller.to_joints(pendant), rng.normal(size=(60, 6)) * 1e3
    none = np.zeros_like(wrench)
    by_load = actuator_torques(m900ib.model(), Poses(pendant, q, wrench)) - actuator_torques(
        m900ib.model(), Poses(pendant, q, none)
    )
    for k in range(len(q)):
        tau = joint_torques(m900ib, q[k], wrench[k]) - joint_torques(m900ib, q[k], none[k])
        assert np.allclose(by_load[k], robot.controller.matrix.T @ tau, atol=1e-7)


@pytest.fixture
def strong(root: Path, tmp_path: Path) -> Path:
    """A folder with an R-2000iC whose files state torques and a payload."""
    shutil.copytree(root / "robots" / "fanuc_r2000ic", tmp_path / "strong")
    path = tmp_path / "strong" / "robot.yaml"
    text = path.read_text()
    for old, new in (
        ("joint_2: {limits_deg: [-60, 76]}", "joint_2: {limits_deg: [-60, 76], torque_limit_kNm: 9}"),
        ("joint_5: {limits_deg: [-125, 125]}", "joint_5: {limits_deg: [-125, 125], torque_limit_Nm: 900}"),
        ("payload_kg: 165", "payload_kg: 210"),
    ):
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return tmp_path


def test_stated_torques_are_kept(strong: Path) -> None:
    experiment = load_experiment(write(strong, "{}", "strong", -2000))
    assert experiment.robot.torque_limits is not None
    assert experiment.robot.torque_limits.tolist() == [np.inf, 9000.0, np.inf, np.inf, 900.0, np.inf]
    pendant = sample(experiment, 300)
    found = check_poses(experiment, experiment.model(), pendant)["load_capacity"]
    for k, q in enumerate(experiment.robot.controller.to_joints(pendant)):
        torques = np.abs([joint_torques(experiment, q, w) for w in (np.zeros(6), experiment.loads[0].wrench)])
        assert found[k] == (torques[:, 1].max() <= 9000.0 and torques[:, 4].max() <= 900.0)
    assert 20 < found.sum() < 280
    off = load_experiment(write(strong, "{load_capacity: false}", "strong", -2000))
    assert "load_capacity" not in check_poses(off, off.model(), pendant)


def test_a_load_beyond_the_payload_is_refused(strong: Path) -> None:
    with pytest.raises(InputError, match=r"load 'weight': 2100 N is more than the robot's payload") as error:
        load_experiment(write(strong, "{}", "strong", -2100))
    assert error.value.problems[0].line == 8
    assert error.value.problems[0].allowed == "210 kg, 2060 N"
    assert load_experiment(write(strong, "{load_capacity: false}", "strong", -2100)).loads
    hung = write(strong, "{}", "strong")
    text = hung.read_text().replace("{point_mm: [150, 0, 200]}", "{mass_kg: 300, centre_mm: [0, 0, 100]}")
    hung.write_text(text[: text.index("loads:")])
    with pytest.raises(InputError, match="load: 300 kg is more than the robot's payload"):
        load_experiment(hung)


def test_a_torque_limit_is_positive(strong: Path) -> None:
    path = strong / "strong" / "robot.yaml"
    path.write_text(path.read_text().replace("torque_limit_Nm: 900", "torque_limit_Nm: -900"))
    with pytest.raises(InputError, match="greater than 0"):
        load_experiment(write(strong, "{}", "strong", -2000))


def test_all_keys_arrive(tmp_path: Path) -> None:
    text = (
        "{x_min_m: -1, x_max_mm: 2500, y_min_m: -2, y_max_m: 2, z_min_m: 0.5, z_max_m: 3, axis1_distance_min_m: 1, "
        "of: flange, flip_margin_Nm: 50, joint_limits_deg: {joint_1: [-90, 90]}, collision: true, clearance_mm: 20, "
        "tool_radius_mm: 300, floor_m: -0.1, singularity_margin: 0.05, load_capacity: false, "
        "sight: {station_m: [4, 0, 1.5], markers: [m1], clearance_mm: 8}}"
    )
    experiment = load_experiment(write(tmp_path, text))
    c = experiment.constraints
    assert (c.x_min, c.x_max, c.y_min, c.y_max, c.z_min, c.z_max) == (-1, 2.5, -2, 2, 0.5, 3)
    assert (c.axis1_distance_min, c.of, c.flip_margin, c.collision, c.clearance) == (1, "flange", 50, True, 0.02)
    assert (c.tool_radius, c.floor, c.singularity_margin, c.load_capacity) == (0.3, -0.1, 0.05, False)
    assert np.allclose(c.joint_limits["joint_1"], (-np.pi / 2, np.pi / 2))
    assert c.sight is not None
    assert c.sight.station.tolist() == [4, 0, 1.5]
    assert (c.sight.markers, c.sight.clearance) == (("m1",), 0.008)
    assert collider_of(experiment).shapes[-1].size == (0.3,)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{x_min_m: 2, x_max_m: 1}", "x_min must be below x_max"),
        ("{collision: false, clearance_mm: 5}", "a clearance has no use with `collision: false`"),
        ("{collision: false, tool_radius_mm: 5}", "a tool_radius has no use"),
        ("{collision: true, clearance_mm: -5}", "is not negative"),
        ("{singularity_margin: -1}", "is not negative"),
        ("{sight: {station_m: [1, 2]}}", "station needs three numbers"),
        ("{sight: {station: [1, 2, 3]}}", "'station' does not say its unit"),
        ("{sight: {station_m: [1, 2, 3], markers: [m3]}}", "sight: no marker 'm3'"),
        ("{sight: {station_m: [1, 2, 3], clearance_mm: -1}}", "a clearance is not negative"),
        ("{collision: maybe}", "collision"),
        ("{floor: 0}", "'floor' does not say its unit"),
    ],
)
def test_wrong_keys_are_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        load_experiment(write(tmp_path, text))
