"""Any chain of links, planar or spatial, that closes a loop from the driver's carrier to the driven link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from qsf_plugins.planar_loop import FLAT, between, length_error, refuse
from qsf_plugins.serial_point import SerialPoint
from qsframework.plugin import (
    Array,
    Context,
    InputError,
    Loop,
    LoopTerm,
    Parameter,
    Problem,
    RobotFacts,
    place,
    setting,
)

STEP = 0.2
_ROUNDS = 30
_GAP = 1e-9


@dataclass(frozen=True)
class ChainLink:
    """A link of the mechanism at zero angles: it turns about `axis` where the one before ends, and reaches to `to`."""

    name: str
    axis: tuple[float, float, float]
    to: tuple[float, float, float]


@dataclass(frozen=True)
class ClosedChain(Loop):
    """A chain of passive links ties the driven link to a lever that the driven joint's actuator turns.

    links: the mechanism as it stands, closed, at zero angles, in the frame of the driver's joint.
    Each entry has name, axis [x, y, z] and to_m or to_mm, the point where it carries the next link; the first is the
    lever, the last ends in the pivot on the driven link, where its point and the driven link's are
    held together. The first may have at_m, where its joint is (default: the driver's axis). Two
    links close a planar loop, three a spatial one: a link of no length gives a second axis at a
    pivot. Assembly follows the loop from zero angles, so it stays on the branch that is drawn.
    The parameters are the length errors of the links, in order.
    """

    driven: str = place()
    driver: str = setting()
    links: tuple[ChainLink, ...] = setting()
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the lever's joint is; in a spec `at_m` of the first link."""
    margin: float = setting("rad", float(np.deg2rad(15.0)))
    """Smallest transmission angle of a planned pose."""
    equation = "end of the chain (phi, psi) = pivot on the driven link (q); G = dq/dphi from its derivative"
    source = "Loop closure by points, implicit differentiation"
    check = "Play in the passive joints, lengths of the links of the mechanism."

    def __post_init__(self) -> None:
        links, at = _read_links(self.links, self.at)
        object.__setattr__(self, "links", links)
        object.__setattr__(self, "at", at)

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        lengths = np.linalg.norm(self._arms(), axis=1)
        names = [link.name for link, length in zip(self.links, lengths, strict=True) if length > 0.0]
        return tuple(length_error(f"{self.name}.{n}") for n in names)

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.driver, self.driven)

    def leaders(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.driver,)

    def validate(self, robot: RobotFacts) -> None:
        if robot.joint_index(self.driven) != robot.joint_index(self.driver) + 1:
            raise InputError(f"{self.name}: {self.driven} must be the joint after {self.driver}")
        if abs(self._orientation(np.zeros((1, self._count(robot))), robot)[0]) < FLAT:
            raise InputError(
                f"{self.name} is flat, or its links are free to move, at zero angles; "
                "two links close a planar loop, three a spatial one"
            )

    def _arms(self) -> Array:
        pivots = np.array([self.at, *(link.to for link in self.links)])
        return np.diff(pivots, axis=0)

    def _count(self, robot: RobotFacts) -> int:
        return 2 + len(self.parameters(robot)) + len(self.links)

    # The variables v: driver, actuator, m length errors, driven joint, passive angles.

    def _ends(self, robot: RobotFacts) -> tuple[SerialPoint, SerialPoint]:
        """The pivot on the mechanism and on the arm."""
        arms = self._arms()
        has = np.linalg.norm(arms, axis=1) > 0.0
        m, n = int(has.sum()), len(self.links)
        stretches = np.where(has, 1 + np.cumsum(has), -1)
        axes = np.array([link.axis for link in self.links])
        chain = SerialPoint(np.array(self.at), axes, arms, np.array([1, *range(3 + m, 2 + m + n)]), stretches)
        first, second = robot.joint_index(self.driver), robot.joint_index(self.driven)
        elbow = between(robot, first, second)
        arm_axes = np.stack([robot.axes[first], elbow[:3, :3] @ robot.axes[second]])
        reach = np.stack([elbow[:3, 3], np.array(self.links[-1].to) - elbow[:3, 3]])
        return chain, SerialPoint(np.zeros(3), arm_axes, reach, np.array([0, 2 + m]), np.array([-1, -1]))

    def _gap(self, v: Array, robot: RobotFacts) -> tuple[Array, Array]:
        """Vector between the two pivots (N, 3) and its slope (N, 3, V)."""
        (p, dp), (a, da) = (end.first(v) for end in self._ends(robot))
        return p - a, dp - da

    def _assemble(self, known: Array, rows: Sequence[int], free: Sequence[int], robot: RobotFacts) -> Array:
        """Variables v (N, V) with v[rows] = known that close the loop, followed from zero; NaN where none do."""
        v = np.zeros((len(known), self._count(robot)))
        steps = max(1, int(np.ceil(np.abs(known).max(initial=0.0) / STEP)))
        for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
            v[:, rows] = share * known
            for _ in range(_ROUNDS):
                gap, slope = self._gap(v, robot)
                move = np.einsum("nzc,nc->nz", _left_inverse(slope[:, :, free]), gap)
                v[:, free] -= np.clip(move, -STEP, STEP)
                if np.abs(move).max(initial=0.0) < 1e-13:
                    break
        gap = np.abs(self._gap(v, robot)[0]).max(axis=1)
        start = self._orientation(np.zeros((1, v.shape[1])), robot)[0]
        lost = (gap > _GAP) | ~(self._orientation(v, robot) * np.sign(start) >= FLAT)
        return np.where(lost[:, None], np.nan, v)

    def _orientation(self, v: Array, robot: RobotFacts) -> Array:
        """Signed volume (N,) of the unit velocities of the pivot by the driven joint and the passive joints."""
        m = len(self.parameters(robot))
        columns = self._gap(v, robot)[1][:, :, 2 + m :]
        columns = columns / np.maximum(np.linalg.norm(columns, axis=1, keepdims=True), 1e-300)
        if len(self.links) == 3:
            return np.linalg.det(columns)
        axis = robot.axes[robot.joint_index(self.driver)]
        return np.cross(columns[:, :, 0], columns[:, :, 1]) @ axis

    def actuators(self, q: Array, robot: RobotFacts) -> Array:
        v = self._inverse(q, robot)
        refuse(self.name, "cannot close at these joint angles", np.isnan(v[:, 0]), q, self.joints(robot))
        return v[:, :2].copy()

    def _inverse(self, q: Array, robot: RobotFacts) -> Array:
        m, n = len(self.parameters(robot)), len(self.links)
        return self._assemble(q, [0, 2 + m], [1, *range(3 + m, 2 + m + n)], robot)

    def closure(self, actuators: Array, bars: Array, context: Context) -> LoopTerm:
        m, known = bars.shape[1], 2 + bars.shape[1]
        free = list(range(known, known + len(self.links)))
        v = self._assemble(np.concatenate([actuators, bars], axis=1), list(range(known)), free, context.robot)
        what = "cannot close without passing a flat position"
        refuse(self.name, what, np.isnan(v[:, 0]), actuators, self.joints(context.robot), bars)

        @cache
        def moved() -> tuple[Array, Array]:
            """All variables by the inputs, and what closes the gap."""
            slope = self._gap(v, context.robot)[1]
            inverse = _left_inverse(slope[:, :, free])
            inputs = np.broadcast_to(np.eye(known), (len(v), known, known))
            return np.concatenate([inputs, -inverse @ slope[:, :, :known]], axis=1), inverse

        def bend() -> Array:
            first, inverse = moved()
            mechanism, arm = self._ends(context.robot)
            curve = mechanism.second(v) - arm.second(v)
            curve = np.einsum("nvu,ncvw,nwt->ncut", first, curve, first, optimize=True)
            q_uu = np.zeros((len(v), 2, 2 + m, 2 + m))
            q_uu[:, 1] = -np.einsum("nc,ncut->nut", inverse[:, 0], curve)
            return q_uu

        return LoopTerm(v[:, [0, known]], lambda: moved()[0][:, [0, known]], bend)

    def transmission_angle(self, q: Array, robot: RobotFacts) -> Array:
        """Angle between the velocity of the driven link's pivot, or of the lever's end, and what the passive joints
        allow; the smaller one, 0 where the loop cannot reach q."""
        v = self._inverse(q, robot)
        lost = np.isnan(v[:, 0])
        v = np.where(lost[:, None], 0.0, v)
        slope = self._gap(v, robot)[1]
        m = len(self.parameters(robot))
        passive = slope[:, :, 3 + m :]
        _, axes, arms, _ = self._ends(robot)[0].place(v)
        across = np.eye(3) - passive @ _left_inverse(passive)
        moving = np.stack([np.cross(axes[:, 0], arms[:, 0]), slope[:, :, 2 + m]], axis=2)
        sine = np.linalg.norm(across @ moving, axis=1) / np.maximum(np.linalg.norm(moving, axis=1), 1e-300)
        return np.where(lost, 0.0, np.arcsin(np.clip(sine.min(axis=1), 0.0, 1.0)))

    @property
    def smallest_transmission_angle(self) -> float:
        return self.margin

    def outline(self, q: Array, robot: RobotFacts) -> Array:
        v = self._inverse(q, robot)
        lost = np.isnan(v[:, 0])
        _, _, arms, _ = self._ends(robot)[0].place(np.where(lost[:, None], 0.0, v))
        pivots = np.array(self.at) + np.cumsum(np.concatenate([np.zeros((len(q), 1, 3)), arms], axis=1), axis=1)
        pivots[lost] = np.nan
        return np.stack([pivots[:, :-1], pivots[:, 1:]], axis=2)


