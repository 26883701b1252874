"""Which reading of which state every point is: by its name, by the order, or by what it lies nearest to."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from qsf_trackers.campaign import Campaign, PlanSlot
from qsf_trackers.options import ImportOptions
from qsf_trackers.tables import Listing, StatedProblem, quoted_word
from qsf_trackers.vocabulary import (
    FOUND_BY,
    HALF,
    PLAIN,
    Said,
    Vocabulary,
    decode,
    plain,
    state_word,
    vocabulary,
)
from qsframework.errors import InputError, Problem, nearest, refuse
from qsframework.experiment import HALF_LOAD, Experiment, Frame
from qsframework.plugin import Array

_REFLECTOR = re.compile(
    r"\b(rrr|ccr|smr|tbr|brr|rfi|tmc|t-?mac|prism|cat-?eye|reflector|reflektor|corner cube)\b", re.IGNORECASE
)
"""What the type of a reflector is called; it is no name of a point."""
_APART = 3.0
"""The second nearest marker is this many times as far away as the nearest, or nothing is taken."""


@dataclass(frozen=True)
class TrackerPoint:
    """A row of a point list: its name, and what that says; series "" where none is named; slot: what it was taken as.

    by: for pose, marker and state, what said it: "name", "column", "file", "stated", "only", "order",
    "place", "log"
    """

    listing: Listing
    row: int
    name: str
    said: Said
    _: KW_ONLY
    series: str = ""
    slot: PlanSlot | None = None
    by: Mapping[str, str] = field(default_factory=dict[str, str])

    def problem(self, message: str, role: str = "name", **more: Any) -> Problem:
        """A problem of this point."""
        return self.listing.problem(self.row, role, message, **more)

    @property
    def taken(self) -> PlanSlot:
        """What it was taken as."""
        assert self.slot is not None
        return self.slot

    @property
    def pose(self) -> str:
        """The pose that it was taken as, or else that it says; "" for none."""
        return (self.said.pose or "") if self.slot is None else self.slot.pose

    @property
    def xyz(self) -> Array:
        """Its coordinates (3,)."""
        return self.listing.xyz[self.row]

    @property
    def hidden(self) -> bool:
        """Whether the instrument saw nothing."""
        return bool(self.listing.hidden[self.row])

    @property
    def block(self) -> str | None:
        """The block of columns that it stands in."""
        return self.listing.texts["block"][self.row] if "block" in self.listing.texts else None

    @property
    def line(self) -> int:
        """Line in the file."""
        return self.listing.sheet.rows[self.row].line


def read_points(
    listings: Sequence[Listing], campaign: Campaign, experiment: Experiment, options: ImportOptions
) -> tuple[list[TrackerPoint], list[TrackerPoint]]:
    """The points of the files in their order, and those that were to be ignored."""
    known = vocabulary(campaign, experiment.marker_names, options.names)
    _check_words(options, known, [*campaign.poses, *experiment.marker_names, "loaded", "unloaded"])
    points: list[TrackerPoint] = []
    ignored: list[TrackerPoint] = []
    for listing in listings:
        sheet = listing.sheet
        around = decode(f"{sheet.path.stem} {sheet.name}", known)
        for i in range(len(listing)):
            parts = [listing.texts[r][i] for r in ("collection", "group", "name", "block") if r in listing.texts]
            name = "::".join(p for p in parts if p)
            point = _point(listing, i, name, around, known, options)
            skip = any(fnmatchcase(text, pattern) for pattern in options.ignore for text in (name, *parts[-2:]))
            (ignored if skip else points).append(point)
    return points, ignored


def without_idle_names(listing: Listing, campaign: Campaign, experiment: Experiment, options: ImportOptions) -> Listing:
    """The listing without columns of names, poses or markers that are the same in all rows, or a reflector's type, and
    say nothing of a point."""
    known = vocabulary(campaign, experiment.marker_names, options.names)
    texts = dict(listing.texts)
    for role in ("name", "pose", "marker"):
        cells = set(texts.get(role, ()))
        same = len(cells) == 1 and len(listing) > 1
        typed = any(cells) and all(not c or _REFLECTOR.search(c) for c in cells)
        if (same or typed) and not any(replace(decode(c, known), unknown=()) != Said() for c in cells):
            del texts[role]
    left = tuple(t.column for t in listing.taken if t.role in PLAIN and t.role not in texts)
    taken = tuple(t for t in listing.taken if t.role not in PLAIN or t.role in texts)
    return replace(listing, texts=texts, taken=taken, left=(*listing.left, *left)) if left else listing


def _check_words(options: ImportOptions, known: Vocabulary, allowed: Sequence[str]) -> None:
    wrong: list[Problem] = []
    for word, meant in options.names.items():
        if plain(meant) not in known.meanings:
            message, hint = f"the word {word!r} cannot mean this", nearest(meant, allowed)
            at = ("names", word, meant)
            wrong.append(StatedProblem(message, found=repr(meant), allowed=_few(allowed), hint=hint, stated=at))
    refuse(wrong)


def _few(names: Sequence[str]) -> str:
    """A list that fits on a line or two."""
    return ", ".join(names) if len(names) <= 16 else ", ".join([*names[:14], f"... and {len(names) - 14} more"])


def _point(
    listing: Listing, i: int, name: str, around: Said, known: Vocabulary, options: ImportOptions
) -> TrackerPoint:
    """What the columns, then the name, then the file and the sheet, then the user say of a row."""
    said = decode(name, known)
    by = {kind: "name" for kind in ("pose", "marker", "loaded") if getattr(said, kind) is not None}
    for role, cells in listing.texts.items():
        if role in FOUND_BY[1:] and cells[i]:
            said, kind = _of_column(said, role, cells[i], known)
            by[kind] = "column"
    if said.loaded is None and around.loaded is not None:
        said = replace(said, loaded=around.loaded, load=said.load or around.load)
        by["loaded"] = "file"
    if said.repeat is None and around.repeat is not None:
        said = replace(said, repeat=around.repeat)
    if said.loaded is None and options.state:
        said = replace(said, loaded=options.state == "loaded")
        by["loaded"] = "stated"
    series = listing.texts["series"][i] if "series" in listing.texts else options.series
    return TrackerPoint(listing, i, name, said, series=series, by=by)


def _of_column(said: Said, role: str, cell: str, known: Vocabulary) -> tuple[Said, str]:
    """What a column of its own says."""
    told = decode(cell, known)
    said = replace(said, several=tuple(s for s in said.several if not s.startswith(role)))
    if role in ("pose", "marker"):
        meant = known.meant(cell, role)
        return replace(said, **{role: meant[0] if len(meant) == 1 else cell}), role
    if role == "state":
        return replace(said, loaded=told.loaded, load=said.load or told.load), "loaded"
    if role == "load_id":
        return replace(said, load=told.load or cell), "load"
    count = int(cell) if cell.isdecimal() else None
    return replace(said, **{role: count}), role


def match_names(points: Sequence[TrackerPoint], campaign: Campaign, experiment: Experiment) -> list[TrackerPoint]:
    """Each point as what its name says. InputError where names say too little, too much or what there is not."""
    problems: list[Problem] = []
    out: list[TrackerPoint] = []
    for point in points:
        out += _named(point, campaign, experiment, problems)
    refuse(_gathered(problems, points))
    check_twice(out)
    return out


def check_order_meant(points: Sequence[TrackerPoint], campaign: Campaign, experiment: Experiment) -> None:
    """InputError where points have no names, or none that says a pose; where they are as many as the readings of the
    plan their order is proposed, with the first of them as they would be read."""
    order, strange = _order(points, campaign), _strange_blocks(points)
    bare = [p for p in points if not p.name and "pose" not in p.listing.texts]
    others = [p for p in points if p.block not in strange]
    fits = len(others) == len(order) > 0
    if any(p.said.pose is not None for p in points) or not (bare or fits):
        return
    if strange and fits:
        message = f"the block of columns {strange[0]!r} names no marker"
        hint = "Leave it out."
        allowed = _few(experiment.marker_names)
        argument = ("ignore", quoted_word(strange[0]))
        raise InputError(points[0].problem(message, "block", allowed=allowed, hint=hint, argument=argument))
    message, role = "no name says a pose of the plan", "name"
    if bare:
        message = f"{len(bare)} points have no names, of which this is the first"
        role = "x"
    if not fits:
        found = f"{len(points)} points"
        allowed = f"{len(order)} readings of the plan, to be taken in its order" if order else "points with names"
        hint = "Export exactly those of the plan, name the points, or say which column holds the names."
        raise InputError(bare[0].problem(message, role, found=found, allowed=allowed, hint=hint))
    pairs = list(zip(_in_order(points, experiment), order, strict=True))[:3]
    first = "; ".join(f"line {p.line} is {label(slot)}" for p, slot in pairs)
    hint = f"Take them in the order of the plan; so read, {first}."
    raise InputError((bare or points)[0].problem(message, role, hint=hint, argument=("match", "order")))


def _order(points: Sequence[TrackerPoint], campaign: Campaign) -> list[PlanSlot]:
    """The readings of the plan in their order, of one state alone where all points are of it."""
    states = {p.said.loaded for p in points}
    return [s for s in campaign.order if len(states) > 1 or None in states or s.loaded in states]


def _in_order(points: Sequence[TrackerPoint], experiment: Experiment) -> list[TrackerPoint]:
    """The points as the files have them, those of one row in the order of the experiment's markers."""
    files = list(dict.fromkeys(p.listing for p in points))
    places = {name: k for k, name in enumerate(experiment.marker_names)}
    return sorted(points, key=lambda p: (files.index(p.listing), p.line, places.get(p.said.marker or "", -1)))


