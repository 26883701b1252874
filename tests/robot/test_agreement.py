"""A robot is loaded only if the batch kernel says of it what Pinocchio says."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from qsframework.errors import InputError
from qsframework.plugin import RobotFacts
from qsframework.plugin.facts import frozen
from qsframework.robot import agreement, kinematics, load_robot, loader, robot_names
from qsframework.robot.agreement import POSES, spread_poses

MACHINES = Path(__file__).parents[1] / "robots" / "machines"
Spoil = Callable[[Callable[[RobotFacts], RobotFacts]], None]


@pytest.fixture
def spoil(monkeypatch: pytest.MonkeyPatch) -> Spoil:
    """Robots loaded from here on have facts that their Pinocchio model has not."""
    read = loader.read_facts

    def spoil(change: Callable[[RobotFacts], RobotFacts]) -> None:
        monkeypatch.setattr(loader, "read_facts", lambda *given: change(read(*given)))

    return spoil


def off(field: str, index: tuple[int, ...], by: float) -> Callable[[RobotFacts], RobotFacts]:
    """One number of the facts wrong."""

    def change(facts: RobotFacts) -> RobotFacts:
        values = np.array(getattr(facts, field))
        values[index] += by
        return replace(facts, **{field: frozen(values)})

    return change


def refused(name: str | Path = "fanuc_m900ib") -> list[str]:
    """The problems of a robot that is not loaded."""
    with pytest.raises(InputError) as caught:
        load_robot(name)
    text = [str(problem) for problem in caught.value.problems]
    assert all("robot.yaml: robot " in line for line in text)
    assert "Install the versions of requirements.lock" in text[-1]
    assert f"pin) {pin.__version__}" in text[-1]
    return text


def about(text: list[str], what: str) -> str:
    """The one problem with a quantity."""
    (line,) = [line for line in text if f": {what} of " in line]
    return line


def size(line: str, unit: str) -> float:
    """The difference that a problem states."""
    (number,) = re.findall(rf"found a difference of up to (\S+) {unit};", line)
    return float(number)


@pytest.mark.parametrize("k", range(6))
def test_a_turned_axis_is_refused(spoil: Spoil, k: int) -> None:
    facts = load_robot("fanuc_m900ib").facts
    beside = int(np.argmin(np.abs(facts.axes[k])))
    spoil(off("axes", (k, beside), 1e-6))
    line = about(refused(), "Jacobian (angular)")
    assert line.split(" of ", 1)[1].startswith(f"'joint_{k + 1}'")
    assert "robot fanuc_m900ib" in line
    assert 0.5e-6 < size(line, "rad/rad") < 2.5e-6
    assert "; allowed: 1.0e-09 rad/rad" in line


@pytest.mark.parametrize("k", range(6))
def test_a_moved_joint_is_refused(spoil: Spoil, k: int) -> None:
    spoil(off("placements", (k, 1, 3), 1e-6))
    text = refused()
    line = about(text, "position")
    names = ", ".join(f"'link_{i}'" for i in range(k + 1, 7))
    assert f"position of {names}, 'flange' by the batch kernel is not Pinocchio's" in line
    assert size(line, "m") == pytest.approx(1e-6, rel=0.1)
    assert "; allowed: 1.0e-09 m" in line
    assert not any("attitude" in line for line in text)


def test_a_turned_joint_is_refused_where_no_link_moves(spoil: Spoil) -> None:
    """The last joint's frame turned about its own axis: only the flange's attitude shows it."""
    turn = np.eye(4)
    turn[:3, :3] = pin.exp3(1e-6 * load_robot("fanuc_m900ib").facts.axes[5])

    def change(facts: RobotFacts) -> RobotFacts:
        placements = np.array(facts.placements)
        placements[5] = placements[5] @ turn
        return replace(facts, placements=frozen(placements))

    spoil(change)
    text = refused()
    assert "attitude of 'link_6', 'flange'" in about(text, "attitude")
    assert len([line for line in text if "position" in line or "Jacobian" in line]) == 0


@pytest.mark.parametrize("name", ["fanuc_m900ib", "ur10"])
@pytest.mark.parametrize("link", range(2, 7))
def test_a_wrong_mass_is_refused(spoil: Spoil, name: str, link: int) -> None:
    """By a millionth. The mass of link 1, whose axis is upright, puts no torque on any joint."""
    facts = load_robot(name).facts
    spoil(off("masses", (link,), 1e-6 * facts.masses[link]))
    (line,) = refused(name)
    assert f"robot {name}: gravity torque of " in line
    assert f"'{facts.joints[1]}'" in line
    assert f"'{facts.joints[0]}'" not in line
    assert line.count(" N m") == 2


def test_a_wrong_centre_is_refused(spoil: Spoil) -> None:
    spoil(off("centres", (3, 0), 1e-6))
    (line,) = refused()
    assert "gravity torque of 'joint_2', 'joint_3'" in line


def test_a_number_that_is_none_is_refused(spoil: Spoil) -> None:
    spoil(off("centres", (3, 0), np.nan))
    assert "gravity torque" in refused()[0]


def test_a_wrong_kernel_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """The facts are right, the code is not."""
    right: Any = kinematics._rotate
    monkeypatch.setattr(kinematics, "_rotate", lambda columns, e, cos, sin: right(columns, e, cos, sin * (1 + 1e-6)))
    told = [line.split(": ", 2)[2].split(" of ")[0] for line in refused("ur10")]
    assert told == ["position", "attitude", "Jacobian (linear)", "Jacobian (angular)", "gravity torque"]


@pytest.mark.parametrize(("by", "good"), [(5e-10, True), (2e-9, False)])
def test_what_is_allowed_is_a_nanometre(spoil: Spoil, by: float, good: bool) -> None:
    spoil(off("placements", (2, 1, 3), by))
    if good:
        assert load_robot("fanuc_m900ib").name == "fanuc_m900ib"
    else:
        assert "position" in refused()[0]


def test_an_axis_that_is_nearly_along_z_is_turned_about_as_it_is(small: Any) -> None:
    """Its largest entry is 1.0 in float64, yet it is not the axis: links were 1.5e-8 m off."""
    small.edit("small.urdf", ('<axis xyz="0 1 0"/>', '<axis xyz="9e-9 1 0"/>'))
    robot = small.load()
    assert robot.facts.axes[0].max() == 1.0
    assert robot.facts.axes[0, 0] == 9e-9
    q = robot.controller.to_joints(spread_poses(robot.controller.lower, robot.controller.upper))
    ours, theirs = agreement.kernel_statics(robot, q), agreement.reference_statics(robot, q)
    np.testing.assert_allclose(ours.positions, theirs.positions, atol=1e-14)


def test_rounding_of_joints_that_bear_nothing_is_no_difference(small: Any) -> None:
    """All axes along gravity: the torques are rounding alone, the largest too."""
    small.edit("small.urdf", ('<axis xyz="0 1 0"/>', '<axis xyz="1 2 3"/>'), ('xyz="0 -1 0"', 'xyz="1 2 3"'))
    small.edit("robot.yaml", ("flange: tip", "flange: tip\ngravity_m/s^2: [-2.7, -5.4, -8.1]"))
    robot = small.load()
    torque = agreement.reference_statics(robot, spread_poses(robot.controller.lower, robot.controller.upper)).torque
    assert 0.0 < np.abs(torque).max() < 1e-12


BRANCHED = {"abb_irb760"}
"""Robots whose URDF has links beside the arm; of the others' lever and bar a URDF knows nothing, nor of this one's."""


@pytest.mark.parametrize("name", robot_names())
def test_every_robot_is_held_at_five_poses(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Cheap: one batch of five poses for the kernel, and five times three calls of Pinocchio."""
    calls: Counter[str] = Counter()
    batches: list[tuple[int, ...]] = []

    def counted(module: Any, function: str) -> None:
        real = getattr(module, function)

        def call(*given: Any) -> Any:
            calls[function] += 1
            if function == "joint_frames":
                batches.append(given[1].shape)
            return real(*given)

        monkeypatch.setattr(module, function, call)

    for function in ("computeJointJacobians", "getFrameJacobian", "computeGeneralizedGravity", "forwardKinematics"):
        counted(pin, function)
    for function in ("joint_frames", "twists", "element_gravity"):
        counted(agreement, function)
    robot = load_robot(name)
    drawn = name in BRANCHED  # by the URDF: these are held to Pinocchio's tree in a second batch
    assert batches == [(POSES, robot.facts.n), *[(POSES, len(robot.facts.turning) - 2)] * drawn]
    assert drawn or calls == {
        "computeJointJacobians": POSES,
        "getFrameJacobian": POSES,
        "computeGeneralizedGravity": POSES,
        "joint_frames": 1,
        "twists": 1,
        "element_gravity": 1,
    }


