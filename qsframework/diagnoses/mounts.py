"""What else could be mounted: a reflector on the base, on a link, on the floor, or a dial gauge."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.errors import InputError, Problem, nearest
from qsframework.experiment import Experiment, Marker, Readings
from qsframework.experiment.setup import WORLD
from qsframework.plugin.facts import frozen

GAUGE = 2e-6
"""m: sd of what a dial gauge reads."""
GAUGES = "gauges"
"""In `without`: all of them."""
_OUT = 0.9
"""m: how far a reflector on the base stands out, on a bar, and a nest on the floor."""
_ASIDE = 0.2
"""m: how far one on a link sits from the far end of it, aside of all axes, so that it sees the link turn."""
_REFLECTED, _GAUGED = 3, 1
"""Links, counted from the base, that a reflector and a gauge may be mounted on."""


@dataclass(frozen=True)
class Mount:
    """A reflector that nobody has mounted yet, or what a dial gauge touches, along an axis of the base; chance: of the
    right place with it."""

    marker: Marker
    along: str = ""
    chance: float = float("nan")


def mounts_of(experiment: Experiment, without: Collection[str] = ()) -> tuple[Mount, ...]:
    """Reflectors on the floor, on a bar of the base and at the far ends of the first links, where none is yet, and
    gauges at the base and the first link.

    without: links that nobody can reach, or `gauges`. InputError where one is no such link
    """
    robot, every = experiment.robot, dict[str, Marker]()
    out = np.array([_OUT, 0.0, 0.0])
    every[WORLD] = Marker(f"reflector_{WORLD}", WORLD, frozen(out))
    for k, own in enumerate(robot.facts.links[: min(1 + _REFLECTED, robot.facts.n)]):
        link = own if own in robot.frames else next((n for n, f in robot.frames.items() if f.link == k), None)
        if link is not None:
            far = out if k == 0 else robot.facts.placements[k][:3, 3] + _ASIDE / np.sqrt(3.0)
            every[link] = Marker(f"reflector_{link}", link, frozen(far))
    if unknown := [name for name in without if name not in (*every, GAUGES)]:
        allowed = (*every, GAUGES)
        hint = nearest(unknown[0], allowed)
        raise InputError(Problem(f"nothing is mounted on {unknown[0]!r}", allowed=", ".join(allowed), hint=hint))
    taken = {m.link for m in experiment.markers}
    free = [m for link, m in every.items() if link not in taken and link not in without]
    near = [m for link, m in list(every.items())[1 : 2 + _GAUGED] if link not in without and GAUGES not in without]
    gauges = [Mount(replace(m, name=f"gauge_{m.link}_{axis}"), axis) for m in near for axis in "xyz"]
    return (*(Mount(m) for m in free), *gauges)


def mounted(experiment: Experiment, mounts: Sequence[Mount]) -> Experiment:
    """The experiment with mounts as its last markers."""
    return experiment.with_(markers=(*experiment.markers, *(m.marker for m in mounts)))


def of_gauges(readings: Readings, mounts: Sequence[Mount], first: int) -> Readings:
    """Readings whose markers from `first` on are mounts, those of gauges as these read them."""
    for i, mount in enumerate(mounts):
        if mount.along:
            way = -np.eye(3)["xyz".index(mount.along)]
            readings = readings.gauged(readings.marker == first + i, way, GAUGE)
    return readings
