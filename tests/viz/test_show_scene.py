"""What a scene holds, against the model: frames against Pinocchio, deflections against the equilibrium."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from qsframework.elastostatics import cartesian_compliance
from qsframework.errors import InputError
from qsframework.experiment import Constraints, Experiment, Plan, Readings, make_plan, make_rows
from qsframework.plugin import Array, Poses
from qsframework.plugin.facts import frozen
from qsframework.robot import load_robot
from qsframework.viz import Scene, residual_scene, show_scene
from qsframework.viz.subject import MOST, floating, measured, one_pose, robot_alone

ANGLES = [
    [0.0, 20.0, -10.0, 0.0, 40.0, 0.0],
    [40.0, 35.0, 5.0, 30.0, -50.0, 60.0],
    [-90.0, -20.0, -40.0, 10.0, 80.0, 0.0],
]


def world(scene: Scene) -> dict[str, Array]:
    """Every path of a scene with its placement in the world: transforms multiplied from the root down."""
    out = {}
    for path in scene.placed:
        parts, placement = path.split("/"), np.eye(4)
        for k in range(1, len(parts) + 1):
            placement = placement @ scene.placed.get("/".join(parts[:k]), np.eye(4))
        out[path] = placement
    return out


def a_plan(experiment: Experiment, wrench: tuple[float, ...] = (0.0, 1500.0, -4000.0, 0.0, 0.0, 0.0)) -> Plan:
    pendant = np.deg2rad(ANGLES)
    forces = np.array([[0.0, 0, -4000, 0, 0, 0], list(wrench), [0.0, 0, -2000, 0, 0, 0]])
    return make_plan(Poses(pendant, experiment.robot.controller.to_joints(pendant), forces), ["weight", "pull", "half"])


def test_links_and_flange_stand_where_pinocchio_puts_them(m900ib: Experiment) -> None:
    plan, robot = a_plan(m900ib), m900ib.robot
    found = world(show_scene(m900ib, plan))
    data = robot.model.createData()
    for i, q in enumerate(plan.q):
        pin.framesForwardKinematics(robot.model, data, q)  # pyright: ignore[reportAttributeAccessIssue]
        for link in range(1, robot.facts.n + 1):
            assert np.allclose(found[f"poses/{i}/robot/link_{link}"], data.oMi[link].homogeneous, atol=1e-12)
        flange = data.oMf[robot.model.getFrameId("link_6")].homogeneous
        for where in (f"poses/{i}/robot/flange", f"ghosts/{i}/flange"):
            assert np.allclose(found[where], flange, atol=1e-12)


def test_every_solid_of_the_urdf_is_drawn_on_its_link(m900ib: Experiment) -> None:
    scene = show_scene(m900ib, a_plan(m900ib))
    drawn = scene.drawn
    for k, shape in enumerate(m900ib.robot.shapes):
        found = drawn[f"poses/1/robot/link_{shape.link}/shape_{k}"]
        assert found.solid[0] == {"box": "BoxGeometry", "cylinder": "CylinderGeometry"}[shape.kind]
        if shape.kind == "cylinder":
            assert (found.solid[1], found.length) == shape.size


def test_a_deflected_marker_is_the_equilibrium_exaggerated(m900ib: Experiment) -> None:
    plan, scale = a_plan(m900ib), 70.0
    model = m900ib.model()
    found = world(show_scene(m900ib, plan, scale=scale))
    given = model.predict(plan.poses)
    assert 5e-4 < np.linalg.norm(given, axis=2).min() < 0.02
    data = m900ib.robot.model.createData()
    for i, q in enumerate(plan.q):
        pin.framesForwardKinematics(m900ib.robot.model, data, q)  # pyright: ignore[reportAttributeAccessIssue]
        flange = data.oMf[m900ib.robot.model.getFrameId("link_6")]
        for k, marker in enumerate(m900ib.markers):
            rigid = flange.act(marker.xyz)
            assert np.allclose(found[f"poses/{i}/markers/{k}"][:3, 3], rigid, atol=1e-12)
            assert np.allclose(found[f"poses/{i}/deflected/marker_{k}"][:3, 3], rigid + scale * given[i, k], atol=1e-7)
            # The deflected link is rigid and turned by the exaggerated angle: the same to second order of it.
            link = found[f"poses/{i}/deflected/link_6"]
            turned = (link @ np.append(m900ib.site(marker.link, marker.xyz).xyz, 1.0))[:3]
            assert np.linalg.norm(turned - rigid - scale * given[i, k]) < 0.03 * scale * np.linalg.norm(given[i, k])


def test_unexaggerated_links_are_the_loaded_arm(m900ib: Experiment) -> None:
    """At a factor of 1 each link has moved from the commanded pose as from the unloaded one to the loaded one."""
    from qsframework.elastostatics.equilibrium import settle
    from qsframework.viz.deflection import deflection
    from qsframework.viz.robot_shapes import link_frames

    plan, model = a_plan(m900ib), m900ib.model()
    given = deflection(model, plan.poses)
    loaded = settle(model, plan.poses, None, True).at.state.placed
    unloaded = settle(model, plan.poses, None, False).at.state.placed
    for i in range(3):
        assert np.allclose(given.links(link_frames(unloaded, i), i, 1.0), link_frames(loaded, i), atol=1e-8)


def test_other_parameters_give_other_deflections(m900ib: Experiment) -> None:
    plan, model = a_plan(m900ib), m900ib.model()
    x = model.nominal
    x[model.index(["joint_compliance[joint_1]"])] *= 3.0
    found = world(show_scene(m900ib, plan, x))
    given = model.predict(plan.poses, x)[1, 0]
    start = found["poses/1/markers/0"][:3, 3]
    assert np.allclose(found["poses/1/deflected/marker_0"][:3, 3], start + 100.0 * given, atol=1e-7)


def test_the_ellipsoid_holds_every_displacement_under_its_force(m900ib: Experiment) -> None:
    plan = a_plan(m900ib)
    found = world(show_scene(m900ib, plan, scale=10.0))
    compliance = cartesian_compliance(m900ib.model(), plan.poses)[:, :3, :3]
    force = float(np.linalg.norm(plan.wrench[:, :3], axis=1).max())
    rng = np.random.default_rng(0)
    for i in range(3):
        placement = found[f"poses/{i}/ellipsoid"]
        axes = placement[:3, :3]
        assert np.linalg.det(axes) > 0.0
        assert np.allclose(placement[:3, 3], found[f"poses/{i}/deflected/tip"][:3, 3] - 10.0 * tip(m900ib, plan, i))
        for direction in rng.normal(size=(20, 3)):
            reached = 10.0 * compliance[i] @ (force * direction / np.linalg.norm(direction))
            assert np.linalg.norm(np.linalg.solve(axes, reached)) == pytest.approx(1.0, abs=1e-6)


def tip(experiment: Experiment, plan: Plan, i: int) -> Array:
    from qsframework.elastostatics import equilibrium

    model = experiment.model()
    loaded, unloaded = equilibrium(model, plan.poses), equilibrium(model, plan.poses, loaded=False)
    return (loaded.tip - unloaded.tip)[i]


def test_arrows_are_the_loads(m900ib: Experiment) -> None:
    plan = a_plan(m900ib, (0.0, 1500.0, -4000.0, 300.0, 0.0, 0.0))
    scene = show_scene(m900ib, plan)
    found = world(scene)
    largest = np.linalg.norm(plan.wrench[:, :3], axis=1).max()
    for i in range(3):
        head = found[f"poses/{i}/load/force/head"]
        start = found[f"poses/{i}/ellipsoid"][:3, 3]
        assert np.allclose(head[:3, 3] - start, 0.7 / largest * plan.wrench[i, :3], atol=1e-12)
        assert np.allclose(head[:3, 2], plan.wrench[i, :3] / np.linalg.norm(plan.wrench[i, :3]), atol=1e-12)
    assert [p for p in found if p.endswith("/load/moment/head")] == ["poses/1/load/moment/head"]
    assert np.allclose(found["poses/1/load/moment/head"][:3, 2], [1, 0, 0])


def test_limits_stand_where_the_experiment_says(m900ib: Experiment) -> None:
    limits = Constraints(floor=-0.1, axis1_distance_min=0.8, z_min=0.5, x_max=2.5, of="flange")
    experiment = m900ib.with_(constraints=limits)
    scene = show_scene(experiment, a_plan(experiment))
    found, drawn = world(scene), scene.drawn
    walls = {p.split("/")[1] for p in found if p.startswith("limits/")}
    assert walls == {"floor", "axis_1", "z_min", "x_max"}
    assert found["limits/z_min"][2, 3] == pytest.approx(0.5)
    assert found["limits/x_max"][0, 3] == pytest.approx(2.5)
    assert np.allclose(found["limits/axis_1"][:2, 3], 0.0)
    assert drawn["limits/axis_1"].solid[1] == 0.8
    thick = drawn["limits/floor"].solid[3]
    assert found["limits/floor"][2, 3] + 0.5 * thick == pytest.approx(-0.1)
    assert any("flange stays 0.8 m" in note for note in scene.notes)
    assert not [p for p in world(show_scene(m900ib.with_(constraints=Constraints()), a_plan(m900ib))) if "limits" in p]


def test_steps_keep_the_plans_order_and_have_ghosts(m900ib: Experiment) -> None:
    plan = a_plan(m900ib)
    scene = show_scene(m900ib, plan)
    assert [path for path, _ in scene.steps] == ["poses/0", "poses/1", "poses/2"]
    assert [label.split(",")[0] for _, label in scene.steps] == ["p01 (weight)", "p02 (pull)", "p03 (half)"]
    assert scene.ghosts == {f"poses/{i}": f"ghosts/{i}" for i in range(3)}
    found = world(scene)
    for i in range(2):  # the way leads from load point to load point
        assert np.allclose(found[f"way/{i}/head"][:3, 3], found[f"poses/{i + 1}/ellipsoid"][:3, 3])
    moved = 1e3 * np.linalg.norm(tip(m900ib, plan, 1))
    assert f"moves {moved:.3f} mm" in scene.steps[1][1]
    assert set(scene.layers) >= {"robot", "markers", "load", "ellipsoid", "deflected", "order", "ghosts", "limits"}


def test_every_layer_names_paths_that_are_drawn(m900ib: Experiment) -> None:
    scene = show_scene(m900ib, a_plan(m900ib))
    paths = {*scene.drawn, *(path for path, *_ in (*scene.texts, *scene.glows))}
    for name, members in scene.layers.items():
        for member in members:
            assert any(path.startswith(member + "/") or path == member for path in paths), name


def test_residuals_are_measured_minus_predicted_at_their_markers(r2000ic: Experiment, real: Readings) -> None:
    model = r2000ic.model()
    x = 1.1 * model.nominal
    plan, missed = measured(r2000ic, real, x)
    scene = show_scene(r2000ic, plan, x, 50.0, missed)
    found = world(scene)
    predicted = make_rows(real).predict(model, x)
    assert len(plan.pose) == MOST < len(set(real.pose))
    worst = np.sort(np.linalg.norm(real.value - predicted, axis=1))
    drawn = np.sort(
        [
            np.linalg.norm(found[p][:3, 3] - found[p.split("/residuals")[0] + "/markers/0"][:3, 3])
            for p in found
            if p.endswith("/head") and "/residuals/" in p
        ]
    )
    assert np.allclose(drawn, 50.0 * worst[-MOST:], atol=1e-9)
    first = int(np.flatnonzero([n == plan.pose[0].split(",")[0] for n in real.pose])[0])
    arrow = found["poses/0/residuals/0/head"][:3, 3] - found["poses/0/markers/0"][:3, 3]
    assert np.allclose(arrow, 50.0 * (real.value[first] - predicted[first]), atol=1e-9)


def test_residuals_beside_another_plan_float_at_their_own_poses(r2000ic: Experiment, real: Readings) -> None:
    x = r2000ic.model().nominal
    missed = floating(r2000ic, real, x)
    scene = show_scene(r2000ic, one_pose(r2000ic, None, np.array([0.0, 0, -1000, 0, 0, 0])), x, 10.0, missed)
    assert scene.layers["residuals"] == ["residuals"]
    assert len([p for p in world(scene) if p.startswith("residuals/") and p.endswith("/head")]) == len(real.use)


def test_springs_glow_by_their_share_and_the_panel_lists_them(m900ib: Experiment) -> None:
    """Shares are those of `qsf stiffness`; each light stands at its joint, and they come and go with the load."""
    from qsframework.uses import stiffness_at

    plan = a_plan(m900ib)
    scene = show_scene(m900ib, plan)
    point = np.array([0.15, 0.0, 0.2])
    told = stiffness_at(m900ib.robot, plan.pendant[1], plan.wrench[1], point)
    share = told.shares @ told.linear / (told.linear @ told.linear)
    listed = dict(scene.facts["poses/1"].shares)
    assert listed == {f"joint_{k + 1}": pytest.approx(s) for k, s in enumerate(share) if s > 0.005}
    lights = [glow for glow in scene.glows if glow[0] == "poses/1/springs"]
    assert len(lights) == len(listed)
    found = world(scene)
    joint = next(iter(listed))
    where = found[f"poses/1/robot/link_{joint[-1]}"][:3, 3]
    strongest = max(lights, key=lambda glow: glow[4])
    assert np.allclose(strongest[1], where, atol=1e-5)
    assert not any(pulse for *_, pulse in scene.glows)


def test_what_is_suspected_glows_where_it_is(r2000ic: Experiment, real: Readings) -> None:
    kept = np.arange(6)
    missed = np.full((6, 3), 1e-4)
    suspects = {"hardening": ("joint_3", 1.0), "load_scale": ("", 1.0), "link_2, 30 %": ("link_2/flange", 0.3)}
    scene, _ = residual_scene(r2000ic, real, kept, missed, 0.5 * missed, suspects)
    found = world(scene)
    first = {words: point for path, words, point, *_ in scene.texts if path.startswith("poses/0/")}
    assert set(first) == {"hardening", "link_2, 30 %"}  # the scale of the load is no place of the arm
    for label, link in (("hardening", 3), ("link_2, 30 %", 2)):
        assert np.allclose(first[label], found[f"poses/0/link_{link}"][:3, 3], atol=1e-5)
    assert all(pulse for *_, pulse in scene.glows)
    assert {strength for *_, strength, _ in scene.glows} == {1.0, 0.3}
    assert scene.facts["poses/0"].name in real.pose


def test_a_robot_alone_carries_its_payload(m900ib: Experiment) -> None:
    experiment = robot_alone(m900ib.robot, np.array([0.15, 0.0, 0.2]))
    plan = one_pose(experiment, None, None)
    assert np.allclose(plan.wrench[0], [0, 0, -700 * 9.81, 0, 0, 0])
    assert np.allclose(plan.pendant, 0.0)
    assert "deflected" in show_scene(experiment, plan).layers


def test_a_robot_without_payload_or_load_shows_its_ellipsoid(r2000ic: Experiment) -> None:
    experiment = robot_alone(dataclasses.replace(r2000ic.robot, payload=None), np.zeros(3))
    scene = show_scene(experiment, one_pose(experiment, None, None))
    assert "deflected" not in scene.layers
    assert "poses/0/ellipsoid" in scene.drawn
    assert any("1000 N" in note for note in scene.notes)


def test_the_ellipsoid_of_a_soft_arm_does_not_fill_the_scene() -> None:
    experiment = robot_alone(dataclasses.replace(load_robot("ur10"), payload=None), np.zeros(3))
    scene = show_scene(experiment, one_pose(experiment, None, None))
    matrix = scene.placed["poses/0/ellipsoid"]
    assert 0.02 < np.linalg.norm(matrix[:3, :3], axis=0).max() <= 0.3 * scene.size
    assert any("under 100 N" in note or "under 10 N" in note for note in scene.notes)


def test_an_arm_without_solids_is_drawn_by_its_bones() -> None:
    robot = dataclasses.replace(load_robot("ur10"), shapes=(), payload=None)
    experiment = robot_alone(robot, frozen(np.zeros(3)))
    drawn = show_scene(experiment, one_pose(experiment, None, None)).drawn
    assert len([p for p in drawn if p.endswith("/joint")]) == robot.facts.n + 1


@pytest.mark.parametrize("scale", [0.0, -3.0, float("nan"), float("inf")])
def test_a_factor_must_be_above_zero(m900ib: Experiment, scale: float) -> None:
    with pytest.raises(InputError, match="above 0"):
        show_scene(m900ib, a_plan(m900ib), scale=scale)


def test_a_pose_outside_its_limits_is_refused_joint_by_joint(m900ib: Experiment) -> None:
    with pytest.raises(InputError) as caught:
        one_pose(m900ib, np.deg2rad([0.0, 95.0, 0.0, 0.0, 130.0, 0.0]), None)
    assert "joint_2 is outside its limits; found 95 deg; allowed: -64 to 90 deg" in str(caught.value)
    assert "joint_5" in str(caught.value)


def test_masked_readings_alone_are_refused(r2000ic: Experiment, real: Readings) -> None:
    masked = dataclasses.replace(real, use=np.zeros_like(real.use))
    with pytest.raises(InputError, match="masked"):
        measured(r2000ic, masked, r2000ic.model().nominal)
