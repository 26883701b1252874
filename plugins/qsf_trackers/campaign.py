"""What was to be measured: poses with their angles, loads and their order, from a plan or a table to fill in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import compress
from pathlib import Path

import numpy as np

from qsframework.errors import refuse
from qsframework.experiment import (
    WRENCH,
    XYZ,
    Experiment,
    header_of,
    joint_stems,
    read_plan,
    read_table,
    seen_markers,
    state_columns,
)
from qsframework.plugin import Array


@dataclass(frozen=True)
class PlanSlot:
    """One reading of one marker at one state; load_id "" where unloaded or where a pose has one load."""

    pose: str
    marker: str
    loaded: bool
    load_id: str = ""
    repeat: int = 1
    cycle: int = 1


@dataclass(frozen=True, eq=False, kw_only=True)
class Campaign:
    """poses: pendant angles (n,) rad by name; loads: wrenches (6,) by pose and load; order: what is read after what.

    names: what the load of a pose is called, by pose and load_id; drive: of each slot, where the table says it;
    exact: whether `order` is what is to be measured to the last reading, and not only once for each repeat
    """

    poses: Mapping[str, Array]
    loads: Mapping[str, Mapping[str, Array]]
    order: tuple[PlanSlot, ...]
    names: Mapping[str, Mapping[str, str]]
    exact: bool = False
    drive: Mapping[PlanSlot, str] | None = None
    source: Path | None = None
    stations: Mapping[str, str] = field(default_factory=dict[str, str])
    """Of poses whose station is named: the series of their points, where these name none."""

    @cached_property
    def slots(self) -> frozenset[PlanSlot]:
        """What is to be measured, in no order."""
        return frozenset(self.order)


EMPTY = Campaign(poses={}, loads={}, order=(), names={})


def read_campaign(path: Path, experiment: Experiment) -> Campaign:
    """A plan.csv, or the table of states that `qsf protocol` writes."""
    return (_of_table if "state" in header_of(path) else _of_plan)(path, experiment)


def _of_plan(path: Path, experiment: Experiment) -> Campaign:
    """Every pose unloaded and then loaded, all markers each time, as often as the plan repeats it; where the experiment
    has no load, none hung."""
    plan = read_plan(path, experiment)
    visible = seen_markers(experiment, plan.q, plan.stations)
    loads = {p: {"": w} for p, w in zip(plan.pose, plan.wrench, strict=True) if np.any(w) and experiment.has_load}
    order = tuple(
        PlanSlot(pose, marker, loaded, repeat=repeat)
        for pose, repeats, flags in zip(plan.pose, plan.repeats, visible, strict=True)
        for repeat in range(1, repeats + 1)
        for loaded in ((False, True) if pose in loads else (False,))
        for marker in compress(experiment.marker_names, flags)
    )
    return Campaign(
        poses=dict(zip(plan.pose, plan.pendant, strict=True)),
        loads=loads,
        order=order,
        names={p: {"": name} for p, name in zip(plan.pose, plan.load, strict=True)},
        source=path,
        stations=dict(zip(plan.pose, plan.station, strict=True)) if plan.station else {},
    )


def _of_table(path: Path, experiment: Experiment) -> Campaign:
    table = read_table(path, state_columns(experiment), experiment.robot.name)
    refuse([p for p in table.problems if p.column not in {table.names.get(a) for a in XYZ}])
    pendant = table.columns(joint_stems(experiment.robot.controller.axes))
    wrench = np.nan_to_num(table.columns(WRENCH, 0.0))
    loaded = [state == "loaded" for state in table.text("state")]
    words = [table.text("pose"), table.text("marker"), loaded, table.text("load_id")]
    slots = list(map(PlanSlot, *words, table.counts("repeat"), table.counts("cycle")))
    wrenches: dict[str, dict[str, Array]] = {}
    for slot, force in zip(slots, wrench, strict=True):
        if slot.loaded:
            wrenches.setdefault(slot.pose, {}).setdefault(slot.load_id, force)
    drives, series = table.texts.get("drive_state"), table.text("series")
    return Campaign(
        poses=dict(zip(reversed([s.pose for s in slots]), reversed(list(pendant)), strict=True)),
        loads=wrenches,
        order=tuple(slots),
        names={pose: {load: load for load in own} for pose, own in wrenches.items()},
        exact=True,
        drive=None if drives is None else dict(zip(slots, drives, strict=True)),
        source=path,
        stations={slot.pose: name for slot, name in zip(slots, series, strict=True) if name},
    )
