"""A heavy arm simulated in MuJoCo, from its data sheet to corrected holes.

    python benchmarks/heavy_arm.py [--draws 12] [--half 6] [--seed 0] [--jobs 1] [--verbose] [--write]

The arm carries 300 kg over 2.7 m; its links weigh 1,500 kg; a coil spring balances joint 2, and the ring under its
first bearing tilts by a spring that no file knows. Each draw is another arm of this type: zeros, placements and
the balancer's pivots are drawn by the typical sizes of their effects (times 1, times .5), springs by the sd that the
data sheet states. MuJoCo holds the truth; it shares no code with qsframework. A tracker of unknown place reads three
nests at 30 poses, by the arm's own weight and with a load. Then comes what the pages say: identify, diagnose and
extend, identify again, compensate; and the same once more. The corrected angles of 50 fresh targets go back into
MuJoCo, and what counts is where the tool then stands: in the base frame, after the rigid motion that suits all targets
best, and after that and the best constant offset of the tool. What `compensate` says is to be expected stands beside
it. A draw takes a minute or two.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from common import PAGE, replace_between, shelved, table

import qsframework as qsf
from qsf_plugins.joint_offset import JointOffset
from qsf_plugins.joint_placement import JointPlacement
from qsf_plugins.marker_offset import MarkerOffset
from qsf_plugins.offaxis_compliance import OffaxisCompliance
from qsframework.elastostatics import equilibrium, make_model
from qsframework.experiment import Experiment, Readings, load_experiment, read_readings
from qsframework.fits import Fit, identify
from qsframework.plans import generate_candidates
from qsframework.plugin import Array, Parameter, Poses
from qsframework.uses.inverse import arm_length, rigid_jacobian
from qsframework.uses.targets import joint_targets
from qsframework.work import Work, run

START, STOP = "<!-- heavy arm -->", "<!-- end of heavy arm -->"
DRAWS, HALF = 12, 6
POSES, TARGETS = 30, 50
COVER = 2.0
"""k of the stated expanded uncertainty."""

# ---------------------------------------------------------------- the data sheet


@dataclass(frozen=True)
class Link:
    """A link, with the joint that moves it: mm, kg, deg, urad/(N m), all frames parallel where the arm is level."""

    name: str
    mass: float
    centre: tuple[float, float, float]
    at: tuple[float, float, float]
    axis: tuple[int, int, int]
    limits: tuple[float, float]
    compliance: float


LINKS = (
    Link("turret", 480, (140, -20, -120), (0, 0, 750), (0, 0, 1), (-180, 180), 0.16),
    Link("upper_arm", 290, (520, -110, 10), (420, 0, 0), (0, 1, 0), (-130, 15), 0.14),
    Link("elbow", 310, (60, 40, 90), (1150, 0, 0), (0, 1, 0), (-110, 150), 0.30),
    Link("forearm", 105, (720, 20, 0), (0, 0, 120), (1, 0, 0), (-300, 300), 1.3),
    Link("wrist", 45, (60, 10, 0), (1150, 0, 0), (0, 1, 0), (-115, 115), 1.2),
    Link("flange", 20, (-40, 0, 0), (240, 0, 0), (1, 0, 0), (-300, 300), 1.5),
)
BASE_MASS = 250.0
SPRING_SD, BALANCER_SD = 0.20, 0.05
"""Shares of themselves, as the data sheet states them and as they are drawn."""
LC, L2, ZERO_DEG = 0.75, 0.20, 100.0
"""The balancer: m from axis 2 to its pivots on turret and upper arm, and the angle between them with the arm level."""
PIVOTS = tuple(f"gravity_compensator[joint_2].{part}" for part in ("lc", "l2", "zero"))
BALANCER, FREE_LENGTH = 1.5e5, 0.45
"""N/m and m: 10 kN m at joint 2 with the arm level."""
TILT = 25e6
"""N m/rad by which the ring under the first bearing resists a tilt about x and y: in no file."""
TOOL = (250, 0, 100)
"""mm on the flange: where the load hangs, and what shall stand at a hole."""
NESTS = {"m1": (120, 260, 180), "m2": (330, -210, 120), "m3": (150, -120, -270)}
NESTS_OFF = 0.0
"""By how many of its typical sizes a nest is not where the file says; its offset is estimated anyway."""
WEIGHT, PULL = 2450.0, 900.0
"""N: the load of every loaded reading and target, and its pull aside at every second pose."""
SIGMA = 3e-5
STATION = (4.2, -2.6, 1.1)
"""m: about where the tracker stands, base frame; it says so to nobody."""
NOTHING = np.zeros(3)


def urdf() -> str:
    """The drawing."""
    masses = [("base", BASE_MASS, (0.0, 0.0, 200.0)), *((one.name, one.mass, one.centre) for one in LINKS)]
    parts = [
        f'<link name="{name}"><inertial><origin xyz="{_words(1e-3 * np.array(centre))}"/><mass value="{mass}"/>'
        '<inertia ixx="5" iyy="5" izz="5" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for name, mass, centre in masses
    ]
    for k, one in enumerate(LINKS):
        low, high = np.deg2rad(one.limits)
        parts.append(
            f'<joint name="joint_{k + 1}" type="revolute"><parent link="{masses[k][0]}"/><child link="{one.name}"/>'
            f'<origin xyz="{_words(1e-3 * np.array(one.at))}"/><axis xyz="{_words(np.array(one.axis))}"/>'
            f'<limit lower="{low:.15g}" upper="{high:.15g}" effort="0" velocity="0"/></joint>'
        )
    return '<?xml version="1.0"?>\n<robot name="heavy_arm">\n' + "\n".join(parts) + "\n</robot>\n"


def write_robot(folder: Path) -> Path:
    """The folder of the nominal robot, as shipped ones are: no geometry that is off, and no tilt."""
    folder.mkdir()
    (folder / "heavy_arm.urdf").write_text(urdf())
    limits = [f"  joint_{k + 1}: {{limits_deg: [{one.limits[0]:g}, {one.limits[1]:g}]}}" for k, one in enumerate(LINKS)]
    lines = ["name: heavy_arm", "title: A heavy arm of nobody's make", "urdf: heavy_arm.urdf", "base: base"]
    lines += ["flange: flange", "controller:", *limits, "effects:", "  - {effect: joint_compliance, joints: all}"]
    lines += [
        f"  - {{effect: gravity_compensator, joint: joint_2, lc_m: {LC}, l2_m: {L2}, zero_deg: {ZERO_DEG}}}",
        "nominal: nominal.yaml",
        "payload_kg: 300",
    ]
    (folder / "robot.yaml").write_text("\n".join(lines) + "\n")
    known = [
        f"joint_compliance[joint_{k + 1}]:\n  value_urad/(N m): {one.compliance}\n"
        f'  sd_percent: {100 * SPRING_SD:g}\n  source: "assumed"\n'
        for k, one in enumerate(LINKS)
    ]
    known += [
        f"gravity_compensator[joint_2].stiffness:\n  value_N/m: {BALANCER}\n  sd_percent: {100 * BALANCER_SD:g}\n"
        '  source: "assumed"\n',
        f'gravity_compensator[joint_2].free_length:\n  value_m: {FREE_LENGTH}\n  source: "assumed"\n',
    ]
    (folder / "nominal.yaml").write_text("".join(known))
    (folder / "README.md").write_text("# A heavy arm of nobody's make\n\nAll of it is assumed.\n")
    return folder


def write_experiment(folder: Path, data: str = "") -> Path:
    """experiment.yaml beside the robot's folder; data: the name of its readings."""
    nests = [f"  {name}: {{xyz_mm: {list(xyz)}}}" for name, xyz in NESTS.items()]
    lines = ["robot: robot", *([f"data: {data}"] if data else []), f"load: {{point_mm: {list(TOOL)}}}", "markers:"]
    lines += [
        *nests,
        f"noise: {{position_sigma_mm: {1e3 * SIGMA:g}, displacement_sigma_mm: {1e3 * SIGMA * 2**0.5:.4g}}}",
        "states: positions",
        "loads:",
        f"  - {{name: weight, fz_N: -{WEIGHT:g}}}",
        f"  - {{name: weight_and_side_pull, fz_N: -{WEIGHT:g}, fy_N: {PULL:g}}}",
        "constraints: {z_min_m: 0.3, z_max_m: 2.6, axis1_distance_min_m: 0.9, of: wrist_centre}",
        "effects:",
        "  - {effect: marker_offset, markers: all}",
        "fit: [geometry, marker_offset, joint_compliance]",
    ]
    path = folder / "experiment.yaml"
    path.write_text("\n".join(lines) + "\n")
    return path


