"""The sheet on the clipboard: what is done before, at and between the poses, with boxes to tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from qsf_day.protocol import Protocol, Visit
from qsframework.files import sha256
from qsframework.plans import turning
from qsframework.report.printed import rendered, write_page
from qsframework.units import JointUnits

_BOX = "\u2610"
_BLOCKS = 2
"""Times that each load may come back, on average, and still begin a page: repeats are in a second round."""
_BLANKS = (
    ("Date", "Operator", "Robot's serial no."),
    ("Tracker, serial no.", "Its certificate", "Temperature, \u00b0C"),
)


@dataclass(frozen=True)
class SheetFiles:
    """The names of the tables to fill in, and the files that the sheet is made of."""

    readings: str
    floor: str
    inputs: tuple[Path, ...]


@dataclass(frozen=True)
class Commands:
    """How the sheet says that the programme and the one of the warm-up are made, and what is run afterwards."""

    programme: str
    warm_up: str
    identify: str


SheetPart = dict[str, Any]
"""What the template needs of a part of the sheet, of visits under one load from one station, or of one visit."""


def write_sheet(path: Path, protocol: Protocol, pictures: Sequence[str], files: SheetFiles, commands: Commands) -> Path:
    """Write the sheet to print, A4: what is done before and at each pose, a card for each visit, what comes after.

    pictures: one SVG for each visit
    """
    content = {
        "title": f"Protocol: {protocol.title}",
        "box": _BOX,
        "blanks": _BLANKS,
        "parts": (_before(protocol, commands), _at_each_pose(protocol, files), _order(protocol)),
        "runs": _runs(protocol, pictures),
        "after": _after(protocol, files, commands),
        "made": _made(protocol, files),
    }
    return write_page(path, rendered("sheet.html.j2", {}, content, "qsf_day"))


def _runs(protocol: Protocol, pictures: Sequence[str]) -> list[SheetPart]:
    """The visits, divided where the load or the station changes: there a page begins, unless the loads come mixed."""
    cards = [(v.load, v.station, _card(v, protocol.units, p)) for v, p in zip(protocol.visits, pictures, strict=True)]
    groups = [(kept, [card for *_, card in group]) for kept, group in groupby(cards, key=lambda card: card[:2])]
    in_blocks = len(groups) <= _BLOCKS * len({kept for kept, _ in groups})
    return [
        {
            "title": (f"Station: {station}, " if station else "") + (f"Load: {load}" if load else "Positions"),
            "visits": group,
            "new_page": k == 0 or in_blocks,
        }
        for k, ((load, station), group) in enumerate(groups)
    ]


def _card(visit: Visit, joints: JointUnits, picture: str) -> SheetPart:
    name = visit.pose if visit.repeat == 1 else f"{visit.pose}, repeat {visit.repeat}"
    half = ", half of it first" if any(s.loaded and s.load_id != visit.load for s in visit.states) else ""
    force = ", ".join(f"{f:.0f}" for f in visit.wrench[:3])
    moment = ", ".join(f"{m:.0f}" for m in visit.wrench[3:])
    turned = f"; moment {moment} N m" if np.any(visit.wrench[3:]) else ""
    return {
        "title": f"Visit {visit.number}: {name}",
        "picture": picture,
        "angles": [(label, f"{v:.2f}") for label, v in zip(joints.labels(), joints.shown(visit.pendant), strict=True)],
        "hung": f"{visit.load}{half}: {force} N{turned}" if visit.load else f"no load; {', '.join(visit.markers)}",
        "states": [_state(s.cycle, s.loaded, s.load_id == visit.load) if visit.load else "" for s in visit.states],
    }


def _state(cycle: int, loaded: bool, whole: bool) -> str:
    what = "unloaded" if not loaded else "loaded" if whole else "half load"
    return f"{what} {cycle}"


def _made(protocol: Protocol, files: SheetFiles) -> str:
    """One line instead of a page: from which files, so that the sheet can be made again."""
    hashes = ", ".join(f"{path.name} {sha256(path)[:12]}" for path in files.inputs)
    made = f"Made by qsf protocol of qsframework {version('qsframework')}; seed {protocol.options.seed}"
    return f"{made}; SHA-256: {hashes}."


def _before(protocol: Protocol, commands: Commands) -> SheetPart:
    options, weight, first = protocol.options, protocol.loaded, protocol.visits[0].pose
    without = " without the weight" * weight
    people = (
        f"Nobody stands in the reach of the arm{' or under the weight' * weight} while the arm moves"
        f"{' or the weight hangs' * weight}. One person "
        "holds the enabling switch and speaks before every move; the others answer before it starts."
    )
    steps = [
        "Fence, emergency stop and enabling switch tested."
        + " The weight, its rope and hook are rated for the load." * weight,
        f"Load data of {'tool and weight' if weight else 'the tool'} set on the controller; mastering unchanged since "
        "the last service.",
        f"Tracker on for as long as its maker asks; {options.reflectors} reflectors fixed to the floor around the "
        "robot, as far apart as the tracker sees.",
        *[
            f"The tracker is set up at {', then '.join(protocol.stations)}, about where the experiment says. Each "
            "stand is a series of its own."
        ]
        * bool(protocol.stations),
        f"The programme drives in this sheet's order: {commands.programme}. At every stop it"
        f"{' names the load and' * weight} waits for the start button. Run once slowly{without}.",
        f"Warm-up: {options.warm_up:g} min{without}, at measuring speed: {commands.warm_up}.",
        *[f"Preload: at pose {first} the weight on and off once, not read. The gears settle on one side."] * weight,
        f"Drive state while reading: {options.drive}. The same for both states of every reading; note any change.",
        "Every pose is reached from the same side: the programme's own way, without jogging in between.",
    ]
    hours = f"About {protocol.hours:.1f} hours in all: {len(protocol.visits)} visits, {protocol.readings} readings."
    notes = (f"Note: {n}." for n in protocol.notes)
    return {"title": "Before", "texts": [people, *notes, hours], "steps": steps}


def _at_each_pose(protocol: Protocol, files: SheetFiles) -> SheetPart:
    options, weight = protocol.options, protocol.loaded
    wait, written = f"Wait {options.settle:g} s.", f"write the time and the temperature ({files.readings})."
    half = "Where a card says 'half', first half of the weight, read, then all of it. " * bool(options.half)
    under_load = [
        f"Unloaded: read all markers ({', '.join(protocol.markers)}), {written}",
        f"{half}Weight on, without a push. {wait} Loaded: read all markers.",
        f"Weight off. {wait} Unloaded: read all markers.",
        f"Cycles: {options.cycles}, so weight on and off {options.cycles} times; the last state is unloaded.",
    ]
    steps = [
        f"The arm arrives{' without the weight' * weight}. People clear. Compare the pendant's angles with the sheet.",
        f"{wait} Read the reflectors on the floor ({files.floor}).",
        *(under_load if weight else [f"Read the markers of the card, {written}"]),
        "A reading that went wrong is not overwritten: write 0 in its column use, and why in your own notes.",
    ]
    bare = any(not visit.load for visit in protocol.visits)
    texts = [
        "The weight never travels with the arm. Between poses it hangs from the crane or stands on its trolley, away "
        "from the way; it comes back when the arm stands still and the drives hold. A side pull is slackened first, "
        "then unhooked.",
        *["At a card of positions nothing hangs: its markers are read once."] * bare,
    ]
    return {"title": "At each pose", "texts": texts * weight, "steps": steps}


def _order(protocol: Protocol) -> SheetPart:
    options, weight = protocol.options, protocol.loaded
    order = {
        "random": f"The order is random (seed {options.seed}), so that drift cannot pass for an effect of the pose.",
        "shortest": "The order is a short way; a drift over the day may then look like an effect of the pose.",
        "plan": "The order is the plan's.",
    }[options.order]
    again = f"Visited again later: {', '.join(protocol.repeated) or 'none'}. Keep to the order, also after a break."
    states = " The number of a state is its cycle: unloaded c and loaded c make one displacement." * weight
    cards = (
        f"Angles are those of the pendant.{states} In the pictures grey lines are the base's x (longer) and y"
        f"{', the red arrow is the force' * weight}."
    )
    return {"title": "Visits", "texts": [f"{order} {again}", cards], "steps": []}


def turning_words(protocol: Protocol) -> str:
    """How far the joint that turns most does so: the cables follow."""
    way = np.array([visit.pendant for visit in protocol.visits])
    if len(way) < 2:
        return ""
    total, steps = turning(way, range(len(way))), np.abs(np.diff(way, axis=0))
    most = int(np.argmax(np.where(protocol.units.sliding, 0.0, total)))
    in_all, at_once = (protocol.units[most].text(float(v), 4) for v in (total[most], steps[:, most].max()))
    said = f"J{most + 1} turns most, {in_all} in all and {at_once} at most between two poses"
    return f"{said}: look at the cables there."


def _after(protocol: Protocol, files: SheetFiles, commands: Commands) -> SheetPart:
    readings = files.readings
    bent = "what did not come back after unloading, whether half the load gives half the deflection, "
    text = (
        f"Name {readings} as `data:` in the experiment and run qsf check on it before any fit: it gives the "
        f"repeatability, {bent if protocol.loaded else ''}and "
        "whether the floor's reflectors moved. Columns that nobody filled in may stay empty; rows not measured get 0 "
        f"in the column use. Then {commands.identify}."
    )
    return {"title": "After", "texts": [text]}
