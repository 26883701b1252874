"""`import_readings`: other programs' files to the readings of a campaign, with all that was taken for what."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from qsf_trackers.campaign import EMPTY, Campaign, PlanSlot, read_campaign
from qsf_trackers.joining import (
    check_planned,
    join_order,
    join_time,
    names_of,
    poses_of,
    visits_of,
)
from qsf_trackers.layout import Sheet
from qsf_trackers.matching import (
    TrackerPoint,
    check_order_meant,
    match_names,
    match_nearest,
    match_order,
    read_points,
    without_idle_names,
)
from qsf_trackers.options import ImportOptions
from qsf_trackers.placing import (
    Aligned,
    Placed,
    align,
    check_places,
    check_units,
    expected_places,
    series_of,
    unit_problem,
)
from qsf_trackers.sheets import NOTHING_STATED, read_sheet
from qsf_trackers.tables import (
    Listing,
    check_columns,
    first_rows,
    interpret,
    stated_units,
)
from qsf_trackers.vocabulary import plain
from qsf_trackers.writing import own_rows, readings_rows
from qsframework.arguments import checked
from qsframework.errors import InputError, Problem, all_of, refuse
from qsframework.experiment import Experiment, Readings, readings_of
from qsframework.plugin import Array

UNLOADED = "unloaded"
"""Alignment by the campaign's own unloaded readings."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Imported:
    """What was taken for what. files: point lists, logs and known points; points: with their slots, in the order of the
    table; angles: where they are from, "plan", "columns", "names", "order" or "time"

    missing: readings of the plan that no point is of; ignored: points left out; hidden: points with no line of sight;
    placed: by series how the points lie to the arm; aligned: frames; header and rows: the table; readings: the table,
    read back
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    readings: Readings
    match: str
    angles: str
    files: tuple[Listing, ...] = ()
    points: tuple[TrackerPoint, ...] = ()
    missing: tuple[PlanSlot, ...] = ()
    ignored: tuple[TrackerPoint, ...] = ()
    hidden: tuple[TrackerPoint, ...] = ()
    placed: tuple[Placed, ...] = ()
    aligned: tuple[Aligned, ...] = ()
    sheets: tuple[Sheet, ...] = ()


@checked
def import_readings(
    experiment: Experiment, files: Sequence[Path], plan: Path | None = None, options: ImportOptions = NOTHING_STATED
) -> Imported:
    """Readings from point lists and joint logs.

    Args:
        experiment: the campaign.
        files: point lists, and a joint log, as they were exported.
        plan: a plan.csv, or the table of states to fill in.
        options: columns, units and names that the files do not state.

    Returns:
        The rows of a readings file, and how columns and points were mapped.

    Raises:
        InputError: with file, row, what was found and what to state, wherever two interpretations are possible.
    """
    units = stated_units(options.units)
    sheets = all_of(partial(read_sheet, p, options) for p in files)
    ours = [(sheet, rows) for sheet in sheets if (rows := own_rows(sheet, experiment)) is not None]
    if ours:
        if len(sheets) > 1:
            where = ", ".join(sheet.where for sheet, _ in ours)
            raise InputError(Problem("is a table of readings already; import it by itself", where))
        sheet, rows = ours[0]
        readings = _read_back(sheet.header, rows, experiment, [(sheet.where, r.line) for r in sheet.rows], {})
        return Imported(
            header=sheet.header, rows=rows, readings=readings, match="columns", angles="columns", sheets=(sheet,)
        )
    joints = experiment.robot.facts.driven
    check_columns(sheets, options.columns, len(joints))
    listings = all_of(partial(interpret, s, options, units, joints) for s in sheets)
    lists, logs = [li for li in listings if li.is_points], [li for li in listings if not li.is_points]
    if not lists:
        where = ", ".join(s.where for s in sheets)
        raise InputError(Problem("no file holds points", where, hint="Name the tracker's export beside the joint log."))
    if len(logs) > 1:
        where = ", ".join(li.sheet.where for li in logs)
        raise InputError(Problem("several joint logs", where, hint="Join them into one file, or import day by day."))
    base = None
    if options.align not in ("", UNLOADED):
        base = interpret(read_sheet(Path(options.align), replace(options, sheet="", ignore=())), options, units, joints)
        _check_base_points(base, options.align)
    return _Import(experiment, lists, logs[0] if logs else None, base, plan, options).run()


def _check_base_points(listing: Listing, path: str) -> None:
    """InputError where a listing is none of points in the base frame, each with a name."""
    if not listing.is_points or "name" not in listing.texts or listing.hidden.any():
        raise InputError(Problem("known points have a name and x, y, z in the base frame", path))
    if not listing.unit:
        hint = "Write it into the heading, as x_mm."
        raise InputError(Problem("nothing says the unit of the known points", path, hint=hint))
    names = listing.plain_names
    twice = [i for i, n in enumerate(names) if n in names[:i]]
    refuse([listing.problem(i, "name", "this name stands here twice") for i in twice])


@dataclass(frozen=True, eq=False)
class _Import:
    """The steps of one import."""

    experiment: Experiment
    lists: list[Listing]
    log: Listing | None
    base: Listing | None
    plan: Path | None
    options: ImportOptions

    @property
    def joints(self) -> int:
        return self.experiment.robot.controller.axes

    def run(self) -> Imported:
        options, experiment = self.options, self.experiment
        campaign, lists, how, logged = self._with_poses()
        points, ignored = read_points(lists, campaign, experiment, options)
        names = set(self.base.plain_names) if self.base is not None else set[str]()
        in_base = [p for p in points if not names.isdisjoint(_names_in_base(p))]
        points = [p for p in points if names.isdisjoint(_names_in_base(p))]
        blind = tuple(p for p in points if p.hidden)
        if options.match == "names":
            check_order_meant(points, campaign, experiment)
        if "order" not in (options.match, how):
            points = [p for p in points if not p.hidden]
        if not points:
            raise InputError(Problem("no point is left to take", ", ".join(li.sheet.where for li in lists)))
        aligned = self._base_frames(in_base)
        points = self._matched(points, campaign, aligned)
        points = [p if p.series else replace(p, series=campaign.stations.get(p.taken.pose, "")) for p in points]
        pendant = self._angles(points, campaign, how, logged)[[not p.hidden for p in points]]
        points = [p for p in points if not p.hidden]
        places = expected_places(points, pendant, experiment)
        check_units(points, places)
        placed = check_places(points, pendant, places, campaign, experiment, options.within)
        if options.align == UNLOADED:
            aligned = _unloaded_frames(points, places)
        header, rows = readings_rows(points, pendant, experiment.robot.controller.units, campaign)
        origins = [(p.listing.sheet.where, p.line) for p in points]
        columns = {t.role: t.column for t in points[0].listing.taken}
        written = {"x_mm": "x", "y_mm": "y", "z_mm": "z", "pose": "name", "marker": "name"}
        sources = {name: columns[role] for name, role in written.items() if role in columns}
        slots = {p.slot for p in points}
        return Imported(
            header=tuple(header),
            rows=tuple(map(tuple, rows)),
            readings=_read_back(header, rows, experiment, origins, sources),
            match=options.match,
            angles=how,
            files=(*lists, *filter(None, (self.log, self.base))),
            points=tuple(points),
            missing=tuple(s for s in campaign.order if s not in slots),
            ignored=tuple(ignored),
            hidden=blind,
            placed=placed,
            aligned=aligned,
        )

    def _with_poses(self) -> tuple[Campaign, list[Listing], str, list[str]]:
        """The campaign with its poses, the lists, where the angles are from, and the poses that a log names."""
        campaign = EMPTY if self.plan is None else read_campaign(self.plan, self.experiment)
        lists = [without_idle_names(li, campaign, self.experiment, self.options) for li in self.lists]
        sliding = [f"q{k + 1}" for k, slides in enumerate(self.experiment.robot.controller.units.sliding) if slides]
        for listing in filter(None, (*lists, self.log)):
            if not listing.numbers.keys().isdisjoint(sliding):  # they would be read as angles
                message = f"states {', '.join(sliding)}, which slide on this arm; only angles are imported so far"
                hint = "Give a plan, and leave the joints out of the file."
                raise InputError(Problem(message, listing.sheet.where, hint=hint))
        how = self._join(campaign)
        logged: list[str] = []
        if self.log is not None and how == "names":
            logged = names_of(self.log, campaign, self.options.names)
            if not campaign.poses:
                campaign = replace(campaign, poses=poses_of(self.log, logged, self.joints))
        if not campaign.poses:
            campaign, lists = self._poses_of_points(lists, how)
        return campaign, lists, how, logged

    def _join(self, campaign: Campaign) -> str:
        """Where the angles are from."""
        if all("q1" in li.numbers for li in self.lists):
            return "columns"
        if self.log is None:
            if not campaign.poses:
                raise InputError(self._no_angles())
            return "plan"
        if self.options.join:
            return self.options.join
        if any(names_of(self.log, campaign, self.options.names)):
            return "names"
        message = "nothing says how the rows of this joint log belong to the points: it names no pose"
        hint = "State it: in their order, or by the time of every point."
        argument = ("join", "order")
        raise InputError(self.log.sheet.problem(None, message, hint=hint, argument=argument))

    def _no_angles(self) -> Problem:
        """Nothing says the angles; where as many columns speak of joints as there are, these are proposed."""
        where = ", ".join(li.sheet.where for li in self.lists)
        message = "nothing says at which angles the points were read"
        hint = "Give a plan, or a joint log."
        argument = ("plan", "plan.csv")
        named = [name for name in self.lists[0].left if re.search("joint|wrist|elbow", name.lower())]
        if len(named) == self.joints:
            pairs = [(f"q{k}", name) for k, name in enumerate(named, start=1)]
            sheet = self.lists[0].sheet
            shown = first_rows(sheet, [(role, sheet.header.index(name)) for role, name in pairs])
            hint = "Give a plan, a joint log, or say which columns hold the angles; "
            hint += f"as proposed, the first rows are {shown}."
            argument = ("map", ",".join(f"{role}={name}" for role, name in pairs))
        return Problem(message, where, hint=hint, argument=argument)

    def _poses_of_points(self, lists: Sequence[Listing], how: str) -> tuple[Campaign, list[Listing]]:
        """Poses out of the points' own angles, or of a log without names: called as the points say, else counted."""
        options = self.options if how != "columns" else replace(self.options, ignore=())
        points, _ = read_points(lists, EMPTY, self.experiment, options)
        if how == "columns":
            angles = np.vstack([li.angles(self.joints) for li in lists])
            counted = [str(k + 1) for k in range(len(points))]
        else:
            angles, stops = self._logged_angles(points, EMPTY, how)
            counted = [f"s{k:02d}" for k in stops] or [str(k + 1) for k in visits_of(points)]
        poses: dict[str, Array] = {}
        named: dict[tuple[int, int], str] = {}
        problems: list[Problem] = []
        for point, pendant, count in zip(points, angles, counted, strict=True):
            name = point.said.pose or "_".join(point.said.unknown) or count
            if name in poses and np.abs(poses[name] - pendant).max() > 1e-3:
                hint = "Let the names, or a column, distinguish the poses."
                problems.append(point.problem(f"pose {name!r} has other angles than above", "name", hint=hint))
            poses.setdefault(name, pendant)
            named[id(point.listing), point.row] = name
        refuse(problems)
        out = [
            replace(li, texts={**li.texts, "pose": tuple(named.get((id(li), i), "") for i in range(len(li)))})
            for li in lists
        ]
        return replace(EMPTY, poses=poses), out

    def _logged_angles(self, points: Sequence[TrackerPoint], campaign: Campaign, how: str) -> tuple[Array, list[int]]:
        """Pendant angles (N, n) rad of every point by a log, and the stop of each where they are joined by time."""
        assert self.log is not None
        if how == "order":
            return join_order(points, self.log, self.joints), []
        return join_time(points, self.log, self.joints, self.options.clock, campaign)

    def _base_frames(self, points: Sequence[TrackerPoint]) -> tuple[Aligned, ...]:
        """The frame of every series from its points that are known in the base frame."""
        if self.base is None:
            return ()
        places = dict(zip(self.base.plain_names, self.base.xyz, strict=True))
        out: list[Aligned] = []
        for series, rows in (series_of(points) or {"": []}).items():
            members = _with_unit(points[i] for i in rows)
            expected = [next(places[name] for name in _names_in_base(p) if name in places) for p in members]
            frame = _aligned("known", members, expected, series, self.base.sheet.where)
            worst = int(np.argmax(frame.missed))
            if frame.missed[worst] > self.options.within:
                message = f"the known point {members[worst].name!r} does not lie where it should beside the others"
                size, most = f"{1e3 * frame.missed[worst]:.1f} mm off", f"up to {1e3 * self.options.within:g} mm"
                hint = "Look at its name, the units of both files and the order of x, y, z."
                raise InputError(members[worst].problem(message, found=size, allowed=most, hint=hint))
            out.append(frame)
        return tuple(out)

    def _matched(
        self, points: list[TrackerPoint], campaign: Campaign, aligned: Sequence[Aligned]
    ) -> list[TrackerPoint]:
        if self.options.match != "nearest":
            return (match_order if self.options.match == "order" else match_names)(points, campaign, self.experiment)
        frames = {f.series: f for f in reversed([*(a.frame for a in aligned), *self.experiment.frames])}
        out: list[TrackerPoint] = []
        for series, rows in series_of(points).items():
            members = _with_unit(points[i] for i in rows)
            if series not in frames:
                named = f" of series {series!r}" if series else ""
                message = f"the nearest prediction needs the tracker's frame{named}"
                argument = ("align", "known.csv")
                hint = "Give known points in the base frame, or state frames: in the experiment and name the series."
                raise InputError(Problem(message, str(self.experiment.path), hint=hint, argument=argument))
            out += match_nearest(members, campaign, self.experiment, frames[series], self.options.within)
        return out

    def _angles(self, points: Sequence[TrackerPoint], campaign: Campaign, how: str, logged: Sequence[str]) -> Array:
        """Pendant angles (N, n) rad of every point."""
        if self.log is None or how in ("plan", "columns"):
            return np.stack([campaign.poses[p.taken.pose] for p in points])
        if how == "names":
            poses = poses_of(self.log, logged, self.joints)
            message = "the joint log has no row of this pose"
            lost = [p for p in points if p.taken.pose not in poses]
            refuse([p.problem(message, found=p.taken.pose) for p in lost])
            pendant = np.stack([poses[p.taken.pose] for p in points])
        else:
            pendant, _ = self._logged_angles(points, campaign, how)
        check_planned(points, pendant, campaign, self.log, self.experiment.robot.controller)
        return pendant