# ---------------------------------------------------------------- the truth


@dataclass(frozen=True)
class Arm:
    """One arm of this type.

    zeros (6,) rad; places (6, 6): m and rotation vector, rad, of each joint's frame against the link before; compliance
    (6,) rad/(N m); balancer N/m; pivots (3,): LC, L2 m and the angle between them with the arm level, rad; tilt
    rad/(N m); nests (3, 3) m on the flange
    """

    zeros: Array
    places: Array
    compliance: Array
    balancer: float
    pivots: Array
    tilt: float
    nests: Array


def nominal_arm() -> Arm:
    """The arm of the data sheet, which does not tilt."""
    n, nests = len(LINKS), 1e-3 * np.array(list(NESTS.values()))
    compliance, pivots = 1e-6 * np.array([a.compliance for a in LINKS]), np.array([LC, L2, np.deg2rad(ZERO_DEG)])
    return Arm(np.zeros(n), np.zeros((n, 6)), compliance, BALANCER, pivots, 0.0, nests)


def drawn_arm(experiment: Experiment, seed: int, factor: float = 1.0) -> Arm:
    """An arm of this type; factor: of the errors of its geometry."""
    rng, facts, sheet = np.random.default_rng([seed, 20]), experiment.robot.facts, nominal_arm()
    zero = np.array([_typical(JointOffset(joint).parameters(facts))[0] for joint in facts.joints])
    place = np.array([_typical(JointPlacement(joint).parameters(facts)) for joint in facts.joints])
    nest = np.array([_typical(MarkerOffset(name).parameters(facts)) for name in NESTS])
    pivot = np.array(_typical([p for p in experiment.robot.parameters if p.name in PIVOTS]))
    return Arm(
        zeros=factor * zero * rng.standard_normal(zero.shape),
        places=factor * place * rng.standard_normal(place.shape),
        compliance=sheet.compliance * (1.0 + SPRING_SD * rng.standard_normal(len(LINKS))),
        balancer=BALANCER * (1.0 + BALANCER_SD * float(rng.standard_normal())),
        tilt=1.0 / TILT,
        nests=sheet.nests + NESTS_OFF * nest * rng.standard_normal(nest.shape),
        pivots=sheet.pivots + factor * pivot * rng.standard_normal(pivot.shape),
    )