def _gathered(problems: Sequence[Problem], points: Sequence[TrackerPoint]) -> list[Problem]:
    """Where the names of a whole file lack the same thing, one problem in place of one for every point."""
    every: dict[tuple[str | None, str], list[Problem]] = {}
    counts = Counter(p.listing.sheet.where for p in points)
    for problem in problems:
        quoted = problem.message.split("'")  # the point's name is what a message quotes first
        kind = problem.message.replace(repr(quoted[1]), "...") if len(quoted) > 2 else problem.message
        every.setdefault((problem.file, kind), []).append(problem)
    out: list[Problem] = []
    for (file, _), own in every.items():
        if len(own) > 1 and len(own) == counts[file or ""]:
            many = f"the same of all {len(own)} points of this file"
            hint = f"{own[0].hint} It is {many}." if own[0].hint else f"It is {many}."
            out.append(replace(own[0], hint=hint))
        else:
            out += own
    return sorted(out, key=lambda p: (p.file or "", p.line or 0))


def _named(
    point: TrackerPoint, campaign: Campaign, experiment: Experiment, problems: list[Problem]
) -> list[TrackerPoint]:
    """The point with the slot that its name says; none where it says too little or too much."""
    said, by, markers = point.said, {**point.by}, experiment.marker_names
    before = len(problems)
    if said.several:
        hint = "Let columns say pose and marker, or rename the point."
        message = f"the name {point.name!r} says more than one thing"
        found = "; ".join(said.several)
        problems.append(point.problem(message, found=found, hint=hint))
    if said.pose is None or said.pose not in campaign.poses:
        names, word = list(campaign.poses), said.pose or "_".join(said.unknown) or point.name
        message = f"the name {point.name!r} says no pose of the plan"
        hint = nearest(word.lower(), names) or nearest(word, names)
        hint = hint or "Say what its words mean, or which points to leave out."
        problems.append(point.problem(message, allowed=_few(names), hint=hint, argument=("word", "FOUND=POSE")))
    marker = said.marker
    if marker is None and len(markers) == 1:
        marker, by["marker"] = markers[0], "only"
    if marker is None or marker not in markers:
        what = "says no marker" if marker is None else f"says a marker that the experiment has not, {marker!r}"
        hint = nearest(marker or (said.unknown or ("",))[0], markers)
        message = f"the name {point.name!r} {what}"
        of_block = point.block is not None and said.pose is not None
        argument = ("ignore", quoted_word(point.block or "")) if of_block else ("word", "FOUND=MARKER")
        problems.append(point.problem(message, allowed=_few(markers), hint=hint, argument=argument))
    loaded = said.loaded
    if loaded is None and not campaign.loads and not experiment.has_load:
        loaded, by["loaded"] = False, "only"
    if loaded is None:
        message = f"nothing says whether {repr(point.name) if point.name else 'this point'} was read loaded or unloaded"
        hint = "Say it of all points, or say which word means it."
        word = state_word(point.name, said.unknown)
        argument = ("word", quoted_word(word)) if word else ("state", "unloaded")
        problems.append(point.problem(message, allowed="unloaded, loaded", hint=hint, argument=argument))
    if len(problems) > before or said.pose is None or marker is None or loaded is None:
        return []
    load = _load(point, said.pose, said.load, campaign, problems) if loaded else ""
    slot = PlanSlot(said.pose, marker, loaded, load, said.repeat or 1, said.cycle or 1)
    if campaign.exact and len(problems) == before and slot not in campaign.slots:
        hint = "Name repeats r2, r3 and cycles c2, c3, as the table to fill in counts them."
        problems.append(point.problem(f"the table to fill in has no {label(slot)}", hint=hint))
    return [] if len(problems) > before else [replace(point, slot=slot, by=by)]


