"""What corrects a point is stated in the frame in which the file states the point, on every robot whose flange is not
the last link's frame: the truth has another point in its file, the fit finds by how much."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.elastostatics.so3 import exponential
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, load_experiment, read_readings
from qsframework.fits import identify, read_fit
from qsframework.plugin import Array, Effect, Poses, registry
from qsframework.robot import load_robot, robot_names
from qsframework.robot.reference import reference_flange

TURNED = [name for name in robot_names() if not np.allclose(load_robot(name).facts.flange_placement, np.eye(4))]
MARKERS = {"m1": [100, -30, 200], "m2": [-60, 90, 150], "m3": [-50, -110, 180]}
ON_LINK = {"xyz_mm": [40, 120, -70], "link": "link_6"}
MOVED = np.array([5.0, 30.0, -12.0])
"""mm, in the frame of the file."""
SOFT = [{"effect": "base_compliance", "directions": "all"}]
"""A palletiser's flange stays level: only what gives below it feels all moments of the load."""


@pytest.fixture(params=TURNED)
def robot(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_robots_with_such_a_flange_are_shipped() -> None:
    assert set(TURNED) == {"abb_irb760", "fanuc_r2000ic"}


def campaign(
    folder: Path,
    robot: str,
    effects: Sequence[Mapping[str, Any]] = (),
    fit: Sequence[str] = (),
    point: Sequence[float] = (100, 0, 200),
    markers: Mapping[str, Any] | None = None,
    **more: Any,
) -> Experiment:
    """An experiment.yaml with markers at the flange and on the last link; base springs that give under every load."""
    given = {name: {"xyz_mm": xyz} for name, xyz in MARKERS.items()} | {"own": ON_LINK}
    document: dict[str, Any] = {
        "robot": robot,
        "load": {"point_mm": [float(v) for v in point]},
        "markers": given | dict(markers or {}),
        "noise": {"sigma_mm": 1e-4},
        "frames": {"tracker": {"xyz_mm": [0, 0, 0], "quat_wxyz": [1, 0, 0, 0]}},
        "effects": [*SOFT, *effects],
        "fit": list(fit),
        "nominal": "soft.yaml",
    } | more
    ways = {f"base_compliance[{d}]": {"value_m/N": 1e-7} for d in "xyz"}
    ways |= {f"base_compliance[r{d}]": {"value_rad/(N m)": 1e-7} for d in "xyz"}
    (folder / "soft.yaml").write_text(yaml.safe_dump(ways))
    path = folder / "experiment.yaml"
    path.write_text(yaml.safe_dump({k: v for k, v in document.items() if v != []}))
    return load_experiment(path)


def moved(xyz: Sequence[float]) -> list[float]:
    return [float(v) for v in np.array(xyz) + MOVED]


def some_poses(experiment: Experiment, count: int = 24) -> Poses:
    """Poses all over the ranges of the joints, under forces and moments of all directions."""
    rng, controller = np.random.default_rng(5), experiment.robot.controller
    middle, half = 0.5 * (controller.upper + controller.lower), 0.5 * (controller.upper - controller.lower)
    pendant = middle + 0.5 * half * rng.uniform(-1.0, 1.0, (count, controller.axes))
    wrench = rng.normal(size=(count, 6)) * ([1e3] * 3 + [200.0] * 3)
    return Poses(pendant, controller.to_joints(pendant), wrench)


def table(experiment: Experiment, poses: Poses, unloaded: Array | None, loaded: Array | None, folder: Path) -> Path:
    """positions (N, K, 3) m of the states that were read, as a file"""
    names, rows = experiment.robot.controller.units.names(), list[str]()
    for i in range(len(poses)):
        for state, value in (("unloaded", unloaded), ("loaded", loaded)):
            if value is None:
                continue
            wrench = poses.wrench[i] if state == "loaded" else np.zeros(6)
            cells = [*experiment.robot.controller.units.shown(poses.pendant[i : i + 1])[0], *wrench]
            for k, marker in enumerate(experiment.markers):
                numbers = ",".join(f"{v:.12g}" for v in (*cells, *(1e3 * value[i, k])))
                rows.append(f"p{i:02d},{state},{marker.name},tracker,{numbers}")
    head = ["pose", "state", "marker", "series", *names, "fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"]
    path = folder / "positions.csv"
    path.write_text("\n".join([",".join([*head, "x_mm", "y_mm", "z_mm"]), *rows]) + "\n")
    return path


def found(guess: Experiment, file: Path, **options: Any) -> dict[str, float]:
    """What a fit of a file finds, SI."""
    fit = identify(guess, read_readings(file, guess), None, FitOptions(keep_all=True, **options))
    return {e.name: e.value for e in fit.estimates}


def vector(values: Mapping[str, float], name: str, end: str = "") -> Array:
    """mm"""
    return 1e3 * np.array([values[f"{name}.{axis}{end}"] for axis in "xyz"])


@pytest.mark.parametrize("effect", ["marker_offset", "learned_offset"])
def test_a_marker(robot: str, effect: str, tmp_path: Path) -> None:
    """At the flange and on a link that the file names."""
    markers = {"m1": {"xyz_mm": moved(MARKERS["m1"])}, "own": ON_LINK | {"xyz_mm": moved(ON_LINK["xyz_mm"])}}
    truth = campaign(tmp_path, robot, markers=markers)
    poses = some_poses(truth)
    file = table(truth, poses, truth.model().positions(poses, None, False), None, tmp_path)
    entries, more, end = [{"effect": effect, "markers": ["m1", "own"]}], "", ""
    if effect == "learned_offset":
        entries, more, end = [{"effect": effect, "at": m, "by": "always"} for m in ("m1", "own")], "/always", ".w1"
    values = found(campaign(tmp_path, robot, entries, [effect]), file)
    for marker in ("m1", "own"):
        np.testing.assert_allclose(vector(values, f"{effect}[{marker}{more}]", end), MOVED, atol=1e-3)


def test_a_marker_that_moves_at_a_reading_or_under_load(robot: str, tmp_path: Path) -> None:
    truth = campaign(tmp_path, robot, markers={"m1": {"xyz_mm": moved(MARKERS["m1"])}})
    start = campaign(tmp_path, robot)
    poses = some_poses(start)
    before, after = (e.model().positions(poses) for e in (start, truth))
    half = np.arange(len(poses))[:, None, None] >= len(poses) // 2
    file = table(start, poses, np.where(half, after, before), None, tmp_path)
    entry = {"effect": "marker_offset_after", "marker": "m1", "percent": "50"}
    values = found(campaign(tmp_path, robot, [entry], ["marker_offset_after"]), file)
    np.testing.assert_allclose(vector(values, "marker_offset_after[m1/50]"), MOVED, atol=1e-3)
    file = table(start, poses, before, truth.model().positions(poses, None, True), tmp_path)
    entry = {"effect": "marker_offset_loaded", "marker": "m1"}
    guess = campaign(tmp_path, robot, [entry], ["marker_offset_loaded"], states="positions")
    np.testing.assert_allclose(vector(found(guess, file), "marker_offset_loaded[m1]"), MOVED, atol=1e-3)


@pytest.mark.parametrize("effect", ["load_point_offset", "learned_load_point"])
def test_the_load_point(robot: str, effect: str, tmp_path: Path) -> None:
    truth = campaign(tmp_path, robot, point=moved([100, 0, 200]))
    poses = some_poses(truth)
    file = table(truth, poses, *(truth.model().positions(poses, None, on) for on in (False, True)), tmp_path)
    entry = {"effect": effect} if effect == "load_point_offset" else {"effect": effect, "at": "tool", "by": "always"}
    values = found(campaign(tmp_path, robot, [entry], [effect]), file)
    name, end = (effect, "") if effect == "load_point_offset" else (f"{effect}[tool/always]", ".w1")
    np.testing.assert_allclose(vector(values, name, end), MOVED, atol=0.03)


def at_the_flange(experiment: Experiment, poses: Poses, give: Array) -> tuple[Array, Array]:
    """By Pinocchio alone: the markers of the flange and, with the tool moved on it by x, y, z, rx, ry, rz (N, 6), the
    displacement of each, (N, K, 3), to first order."""
    stand = reference_flange(experiment.robot, poses.q)
    R, origin = stand[:, :3, :3], stand[:, :3, 3]
    arms = np.einsum("nij,kj->nki", R, [m.xyz for m in experiment.markers if m.name != "own"])
    shift, turn = np.einsum("nij,nj->ni", R, give[:, :3]), np.einsum("nij,nj->ni", R, give[:, 3:])
    return origin[:, None] + arms, shift[:, None] + np.cross(turn[:, None], arms)


def flange_wrench(experiment: Experiment, poses: Poses) -> Array:
    """The load (N, 6) along and about the axes of the flange, at its origin."""
    R = reference_flange(experiment.robot, poses.q)[:, :3, :3]
    force, moment = np.split(np.einsum("nji,njk->nik", R, poses.wrench.reshape(-1, 2, 3).transpose(0, 2, 1)), 2, axis=2)
    return np.concatenate([force[..., 0], moment[..., 0] + np.cross(experiment.load_point, force[..., 0])], axis=1)


def test_the_springs_of_the_tool(robot: str, tmp_path: Path) -> None:
    """About and along the flange's axes, at its origin; a learned law there turns and shifts the same."""
    ways = [*"xyz", "rx", "ry", "rz"]
    springs = [{"effect": "flange_compliance", "directions": "all"}]
    guess = campaign(tmp_path, robot, springs, ["flange_compliance"])
    poses = some_poses(guess)
    model, markers = guess.model(), [k for k, m in enumerate(guess.markers) if m.name != "own"]
    names = [f"flange_compliance[{way}]" for way in ways]
    slope = model.sensitivity(poses, None, names, linear=True)[:, markers]
    for i in range(6):
        give = flange_wrench(guess, poses) * np.eye(6)[i]
        _, expected = at_the_flange(guess, poses, give)
        np.testing.assert_allclose(slope[..., i], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    flange = guess.robot.facts.flange
    laws = [{"effect": "learned", "part": "link"}, {"effect": "learned_shift"}]
    learned = campaign(tmp_path, robot, [*springs, *(law | {"at": flange, "by": "loaded"} for law in laws)])
    names = [f"learned_shift[{flange}/loaded].{a}.w1" for a in "xyz"]
    names += [f"learned[{flange}/loaded].r{a}.w1" for a in "xyz"]
    slope = learned.model().sensitivity(poses, None, names, linear=True)[:, markers]
    for i in range(6):
        _, expected = at_the_flange(guess, poses, np.tile(np.eye(6)[i], (len(poses), 1)))
        np.testing.assert_allclose(slope[..., i], expected, rtol=1e-9, atol=1e-9)


def test_a_hose_is_tied_to_the_flange_or_to_the_link_that_carries_it(robot: str, tmp_path: Path) -> None:
    facts = load_robot(robot).facts
    tied = np.array([0.05, -0.02, 0.1])
    read = []
    for link, xyz in ((facts.flange, tied), ("link_6", (facts.flange_placement @ [*tied, 1.0])[:3])):
        hose = {"effect": "hose", "link": link, "from_z_m": 4.0} | dict(
            zip(("x_m", "y_m", "z_m"), xyz.tolist(), strict=True)
        )
        model = campaign(tmp_path, robot, [hose]).model()
        x = model.nominal
        x[model.index([f"hose[{link}]"])] = 500.0
        read.append(model.positions(some_poses(campaign(tmp_path, robot)), x, True))
    np.testing.assert_allclose(*read, rtol=0, atol=1e-12)


def test_derivatives(robot: str, tmp_path: Path) -> None:
    """By everything that acts in these frames, with errors of geometry beside it."""
    flange = load_robot(robot).facts.flange
    own = [
        {"effect": "flange_compliance", "directions": "all"},
        {"effect": "learned", "part": "link", "at": flange, "by": "attitude", "scale_Nm": 1e3},
        {"effect": "load_point_offset"},
        {"effect": "learned_load_point", "at": "tool", "by": "attitude"},
        {"effect": "marker_offset", "markers": ["m1", "own"]},
        {"effect": "marker_offset_loaded", "markers": ["m1", "own"]},
        {"effect": "learned_offset", "at": "m1", "by": "loaded*attitude"},
        {"effect": "hose", "link": flange, "from_z_m": 4.0, "x_m": 0.1},
        {"effect": "joint_placement", "joints": ["joint_2", "joint_6"]},
    ]
    model = campaign(tmp_path, robot, own).model()
    poses, rng = some_poses(campaign(tmp_path, robot), 2), np.random.default_rng(1)
    x = model.nominal + 0.3 * np.array([p.typical for p in model.parameters]) * rng.uniform(0.5, 1.0, len(model.names))
    for ask, slope in (
        (model.predict, model.sensitivity(poses, x)),
        (lambda p, v: model.positions(p, v, True), model.position_sensitivity(poses, x, None, True)),
    ):
        for i, p in enumerate(model.parameters):
            if not p.name.endswith((".y", ".w2", ".rx", "[y]", "[rz]", f"hose[{flange}]")):
                continue  # what differs in its axis alone is passed on alike
            h = 1e-2 * p.typical * np.eye(len(x))[i]
            near, far = (ask(poses, x + k * h) - ask(poses, x - k * h) for k in (1.0, 2.0))
            numeric = (8.0 * near - far) / (12.0 * h[i])
            error = np.abs(slope[..., i] - numeric).max()
            assert error < 1e-6 * np.abs(numeric).max() + 1e-12 / p.typical, (p.name, error)


# ------------------------------------------------------------------- by the command line, from numbers of another chain


def turned(axis: int, angle: float) -> Array:
    return exponential(angle * np.eye(3)[axis])


def r2000ic_flange(pendant: Array) -> tuple[Array, Array]:
    """Origin, mm, and rotation of the R-2000iC's flange at angles on the pendant, deg, from its dimensions alone."""
    J = np.radians(pendant)
    R, p = turned(2, J[0]), np.array([0.0, 0.0, 670.0])
    steps = [(312, 0, 0, 1, J[1]), (0, 0, 1075, 1, -J[2] - J[1]), (0, 0, 225, 0, -J[3]), (1280, 0, 0, 1, -J[4])]
    for x, y, z, axis, angle in [*steps, (215, 0, 0, 0, -J[5])]:
        p, R = p + R @ [x, y, z], R @ turned(axis, angle)
    return p, R @ turned(1, -0.5 * np.pi) @ turned(0, np.pi)


POSES = np.random.default_rng(3).uniform([-60, -20, -40, -150, -90, -170], [60, 50, 30, 150, 90, 170], (16, 6)).round(3)
JOINTS = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg"
TRUE = {"m1": [100, 0, 200], "m2": [-60, 90, 150], "m3": [-50, -80, 180]}
NESTS = """
robot: fanuc_r2000ic
load: {point_mm: [0, 0, 100]}
markers:
  m1: {xyz_mm: [100, -30, 200]}
  m2: {xyz_mm: [-60, 60, 150]}
  m3: {xyz_mm: [-50, -110, 180]}
noise: {sigma_mm: 0.03}
rigid: true
effects:
  - {effect: marker_offset, markers: all}
fit: [marker_offset]
"""


def run(*arguments: str) -> None:
    result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0, result.output


def by_command(folder: Path, text: str, readings: Path) -> tuple[Path, Path, dict[str, float]]:
    """The experiment and the fit as files, and the estimates, SI."""
    file, fit = folder / "guess.yaml", folder / "fit.json"
    file.write_text(text)
    run("identify", str(file), str(readings), "--json", str(fit))
    return file, fit, {name: e["value"] for name, e in json.loads(fit.read_text())["estimates"].items()}


def nests(folder: Path, sigma: float, errors: Array | None = None) -> Path:
    """Positions of the TRUE markers; errors (16, 6) deg of the joints."""
    rng, rows = np.random.default_rng(4), [f"pose,{JOINTS},marker,state,x_mm,y_mm,z_mm"]
    for i, pendant in enumerate(POSES):
        p, R = r2000ic_flange(pendant if errors is None else pendant + errors)
        for name, xyz in TRUE.items():
            read = (p + R @ xyz + rng.normal(0.0, sigma, 3)).round(5)
            rows.append(",".join(map(str, [f"p{i:02d}", *pendant, name, "unloaded", *read])))
    path = folder / "positions.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_nests_30_mm_further_along_y_of_the_flange(tmp_path: Path) -> None:
    _, _, values = by_command(tmp_path, NESTS, nests(tmp_path, 0.03))
    for marker in TRUE:
        np.testing.assert_allclose(vector(values, f"marker_offset[{marker}]"), [0.0, 30.0, 0.0], atol=0.03)


def test_a_load_30_mm_further_along_y_of_the_flange(tmp_path: Path) -> None:
    """The readings are simulated with the load there, and fitted with it thought elsewhere."""
    rows = [f"pose,{JOINTS},fx_N,fy_N,fz_N"]
    loads = ("0,0,-1500", "0,800,-1200", "900,0,-900")
    rows += [",".join([f"p{i:02d}", *map(str, pendant), loads[i % 3]]) for i, pendant in enumerate(POSES)]
    plan, truth, readings = (tmp_path / name for name in ("plan.csv", "truth.yaml", "readings.csv"))
    plan.write_text("\n".join(rows) + "\n")
    text = "robot: fanuc_r2000ic\nload: {{point_mm: [100, {}, 200]}}\nnoise: {{sigma_mm: 0.00001}}\n"
    text += "markers:\n  m1: {{xyz_mm: [100, 0, 200]}}\n  m2: {{xyz_mm: [-60, 90, 150]}}\n"
    truth.write_text(text.format(30))
    run("simulate", str(truth), str(plan), "-o", str(readings))
    guess = text.format(0) + "effects: [{effect: load_point_offset}]\nfit: [load_point_offset]\n"
    _, _, values = by_command(tmp_path, guess, readings)
    np.testing.assert_allclose(vector(values, "load_point_offset"), [0.0, 30.0, 0.0], atol=0.03)


def test_the_exported_urdf_with_the_offset_is_the_measured_point(tmp_path: Path) -> None:
    """The zeros of the joints are off too: what the fit finds of both is in one frame, as Pinocchio reads the file."""
    readings = nests(tmp_path, 1e-4, np.array([0.0, 0.05, -0.04, 0.06, -0.03, 0.0]))
    text = NESTS.replace("sigma_mm: 0.03", "sigma_mm: 0.0001").replace("fit: [", "fit: [joint_offset, ")
    text = text.replace("effects:\n", "effects:\n  - {effect: joint_offset, joints: all}\n")
    text += "frames: {tracker: {xyz_mm: [0, 0, 0], quat_wxyz: [1, 0, 0, 0]}}\n"
    lines = readings.read_text().splitlines()
    readings.write_text("\n".join([lines[0] + ",series", *(f"{line},tracker" for line in lines[1:])]) + "\n")
    file, fit, values = by_command(tmp_path, text, readings)
    run("kinematics", str(file), str(fit), "--urdf", str(tmp_path / "corrected.urdf"), "--anyway")
    model = pin.buildModelFromUrdf(str(tmp_path / "corrected.urdf"))
    data, experiment = model.createData(), load_experiment(file)
    cells = iter(lines[1:])
    for q in experiment.robot.controller.to_joints(np.radians(POSES)):
        pin.forwardKinematics(model, data, q)
        flange = pin.updateFramePlacement(model, data, model.getFrameId("flange"))
        for marker in experiment.markers:
            read = np.array([float(v) for v in next(cells).split(",")[-3:]])
            point = flange.act(marker.xyz + 1e-3 * vector(values, f"marker_offset[{marker.name}]"))
            np.testing.assert_allclose(1e3 * point, read, atol=2e-3)


# ---------------------------------------------------------------------------------------------------- files of old


OLD = [(e.replaces[0], e) for e in registry().values() if e.replaces[0]]


def test_what_was_replaced() -> None:
    assert len(OLD) == 7
    assert not {name for name, _ in OLD} & {*registry()}


@pytest.mark.parametrize(("old", "new"), OLD)
def test_an_old_name_says_the_new_one_and_its_frame(old: str, new: type[Effect], tmp_path: Path) -> None:
    said = (
        rf"Use {new.effect_name()}: it is stated in .*{new.replaces[1][-10:]}.*, {old} was in that of the moving link"
    )
    with pytest.raises(InputError, match=rf"unknown effect '{old}'.*{said}"):
        campaign(tmp_path, "fanuc_r2000ic", [{"effect": old}])
    with pytest.raises(InputError, match=rf"fit: no parameter '{old}\[m1\].x'.*{said}"):
        campaign(tmp_path, "fanuc_r2000ic", fit=[f"{old}[m1].x"])
    (tmp_path / "old.yaml").write_text(f"{old}.x: {{value_mm: 1}}\n")
    with pytest.raises(InputError, match=rf"no effect has the parameter '{old}.x'.*{said}"):
        campaign(tmp_path, "fanuc_r2000ic", nominal="old.yaml", effects=[])


def test_a_fit_of_the_old_format_is_refused(tmp_path: Path) -> None:
    _, fit, _ = by_command(tmp_path, NESTS, nests(tmp_path, 0.03))
    fit.write_text(fit.read_text().replace("marker_offset", "tool_offset"))
    said = (
        r"of an older format: it holds 'tool_offset\[m3\].z'. Use marker_offset: .*the frame of the marker's xyz_mm.*"
    )
    with pytest.raises(InputError, match=said + "Identify again") as caught:
        read_fit(fit)
    assert len(caught.value.problems) == 1
