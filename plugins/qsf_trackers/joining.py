"""Angles from a joint log: by the names of its rows, by the order, or by the time of every point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from qsf_trackers.campaign import Campaign
from qsf_trackers.matching import TrackerPoint, label
from qsf_trackers.tables import Listing
from qsf_trackers.vocabulary import decode, vocabulary
from qsframework.errors import InputError, Problem, refuse
from qsframework.experiment import other_angles
from qsframework.plugin import Array
from qsframework.robot import Controller
from qsframework.robot.collision import Flags

_STILL = np.deg2rad(0.02)
"""An arm whose angles change by less stands still; controllers show hundredths."""
_PLANNED = np.deg2rad(1.0)
"""An arm that stands farther from a planned angle does not stand at that pose."""


_CLOCK = 0.25
"""Share of the points above which the clocks are blamed, and not the points."""


def names_of(log: Listing, campaign: Campaign, words: Mapping[str, str]) -> list[str]:
    """The pose that each row of a log names, as the plan calls it where there is one; "" where it names none."""
    role = next((r for r in ("pose", "name") if r in log.texts), None)
    if role is None:
        return [""] * len(log)
    known = vocabulary(campaign, (), words)
    other = {cell: decode(cell, known).pose or ("" if campaign.poses else cell) for cell in log.texts[role]}
    return [next(iter(known.meant(cell, "pose")), other[cell]) for cell in log.texts[role]]


def poses_of(log: Listing, names: Sequence[str], joints: int) -> dict[str, Array]:
    """The poses of a log that names them. InputError where one name stands for different angles."""
    angles, out = log.angles(joints), dict[str, Array]()
    lines: dict[str, int] = {}
    problems: list[Problem] = []
    for i, name in enumerate(names):
        if not name:
            continue
        if name in out and np.abs(out[name] - angles[i]).max() > _STILL:
            turned = np.rad2deg(np.abs(out[name] - angles[i]).max())
            message = f"pose {name!r} stands here with other angles than in line {lines[name]}"
            hint = "Name the second pose differently, or join the log by time or by order."
            found, argument = f"up to {turned:.3g} deg", ("join", "order")
            problems.append(log.problem(i, "q1", message, found=found, hint=hint, argument=argument))
        out.setdefault(name, angles[i])
        lines.setdefault(name, log.sheet.rows[i].line)
    refuse(problems)
    return out


def visits_of(points: Sequence[TrackerPoint]) -> list[int]:
    """The visit of each point, from 0: points one after the other of one pose and repeat, or of one row."""
    visit: list[int] = []
    last: object = None
    for point in points:
        key: object = (id(point.listing), point.line) if point.said.pose is None else point.said.pose
        key = (point.slot.pose, point.slot.repeat) if point.slot is not None else key
        visit.append((visit[-1] if visit else -1) + (key != last or not visit))
        last = key
    return visit


def join_order(points: Sequence[TrackerPoint], log: Listing, joints: int) -> Array:
    """Angles (N, joints): the k-th row is of the k-th point, or of the k-th visit (points one after the other at a
    pose and repeat). InputError where the rows are as many as neither."""
    angles, visit = log.angles(joints), visits_of(points)
    count = visit[-1] + 1 if visit else 0
    if len(log) == len(points):
        return angles
    if len(log) == count:
        return angles[visit]
    found = f"{len(log)} rows"
    allowed = f"{len(points)}, one for each point, or {count}, one for each visit"
    hint = "Cut the log to the readings, or join it by time or by names."
    message = "the log has another number of rows than there are points"
    argument = ("join", "time")
    raise InputError(Problem(message, log.sheet.where, found=found, allowed=allowed, hint=hint, argument=argument))


def stops_of(log: Listing, joints: int) -> tuple[Array, Array]:
    """Where the arm stood still, in the order of time: first and last times (S, 2) s, mean angles (S, n).

    InputError where times are missing or run backwards.
    """
    angles, times = log.angles(joints), log.numbers.get("time")
    if times is None:
        hint = "Join it by order or by names, or say which column holds the time."
        argument = ("join", "order")
        raise InputError(log.sheet.problem(None, "the log has no column of times", hint=hint, argument=argument))
    back = np.flatnonzero(np.diff(times) < 0.0)
    if len(back):
        i = int(back[0]) + 1
        message = "the log's clock runs backwards here"
        hint = "Cut the log there: two runs are two logs."
        raise InputError(log.problem(i, "time", message, hint=hint))
    ends: list[list[float]] = []
    means: list[Array] = []
    first = 0
    for i in range(1, len(log) + 1):
        if i == len(log) or np.abs(angles[i] - angles[first]).max() > _STILL:
            if i - first > 1:
                ends.append([times[first], times[i - 1]])
                means.append(angles[first] + (angles[first:i] - angles[first]).mean(axis=0))
            first = i
    return np.array(ends).reshape(-1, 2), np.array(means).reshape(-1, joints)


def join_time(
    points: Sequence[TrackerPoint], log: Listing, joints: int, clock: float, campaign: Campaign
) -> tuple[Array, list[int]]:
    """Angles (N, joints) of the stop in which each point was read, and the stop's number.

    clock: s, the log's clock minus the tracker's. InputError where a point has no time, where the arm moved or the log
    says nothing then, or stood elsewhere than the plan has it; proposes a difference of the clocks that puts all right,
    and says where none does.
    """
    ends, means = stops_of(log, joints)
    times = _times(points, log)
    if not len(ends):
        message = "nowhere in this log does the arm stand still for two rows"
        hint = "A log that is joined by time is written all the time; join one row for each pose by order or names."
        raise InputError(Problem(message, log.sheet.where, hint=hint, argument=("join", "order")))
    place: list[int] = (np.searchsorted(ends[:, 0], times + clock, side="right") - 1).tolist()
    wrong: list[tuple[TrackerPoint, str]] = []
    for point, k, t in zip(points, place, (times + clock).tolist(), strict=True):
        at = f"{t:.3f} s by the log's clock"
        if k < 0 or t > ends[k, 1]:
            outside = k in (-1, len(ends) - 1)
            wrong.append((point, f"the log says nothing at {at}" if outside else f"the arm moves at {at}"))
        elif not _at_pose(point, means[k], campaign).all():
            wrong.append((point, f"the arm does not stand at pose {point.pose} at {at}"))
    if wrong:
        windows = [
            (t, *(ends[k] - t).tolist())
            for point, t in zip(points, times.tolist(), strict=True)
            if point.pose in campaign.poses
            for k in np.flatnonzero(_at_pose(point, means, campaign))
            if _at_pose(point, means, campaign).sum() == 1
        ]
        raise InputError(_clock_problems(wrong, len(points), times, ends, windows, log.sheet.where))
    return means[place], [k + 1 for k in place]


def _at_pose(point: TrackerPoint, pendant: Array, campaign: Campaign) -> Flags:
    """Which of some angles (..., n) rad are those of the planned pose of a point; all where none is planned."""
    return np.abs(pendant - campaign.poses.get(point.pose, pendant)).max(axis=-1) <= _PLANNED


def _times(points: Sequence[TrackerPoint], log: Listing) -> Array:
    """Times (N,) s of the points, counted from what the log's are."""
    problems: list[Problem] = []
    for listing in dict.fromkeys(p.listing for p in points):
        message = hint = None
        if "time" not in listing.numbers:
            message = "the points have no column of times"
            hint = "Join by order or by names, or say which column holds the time."
        elif listing.clock != log.clock and "count" not in (listing.clock, log.clock):
            message = "the points' times and the log's are of different kinds: one has the date, the other not"
            hint = "Export both with the date, or join by order or by names."
        if message:
            problems.append(listing.problem(None, "time", message, hint=hint, argument=("join", "order")))
    refuse(problems)
    return np.array([p.listing.numbers["time"][p.row] for p in points])


