"""A comparison of robots in words."""

from __future__ import annotations

import numpy as np

from qsframework.report.blocks import Mark, Verdict
from qsframework.report.words.sizes import mm
from qsframework.uses.compare import Compared, Comparison

_SHOWN = 4


def comparison_verdict(result: Comparison) -> Verdict:
    """Which robot moves least under the task's force, of those that reach the whole path."""
    whole = sorted((r for r in result.robots if np.isfinite(r.task).all()), key=lambda r: float(r.task.max()))
    short = [r for r in result.robots if not np.isfinite(r.task).all()]
    missing = f"; {' and '.join(r.robot.name for r in short)} cannot reach all of the path" if short else ""
    numbers = tuple((_worst(r), f"{r.robot.name}, largest along the path") for r in [*whole, *short][:_SHOWN])
    if not whole:
        return Verdict(
            Mark.BAD, "No robot reaches the path", f"None of them reaches all of the path{missing}.", numbers
        )
    best, others = whole[0], whole[1:]
    against = (
        f", against {', '.join(f'{mm(float(r.task.max()))} mm of {r.robot.name}' for r in others)}" if others else ""
    )
    said = f"{best.robot.name} moves least along the path: at most {mm(float(best.task.max()))} mm{against}{missing}."
    if short:
        return Verdict(Mark.LOOK, "Not all robots reach the path", said, numbers)
    return Verdict(Mark.GOOD, "All robots reach the path", said, numbers)


def _worst(r: Compared) -> str:
    there = r.task[np.isfinite(r.task)]
    return f"{mm(float(there.max()))} mm" if len(there) else "not reached"
