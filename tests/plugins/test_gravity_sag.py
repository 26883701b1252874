"""Gravity sag without masses: compliance times first moments, against arms whose masses are known."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.elastostatics import Model, Site, equilibrium, make_model
from qsframework.plugin import Context, Effect, InputError, Loop, Poses, RobotFacts, build_effects
from qsframework.plugin.check import sample_robot
from qsframework.plugin.facts import frozen
from qsframework.robot import Robot, load_robot

MARKERS = [("a", Site(6, np.array([0.2, 0.0, 0.1]))), ("b", Site(6, np.array([-0.1, 0.2, 0.1])))]
COMPLIANCE = {"ur10": 1e-5, "fanuc_m900ib": 2e-7}


def heavy(robot: Robot, seed: int = 1) -> RobotFacts:
    """The arm with masses and centres that nobody published."""
    rng = np.random.default_rng(seed)
    n, size = robot.facts.n, 5.0 if robot.facts.name == "ur10" else 200.0
    masses, centres = size * rng.uniform(0.3, 1.0, n + 1), rng.uniform(-0.3, 0.3, (n + 1, 3))
    return replace(robot.facts, masses=frozen(masses), centres=frozen(centres))


def weightless(facts: RobotFacts) -> RobotFacts:
    return replace(facts, masses=frozen(np.zeros(facts.n + 1)))


def model(facts: RobotFacts, effects: list[Effect]) -> Model:
    parameters = [p for e in effects for p in e.parameters(facts)]
    return make_model(facts, effects, parameters, MARKERS[0][1], MARKERS, facts.gravity)


def soft(facts: RobotFacts, joints: list[str], loops: list[Effect]) -> tuple[Model, np.ndarray]:
    """The heavy arm with compliant joints."""
    m = model(facts, [*loops, *build_effects({"effect": "joint_compliance", "joints": joints}, facts)])
    x = np.zeros(len(m.parameters))
    x[m.index([f"joint_compliance[{j}]" for j in joints])] = COMPLIANCE[facts.name] * (1.0 + np.arange(len(joints)))
    return m, x


def sagging(facts: RobotFacts, joints: list[str], loops: list[Effect]) -> Model:
    """The same arm without masses or springs."""
    return model(weightless(facts), [*loops, *build_effects({"effect": "gravity_sag", "joints": joints}, facts)])


def poses(n: int = 6, count: int = 120, seed: int = 0, spread: float = 2.5) -> Poses:
    q = np.random.default_rng(seed).uniform(-spread, spread, (count, n))
    return Poses(q, q, np.zeros((count, 6)))


def fitted(m: Model, p: Poses, bend: np.ndarray) -> np.ndarray:
    """Least squares of the markers' deflection on the sag's parameters; they must be independent."""
    names = [name for name in m.names if name.startswith("gravity_sag")]
    A = m.position_sensitivity(p, names=names).reshape(-1, len(names))
    size = np.linalg.norm(A, axis=0)
    values = np.linalg.svd(A / size, compute_uv=False)
    assert values[-1] > 1e-3 * values[0], "no parameter can be told by the others"
    solution = np.zeros(len(m.parameters))
    solution[m.index(names)] = np.linalg.lstsq(A / size, bend.ravel(), rcond=None)[0] / size
    return solution


@pytest.mark.parametrize("joint", ["joint_2", "joint_3", "joint_4", "joint_5", "joint_6"])
def test_one_soft_joint_is_reproduced(joint: str) -> None:
    """UR10 with random masses: fitted on 120 poses, markers and the joint's own angle told on 200 others."""
    facts = heavy(load_robot("ur10"))
    truth, x = soft(facts, [joint], [])
    sag = sagging(facts, [joint], [])
    train, test = poses(), poses(count=200, seed=9)
    found = fitted(sag, train, truth.positions(train, x) - sag.positions(train))
    bend = truth.positions(test, x) - sag.positions(test)
    assert np.abs(bend).max() > 1e-6
    assert np.abs(sag.positions(test, found) - truth.positions(test, x)).max() < 1e-3 * np.abs(bend).max()
    k = facts.joint_index(joint)
    angle = sag.effects[0].errors(found, Context(facts, test)).angles[:, k]  # type: ignore[attr-defined]
    expected = equilibrium(truth, test, x, loaded=False).eps[:, 0]
    assert np.abs(angle - expected).max() < 1e-3 * np.abs(expected).max()