def _typical(parameters: Sequence[Parameter]) -> list[float]:
    sizes = [p.typical for p in parameters]
    assert all(size is not None for size in sizes)
    return [float(size) for size in sizes if size is not None]


def _words(values: Array) -> str:
    return " ".join(f"{v:.15g}" for v in values)


def mjcf(arm: Arm) -> str:
    """The arm in MuJoCo, at zero angles. Each drive is a hinge whose spring rests at the angle that is commanded; the
    first bearing has two more, across. An arm that does not tilt has them, too, a million times as stiff."""
    lc, l2, zero = arm.pivots
    inner = f'<site name="tool" pos="{_words(1e-3 * np.array(TOOL))}"/>'
    inner += "".join(f'<site name="{name}" pos="{_words(at)}"/>' for name, at in zip(NESTS, arm.nests, strict=True))
    for k, one in reversed(list(enumerate(LINKS))):
        quat, angle = np.zeros(4), float(np.linalg.norm(arm.places[k, 3:]))
        mujoco.mju_axisAngle2Quat(quat, arm.places[k, 3:] / (angle or 1.0), angle)
        joints = (
            f'<joint name="j{k + 1}" axis="{_words(np.array(one.axis))}" stiffness="{1 / arm.compliance[k]:.15g}"/>'
        )
        if k == 0:
            stiff = 1.0 / max(arm.tilt, 1e-6 / TILT)
            joints = "".join(f'<joint axis="{axis}" stiffness="{stiff:.15g}"/>' for axis in ("1 0 0", "0 1 0")) + joints
            pivot = 1e-3 * np.array(LINKS[1].at) - lc * np.array([np.cos(zero), 0.0, np.sin(zero)])
            inner += f'<site name="on_turret" pos="{_words(pivot)}"/>'
        elif k == 1:
            inner += f'<site name="on_upper_arm" pos="{-l2:.15g} 0 0"/>'
        at = _words(1e-3 * np.array(one.at) + arm.places[k, :3])
        inner = (
            f'<body name="{one.name}" pos="{at}" quat="{_words(quat)}">'
            f'{joints}<inertial pos="{_words(1e-3 * np.array(one.centre))}" mass="{one.mass}" diaginertia="5 5 5"/>'
            f"{inner}</body>"
        )
    return (
        '<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"><flag contact="disable"/></option>'
        f"<worldbody>{inner}</worldbody>"
        f'<tendon><spatial stiffness="{arm.balancer:.15g}" springlength="{FREE_LENGTH}">'
        '<site site="on_turret"/><site site="on_upper_arm"/></spatial></tendon></mujoco>'
    )


