"""Robots side by side: how far each gives over a slice of the workspace and along a path, and how well as many
measured poses would tell its parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.arguments import checked
from qsframework.elastostatics import Model, cartesian_compliance, equilibrium, make_model, range_notes
from qsframework.errors import InputError, NotCertified, NotConverged, NotIdentifiable
from qsframework.experiment import Constraints, Experiment, LoadCase, Marker, NoiseModel, Plan
from qsframework.information import predicted_sd
from qsframework.option import Seed
from qsframework.plans import DesignOptions, design
from qsframework.plans.need import tip_variances
from qsframework.plugin import Array, Parameter, Poses
from qsframework.plugin.facts import frozen
from qsframework.robot import Robot, as_robot
from qsframework.robot.collision import Flags, above_floor, make_collider
from qsframework.robot.kinematics import joint_frames
from qsframework.uses.inverse import Free, Reached, ReachTool, poses_at, reach, tool_of
from qsframework.uses.task import Task
from qsframework.viewed import Viewed
from qsframework.work import HERE, Work, run

_SPREAD = 0.2
"""m: the campaign's three reflectors stand this far from the load point, along the axes of the last link."""
_EFFICIENCY = 0.99
Tell = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False, kw_only=True)
class Compared:
    """One robot. NaN where it does not reach.

    deflection (C,) m and softest (C,) N/m: of the map's C cells (z, then x); pendant (P, n) rad: along the path
    touching: cells of the map that it would reach if it could touch itself or the floor
    task (P,) m: the load point's way from unloaded to loaded; after (P,) m: expected error after compensation with a
    fit of the campaign, NaN without one; sds: of the parameters, with `campaign` in words
    """

    robot: Robot
    deflection: Array
    softest: Array
    pendant: Array
    task: Array
    after: Array
    parameters: tuple[Parameter, ...]
    sds: Array
    campaign: str
    notes: tuple[str, ...]
    touching: int = 0

    @property
    def reached(self) -> Flags:
        """Which cells of the map it reaches (C,)."""
        return np.isfinite(self.deflection)


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Viewed):
    """All robots on one task."""

    task: Task
    robots: tuple[Compared, ...]

    @property
    def shared(self) -> Flags:
        """Cells of the map that every robot reaches (C,)."""
        return np.logical_and.reduce([r.reached for r in self.robots])

    def as_json(self) -> dict[str, Any]:
        """Millimetres, N/um and the parameters' SI units."""
        shared = self.shared
        return {
            "task": self.task.title,
            "map": {"x_m": self.task.map_x.tolist(), "z_m": self.task.map_z.tolist(), "y_m": self.task.map_y},
            "shared_cells": int(shared.sum()),
            "robots": {r.robot.name: _robot_json(r, shared) for r in self.robots},
        }


def _robot_json(r: Compared, shared: Flags) -> dict[str, Any]:
    def listed(values: Array, scale: float) -> list[float | None]:
        return [float(v * scale) if np.isfinite(v) else None for v in values]

    def over(values: Array, how: Callable[[Array], Any]) -> float | None:
        known = values[np.isfinite(values)]
        return float(how(known)) if len(known) else None

    return {
        "cells_reached": int(r.reached.sum()),
        "cells_only_touching_itself_or_the_floor": r.touching,
        "deflection_mm": listed(r.deflection, 1e3),
        "softest_N_per_um": listed(r.softest, 1e-6),
        "shared_mean_deflection_mm": over(r.deflection[shared] * 1e3, np.mean),
        "shared_softest_N_per_um": over(r.softest[shared] * 1e-6, np.min),
        "task_points_reached": int(np.isfinite(r.task).sum()),
        "task_mean_mm": over(r.task * 1e3, np.mean),
        "task_worst_mm": over(r.task * 1e3, np.max),
        "after_compensation_mean_mm": over(r.after * 1e3, np.mean),
        "after_compensation_worst_mm": over(r.after * 1e3, np.max),
        "task_deflection_mm": listed(r.task, 1e3),
        "task_after_compensation_mm": listed(r.after, 1e3),
        "campaign": r.campaign,
        "sds": {
            p.name: {"sd": float(s) if np.isfinite(s) else None, "unit": p.unit, "nominal": p.nominal}
            for p, s in zip(r.parameters, r.sds, strict=True)
        },
        "notes": list(r.notes),
    }


