"""One made-up effect of every kind, with nothing linear about it, to hold the chain rule to differences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.plugin import (
    Actuator,
    Array,
    At,
    Bar,
    Context,
    Geometry,
    GeometryTerm,
    LawTerm,
    Load,
    Loads,
    LoadTerm,
    Loop,
    LoopTerm,
    ParallelSpring,
    Parameter,
    Reading,
    RobotFacts,
    Sensor,
    SensorTerm,
    Spring,
    SpringLaw,
    StiffnessTerm,
    VirtualJoint,
    cross_matrix,
)


@dataclass(frozen=True)
class BentLoop(Loop):
    """q3 = phi3 + phi2 + bar sin(phi3 - phi2): a loop with curvature and one bar."""

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return ("joint_2", "joint_3")

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter("bent_loop", "m", nominal=0.1),)

    def actuators(self, q: Array, robot: RobotFacts) -> Array:
        return np.stack([q[:, 0], q[:, 1] - q[:, 0]], axis=1)

    def closure(self, actuators: Array, bars: Array, context: Context) -> LoopTerm:
        a, b, bar = actuators[:, 0], actuators[:, 1], bars[:, 0]
        sin, cos = np.sin(b - a), np.cos(b - a)
        one, zero = np.ones_like(a), np.zeros_like(a)
        q = np.stack([a, a + b + bar * sin], axis=1)
        q_u = np.stack([np.stack([one, zero, zero], 1), np.stack([one - bar * cos, one + bar * cos, sin], 1)], axis=1)
        second = np.stack(
            [
                np.stack([-bar * sin, bar * sin, -cos], 1),
                np.stack([bar * sin, -bar * sin, cos], 1),
                np.stack([-cos, cos, zero], 1),
            ],
            axis=1,
        )
        return LoopTerm(q, q_u, np.stack([np.zeros_like(second), second], axis=1))

    def transmission_angle(self, q: Array, robot: RobotFacts) -> Array:
        return np.ones(len(q))

    @property
    def smallest_transmission_angle(self) -> float:
        return 0.1


@dataclass(frozen=True)
class Placements(Geometry):
    """Joint 3's placement moves with the temperature; joint 2's encoder is off."""

    moves_placements = True

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"placements.{i}", "rad", typical=1e-2) for i in range(7))

    def errors(self, x: Array, context: Context) -> GeometryTerm:
        poses, n = context.poses, len(context)
        angles_dx, twists_dx = np.zeros((n, context.robot.n, 7)), np.zeros((n, context.robot.n, 6, 7))
        angles_dx[:, 1, 6] = 1.0
        for i in range(6):
            twists_dx[:, 2, i, i] = 1.0 + 0.1 * poses.q[:, 3]
        return GeometryTerm(angles_dx @ x, angles_dx, twists_dx @ x, twists_dx)


@dataclass(frozen=True)
class Links(Spring):
    """A bar, a joint, base and tool springs, and a mixed pair."""

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"links.{i}", "rad/(N m)", lower=0.0, nominal=1e-6, typical=1e-6) for i in range(5))

    def virtual_joints(self, robot: RobotFacts) -> tuple[Actuator | Bar | VirtualJoint, ...]:
        return (
            Bar("bent_loop", 0),
            VirtualJoint(robot.base, "y", "rotation"),
            VirtualJoint("link_3", (0.6, 0.0, 0.8), "rotation", "before"),
            VirtualJoint("link_4", "x", "translation"),
            VirtualJoint("link_6", "x", "rotation"),
            VirtualJoint("link_6", "z", "translation"),
        )

    def mixing(self, x: Array, context: Context) -> Array:
        mixing = np.zeros((6, 5))
        mixing[range(5), range(5)] = 1.0
        mixing[5, 4] = 0.3
        return mixing


@dataclass(frozen=True)
class TwoJointSpring(ParallelSpring):
    """An equivalent stiffness that couples joints 2 and 3."""

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter("two_joint_spring", "N m/rad", nominal=8e5, typical=1e6),)

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return ("joint_2", "joint_3")

    def stiffness(self, q: Array, x: Array, context: Context) -> StiffnessTerm:
        sin, cos = np.sin(q[:, 0] + 2 * q[:, 1]), np.cos(q[:, 0] + 2 * q[:, 1])
        base = np.array([[2.0, 0.5], [0.5, 1.0]])
        dx = (1.5 + sin)[:, None, None] * base
        dq = x[0] * cos[:, None, None, None] * base[..., None] * np.array([1.0, 2.0])
        return StiffnessTerm(x[0] * dx, dq, dx[..., None])


@dataclass(frozen=True)
class Cubic(SpringLaw):
    """Two gears harden."""

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter("cubic", "", nominal=3e-15, typical=1e-15),)

    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        return (("gear", "joint_2"), ("gear", "joint_5"))

    def extra(self, torque: Array, x: Array, context: Context) -> LawTerm:
        return LawTerm(x[0] * torque**3, 3 * x[0] * torque**2, (torque**3)[..., None])


@dataclass(frozen=True)
class Hook(Load):
    """The force is scaled and applied at an offset in the flange; link 3 is heavier than thought."""

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter("hook.scale", ""), Parameter("hook.offset", "m"), Parameter("hook.mass", "kg", typical=50.0))

    def apply(self, loads: Loads, x: Array, context: Context) -> LoadTerm:
        scale, offset, _ = x
        arm = loads.rotation @ np.array([offset, 0.0, 2 * offset])
        force = loads.wrench[:, :3] * (1 + scale)
        d_wrench = np.zeros((len(force), 6, 6))
        d_wrench[:, :3, :3] = np.eye(3) * (1 + scale)
        d_wrench[:, 3:, :3] = cross_matrix(arm) * (1 + scale)
        d_wrench[:, 3:, 3:] = np.eye(3)
        wrench = np.concatenate([force, loads.wrench[:, 3:] + np.cross(arm, force)], axis=1)
        dx = np.zeros((len(force), 6, 3))
        dx[:, :3, 0], dx[:, 3:, 0] = loads.wrench[:, :3], np.cross(arm, loads.wrench[:, :3])
        dx[:, 3:, 1] = np.cross(loads.rotation @ np.array([1.0, 0.0, 2.0]), force)
        d_rotation = np.zeros((len(force), 6, 3))
        d_rotation[:, 3:] = cross_matrix(force) @ cross_matrix(arm)
        moments = np.zeros((*loads.moments.shape, 3))
        moments[3, :, 2] = (1.0, 0.2, 0.0, 0.1)
        return LoadTerm(wrench, d_wrench, dx, d_rotation, moments @ x, moments)


@dataclass(frozen=True)
class CrookedTracker(Sensor):
    """A marker sits off its place, and the tracker drifts and is scaled."""

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter("crooked_tracker.offset", "m"), Parameter("crooked_tracker.scale", ""))

    def read(self, reading: Reading, x: Array, context: Context) -> SensorTerm:
        offset, scale = x
        unit = np.array([1.0, -2.0, 0.5])
        arm = reading.rotation @ (offset * unit)
        assert context.conditions.time is not None
        factor = (1 + scale * (1 + 1e-4 * context.conditions.time))[:, None, None]
        position = (reading.position + arm) * factor
        drift = (1 + 1e-4 * context.conditions.time)[:, None, None]
        dx = np.stack([reading.rotation @ unit * factor, (reading.position + arm) * drift], axis=-1)
        d_position = np.broadcast_to(np.eye(3) * factor[..., None], (*position.shape, 3))
        return SensorTerm(position, d_position, dx, -cross_matrix(arm) * factor[..., None])


ALL = (BentLoop(), Placements(), Links(), TwoJointSpring(), Cubic(), Hook(), CrookedTracker())