def _load(point: TrackerPoint, pose: str, said: str, campaign: Campaign, problems: list[Problem]) -> str:
    """The load_id at a pose that a name means."""
    own, names = list(campaign.loads.get(pose, {})), campaign.names.get(pose, {})
    fits = [i for i in own if i.startswith(HALF_LOAD) is (said == HALF)]
    if said not in ("", HALF):
        fits = [i for i in own if said in (i, names.get(i))]
    if len(fits) == 1:
        return fits[0]
    told = ", ".join(names.get(i) or i for i in own)
    if not own:
        message = f"no load is known at pose {pose!r}"
        hint = "Give the plan or the table that says it."
        problems.append(point.problem(message, hint=hint, argument=("plan", "plan.csv")))
    elif not fits:
        problems.append(point.problem(f"pose {pose!r} has no load {said!r}", allowed=told))
    else:
        message = f"several loads hung at pose {pose!r}"
        hint = "Let the name say which one."
        problems.append(point.problem(message, found=told, hint=hint))
    return ""


def label(slot: PlanSlot) -> str:
    """A slot in words."""
    more = f", load {slot.load_id}" if slot.load_id else ""
    more += f", repeat {slot.repeat}" if slot.repeat > 1 else ""
    more += f", cycle {slot.cycle}" if slot.cycle > 1 else ""
    return f"pose {slot.pose}, marker {slot.marker}, {'loaded' if slot.loaded else 'unloaded'}{more}"