class Truth:
    """One arm in MuJoCo, and where it stands at rest."""

    SITES = ("tool", *NESTS)
    STEP, STEPS, REST = 1e-6, 30, 1e-6
    """rad of the differences of a Newton step; steps at most; N m that may be left."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self.model = mujoco.MjModel.from_xml_string(mjcf(arm))
        self.data = mujoco.MjData(self.model)
        self.sites = [self.model.site(name).id for name in self.SITES]
        self.flange = self.model.body(LINKS[-1].name).id
        self.left = 0.0
        """N m: the largest torque that an equilibrium has left so far."""

    def stands(self, pendant: Array, force: Array) -> tuple[Array, Array]:
        """Places (N, 4, 3) m of tool and nests, and the flange's rotations (N, 3, 3), at commanded angles (N, 6) under
        forces (N, 3) N at the tool."""
        places, turns = np.empty((len(pendant), len(self.sites), 3)), np.empty((len(pendant), 3, 3))
        for i, (q, f) in enumerate(zip(pendant, force, strict=True)):
            self._settle(np.concatenate([[0.0, 0.0], q + self.arm.zeros]), f)
            places[i] = self.data.site_xpos[self.sites]
            turns[i] = self.data.xmat[self.flange].reshape(3, 3)
        return places, turns

    def _torque(self, q: Array, force: Array) -> Array:
        """What is left of all torques (8,) N m at angles q, the arm at rest."""
        self.data.qpos[:], self.data.qvel[:] = q, 0.0
        mujoco.mj_forward(self.model, self.data)
        pull = np.zeros(self.model.nv)
        tool = self.data.site_xpos[self.sites[0]]
        mujoco.mj_applyFT(self.model, self.data, force, NOTHING, tool, self.flange, pull)
        return np.asarray(self.data.qfrc_passive - self.data.qfrc_bias + pull)

    def _settle(self, rest: Array, force: Array) -> None:
        """Newton steps, by differences at the commanded pose, to the equilibrium of springs that rest at `rest`."""
        self.model.qpos_spring[:] = rest
        steps = self.STEP * np.eye(len(rest))
        slope = np.stack([self._torque(rest + e, force) - self._torque(rest - e, force) for e in steps], axis=1)
        inverse, q = np.linalg.inv(slope / (2.0 * self.STEP)), rest.copy()
        for _ in range(self.STEPS):
            left = self._torque(q, force)
            if np.abs(left).max() < self.REST:
                self.left = max(self.left, float(np.abs(left).max()))
                return
            q = q - inverse @ left
        raise RuntimeError(f"not settled: {np.abs(left).max():.1e} N m are left")


def agreement(experiment: Experiment, arm: Arm, pendant: Array, force: Array) -> float:
    """How far (m) MuJoCo and the full equilibrium of qsframework, told all of an arm and its tilt, are apart at most.

    Rounding, where nothing is misplaced; else some um, because the balancer's pivot stays on the turret when joint 2 is
    misplaced, and the ring's axes turn with a misplaced joint 1.
    """
    facts = experiment.robot.facts
    tilts = [OffaxisCompliance("joint_1", axis) for axis in "xy"]
    more = [kind(joint) for kind in (JointOffset, JointPlacement) for joint in facts.joints]
    effects = [*experiment.robot.effects, *more, *tilts]
    values = {f"joint_compliance[joint_{k + 1}]": c for k, c in enumerate(arm.compliance)}
    values |= {f"joint_offset[joint_{k + 1}]": zero for k, zero in enumerate(arm.zeros)}
    for k, twist in enumerate(arm.places):
        names = ("x", "y", "z", "rx", "ry", "rz")
        values |= {f"joint_placement[joint_{k + 1}].{a}": v for a, v in zip(names, twist, strict=True)}
    values |= {tilt.name: arm.tilt for tilt in tilts} | {"gravity_compensator[joint_2].stiffness": arm.balancer}
    values |= dict(zip(PIVOTS, arm.pivots, strict=True))
    every = {p.name: p for e in effects for p in e.parameters(facts)} | {p.name: p for p in experiment.robot.parameters}
    parameters = [replace(p, nominal=values.get(name, p.nominal)) for name, p in every.items()]
    tool = experiment.load_site
    model = make_model(facts, effects, parameters, tool, [("tool", tool)], experiment.robot.gravity)
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), np.pad(force, ((0, 0), (0, 3))))
    return float(np.abs(equilibrium(model, poses).tip - Truth(arm).stands(pendant, force)[0][:, 0]).max())


# ---------------------------------------------------------------- the campaign


@dataclass(frozen=True)
class Shared:
    """What all draws have in common: the poses (30, 6) rad that are measured with their loads (30, 3) N, and the
    targets (50, 6) with theirs."""

    pendant: Array
    force: Array
    targets: Array
    target_force: Array


def shared(experiment: Experiment) -> Shared:
    """Poses and targets of the experiment's constraints, by fixed seeds, away from singular poses."""
    pendant, targets = (_regular(experiment, count, seed) for count, seed in ((POSES, 3), (TARGETS, 4)))
    loads = [(0.0, PULL * (i % 2), -WEIGHT) for i in range(POSES)]
    return Shared(pendant, np.array(loads), targets, np.array([(0.0, 0.0, -WEIGHT)] * TARGETS))


