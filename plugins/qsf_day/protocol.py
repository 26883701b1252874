"""How a plan is measured: which state of which pose after which, and the file of readings to fill in.

At every visit under a load the markers are read unloaded, loaded, unloaded, loaded, unloaded: two cycles. Unloaded
state c and loaded state c make one displacement; what the unloaded states differ by is drift and hysteresis, which no
fit could tell from compliance. Where positions are planned they are read once a visit, from the plan's station.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import compress
from pathlib import Path

import numpy as np

from qsf_day.options import ProtocolOptions
from qsframework.arguments import checked
from qsframework.errors import InputError, Problem
from qsframework.experiment import (
    HALF_LOAD,
    STATES,
    WRENCH_NAMES,
    Experiment,
    Plan,
    joint_cells,
    number,
    seen_markers,
    write_table,
)
from qsframework.plans import check_plan, load_name, payload_notes, visits, with_repeats
from qsframework.plugin import Array
from qsframework.units import JointUnits

"""Before the name of a load: half its weight."""
_READ = 20.0
_HANDLE = 60.0
"""Seconds that a reading of all markers and a change of the load take, for the estimate of the whole."""


@dataclass(frozen=True, eq=False)
class ProtocolState:
    """One state to read: load_id "" is unloaded; wrench (6,)."""

    cycle: int
    load_id: str
    wrench: Array

    @property
    def loaded(self) -> bool:
        return self.load_id != ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Visit:
    """One stay at a pose: its states in the order in which they are read; pendant (n,) rad.

    markers: those that are read, which the station sees; station: "" where none is named
    """

    number: int
    pose: str
    repeat: int
    pendant: Array
    load: str
    wrench: Array
    states: tuple[ProtocolState, ...]
    markers: tuple[str, ...]
    station: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Protocol:
    """The visits of a campaign."""

    robot: str
    title: str
    units: JointUnits
    visits: tuple[Visit, ...]
    options: ProtocolOptions
    markers: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def readings(self) -> int:
        """How many positions of markers are read, without the floor's reflectors."""
        return sum(len(v.states) * len(v.markers) for v in self.visits)

    @property
    def loaded(self) -> bool:
        """Whether a load hangs at any visit."""
        return any(v.load for v in self.visits)

    @property
    def stations(self) -> tuple[str, ...]:
        """The named stations, in the order of the visits."""
        return tuple(dict.fromkeys(v.station for v in self.visits if v.station))

    @property
    def repeated(self) -> tuple[str, ...]:
        """Poses that are visited more than once."""
        return tuple(dict.fromkeys(v.pose for v in self.visits if v.repeat > 1))

    @property
    def hours(self) -> float:
        """About how long it takes, with the warm-up."""
        states = sum(len(v.states) for v in self.visits if v.load)
        seconds = states * (self.options.settle + _READ + _HANDLE) + len(self.visits) * (self.options.settle + _READ)
        seconds += _READ * sum(len(v.states) for v in self.visits if not v.load)
        return (seconds + 60.0 * self.options.warm_up) / 3600.0


@checked
def make_protocol(
    experiment: Experiment, plan: Plan, options: ProtocolOptions | None = None, file: str = ""
) -> Protocol:
    """The order and the states of a measuring campaign.

    Args:
        experiment: the campaign.
        plan: its plan.
        options: order, cycles, repeats and the like.
        file: the plan's name, for the sheet.

    Returns:
        The visits with their states.

    Raises:
        InputError: for a plan that the robot must not carry out.
    """
    options = options or ProtocolOptions()
    check_plan(experiment, plan, file)
    if plan.of_positions.any() and not experiment.plans_positions:
        bare = [p for p, w in zip(plan.pose, plan.of_positions, strict=True) if w]
        hint = "`positions: {}` in the experiment plans positions without a load."
        message = f"no load at {', '.join(bare)}: nothing would bend the arm"
        raise InputError(Problem(message, file or None, hint=hint))
    names = tuple(m.name for m in experiment.markers)
    visible = seen_markers(experiment, plan.q, plan.stations)
    plan = with_repeats(plan, options.repeat_share, options.seed)
    counts: Counter[int] = Counter()
    out: list[Visit] = []
    for place, i in enumerate(visits(plan, options.order, options.seed), start=1):
        counts[i] += 1
        load, wrench, states = load_name(plan, i), plan.wrench[i], list[ProtocolState]()
        for cycle in range(1, options.cycles + 1) if not plan.of_positions[i] else ():
            states.append(ProtocolState(cycle, "", np.zeros(6)))
            if options.half and plan.repeats[i] > 1:
                states.append(ProtocolState(cycle, HALF_LOAD + load, 0.5 * wrench))
            states.append(ProtocolState(cycle, load, wrench))
        last = 1 if plan.of_positions[i] else options.cycles + 1
        out.append(
            Visit(
                number=place,
                pose=plan.pose[i],
                repeat=counts[i],
                pendant=plan.pendant[i],
                load=load,
                wrench=wrench,
                states=(*states, ProtocolState(last, "", np.zeros(6))),
                markers=tuple(compress(names, visible[i])),
                station=plan.stations[i],
            )
        )
    return Protocol(
        robot=experiment.robot.name,
        title=experiment.robot.title,
        units=experiment.robot.controller.units,
        visits=tuple(out),
        options=options,
        markers=names,
        notes=payload_notes(experiment),
    )


def row_start(protocol: Protocol, visit: Visit, state: ProtocolState, pendant: Array, wrench: Array) -> dict[str, str]:
    """The first cells of a row of readings by their columns: a pose, its angles (n,) and the load (6,) of a state."""
    angles = zip(protocol.units.names(), joint_cells(pendant, protocol.units), strict=True)
    loads = map(number, wrench.tolist()) if state.loaded else [""] * 6
    return {"pose": visit.pose, **dict(angles), **dict(zip(WRENCH_NAMES, loads, strict=True))}


def write_reading_file(path: Path, protocol: Protocol) -> None:
    """The table to fill in: one row per state and marker in the order of reading; no position, time or temperature."""
    rows = [
        {
            **row_start(protocol, visit, state, visit.pendant, state.wrench),
            "marker": marker,
            "state": STATES[state.loaded],
            **dict.fromkeys(("x_mm", "y_mm", "z_mm"), ""),
            "load_id": state.load_id,
            **({"series": visit.station} if protocol.stations else {}),
            "repeat": str(visit.repeat),
            "cycle": str(state.cycle),
            "use": "1",
            **dict.fromkeys(("time_s", "temperature_degC"), ""),
            "drive_state": protocol.options.drive,
        }
        for visit in protocol.visits
        for state in visit.states
        for marker in visit.markers
    ]
    write_table(path, list(rows[0]), [list(row.values()) for row in rows], [f"robot: {protocol.robot}"])


def write_floor_file(path: Path, protocol: Protocol) -> None:
    """The table of the floor's reflectors to fill in: all of them at the start of every visit."""
    rows = [
        [str(v.number), v.pose, str(v.repeat), f"floor_{k + 1}", "", "", "", ""]
        for v in protocol.visits
        for k in range(protocol.options.reflectors)
    ]
    write_table(
        path,
        ["visit", "pose", "repeat", "reflector", "x_mm", "y_mm", "z_mm", "time_s"],
        rows,
        [f"robot: {protocol.robot}"],
    )