def _clock_problems(
    wrong: Sequence[tuple[TrackerPoint, str]],
    count: int,
    times: Array,
    ends: Array,
    windows: Sequence[tuple[float, ...]],
    where: str,
) -> list[Problem]:
    """What is wrong with each of `count` points, and first what the clocks have to do with it.

    times, ends: of the points, and of the stops (S, 2), s; windows: time of each point whose planned pose the log holds
    once, and the least and largest difference of the clocks that puts the point there
    """
    out = [point.problem(message, "time") for point, message in wrong]
    if len(wrong) < _CLOCK * count:
        return out
    more = f"{len(wrong)} of {count} points are like this one"
    out = [replace(out[0], hint=more)] if len(wrong) > 1 else out
    if not windows:
        message = "the clocks of tracker and controller do not fit"
        found = (
            f"points from {times.min():.3f} to {times.max():.3f} s, log from {ends[0, 0]:.3f} to {ends[-1, 1]:.3f} s"
        )
        hint = "State their difference, the log's minus the tracker's."
        return [Problem(message, where, found=found, hint=hint, argument=("clock", "SECONDS")), *out]
    low, high = max(w[1] for w in windows), min(w[2] for w in windows)
    if low <= high:
        message = f"the log's clock seems to be {0.5 * (low + high):.3f} s ahead of the tracker's"
        hint = f"From {low:.3f} to {high:.3f} s every point falls into a stop at its pose."
        return [Problem(message, where, hint=hint, argument=("clock", f"{0.5 * (low + high):.3f}")), *out]
    first, last = min(windows, key=lambda w: w[0]), max(windows, key=lambda w: w[0])
    told = f"{first[1]:.3f} to {first[2]:.3f} s at the first point, {last[1]:.3f} to {last[2]:.3f} s at the last"
    message = "the clocks of tracker and controller run apart: no one difference suits all points"
    hint = "Join by order or by names, or import the stretches between two settings of the clocks one by one."
    return [Problem(message, where, found=told, hint=hint, argument=("join", "order")), *out]


def check_planned(
    points: Sequence[TrackerPoint], pendant: Array, campaign: Campaign, log: Listing, controller: Controller
) -> None:
    """InputError where the log's angles are not those of the planned pose; one where those of most are not, with the
    convention in which all are."""
    known = [i for i, point in enumerate(points) if point.pose in campaign.poses]
    planned = np.array([campaign.poses[points[i].pose] for i in known]).reshape(-1, pendant.shape[1])
    hint = f"Is {log.sheet.path.name} of this campaign, in this order, in this unit?"
    problems: list[Problem] = []
    for i, off in zip(known, np.rad2deg(np.abs(pendant[known] - planned)), strict=True):
        k = int(np.argmax(off))
        if off[k] > np.rad2deg(_PLANNED):
            message = f"the log has joint {k + 1} {off[k]:.3g} deg from where the plan puts it"
            problems.append(points[i].problem(f"{label(points[i].taken)}: {message}", hint=hint))
    if len(problems) > 2 and 2 * len(problems) > len(points):
        others = other_angles(controller, pendant[known])
        words = next((words for words, values in others if (np.abs(values - planned) <= _PLANNED).all()), "")
        message = f"{problems[0].message}, and so with {len(problems)} of {len(points)} points"
        hint = f"They agree {words}. Correct the log, or its headers." if words else hint
        problems = [replace(problems[0], message=message, hint=hint)]
    refuse(problems)