def _regular(experiment: Experiment, count: int, seed: int) -> Array:
    """Angles (count, 6) where the arm can move its tool every way."""
    robot = experiment.robot
    pool = generate_candidates(experiment, 3 * count, seed=seed).pendant
    J = rigid_jacobian(robot, experiment.load_site, robot.controller.to_joints(pool))
    J[:, :3] /= arm_length(robot)
    return pool[np.linalg.svd(J, compute_uv=False)[:, -1] > 0.04][:count]


def readings_csv(truth: Truth, plan: Shared, seed: int) -> str:
    """What the tracker reads: of each pose the arm by its own weight, then with the load."""
    rng = np.random.default_rng([seed, 21])
    turn, quat = np.zeros(9), np.concatenate([[1.0], [0.02, 0.02, 1.0] * rng.standard_normal(3)])
    mujoco.mju_quat2Mat(turn, quat / np.linalg.norm(quat))
    states = [truth.stands(plan.pendant, f)[0][:, 1:] for f in (0.0 * plan.force, plan.force)]
    seen = (np.stack(states, axis=1) - np.array(STATION)) @ turn.reshape(3, 3)
    seen = 1e3 * (seen + SIGMA * rng.standard_normal(seen.shape))
    lines = [f"pose,{','.join(f'q{k + 1}_deg' for k in range(6))},fx_N,fy_N,fz_N,marker,state,x_mm,y_mm,z_mm"]
    for i, q in enumerate(np.rad2deg(plan.pendant)):
        angles = ",".join(f"{a:.10g}" for a in q)
        for s, (load, state) in enumerate(((",,", "unloaded"), (_csv(plan.force[i]), "loaded"))):
            lines += [f"p{i + 1:02d},{angles},{load},{m},{state},{_csv(seen[i, s, k])}" for k, m in enumerate(NESTS)]
    return "\n".join(lines) + "\n"


