"""The sheet on the clipboard: what is done before, at and between the poses, with boxes to tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from qsframework.applications.ordering import turning
from qsframework.applications.protocol import Protocol, Visit
from qsframework.files import sha256
from qsframework.report.printed import write_page
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


@dataclass(frozen=True)
class SheetPart:
    """A titled part of the sheet: paragraphs, then steps with a box each."""

    title: str
    texts: tuple[str, ...] = ()
    steps: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Card:
    """One visit on the sheet. angles: name and value of each; states: in the order in which they are read."""

    title: str
    picture: str
    angles: tuple[tuple[str, str], ...]
    hung: str
    states: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Run:
    """Visits one after the other under one load, from one station; new_page: whether a page begins with them."""

    title: str
    visits: tuple[Card, ...]
    new_page: bool


def write_sheet(path: Path, protocol: Protocol, pictures: Sequence[str], files: SheetFiles, commands: Commands) -> Path:
    """Write the sheet to print, A4: what is done before and at each pose, a card for each visit, what comes after.

    pictures: one SVG for each visit
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("qsframework.report"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    page = environment.get_template("sheet.html.j2").render(
        title=f"Protocol: {protocol.title}",
        box=_BOX,
        blanks=_BLANKS,
        parts=(_before(protocol, commands), _at_each_pose(protocol, files), _order(protocol)),
        runs=_runs(protocol, pictures),
        after=_after(protocol, files, commands),
        made=_made(protocol, files),
    )
    return write_page(path, page)


def _runs(protocol: Protocol, pictures: Sequence[str]) -> tuple[Run, ...]:
    """The visits, divided where the load or the station changes: there a page begins, unless the loads come mixed."""
    groups: list[list[int]] = []
    for i, visit in enumerate(protocol.visits):
        if not groups or _kept(protocol.visits[groups[-1][0]]) != _kept(visit):
            groups.append([])
        groups[-1].append(i)
    out: list[Run] = []
    in_blocks = len(groups) <= _BLOCKS * len({_kept(v) for v in protocol.visits})
    for k, group in enumerate(groups):
        cards = tuple(_card(protocol.visits[i], protocol.units, pictures[i]) for i in group)
        load, station = _kept(protocol.visits[group[0]])
        title = ", ".join([*([f"Station: {station}"] if station else []), f"Load: {load}" if load else "Positions"])
        out.append(Run(title=title, visits=cards, new_page=k == 0 or in_blocks))
    return tuple(out)


def _kept(visit: Visit) -> tuple[str, str]:
    """What stays as it is from one visit to the next: load and station."""
    return visit.load, visit.station


def _card(visit: Visit, joints: JointUnits, picture: str) -> Card:
    name = visit.pose if visit.repeat == 1 else f"{visit.pose}, repeat {visit.repeat}"
    half = ", half of it first" if any(s.loaded and s.load_id != visit.load for s in visit.states) else ""
    force = ", ".join(f"{f:.0f}" for f in visit.wrench[:3])
    moment = ", ".join(f"{m:.0f}" for m in visit.wrench[3:])
    turned = f"; moment {moment} N m" if np.any(visit.wrench[3:]) else ""
    return Card(
        title=f"Visit {visit.number}: {name}",
        picture=picture,
        angles=tuple(
            (label, f"{v:.2f}") for label, v in zip(joints.labels(), joints.shown(visit.pendant), strict=True)
        ),
        hung=f"{visit.load}{half}: {force} N{turned}" if visit.load else f"no load; {', '.join(visit.markers)}",
        states=tuple(_state(s.cycle, s.loaded, s.load_id == visit.load) if visit.load else "" for s in visit.states),
    )


def _state(cycle: int, loaded: bool, whole: bool) -> str:
    what = "unloaded" if not loaded else "loaded" if whole else "half load"
    return f"{what} {cycle}"


def _made(protocol: Protocol, files: SheetFiles) -> str:
    """One line instead of a page: from which files, so that the sheet can be made again."""
    hashes = ", ".join(f"{path.name} {sha256(path)[:12]}" for path in files.inputs)
    made = f"Made by qsf protocol of qsframework {version('qsframework')}; seed {protocol.options.seed}"
    return f"{made}; SHA-256: {hashes}."


def _before(protocol: Protocol, commands: Commands) -> SheetPart:
    options = protocol.options
    first = protocol.visits[0]
    weight = protocol.loaded
    people = (
        f"Nobody stands in the reach of the arm{' or under the weight' if weight else ''} while the arm moves"
        f"{' or the weight hangs' if weight else ''}. One person "
        "holds the enabling switch and speaks before every move; the others answer before it starts."
    )
    rated = " The weight, its rope and hook are rated for the load." if weight else ""
    steps = [
        f"Fence, emergency stop and enabling switch tested.{rated}",
        f"Load data of {'tool and weight' if weight else 'the tool'} set on the controller; mastering unchanged since "
        "the last service.",
        f"Tracker on for as long as its maker asks; {options.reflectors} reflectors fixed to the floor around the "
        "robot, as far apart as the tracker sees.",
        *_stands(protocol),
        f"The programme drives in this sheet's order: {commands.programme}. At every stop it"
        f"{' names the load and' if weight else ''} waits for the start button. Run once slowly"
        f"{' without the weight' if weight else ''}.",
        f"Warm-up: {options.warm_up:g} min{' without the weight' if weight else ''}, at measuring speed: "
        f"{commands.warm_up}.",
        *(
            [f"Preload: at pose {first.pose} the weight on and off once, not read. The gears settle on one side."]
            * weight
        ),
        f"Drive state while reading: {options.drive}. The same for both states of every reading; note any change.",
        "Every pose is reached from the same side: the programme's own way, without jogging in between.",
    ]
    hours = f"About {protocol.hours:.1f} hours in all: {len(protocol.visits)} visits, {protocol.readings} readings."
    notes = (f"Note: {n}." for n in protocol.notes)
    return SheetPart("Before", (people, *notes, hours), tuple(steps))


def _stands(protocol: Protocol) -> list[str]:
    """Where the tracker is set up."""
    if not protocol.stations:
        return []
    names = ", then ".join(protocol.stations)
    return [f"The tracker is set up at {names}, about where the experiment says. Each stand is a series of its own."]


def _positions(protocol: Protocol, files: SheetFiles) -> SheetPart:
    """What is done at a pose where positions are read."""
    steps = (
        "The arm arrives. People clear. Compare the pendant's angles with the sheet.",
        f"Wait {protocol.options.settle:g} s. Read the reflectors on the floor ({files.floor}).",
        f"Read the markers of the card, write the time and the temperature ({files.readings}).",
        "A reading that went wrong is not overwritten: write 0 in its column use, and why in your own notes.",
    )
    return SheetPart("At each pose", (), steps)


def _at_each_pose(protocol: Protocol, files: SheetFiles) -> SheetPart:
    if not protocol.loaded:
        return _positions(protocol, files)
    options, readings, floor = protocol.options, files.readings, files.floor
    half = "Where a card says 'half', first half of the weight, read, then all of it. " if options.half else ""
    steps = [
        "The arm arrives without the weight. People clear. Compare the pendant's angles with the sheet.",
        f"Wait {options.settle:g} s. Read the reflectors on the floor ({floor}).",
        f"Unloaded: read all markers ({', '.join(protocol.markers)}), write the time and the temperature ({readings}).",
        f"{half}Weight on, without a push. Wait {options.settle:g} s. Loaded: read all markers.",
        f"Weight off. Wait {options.settle:g} s. Unloaded: read all markers.",
        f"Cycles: {options.cycles}, so weight on and off {options.cycles} times; the last state is unloaded.",
        "A reading that went wrong is not overwritten: write 0 in its column use, and why in your own notes.",
    ]
    bare = ("At a card of positions nothing hangs: its markers are read once.",) * any(
        not v.load for v in protocol.visits
    )
    weight = (
        "The weight never travels with the arm. Between poses it hangs from the crane or stands on its trolley, away "
        "from the way; it comes back when the arm stands still and the drives hold. A side pull is slackened first, "
        "then unhooked."
    )
    return SheetPart("At each pose", (weight, *bare), tuple(steps))


def _order(protocol: Protocol) -> SheetPart:
    options = protocol.options
    order = {
        "random": f"The order is random (seed {options.seed}), so that drift cannot pass for an effect of the pose.",
        "shortest": "The order is a short way; a drift over the day may then look like an effect of the pose.",
        "plan": "The order is the plan's.",
    }[options.order]
    again = f"Visited again later: {', '.join(protocol.repeated) or 'none'}. Keep to the order, also after a break."
    if not protocol.loaded:
        cards = "Angles are those of the pendant. In the pictures grey lines are the base's x (longer) and y."
        return SheetPart("Visits", (f"{order} {again}", cards))
    cards = (
        "Angles are those of the pendant. The number of a state is its cycle: unloaded c and loaded c make one "
        "displacement. In the pictures grey lines are the base's x (longer) and y, the red arrow is the force."
    )
    return SheetPart("Visits", (f"{order} {again}", cards))


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
    return SheetPart("After", (text,))