def check_twice(points: Sequence[TrackerPoint]) -> None:
    """InputError where two points were taken for one reading of one marker."""
    first: dict[tuple[str, PlanSlot | None], TrackerPoint] = {}
    problems: list[Problem] = []
    for point in points:
        other = first.setdefault((point.series, point.slot), point)
        if other is point or point.slot is None:
            continue
        apart = float(np.linalg.norm(point.xyz - other.xyz))
        size = f"{apart * 1e3:.3g} mm apart" if point.listing.unit else f"{apart:.4g} apart"
        where = "" if other.listing is point.listing else f"{other.listing.sheet.where}, "
        message = f"two points for one marker: {label(point.slot)} stands in {where}line {other.line} too, {size}"
        again = "" if point.slot.loaded else f"c{point.slot.cycle + 1} where the load was taken off again, or with "
        another = f"r{point.slot.repeat + 1} where the pose was visited again"
        hint = f"End the name of the second reading with {again}{another}; or delete one of the two lines."
        problems.append(point.problem(message, found=repr(point.name), hint=hint))
    refuse(problems)


def match_order(points: Sequence[TrackerPoint], campaign: Campaign, experiment: Experiment) -> list[TrackerPoint]:
    """The k-th point as the k-th reading of the plan. InputError where they are not as many, or names contradict."""
    files = ", ".join(dict.fromkeys(p.listing.sheet.where for p in points))
    if not campaign.order:
        message = "an order needs a plan, or the table that qsf protocol writes"
        hint = "Give it."
        raise InputError(Problem(message, files, hint=hint, argument=("plan", "plan.csv")))
    order, points = _order(points, campaign), _in_order(points, experiment)
    if len(points) != len(order):
        told = f"{len(points)} points"
        allowed = f"{len(order)} readings, as in {campaign.source}"
        hint = "Name the points, or export exactly those of the campaign; points on the floor can be ignored."
        message = "the points are not as many as the readings of the plan"
        strange = _strange_blocks(points)
        argument = ("ignore", quoted_word(strange[0]) if strange else "PATTERN")
        raise InputError(Problem(message, files, found=told, allowed=allowed, hint=hint, argument=argument))
    problems: list[Problem] = []
    out: list[TrackerPoint] = []
    for point, slot in zip(points, order, strict=True):
        said = point.said
        pairs = ((said.pose, slot.pose), (said.marker, slot.marker), (said.loaded, slot.loaded))
        if any(told is not None and told != meant for told, meant in pairs):
            message = f"by the order this is {label(slot)}, but it is named {point.name!r}"
            hint = "Put the points in the order of the plan, or match them by their names."
            problems.append(point.problem(message, hint=hint, argument=("match", "names")))
        out.append(replace(point, slot=slot, by=dict.fromkeys(("pose", "marker", "loaded"), "order")))
    refuse(problems)
    check_twice(out)
    return out


