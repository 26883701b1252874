"""The sheet on the clipboard: what is done before, at and between the poses, with boxes to tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.applications.protocol import Protocol, Visit
from qsframework.report.blocks import Section, Table, Text

_BOX = "\u2610"


@dataclass(frozen=True)
class Commands:
    """How the sheet says that the programme and the one of the warm-up are made, and what is run afterwards."""

    programme: str
    warm_up: str
    identify: str


def protocol_sections(protocol: Protocol, readings: str, floor: str, commands: Commands) -> tuple[Section, ...]:
    """Before, at each pose, the visits, and what to do with the file."""
    return (
        _before(protocol, commands),
        _at_each_pose(protocol, readings, floor),
        _visits(protocol),
        _states(protocol),
        _after(readings, commands),
    )


def _steps(title: str, steps: list[str], caption: str = "") -> Table:
    rows = tuple((f"{k}", _BOX, step) for k, step in enumerate(steps, start=1))
    return Table((title, "done", "what"), rows, caption)


def _before(protocol: Protocol, commands: Commands) -> Section:
    wish = protocol.wish
    first = protocol.visits[0]
    people = (
        "Nobody stands in the reach of the arm or under the weight while the arm moves or the weight hangs. One person "
        "holds the enabling switch and speaks before every move; the others answer before it starts."
    )
    steps = [
        "Fence, emergency stop and enabling switch tested. The weight, its rope and hook are rated for the load.",
        "Load data of tool and weight set on the controller; mastering unchanged since the last service.",
        f"Tracker on for as long as its maker asks; {wish.reflectors} reflectors fixed to the floor around the robot, "
        "as far apart as the tracker sees.",
        f"The programme drives in this sheet's order: {commands.programme}. At every stop it names the load "
        "and waits for the start button. Run once slowly without the weight.",
        f"Warm-up: {wish.warm_up:g} min without the weight, at measuring speed: {commands.warm_up}.",
        f"Preload: at pose {first.pose} the weight on and off once, not read. The gears settle on one side.",
        f"Drive state while reading: {wish.drive}. The same for both states of every reading; note any change.",
        "Every pose is reached from the same side: the programme's own way, without jogging in between.",
    ]
    hours = f"About {protocol.hours:.1f} hours in all: {len(protocol.visits)} visits, {protocol.readings} readings."
    notes = (Text(f"Note: {n}.") for n in protocol.notes)
    return Section("Before", (Text(people), *notes, Text(hours), _steps("before", steps)))


def _at_each_pose(protocol: Protocol, readings: str, floor: str) -> Section:
    wish = protocol.wish
    half = "At visits marked 'half', first half of the weight, read, then all of it. " if wish.half else ""
    steps = [
        "The arm arrives without the weight. People clear. Compare the pendant's angles with the sheet.",
        f"Wait {wish.settle:g} s. Read the reflectors on the floor ({floor}).",
        f"Unloaded: read all markers ({', '.join(protocol.markers)}), write the time and the temperature ({readings}).",
        f"{half}Weight on, without a push. Wait {wish.settle:g} s. Loaded: read all markers.",
        f"Weight off. Wait {wish.settle:g} s. Unloaded: read all markers.",
        f"Cycles: {wish.cycles}, so weight on and off {wish.cycles} times; the last state is unloaded.",
        "A reading that went wrong is not overwritten: write 0 in its column use, and why in your own notes.",
    ]
    weight = (
        "The weight never travels with the arm. Between poses it hangs from the crane or stands on its trolley, away "
        "from the way; it comes back when the arm stands still and the drives hold. A side pull is slackened first, "
        "then unhooked."
    )
    return Section("At each pose", (_steps("at each pose", steps), Text(weight)))


def _visits(protocol: Protocol) -> Section:
    n = len(protocol.visits[0].pendant)
    header = ("visit", "done", "pose", "time", *(f"J{k + 1} deg" for k in range(n)), "load", "force N")
    rows = tuple(_visit_row(v) for v in protocol.visits)
    wish = protocol.wish
    order = {
        "random": f"The order is random (seed {wish.seed}), so that drift cannot pass for an effect of the pose.",
        "shortest": "The order is a short way; a drift over the day may then look like an effect of the pose.",
        "plan": "The order is the plan's.",
    }[wish.order]
    again = f"Visited again later: {', '.join(protocol.repeated) or 'none'}. Keep to the order, also after a break."
    return Section("Visits", (Text(f"{order} {again}"), Table(header, rows, "Angles as the pendant shows them.")))


def _visit_row(visit: Visit) -> tuple[str, ...]:
    half = " (half, too)" if any(s.loaded and s.load_id != visit.load for s in visit.states) else ""
    name = visit.pose if visit.repeat == 1 else f"{visit.pose}, repeat {visit.repeat}"
    angles = (f"{a:.2f}" for a in np.rad2deg(visit.pendant))
    force = ", ".join(f"{f:.0f}" for f in visit.wrench[:3])
    return (str(visit.number), _BOX, name, "", *angles, visit.load + half, force)


def _states(protocol: Protocol) -> Section:
    kinds: dict[tuple[tuple[int, str], ...], list[str]] = {}
    for v in protocol.visits:
        label = tuple(
            (s.cycle, "unloaded" if not s.loaded else "loaded" if s.load_id == v.load else "half load")
            for s in v.states
        )
        kinds.setdefault(label, []).append(str(v.number))
    rows = tuple(
        (", ".join(numbers), " - ".join(f"{what} {c}" for c, what in label)) for label, numbers in kinds.items()
    )
    caption = "The number is the cycle: unloaded c and loaded c make one displacement."
    return Section("States of a visit", (Table(("visits", "states in this order"), rows, caption),))


def _after(readings: str, commands: Commands) -> Section:
    text = (
        f"Name {readings} as `data:` in the experiment and run qsf check on it before any fit: it tells the "
        "repeatability, what did not come back after unloading, whether half the load gives half the deflection, and "
        "whether the floor's reflectors moved. Columns that nobody filled in may stay empty; rows not measured get 0 "
        f"in the column use. Then {commands.identify}."
    )
    return Section("After", (Text(text),))