def _left_inverse(columns: Array) -> Array:
    """(N, f, 3) that solves for f <= 3 independent columns (N, 3, f). Where they are not independent the answer
    is huge, not a silent choice: the step is then bounded, and the end is checked."""
    Q, R = np.linalg.qr(columns)
    diagonal = np.einsum("nii->ni", R)
    least = 1e-10 * np.maximum(np.abs(diagonal).max(axis=1, keepdims=True), 1e-300)
    np.copyto(diagonal, np.copysign(least, diagonal), where=np.abs(diagonal) < least)
    return np.linalg.solve(R, np.swapaxes(Q, 1, 2))


def _read_links(links: Any, at: Any) -> tuple[tuple[ChainLink, ...], tuple[float, float, float]]:
    """Links from a spec's list of mappings, or as they are. InputError with all problems."""
    listed = links
    if isinstance(links, tuple) and all(isinstance(link, ChainLink) for link in listed):
        return listed, at
    if not isinstance(links, list) or not 2 <= len(listed) <= 3 or not all(isinstance(e, Mapping) for e in listed):
        example = "[{name: lever, axis: [0, 1, 0], to_m: [-0.75, 0, 0]}, {name: bar, ...}]"
        raise InputError(Problem("closed_chain: links must be a list of two or three links", allowed=example))
    problems: list[Problem] = []
    read: list[ChainLink] = []
    for i, entry in enumerate(listed):
        name = entry.get("name")
        if not isinstance(name, str) or not name or name in [link.name for link in read]:
            problems.append(Problem(f"closed_chain: link {i + 1} needs a name of its own", found=repr(name)))
        axis = np.array(_vector(entry, "axis", {"axis": 1.0}, i, problems))
        if not axis.any():
            problems.append(Problem(f"closed_chain: the axis of link {i + 1} must not be zero"))
        to = _vector(entry, "to_m", {"to_m": 1.0, "to_mm": 1e-3}, i, problems)
        if i == 0 and ("at_m" in entry or "at_mm" in entry):
            at = _vector(entry, "at_m", {"at_m": 1.0, "at_mm": 1e-3}, i, problems)
        extra = set(entry) - {"name", "axis", "to_m", "to_mm"} - ({"at_m", "at_mm"} if i == 0 else set())
        if extra:
            allowed = "name, axis, to_m, to_mm; the first also at_m, at_mm"
            problems.append(
                Problem(f"closed_chain: unknown key in link {i + 1}", found=repr(min(extra)), allowed=allowed)
            )
        x, y, z = axis / max(float(np.linalg.norm(axis)), 1e-300)
        read.append(ChainLink(str(name), (float(x), float(y), float(z)), to))
    if problems:
        raise InputError(problems)
    return tuple(read), at


def _vector(
    entry: Mapping[str, Any], asked: str, factors: Mapping[str, float], index: int, problems: list[Problem]
) -> tuple[float, float, float]:
    """Three finite numbers under one of the keys, times its factor."""
    for key, factor in factors.items():
        value: Any = entry.get(key)
        listed = value
        numbers: list[Any] = list(listed) if isinstance(value, list | tuple) else []
        if len(numbers) == 3 and all(type(c) in (int, float) and np.isfinite(c) for c in numbers):
            return factor * numbers[0], factor * numbers[1], factor * numbers[2]
    problems.append(Problem(f"closed_chain: link {index + 1} needs {asked}: three numbers", found=repr(entry)))
    return 0.0, 0.0, 1.0
