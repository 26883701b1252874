"""A robot in a report: its joints and effects, and how it looks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.report.blocks import ReportTable, SceneView, Section
from qsframework.report.words.sizes import number
from qsframework.robot import Robot
from qsframework.viz import robot_row

_LOOK = "Look whether the joints turn about the right axes, and whether bars and balancer hang as on the machine."


def joint_table(robot: Robot) -> ReportTable:
    """Limits as the pendant shows them, and the largest torque."""
    c, most = robot.controller, robot.torque_limits
    most = np.full(robot.facts.n, np.inf) if most is None else most
    torque = [number(t, ".4g") for t in most]
    limits = dict(zip(robot.facts.driven, c.units.shown([c.lower, c.upper]).T, strict=True))
    ends = [[f"{v:.4g}" for v in limits[j]] if j in limits else ["follows", "-"] for j in robot.facts.joints]
    rows = [(j, *own, t) for j, own, t in zip(robot.facts.joints, ends, torque, strict=True)]
    head = ("joint", "from deg", "to deg", "torque limit N m")
    if any(robot.facts.sliding):
        units = [robot.facts.units[k] for k in range(robot.facts.n)]
        rows = [(j, low, high, u.shown, t, u.load) for (j, low, high, t), u in zip(rows, units, strict=True)]
        head = ("joint", "from", "to", "unit", "largest load", "its unit")
    carried = "no payload is stated" if robot.payload is None else f"payload {robot.payload:g} kg"
    return ReportTable(
        head,
        tuple(rows),
        f"Limits of what the pendant shows; {carried}.",
    )


def robots_table(robots: Sequence[Robot]) -> ReportTable:
    """One row per robot."""
    rows: list[tuple[str, ...]] = []
    for r in robots:
        assumed = sum("assumed" in p.source.lower() for p in r.parameters if p.nominal)
        valued = sum(1 for p in r.parameters if p.nominal)
        kinds = ", ".join(dict.fromkeys(e.effect_name() for e in r.effects))
        payload = "-" if r.payload is None else f"{r.payload:g}"
        rows.append((r.name, r.title, str(r.facts.n), payload, f"{assumed} of {valued}", kinds))
    return ReportTable(
        ("robot", "title", "joints", "payload kg", "values assumed", "effects"),
        tuple(rows),
        "Assumed values stand where no measurement is published: what is computed from them is no better.",
    )


def robots_section(robots: Sequence[Robot]) -> Section:
    """A table of robots and a scene that shows them one at a time."""
    views = (SceneView(robot_row(robots).html(), _SLIDE, robots_table(robots)),) if robots else ()
    return Section("Robots", views)


_SLIDE = "The slider goes through the robots at zero angles, or the nearest allowed. " + _LOOK


def robot_section(robot: Robot) -> Section:
    """One robot with its joints."""
    return Section(robot.title, (SceneView(robot_row([robot]).html(), _LOOK, joint_table(robot)),))