@checked
def compare(
    robots: Sequence[Robot | str | Path],
    task: Task,
    seed: Seed = 0,
    tell: Tell | None = None,
    notes: Mapping[str, Sequence[str]] | None = None,
    work: Work = HERE,
) -> Comparison:
    """Compare robots on a task, each by its nominal parameters (see `with_fit`).

    Args:
        robots: two or more, each a Robot, its name, or its path, which may be relative to the task's file.
        task: path, map and campaign.
        seed: random seed of the candidates of the campaign.
        tell: called with each step, its number and how many there are.
        notes: more to say, by the robot's name.
        work: where it is computed, robot by robot.

    Returns:
        Deflections, m, in the map and along the path, and predicted sds.

    Raises:
        InputError: where a robot is not found or cannot do the task's campaign.
    """
    arms = [as_robot(robot, task.path.parent) for robot in robots]
    names = [r.name for r in arms]
    if len(set(names)) != len(names) or len(names) < 2:
        raise InputError(f"compare needs two or more different robots, found {', '.join(names)}")
    tell = tell or (lambda label, done, total: None)
    out: list[Compared] = []
    tell("robots", 0, len(arms))
    for values in run(_computed, (tuple(arms), task, seed), range(len(arms)), work):
        robot = arms[len(out)]
        parameters = campaign_of(robot, task, tool_of(robot, task.tool)).fit_parameters()
        values["notes"] += tuple((notes or {}).get(robot.name, ()))
        out.append(Compared(robot=robot, parameters=parameters, **values))
        tell("robots", len(out), len(arms))
    return Comparison(task, tuple(out))


def _computed(shared: tuple[tuple[Robot, ...], Task, int], k: int) -> dict[str, Any]:
    """All of `Compared` for robot k but what the robot itself says."""
    robot, task, seed = shared[0][k], *shared[1:]
    tool = tool_of(robot, task.tool)
    experiment = campaign_of(robot, task, tool)
    model = tip_model(robot, tool)
    free = _free(robot, task)
    deflection, softest, touching, mapped = _map(robot, model, tool, task, seed, free)
    path = reach(robot, model, tool, task.points, task.directions, seed, free)
    points = np.flatnonzero(path.good)
    poses = poses_at(robot, path.pendant, task.wrenches).take(points)
    moved, after = np.full((2, len(path.pendant)), np.nan)
    moved[points] = _deflections(model, poses)
    sds = np.full(len(experiment.fit_names()), np.nan)
    plan, campaign = _designed(experiment, task, poses if len(points) else None, seed)
    if plan is not None:
        sds = predicted_sd(experiment, plan)
        if len(points):
            variances, _ = tip_variances(experiment, plan, poses, tool.site, poses.pendant, free=False)
            after[points] = np.sqrt(variances)
    beyond = range_notes(model, poses, [f"point {i + 1} of the path" for i in points])
    return {
        "deflection": deflection,
        "softest": softest,
        "pendant": frozen(path.pendant),
        "task": moved,
        "after": after,
        "sds": sds,
        "campaign": campaign,
        "notes": (*_notes(robot, task, path, touching), *beyond, *mapped),
        "touching": touching,
    }


def _free(robot: Robot, task: Task) -> Free:
    """Which joint angles keep the arm's simple solids apart and above the floor."""
    collider = make_collider(robot)

    def free(q: Array) -> Flags:
        placed = joint_frames(robot.facts, q)
        clear = ~collider.collides(placed)
        return clear if task.floor is None else clear & above_floor(robot.shapes, placed, task.floor)

    return free


def campaign_of(robot: Robot, task: Task, tool: ReachTool) -> Experiment:
    """The task's campaign on a robot: the load hung beside the tool, three reflectors around it."""
    link = robot.facts.links[tool.site.link]
    side = np.eye(3)[int(np.argmin(np.abs(tool.axis)))]
    side = side - (side @ tool.axis) * tool.axis
    hung = tool.site.xyz + task.campaign.lever * side / np.linalg.norm(side)
    load_point = (np.linalg.inv(robot.flange.placement) @ np.append(hung, 1.0))[:3]
    markers = tuple(Marker(f"m{k + 1}", link, frozen(tool.site.xyz + _SPREAD * np.eye(3)[k])) for k in range(3))
    loads = tuple(LoadCase(s.name, frozen(s.wrench()), s.poses, s.poses_min, cost=s.cost) for s in task.campaign.loads)
    return Experiment(
        path=task.path,
        robot=robot,
        load_point=frozen(load_point),
        markers=markers,
        noise=NoiseModel(task.campaign.sigma),
        loads=loads,
        effects=(),
        parameters=(),
        fit=None,
        constraints=Constraints(load_capacity=False),
        data=(),
    )


