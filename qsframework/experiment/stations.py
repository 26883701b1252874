"""Where the tracker stands: which markers it sees from there, and how well it reads them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qsframework.experiment.frames import Frame
from qsframework.plugin import Array
from qsframework.robot.kinematics import joint_frames
from qsframework.robot.sight import Flags, incidence, visible

if TYPE_CHECKING:
    from qsframework.experiment.setup import Experiment

_BLOCK = 4096


@dataclass(frozen=True, eq=False)
class Station:
    """A stand of the tracker, a series of readings by its name; "" where nobody says where the one stand is.

    xyz (3,) m: where it is about, base frame; None: not stated, and every marker is seen
    cost: of setting the tracker up there, in plain poses; clearance, incidence_max: as of `Sight`
    """

    name: str = ""
    xyz: Array | None = None
    cost: float = 0.0
    clearance: float = 0.005
    incidence_max: float | None = None

    def sees(self, experiment: Experiment, q: Array) -> Flags:
        """Which of the K markers (N, K) it sees at URDF joint angles (N, n)."""
        robot, out = experiment.robot, np.ones((len(q), len(experiment.markers)), dtype=bool)
        if self.xyz is None:
            return out
        for start in range(0, len(q), _BLOCK):
            part = slice(start, start + _BLOCK)
            placed = joint_frames(robot.facts, q[part])
            for k, marker in enumerate(experiment.markers):
                site = experiment.site(marker.link, marker.xyz)
                out[part, k] = visible(robot.shapes, placed, self.xyz, site.link, site.xyz, self.clearance)
                if self.incidence_max is not None and marker.normal is not None:
                    normal = experiment.frame_of(marker.link).placement[:3, :3] @ marker.normal
                    angle = incidence(placed, self.xyz, site.link, site.xyz, normal)
                    out[part, k] &= angle <= self.incidence_max
        return out


def station_of(experiment: Experiment, name: str) -> Station:
    """The station of a name; one that sees everything where the experiment has none of it."""
    return next((s for s in experiment.stations if s.name == name), Station(name))


def station_frame(experiment: Experiment, series: str) -> Frame:
    """The base as the tracker of a station would see it, with axes along those of the base."""
    xyz = station_of(experiment, series).xyz
    return Frame(series, np.eye(3), np.zeros(3) if xyz is None else -xyz)


def seen_markers(experiment: Experiment, q: Array, names: Sequence[str]) -> Flags:
    """Which markers (N, K) are seen at joint angles (N, n), each from the station (N,) of a name."""
    out = np.ones((len(q), len(experiment.markers)), dtype=bool)
    for name in dict.fromkeys(names):
        rows = np.flatnonzero(np.array(names) == name)
        out[rows] = station_of(experiment, name).sees(experiment, q[rows])
    return out