def _csv(values: Array) -> str:
    return ",".join(f"{v:.6f}" for v in values)


# ---------------------------------------------------------------- what is judged

LEVELS = ("base", "frame", "tool")
"""In the base frame; after the best rigid motion of all targets; after it and the best constant offset of the tool."""


def at_levels(stands: Array, turns: Array, wanted: Array) -> dict[str, Array]:
    """Distances (N,) m of places (N, 3) from wanted ones, at each level; turns (N, 3, 3): of the flange."""
    tool, moved = np.zeros(3), np.array(stands)
    R, t = _rigid(stands, wanted)
    out = {"base": _far(stands, wanted), "frame": _far(stands @ R.T + t, wanted)}
    for _ in range(20):
        moved = (stands + turns @ tool) @ R.T + t
        arms = np.einsum("ij,njk->nik", R, turns)
        cross = np.array([np.cross(np.eye(3), m) for m in moved]).transpose(0, 2, 1)
        slope = np.concatenate([np.broadcast_to(np.eye(3), arms.shape), cross, arms], axis=2).reshape(-1, 9)
        step = np.linalg.lstsq(slope, (wanted - moved).ravel(), rcond=None)[0]
        tool = tool + step[6:]
        R, t = _rigid(stands + turns @ tool, wanted)
        if np.abs(step).max() < 1e-10:
            break
    return out | {"tool": _far((stands + turns @ tool) @ R.T + t, wanted)}


def _far(places: Array, wanted: Array) -> Array:
    return np.asarray(np.linalg.norm(places - wanted, axis=1))


def _rigid(places: Array, wanted: Array) -> tuple[Array, Array]:
    """Rotation and shift that bring places (N, 3) closest to wanted ones (Kabsch)."""
    a, b = places.mean(axis=0), wanted.mean(axis=0)
    U, _, Vt = np.linalg.svd((places - a).T @ (wanted - b))
    R = (Vt.T * [1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))]) @ U.T
    return R, b - R @ a


@dataclass(frozen=True)
class Stage:
    """What an arm does at the targets after one stage, and what was said of it."""

    real: dict[str, Array]
    """Distances (N,) m from the wanted places, by level."""
    stated: dict[str, Array]
    """What was expected of them, by level as far as it was said."""
    moved: dict[str, Array]
    """As `real`, if every target is moved, also those that the product leaves where they were."""
    kept: int = 0
    """Targets that it leaves."""
    held_out: float = float("nan")
    """Error m of the fit at held-out poses."""
    refused: str = ""
    """Why the product corrects nothing without --anyway, by which it then does; empty: it goes on."""
    added: tuple[str, ...] = ()
    """Effects of the model beyond those of the campaign."""


STAGES = ("uncorrected", "identified", "extended", "extended twice")


