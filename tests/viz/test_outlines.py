"""Bars and balancers are drawn where the effects' own lengths and angles put them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsf_plugins.closed_chain import ClosedChain
from qsf_plugins.four_bar import FourBar
from qsf_plugins.gravity_compensator import GravityCompensator
from qsf_plugins.parallelogram import Parallelogram
from qsf_plugins.point_spring import PointSpring
from qsf_plugins.spring_triangle import SpringTriangle
from qsframework.experiment import Experiment
from qsframework.plugin import Array
from qsframework.robot.kinematics import joint_frames

RNG = np.random.default_rng(3)
Q = RNG.uniform(-0.5, 0.5, (6, 2))


def lengths(ends: Array) -> Array:
    return np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)


def test_the_parallelograms_bars_keep_their_lengths_and_directions(m900ib: Experiment) -> None:
    facts = m900ib.robot.facts
    loop = next(e for e in m900ib.robot.effects if isinstance(e, Parallelogram))
    ends = loop.outline(Q, facts)
    assert np.allclose(lengths(ends), [0.75, 1.12, 0.75])
    lever, bar, rocker = (ends[:, b, 1] - ends[:, b, 0] for b in range(3))
    assert np.allclose(lever, rocker)
    # Angles against the commands of the joints: the lever turns with the actuator alone, the bar with link 2.
    turn = replace(loop, lever_mass=0.0, bar_mass=0.0).actuators(Q, facts)[:, 1]  # no joints but the two
    angle = np.arctan2(lever[:, 0], lever[:, 2])  # about +y from z
    assert np.allclose(angle - angle[0], -(turn - turn[0]))
    assert np.allclose(np.arctan2(bar[:, 0], bar[:, 2]), Q[:, 0])


def test_the_rocker_lies_on_the_driven_link(m900ib: Experiment) -> None:
    """Its far end, carried to the link's frame, is one point for all poses: the pivot at the rear of the elbow."""
    robot = m900ib.robot
    loop = next(e for e in robot.effects if isinstance(e, Parallelogram))
    q = np.zeros((6, 6))
    q[:, 1:3] = Q
    placed = joint_frames(robot.facts, q)
    for i, end in enumerate(loop.outline(Q, robot.facts)[:, 2, 1]):
        base = placed.positions[1][:, i] + placed.matrix(1)[i] @ (robot.facts.placements[1] @ np.append(end, 1.0))[:3]
        inside = placed.matrix(3)[i].T @ (base - placed.positions[3][:, i])
        assert np.allclose(inside, [-0.75, 0.0, 0.0], atol=1e-12)


def test_a_four_bars_ends_meet(m900ib: Experiment) -> None:
    facts = m900ib.robot.facts
    loop = FourBar(
        "joint_3", "joint_2", lever=0.7, bar=1.05, rocker=0.75, lever_zero=-1.5, rocker_zero=-np.pi / 2, branch=-1.0
    )
    ends = loop.outline(0.4 * Q, facts)
    assert np.isfinite(ends).all()
    assert np.allclose(lengths(ends), [0.7, 1.05, 0.75], atol=1e-9)
    assert np.allclose(ends[:, 0, 1], ends[:, 1, 0])
    assert np.allclose(ends[:, 1, 1], ends[:, 2, 1])


def test_a_closed_chain_draws_the_parallelogram_that_it_is(m900ib: Experiment) -> None:
    facts = m900ib.robot.facts
    links = [
        {"name": "lever", "axis": [0, 1, 0], "to_m": [-0.75, 0, 0]},
        {"name": "bar", "axis": [0, 1, 0], "to_m": [-0.75, 0, 1.12]},
    ]
    chain = ClosedChain("joint_3", "joint_2", links)  # pyright: ignore[reportArgumentType]
    plain = Parallelogram("joint_3", "joint_2", 0.75, zero=-np.pi / 2)
    assert np.allclose(chain.outline(Q, facts), plain.outline(Q, facts)[:, :2], atol=1e-9)


def test_a_chain_that_cannot_reach_a_pose_is_not_drawn(m900ib: Experiment) -> None:
    links = [
        {"name": "lever", "axis": [0, 1, 0], "to_m": [-0.75, 0, 0]},
        {"name": "bar", "axis": [0, 1, 0], "to_m": [-0.75, 0, 1.12]},
    ]
    chain = ClosedChain("joint_3", "joint_2", links)  # pyright: ignore[reportArgumentType]
    flat = np.array([[0.0, 0.1], [0.0, 1.9]])
    ends = chain.outline(flat, m900ib.robot.facts)
    assert np.isfinite(ends[0]).all()
    assert np.isnan(ends[1]).all()


@pytest.mark.parametrize("zero", [0.0, 0.6])
def test_a_balancers_length_is_that_of_its_triangle(m900ib: Experiment, zero: float) -> None:
    facts = m900ib.robot.facts
    effect = GravityCompensator("joint_2", 0.235, 1.12, zero)
    first, second = effect.outline(facts)
    q = np.zeros((6, 6))
    q[:, 1] = Q[:, 0]
    placed = joint_frames(facts, q)
    ends = [placed.point(facts.link_index(p.link), np.array(p.xyz)) for p in (first, second)]
    length = np.linalg.norm(ends[1] - ends[0], axis=0)
    assert np.allclose(length, SpringTriangle(0.235, 1.12).length(q[:, 1] + zero), atol=1e-12)
    assert (first.link, second.link) == ("link_1", "link_2")


def test_a_balancer_at_the_last_joint_has_a_direction(m900ib: Experiment) -> None:
    facts = m900ib.robot.facts
    first, second = GravityCompensator("joint_6", 0.1, 0.3).outline(facts)
    assert np.linalg.norm(second.xyz) == pytest.approx(0.3)
    assert first.link == "link_5"


def test_a_point_spring_is_drawn_between_its_points(m900ib: Experiment) -> None:
    spring = PointSpring(
        "link_1", "link_2", first_x=-0.3, first_y=0.1, first_z=0.2, second_x=0.1, second_y=0.1, second_z=0.6
    )
    assert spring.outline(m900ib.robot.facts) == spring.ends(m900ib.robot.facts)