@pytest.mark.parametrize("joint", ["joint_2", "joint_4"])
def test_parameters_are_compliance_times_lumped_moments(joint: str) -> None:
    """In the linear model: c |g| L, L summed from the tip: what lies along a joint's axis goes to the link before."""
    facts = heavy(load_robot("ur10"))
    truth, x = soft(facts, [joint], [])
    sag = sagging(facts, [joint], [])
    found = fitted(sag, poses(), truth.positions(poses(), x, linear=True) - sag.positions(poses()))
    mass, moment, expected = 0.0, np.zeros(3), {}
    for k in reversed(range(facts.joint_index(joint), facts.n)):
        moment = moment + facts.masses[k + 1] * facts.centres[k + 1]
        mass += facts.masses[k + 1]
        along = facts.axes[k] @ moment
        for i in np.flatnonzero(facts.axes[k] == 0.0):
            expected[f"gravity_sag[{joint}].{facts.links[k + 1]}_{'xyz'[i]}"] = moment[i]
        rotation, origin = facts.placements[k, :3, :3], facts.placements[k, :3, 3]
        moment = along * rotation @ facts.axes[k] + mass * origin
    size = COMPLIANCE["ur10"] * np.linalg.norm(facts.gravity)
    assert set(expected) == set(sag.names)
    for name, value in zip(sag.names, found, strict=True):
        assert value == pytest.approx(size * expected[name], rel=1e-6, abs=1e-6 * np.abs(found).max()), name


def test_all_joints_of_a_parallelogram_arm_at_once() -> None:
    """M-900iB: actuators 2 to 6 soft, 30 parameters, the forearm kept level by its loop."""
    robot = load_robot("fanuc_m900ib")
    facts, loops = heavy(robot), [e for e in robot.effects if isinstance(e, Loop)]
    joints = [f"joint_{k}" for k in range(2, 7)]
    truth, x = soft(facts, joints, list(loops))
    sag = sagging(facts, joints, list(loops))
    assert len([n for n in sag.names if n.startswith("gravity_sag")]) == 10 + 8 + 6 + 4 + 2
    train, test = poses(count=300, spread=1.0), poses(count=100, seed=9, spread=1.0)
    found = fitted(sag, train, truth.positions(train, x) - sag.positions(train))
    bend = truth.positions(test, x) - sag.positions(test)
    assert np.abs(bend).max() > 1e-3
    assert np.abs(sag.positions(test, found) - truth.positions(test, x)).max() < 2e-3 * np.abs(bend).max()


def test_a_third_entry_per_link_tells_nothing_more() -> None:
    """Torque regressors of all three components of every moment have the rank of the parameters kept."""
    facts = heavy(load_robot("ur10"))
    p = poses()
    full = []
    for link in range(2, 7):
        for i in range(3):
            one = replace(facts, masses=frozen(np.zeros(7)), centres=frozen(np.zeros((7, 3))))
            m = model(
                one,
                [
                    *build_effects({"effect": "joint_compliance", "joint": "joint_2"}, one),
                    *build_effects({"effect": "link_mass", "link": facts.links[link]}, one),
                ],
            )
            x = np.zeros(len(m.parameters))
            x[m.index(["joint_compliance[joint_2]", f"link_mass[{facts.links[link]}].m{'xyz'[i]}"])] = 1e-5, 1.0
            full.append((m.positions(p, x, linear=True) - m.positions(p, 0 * x)).ravel())
    values = np.linalg.svd(np.stack(full, axis=1), compute_uv=False)
    assert int((values > 1e-9 * values[0]).sum()) == 10
    assert len(build_effects({"effect": "gravity_sag", "joint": "joint_2"}, facts)[0].parameters(facts)) == 10


def test_only_joints_that_gravity_turns_are_places() -> None:
    facts = sample_robot()
    effect = build_effects({"effect": "gravity_sag", "joints": ["joint_2"], "last": "link_3"}, facts)[0]
    assert [e.name for e in type(effect).places(facts)] == [f"gravity_sag[joint_{k}]" for k in range(2, 7)]
    assert [p.name for p in effect.parameters(facts)] == [
        f"gravity_sag[joint_2].link_{k}_{a}" for k in (2, 3) for a in "xz"
    ]
    wall = replace(facts, gravity=frozen([9.81, 0.0, 0.0]))
    assert len(type(effect).places(wall)) == 6
    assert not type(effect).places(replace(facts, gravity=frozen(np.zeros(3))))
    with pytest.raises(InputError, match=r"gravity never turns this joint.*joint_2, joint_3"):
        build_effects({"effect": "gravity_sag", "joint": "joint_1"}, facts)
    with pytest.raises(InputError, match=r"last must be carried by the joint.*link_3, link_4, link_5, link_6"):
        build_effects({"effect": "gravity_sag", "joint": "joint_3", "last": "link_2"}, facts)
    with pytest.raises(InputError, match="no link 'link_9'"):
        build_effects({"effect": "gravity_sag", "joint": "joint_3", "last": "link_9"}, facts)


def test_an_arm_on_a_wall_sags_at_joint_1_too(tmp_path: Path) -> None:
    folder = tmp_path / "wall"
    shutil.copytree(load_robot("ur10").folder, folder)
    spec = folder / "robot.yaml"
    spec.write_text(spec.read_text() + "gravity_m/s^2: [9.81, 0, 0]\n")
    facts = load_robot(str(folder)).facts
    assert facts.gravity.tolist() == [9.81, 0.0, 0.0]
    assert len(build_effects({"effect": "gravity_sag", "joint": "joint_1"}, facts)[0].parameters(facts)) == 12