def _strange_blocks(points: Sequence[TrackerPoint]) -> list[str]:
    """Blocks of columns that name no marker where others do."""
    labels = dict.fromkeys((p.block, p.said.marker) for p in points if p.block is not None)
    named = any(marker is not None for _, marker in labels)
    return [text for text, marker in labels if marker is None] if named else []


def match_nearest(
    points: Sequence[TrackerPoint], campaign: Campaign, experiment: Experiment, frame: Frame, within: float
) -> list[TrackerPoint]:
    """Each point as the marker and pose that it lies nearest to, in a frame that is known.

    The state cannot be told from a place: a load moves a marker less than the arm errs. InputError where it is not
    said, where nothing is near (m), or where two are about as near.
    """
    poses = list(campaign.poses)
    slots = [(pose, marker) for pose in poses for marker in experiment.marker_names]
    if not poses:
        hint = "Give a plan, or a joint log with the names of the poses."
        raise InputError(Problem("the nearest pose needs poses", hint=hint, argument=("plan", "plan.csv")))
    pendant = np.stack([campaign.poses[p] for p in poses])
    there = frame.apply(experiment.rigid_places(experiment.robot.controller.to_joints(pendant))).reshape(-1, 3)
    problems: list[Problem] = []
    out: list[TrackerPoint] = []
    for point in points:
        said = point.said
        allowed = [said.pose in (None, pose) and said.marker in (None, marker) for pose, marker in slots]
        off = np.where(allowed, np.linalg.norm(there - point.xyz, axis=1), np.inf)
        first, second = (int(k) for k in np.argsort(off)[:2]) if len(off) > 1 else (0, 0)
        pose, marker = slots[first]
        if not off[first] < within:
            message = f"{point.name!r} lies near no marker of the plan"
            near = f"{1e3 * off[first]:.0f} mm from {marker} at {pose}" if np.isfinite(off[first]) else "nothing"
            hint = "Leave it out, or look at frame, unit and plan."
            most, argument = f"up to {1e3 * within:.0f} mm", ("ignore", "PATTERN")
            problems.append(point.problem(message, "x", found=near, allowed=most, hint=hint, argument=argument))
            continue
        if first != second and off[second] < _APART * max(off[first], 1e-3):
            other = f"{1e3 * off[second]:.1f} mm to {slots[second][1]} at {slots[second][0]}"
            found = f"{1e3 * off[first]:.1f} mm to {marker} at {pose}, {other}"
            hint = "Let the names say which is which."
            problems.append(point.problem(f"{point.name!r} lies as near to two markers", "x", found=found, hint=hint))
            continue
        by = {**point.by, "pose": "place", "marker": "place"}
        placed = replace(point, said=replace(said, pose=pose, marker=marker), by=by)
        out += _named(placed, campaign, experiment, problems)
    refuse(problems)
    check_twice(out)
    return out
