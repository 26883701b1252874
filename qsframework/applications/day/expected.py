"""What every state of the day should read, before anything is read: places and deflections, and what may be off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from qsframework.applications.day.record import Slot
from qsframework.applications.protocol import Protocol
from qsframework.elastostatics import Model
from qsframework.experiment import Experiment, Frame
from qsframework.plugin import Array, Poses
from qsframework.robot.kinematics import joint_frames

_SIGMA = 5e-5
"""m: noise of a coordinate where the experiment states none."""
_UNKNOWN = 0.5
"""Share of its nominal value by which a spring may be off where no sd is stated."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Expected:
    """The M markers of one link, that which carries most, at the N states of a day, base frame, m.

    names: of these markers; those of other links are stored and not judged; at: place of each state; poses: of the N
    states under their loads; place (N, M, 3): where the markers are; moved (N, M, 3): by how much the load moved them
    there; slope (N, M, 3, p): its rates by the springs, whose sds are spread (p,); rotation (N, 3, 3): of the markers'
    link; sigma, m: of a coordinate of a position; frames: series whose frame is known
    """

    experiment: Experiment
    model: Model
    protocol: Protocol
    names: tuple[str, ...]
    at: Mapping[Slot, int]
    poses: Poses
    place: Array
    moved: Array
    slope: Array
    spread: Array
    rotation: Array
    sigma: float
    frames: Mapping[str, Frame]

    @property
    def stated(self) -> Array:
        """The markers (M, 3) m in their link's frame, as the experiment states them."""
        return np.array([m.xyz for m in self.experiment.markers if m.name in self.names])

    def standing(self, pendant: Array) -> Array:
        """Where the markers are (N, M, 3) m at other angles (N, n) rad, without a load."""
        all_ = self.model.positions(_poses(self.experiment, pendant, np.zeros((len(pendant), 6))))
        return all_[:, [i for i, m in enumerate(self.experiment.markers) if m.name in self.names]]


def expected(experiment: Experiment, protocol: Protocol) -> Expected:
    """What the nominal arm would read at every state of a protocol."""
    model = experiment.model()
    slots = [Slot(v, k) for v, visit in enumerate(protocol.visits) for k in range(len(visit.states))]
    pendant = np.stack([protocol.visits[s.visit].pendant for s in slots])
    wrench = np.stack([protocol.visits[s.visit].states[s.state].wrench for s in slots])
    _, one, where = np.unique(np.round(np.hstack([pendant, wrench]), 9), axis=0, return_index=True, return_inverse=True)
    where = where.ravel()
    poses = _poses(experiment, pendant[one], wrench[one])
    names = experiment.spring_names()
    place = model.positions(poses, loaded=True)
    moved = place - model.positions(replace(poses, wrench=np.zeros_like(poses.wrench)))
    slope = model.sensitivity(poses, None, names) if names else np.zeros((*place.shape, 0))
    parameters = [model.parameters[i] for i in model.index(names)]
    spread = np.array([p.sd or _UNKNOWN * abs(p.nominal) or p.typical for p in parameters])
    links = [m.link for m in experiment.markers]
    carrier = max(dict.fromkeys(links), key=links.count)
    own = [i for i, name in enumerate(links) if name == carrier]
    link = experiment.site(carrier, np.zeros(3)).link
    rotation = joint_frames(model.facts, poses.q).matrix(link)
    return Expected(
        experiment=experiment,
        model=model,
        protocol=protocol,
        names=tuple(experiment.markers[i].name for i in own),
        at={s: i for i, s in enumerate(slots)},
        poses=_poses(experiment, pendant, wrench),
        place=place[where][:, own],
        moved=moved[where][:, own],
        slope=slope[where][:, own],
        spread=spread,
        rotation=np.asarray(rotation)[where],
        sigma=_sigma(experiment),
        frames={f.series: f for f in experiment.frames},
    )


def _sigma(experiment: Experiment) -> float:
    """sd m of a coordinate of a position, as a table of states has it."""
    return experiment.noise.position or experiment.noise.sigma or _SIGMA


def _poses(experiment: Experiment, pendant: Array, wrench: Array) -> Poses:
    return Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench)