def _map(
    robot: Robot, model: Model, tool: ReachTool, task: Task, seed: int, free: Free
) -> tuple[Array, Array, int, tuple[str, ...]]:
    """Deflection (C,) m, the stiffness (C,) N/m in the most compliant direction, the cells that are reached only by
    touching, and what is asked beyond where a law holds."""
    z, x = (a.ravel() for a in np.meshgrid(task.map_z, task.map_x, indexing="ij"))
    points = np.stack([x, np.full(len(x), task.map_y), z], axis=1)
    found = reach(robot, model, tool, points, np.tile(task.map_direction, (len(x), 1)), seed, free)
    pendant, reached = found.pendant, found.good
    wrench = np.tile(np.concatenate([task.map_force, np.zeros(3)]), (len(x), 1))
    poses = poses_at(robot, pendant, wrench).take(reached)
    deflection, softest = np.full(len(x), np.nan), np.full(len(x), np.nan)
    moved = _deflections(model, poses)
    stable = np.isfinite(moved)
    deflection[reached] = moved
    if stable.any():
        compliance = cartesian_compliance(model, poses.take(stable))[:, :3, :3]
        softest[np.flatnonzero(reached)[stable]] = 1.0 / np.linalg.svd(compliance, compute_uv=False)[:, 0]
    cells = [f"the cell at x {x[i]:.2f}, z {z[i]:.2f} m" for i in np.flatnonzero(reached)]
    return deflection, softest, int(found.blocked.sum()), range_notes(model, poses, cells)


def _deflections(model: Model, poses: Poses) -> Array:
    """Way (N,) m of the load point from unloaded to loaded, full equilibrium; NaN where the load is not carried."""
    if not len(poses):
        return np.zeros(0)
    try:
        moved = equilibrium(model, poses).tip - equilibrium(model, poses, loaded=False).tip
    except NotConverged:
        if len(poses) == 1:
            return np.full(1, np.nan)
        return np.concatenate([_deflections(model, poses.take([i])) for i in range(len(poses))])
    return np.asarray(np.linalg.norm(moved, axis=1))


def _designed(experiment: Experiment, task: Task, work: Poses | None, seed: int) -> tuple[Plan | None, str]:
    """The campaign's plan, best for the tip along the path (the parameters, if none of it is reached), or why none."""
    options = DesignOptions(criterion="D" if work is None else "I", efficiency=_EFFICIENCY, polish=False)
    count = task.campaign.poses
    try:
        plan = design(
            experiment, count, candidates=task.campaign.candidates, seed=seed, options=options, test_poses=work
        )
    except (InputError, NotIdentifiable, NotCertified) as error:
        return None, f"no plan of {count} poses: {error}"
    best = "the parameters: no point of the path is reached" if work is None else "the tip along the path"
    return plan, f"{count} poses under {', '.join(dict.fromkeys(plan.load))}, best for {best}"


def tip_model(robot: Robot, tool: ReachTool) -> Model:
    """A robot's model with the load at the tool, and one marker there."""
    return make_model(robot.facts, robot.effects, robot.parameters, tool.site, [("tip", tool.site)], robot.gravity)


def _notes(robot: Robot, task: Task, found: Reached, touching: int) -> tuple[str, ...]:
    reached = found.good
    notes: list[str] = []
    if not reached.all():
        missed = ", ".join(str(i + 1) for i in np.flatnonzero(~reached))
        touch = " without touching itself or the floor" if (found.blocked & ~reached).any() else ""
        notes.append(f"does not reach point {missed} of the path in this direction{touch}")
    if touching:
        notes.append(f"{touching} cells of the map excluded for collision with the arm itself or the floor")
    if not robot.shapes:
        notes.append("its URDF has no simple solids: nothing was checked for collisions")
    if robot.payload is None:
        notes.append("its payload is not stated: the forces were not checked against it")
    else:
        most = robot.payload * float(np.linalg.norm(robot.gravity))
        forces = [*task.wrenches[:, :3], task.map_force, *(np.array(s.wrench()[:3]) for s in task.campaign.loads)]
        largest = max(float(np.linalg.norm(f)) for f in forces)
        if largest > most:
            notes.append(f"its payload, {robot.payload:g} kg, is less than the {largest:.0f} N of the task or campaign")
    sources = [p.source for p in robot.parameters if "identified: " in p.source]
    if sources:
        notes.append(
            f"with identified values of {', '.join(dict.fromkeys(s.removeprefix('identified: ') for s in sources))}"
        )
    if assumed := dict.fromkeys(p.name.split("[")[0] for p in robot.parameters if p.source.startswith("assumed")):
        notes.append(f"values assumed, not measured: {', '.join(assumed)}; results rest on these values")
    return tuple(notes)