@dataclass(frozen=True)
class Draw:
    """One arm: its stages by name, the torque N m that its equilibria have left, and CPU s."""

    seed: int
    factor: float
    stages: dict[str, Stage]
    left: float
    seconds: float


@dataclass(frozen=True)
class _Case:
    """What the stages of one draw need."""

    truth: Truth
    plan: Shared
    wanted: Array

    def judged(self, pendant: Array) -> dict[str, Array]:
        places, turns = self.truth.stands(pendant, self.plan.target_force)
        return at_levels(places[:, 0], turns, self.wanted)


def silent(text: str) -> None:
    """Tell nobody."""


def loud(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def draw(seed: int, factor: float = 1.0, last: str = STAGES[-1], tell: Callable[[str], None] = silent) -> Draw:
    """One arm from its data sheet to corrected holes, in a folder of its own.

    Args:
        seed: of the arm, its tracker and their noise.
        factor: of the errors of its geometry.
        last: the stage to stop after; each diagnosis takes most of the time.
        tell: called with what each stage says.
    """
    start = time.process_time()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_robot(folder / "robot")
        experiment = load_experiment(write_experiment(folder, "readings.csv"))
        plan, truth = shared(experiment), Truth(drawn_arm(experiment, seed, factor))
        (folder / "readings.csv").write_text(readings_csv(truth, plan, seed))
        targets = joint_targets(experiment, plan.targets, np.pad(plan.target_force, ((0, 0), (0, 3))))
        case = _Case(truth, plan, targets.wanted.position)
        before = case.judged(plan.targets)
        stages = {STAGES[0]: Stage(before, {}, before)}
        tell(f"arm {seed}, {factor:g}: {told(stages[STAGES[0]])}")
        own = {e.name for e in (*experiment.robot.effects, *experiment.effects)}
        readings = read_readings(experiment.data, experiment)
        for k, stage in enumerate(STAGES[1 : STAGES.index(last) + 1]):
            if k:
                experiment = extended(experiment, readings, folder / f"extended{k}", tell)
                readings = read_readings(experiment.data, experiment)
            fit = identify(experiment, readings)
            added = tuple(e.name for e in (*experiment.robot.effects, *experiment.effects) if e.name not in own)
            stages[stage] = corrected(case, experiment, fit, targets.wrench, added)
            tell(f"{stage}: {told(stages[stage])}")
    return Draw(seed, factor, stages, truth.left, time.process_time() - start)


def corrected(case: _Case, experiment: Experiment, fit: Fit, wrench: Array, added: tuple[str, ...] = ()) -> Stage:
    """The targets corrected by a fit; where the product refuses, as `anyway` does it."""
    targets, refused = joint_targets(experiment, case.plan.targets, wrench), ""
    result = forced = qsf.compensate(experiment, fit, targets, anyway=True)
    try:
        result = qsf.compensate(experiment, fit, targets)
    except qsf.QsfError as error:
        refused = str(error)
    return Stage(
        real=case.judged(result.pendant),
        stated=result.sds,
        moved=case.judged(forced.pendant),
        kept=int(result.kept.sum()),
        held_out=fit.held_out_error,
        refused=refused,
        added=added,
    )


def extended(experiment: Experiment, readings: Readings, folder: Path, tell: Callable[[str], None]) -> Experiment:
    """The experiment on the robot that a diagnosis extends."""
    found = qsf.diagnose(experiment, readings)
    tell(str(qsf.diagnosis_words(found)).splitlines()[0])
    qsf.extend(found, folder)
    return load_experiment(folder / "experiment.yaml")


def told(stage: Stage) -> str:
    """One stage of one arm, mm."""

    def sizes(levels: dict[str, Array]) -> str:
        return ", ".join(f"{level} {1e3 * rms(levels[level]):.3f}" for level in LEVELS if level in levels)

    said = f"real {sizes(stage.real)}"
    if stage.stated:
        said += f"; expected {sizes(stage.stated)}; held-out {1e3 * stage.held_out:.3f} mm"
    if stage.kept:
        said += f"; {stage.kept} targets not moved, else real {sizes(stage.moved)}"
    said += f"; with {', '.join(stage.added)}" if stage.added else ""
    return said + (f"; refused: {stage.refused.splitlines()[0]}" if stage.refused else "")


# ---------------------------------------------------------------- the table

HEAD = (
    "geometry off by, stage",
    *(f"{level}, mm (worse)" for level in LEVELS),
    "expected, mm",
    "real / expected",
    "within U",
    "held-out, mm",
    "targets not moved",
    "draws refused",
)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def row(draws: Sequence[Draw], name: str) -> tuple[str, ...]:
    """One line of the table: RMS over draws and targets; of levels that are not stated nothing."""
    stages, before = [d.stages[name] for d in draws], [d.stages[STAGES[0]] for d in draws]
    cells = list[str]()
    for level in LEVELS:
        worse = sum(rms(s.real[level]) > rms(b.real[level]) for s, b in zip(stages, before, strict=True))
        size = rms(np.concatenate([s.real[level] for s in stages]))
        cells.append(f"{1e3 * size:.3f}" + (f" ({worse})" if name != STAGES[0] else ""))
    said, ratio, within = list[str](), list[str](), list[str]()
    for level in LEVELS:
        have = [s for s in stages if level in s.stated]
        if have:
            real, stated = (np.concatenate([getattr(s, k)[level] for s in have]) for k in ("real", "stated"))
            of = "" if len(have) == len(stages) else f" of {len(have)}"
            said.append(f"{level} {1e3 * rms(stated):.3f}{of}")
            ratio.append(f"{level} {rms(real) / rms(stated):.2f}")
            within.append(f"{level} {100 * np.mean(real <= COVER * stated):.0f} %")
    held = f"{1e3 * rms(np.array([s.held_out for s in stages])):.3f}"
    shown = ["; ".join(words) or "-" for words in (said, ratio, within)]
    kept, refused = str(sum(s.kept for s in stages)), str(sum(bool(s.refused) for s in stages))
    last = (held, kept, refused) if name != STAGES[0] else ("-", "-", "-")
    return (f"{draws[0].factor:g}, {name}", *cells, *shown, *last)


def rows(draws: Sequence[Draw]) -> list[tuple[str, ...]]:
    """The lines of all draws, by the size of what is drawn."""
    factors = dict.fromkeys(d.factor for d in draws)
    return [row([d for d in draws if d.factor == factor], name) for factor in factors for name in STAGES]


def one(verbose: bool, task: tuple[int, float]) -> Draw:
    """The draw of a seed and a factor."""
    done = draw(*task, tell=loud if verbose else silent)
    loud(f"arm {done.seed}, {done.factor:g}: {done.seconds:.0f} s of CPU, at most {done.left:.0e} N m out of balance")
    return done


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=DRAWS, help="arms whose geometry is off by its typical sizes")
    parser.add_argument("--half", type=int, default=HALF, help="arms whose geometry is off by half of them")
    parser.add_argument("--seed", type=int, default=0, help="of the first arm")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--verbose", action="store_true", help="what each stage of each arm says")
    parser.add_argument("--write", action="store_true", help="put the table into docs/results.md")
    a = parser.parse_args()
    if a.write and any(PAGE.read_text().count(mark) != 1 for mark in (START, STOP)):
        raise SystemExit(f"{PAGE} must hold {START} and {STOP} once each")
    tasks = [(a.seed + k, factor) for factor, count in ((1.0, a.draws), (0.5, a.half)) for k in range(count)]
    text = table(HEAD, rows(list(run(one, a.verbose, tasks, Work(jobs=a.jobs)))))
    print(text)
    if a.write and (a.draws, a.half) == (DRAWS, HALF):
        replace_between(PAGE, START, STOP, shelved(text, "heavy arm", False))
    elif a.write:
        print("fewer draws than those of the page are not written to it", file=sys.stderr)


if __name__ == "__main__":
    main()
