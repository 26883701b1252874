"""What the planar loops share: parallel axes, implicit differentiation, and how a loop that does not close says so.

In the plane across the axes, seen from link 2 (x from the driver's axis A to the driven axis B):
the lever stands at psi on A, the rocker at rho on B, the bar joins their ends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from qsframework.plugin import Array, InputError, LoopTerm, Parameter, Problem, RobotFacts

FLAT = 1e-6
"""Sine of the transmission angle under which a loop counts as flat."""


def length_error(name: str) -> Parameter:
    """The error of a bar's length: .2 mm is what a drawing allows (ISO 2768-1, fine, beyond .4 m)."""
    return Parameter(name, "m", typical=1e-4, nominal_sd=1e-4, source="length error")


@lru_cache(maxsize=256)
def parallel_sign(robot: RobotFacts, driver: str, driven: str) -> float:
    """+1 where the axes of two joints point alike, -1 where opposed. InputError if they are not parallel."""
    first, second = robot.joint_index(driver), robot.joint_index(driven)
    rotation = between(robot, first, second)[:3, :3]
    cosine = float(robot.axes[first] @ rotation @ robot.axes[second])
    if second <= first:
        raise InputError(
            Problem(f"{driven} cannot be driven by {driver}: it comes before it in the arm", hint="Exchange the two.")
        )
    if abs(abs(cosine) - 1.0) > 1e-6:
        raise InputError(f"a loop needs parallel axes: {driver} and {driven} are not (cosine {cosine:.6f})")
    return float(np.sign(cosine))


@lru_cache(maxsize=256)
def link_length(robot: RobotFacts, driver: str, driven: str) -> float:
    """Distance (m) of two parallel axes at zero angles."""
    first, second = robot.joint_index(driver), robot.joint_index(driven)
    arm = between(robot, first, second)[:3, 3]
    axis = robot.axes[first]
    return float(np.linalg.norm(arm - axis * (axis @ arm)))


def planar_outline(robot: RobotFacts, driver: str, driven: str, q: Array, lever: Array, rocker: Array) -> Array:
    """Ends (N, 3, 2, 3) of lever, bar and rocker, as `Loop.outline` wants them, at joint angles q (N, 2).

    lever, rocker (2, N): length and angle from link 2 of each, about the driver's axis
    """
    k = robot.joint_index(driver)
    axis, arm = robot.axes[k], between(robot, k, robot.joint_index(driven))[:3, 3]
    arm = arm - axis * (axis @ arm)
    x = arm / np.linalg.norm(arm)
    y = np.cross(axis, x)

    def reach(length: Array, angle: Array) -> Array:
        turned = q[:, 0] + angle
        return length[:, None] * (np.cos(turned)[:, None] * x + np.sin(turned)[:, None] * y)

    zero = np.zeros(len(q))
    shoulder, elbow = reach(zero, zero), reach(zero + float(np.linalg.norm(arm)), zero)
    low, high = reach(*lever), elbow + reach(*rocker)
    return np.stack([np.stack(ends, axis=1) for ends in ((shoulder, low), (low, high), (elbow, high))], axis=1)


def between(robot: RobotFacts, first: int, second: int) -> Array:
    """(4, 4) frame of joint `second` in that of joint `first` at zero angles."""
    placement = np.eye(4)
    for k in range(first + 1, second + 1):
        placement = placement @ robot.placements[k]
    return placement


@dataclass(frozen=True, eq=False)
class Slopes:
    """An angle by its m variables y: first (N, m), and second (N, m, m) for those who ask for it."""

    first: Array
    bend: Callable[[], Array]

    @cached_property
    def second(self) -> Array:
        return self.bend()


def implicit(F_r: Array, F_y: Array, F_rr: Array, F_ry: Array, F_yy: Array) -> Slopes:
    """Differentiate F(rho, y) = 0 twice, from F's own derivatives; F_r must not be zero."""
    first = -F_y / F_r[:, None]

    def second() -> Array:
        mixed = F_ry[:, :, None] * first[:, None, :]
        bent = F_yy + mixed + mixed.transpose(0, 2, 1) + F_rr[:, None, None] * first[:, :, None] * first[:, None, :]
        return -bent / F_r[:, None, None]

    return Slopes(first, second)


@lru_cache(maxsize=256)
def _inputs(count: int, sign: float) -> tuple[Array, Array]:
    """y = (psi, lengths) by u = (phi_driver, phi_driven, lengths), (m, m + 1), where
    psi = constant + sign phi_driven - phi_driver; and its square by Kronecker's product."""
    y_u = np.zeros((count, count + 1))
    y_u[0, :2] = -1.0, sign
    y_u[1:, 2:] = np.eye(count - 1)
    return y_u, np.asarray(np.kron(y_u, y_u), dtype=np.float64)


def slope_by_inputs(slopes: Slopes, sign: float) -> Array:
    """The first derivatives by u (N, m + 1), see `_inputs`."""
    return (_inputs(slopes.first.shape[1], sign)[0].T @ slopes.first.T).T