def _unloaded_frames(points: Sequence[TrackerPoint], places: Array) -> tuple[Aligned, ...]:
    """The frame of every series from its unloaded markers, by their places (N, 3) m."""
    where, out = ", ".join(dict.fromkeys(p.listing.sheet.where for p in points)), list[Aligned]()
    for series, rows in series_of(points).items():
        rows = [i for i in rows if not points[i].taken.loaded]
        out.append(_aligned(UNLOADED, [points[i] for i in rows], places[rows], series, where))
    return tuple(out)


def _aligned(
    kind: str, points: Sequence[TrackerPoint], places: Sequence[Array] | Array, series: str, where: str
) -> Aligned:
    """The frame of a series from points with their places (3,) m, base frame."""
    names = tuple(p.name or str(p.line) for p in points)
    xyz = np.array([p.xyz for p in points]).reshape(-1, 3)
    return align(kind, np.array(places).reshape(-1, 3), xyz, names, series, where)


def _names_in_base(point: TrackerPoint) -> tuple[str, str]:
    """The names that a point may have among those of the base frame."""
    return plain(point.name), plain(point.name.rpartition("::")[2])


def _with_unit(points: Iterable[TrackerPoint]) -> list[TrackerPoint]:
    """The points. InputError where nobody says the unit of one."""
    out = list(points)
    refuse([unit_problem(p.listing) for p in out if not p.listing.unit][:1])
    return out


def _read_back(
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    experiment: Experiment,
    origins: Sequence[tuple[str, int]],
    columns: Mapping[str, str],
) -> Readings:
    """The table as our own reader reads it; its problems stand at the rows from which they come."""
    lines = dict(enumerate(origins, start=2))  # of the table as it is written, below its heading
    try:
        return readings_of(Path(origins[0][0]), header, rows, experiment, "positions" if "state" in header else None)
    except InputError as error:
        problems: list[Problem] = []
        for problem in error.problems:
            file, line = lines.get(problem.line or 0, (origins[0][0], None))
            column = columns.get(problem.column or "", problem.column)
            problems.append(replace(problem, file=file, line=line, column=column))
        raise InputError(problems) from None