@pytest.mark.parametrize("name", robot_names())
def test_the_poses_spread_over_the_limits(name: str) -> None:
    controller = load_robot(name).controller
    pendant = spread_poses(controller.lower, controller.upper)
    assert pendant.shape == (POSES, len(controller.lower))
    assert not controller.outside(pendant).any()
    part = np.sort((pendant - controller.lower) / (controller.upper - controller.lower), axis=0)
    np.testing.assert_allclose(np.diff(part, axis=0), 1.0 / POSES)
    np.testing.assert_array_equal(pendant, spread_poses(controller.lower, controller.upper))


@pytest.mark.parametrize(
    ("field", "change", "words"),
    [
        ("centre", [0.0, 0.0, 1e-6], "gravity torque of 'joint_2', 'housing_joint'"),
        ("axis", [0.0, -2.0, 0.0], "attitude of 'housing' by"),
        ("placement", 1e-6 * np.outer([1, 0, 0, 0], [0, 0, 0, 1]), "position of 'housing' by"),
    ],
)
def test_branches_too_are_held_to_pinocchio(
    field: str, change: Any, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = loader.read_branches

    def spoilt(*given: Any) -> Any:
        (first, *rest), frames = read(*given)
        wrong = replace(first, **{field: frozen(getattr(first, field) + np.array(change))})
        return (wrong, *rest), frames

    monkeypatch.setattr(loader, "read_branches", spoilt)
    text = refused(MACHINES / "counterweight_arm")
    assert any(words in line for line in text), text