def zeros(batch: int, *shape: int) -> Array:
    """(N, ...) zeros. What is of one entry at all poses lies together in memory: it is written and read so."""
    return np.moveaxis(np.zeros((*shape, batch)), -1, 0)


def bend_by_inputs(slopes: Slopes, sign: float) -> Array:
    """The second derivatives by u (N, m + 1, m + 1)."""
    batch, count = slopes.first.shape
    # one product of flat matrices: of small ones (N, m, m) numpy is several times slower
    flat = slopes.second.reshape(batch, count * count) @ _inputs(count, sign)[1]
    return flat.reshape(batch, count + 1, count + 1)


def driven_term(q_driver: Array, q_driven: Array, slopes: Callable[[], Slopes], sign: float) -> LoopTerm:
    """The loop over (driver, driven), where rho = constant + sign q_driven, with the slopes of rho."""

    def first() -> Array:
        by_u = slope_by_inputs(slopes(), sign)
        q_u = zeros(len(by_u), 2, by_u.shape[1])
        q_u[:, 0, 0] = 1.0
        q_u[:, 1] = sign * by_u
        return q_u

    def second() -> Array:
        by_u = bend_by_inputs(slopes(), sign)
        q_uu = np.zeros((len(by_u), 2, *by_u.shape[1:]))
        q_uu[:, 1] = sign * by_u
        return q_uu

    return LoopTerm(np.array([q_driver, q_driven]).T, first, second)


def with_branches(term: LoopTerm, turned: LoopTerm, own: Array) -> LoopTerm:
    """A loop over k joints and m bars that also turns b branches: by its own inputs, as `turned` has them, and by what
    theirs (N, b) add."""
    (batch, k), b = term.q.shape, own.shape[1]
    # its own inputs, k angles and the bars, among all: before the branches' angles and after them
    places = ((slice(0, k), slice(0, k)), (slice(k, None), slice(k + b, None)))

    def first() -> Array:
        q_u = zeros(batch, k + b, term.q_u.shape[2] + b)
        for i, at in places:
            q_u[:, :k, at], q_u[:, k:, at] = term.q_u[:, :, i], turned.q_u[:, :, i]
        q_u[:, range(k, k + b), range(k, k + b)] = 1.0
        return q_u

    def second() -> Array:
        inputs = term.q_uu.shape[2] + b
        q_uu = np.zeros((batch, k + b, inputs, inputs))
        for i, at in places:
            for j, to in places:
                q_uu[:, :k, at, to], q_uu[:, k:, at, to] = term.q_uu[:, :, i, j], turned.q_uu[:, :, i, j]
        return q_uu

    return LoopTerm(np.concatenate([term.q.T, (turned.q + own).T]).T, first, second)


@lru_cache(maxsize=256)
def branch_stands(robot: RobotFacts, driver: str, joints: tuple[str, ...]) -> tuple[float, Array]:
    """Sense of a branch's axis against the driver's, and where it stands across that axis (3,) m at zero angles.

    joints: the way to the branch from the link that carries the driver; the driver's frame. InputError where the
    branches do not hang on each other so, or their axes are not parallel.
    """
    k = robot.joint_index(driver)
    frame = np.asarray(np.linalg.inv(robot.placements[k]), dtype=np.float64)
    parent, along = robot.links[k], np.zeros(3)
    for joint in joints:
        branch = robot.branch(joint)
        if branch.parent != parent:
            raise InputError(Problem(f"{joint} hangs on the wrong link", found=branch.parent, allowed=parent))
        frame, parent = frame @ branch.placement, branch.link
        along = frame[:3, :3] @ branch.axis
    axis, at = robot.axes[k], frame[:3, 3]
    cosine = float(axis @ along)
    if abs(abs(cosine) - 1.0) > 1e-6:
        raise InputError(f"a loop needs parallel axes: {driver} and {joints[-1]} are not (cosine {cosine:.6f})")
    return float(np.sign(cosine)), at - axis * (axis @ at)


def refuse(
    name: str, what: str, bad: npt.NDArray[np.bool_], angles: Array, names: tuple[str, ...], bars: Array | None = None
) -> None:
    """InputError if any pose is bad (N,), with the angles (N, k) of the first of them."""
    if not bad.any():
        return
    first = int(np.flatnonzero(bad)[0])
    pose = ", ".join(f"{n} {np.rad2deg(a):.2f} deg" for n, a in zip(names, angles[first], strict=True))
    errors = ""
    if bars is not None and bars.size and np.any(bars[first]):
        errors = " with bar errors of " + ", ".join(f"{1e3 * b:.3f} mm" for b in bars[first])
    raise InputError(
        Problem(
            f"{name} {what} at {int(bad.sum())} of {len(bad)} poses, first at pose {first + 1}: {pose}{errors}",
            hint="Check the bar lengths, the angles at zero and the branch, or leave this pose out.",
        )
    )
