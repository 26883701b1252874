"""The noise of a campaign: what is known of the errors of its readings, and from where.

A reading errs by the instrument (alike in all coordinates, growing with the distance, or along its range and across),
by its nest, which all reads of a marker at one visit share, and by the arm, which comes back elsewhere: that error all
markers of a visit share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.plugin import Array

if TYPE_CHECKING:
    from qsframework.experiment.setup import Experiment
    from qsframework.experiment.stations import Station

Source = Literal["stated", "repeats", "data sheet", "estimated"]

_KEYS = {
    "sigma": ("sigma_mm", 1e3),
    "position": ("position_sigma_mm", 1e3),
    "displacement": ("displacement_sigma_mm", 1e3),
    "gauge": ("gauge_sigma_mm", 1e3),
    "repeatability": ("repeatability_mm", 1e3),
    "per_distance": ("distance_sigma_um/m", 1e6),
    "range": ("range_sigma_mm", 1e3),
    "angle": ("angle_sigma_urad", 1e6),
    "nest": ("nest_sigma_mm", 1e3),
}
"""The sizes of a noise, as an experiment.yaml says them."""


@dataclass(frozen=True)
class NoiseModel:
    """Standard deviations of one coordinate of a reading, m; None: nobody says.

    sigma: of a displacement, as plans count it; position, displacement, gauge: where the kinds are stated apart, and
    then `apart`; repeatability: of the error that the markers of a visit share; per_distance: what the sd of a position
    grows by per metre from the tracker; range, angle (rad): of a position along the tracker's beam, and of its
    direction across it; nest: of the error that all reads of a marker at one visit share
    source: where the sizes are from; of estimated ones a fit takes the ratios and estimates a common factor
    """

    sigma: float | None
    _: KW_ONLY
    position: float | None = None
    displacement: float | None = None
    gauge: float | None = None
    repeatability: float | None = None
    per_distance: float = 0.0
    range: float | None = None
    angle: float = 0.0
    nest: float = 0.0
    source: Source = "stated"

    @property
    def apart(self) -> bool:
        """Whether the kinds of readings are stated one by one."""
        return any(v is not None for v in (self.position, self.displacement, self.gauge, self.range))

    @property
    def estimated(self) -> bool:
        """Whether a fit has to estimate its size, or a common factor."""
        return self.source == "estimated"

    @property
    def known(self) -> bool:
        """Whether anything is said of its size."""
        return self.sigma is not None or self.apart

    def of(self, kind: str) -> float | None:
        """sd of one coordinate of a "position" near the tracker, a "touch", a "displacement" or a "gauge"."""
        own = {"displacement": self.displacement, "gauge": self.gauge}
        return own.get(kind, self.position) if self.apart else self.sigma

    def of_beam(self, kind: str) -> bool:
        """Whether readings of a kind err along the tracker's beam otherwise than across."""
        return self.range is not None and (kind == "position" or (kind == "displacement" and self.of(kind) is None))

    def covariances(self, kind: str, seen: Array) -> Array | None:
        """Covariances (n, 3, 3) m^2 of one read of markers at `seen` (n, 3) m from the tracker, in its axes, without
        what a visit brings; None where nobody states them. A displacement is the difference of two positions."""
        distance = np.linalg.norm(seen, axis=-1)[:, None, None]
        if self.range is not None and self.of_beam(kind):
            beam = seen / np.maximum(distance[..., 0], 1e-9)
            along = beam[:, :, None] * beam[:, None, :]
            square = self.range**2 * along + np.square(self.angle * distance) * (np.eye(3) - along)
            return square if kind == "position" else 2.0 * square
        near = self.of(kind)
        if near is None:
            return None
        far = self.per_distance * distance if kind == "position" else np.zeros_like(distance)
        return np.square(near + far) * np.eye(3)

    def scaled(self, factor: float, source: Source) -> NoiseModel:
        """All its sizes times a factor, from another source."""
        sizes = {name: factor * v for name in _KEYS if (v := getattr(self, name)) is not None}
        return replace(self, **sizes, source=source)

    def entry(self) -> dict[str, float | str]:
        """`noise:` of an experiment.yaml that states it."""
        sizes = {name: getattr(self, name) for name in _KEYS if getattr(self, name)}
        if self.apart:
            sizes.pop("sigma", None)  # that of a displacement, which is stated by itself
        said = {_KEYS[name][0]: _KEYS[name][1] * value for name, value in sizes.items()}
        return said | ({} if self.source == "stated" else {"source": self.source})


def split_covariances(covariance: Array) -> tuple[Array, Array]:
    """sd (n, 3) of each coordinate of covariances (n, 3, 3), and two vectors (n, 2, 3) of what they have beyond an
    equal error of all coordinates: C = (smallest eigenvalue) I + the sum of v v'."""
    values, vectors = np.linalg.eigh(covariance)
    beyond = np.sqrt(np.maximum(values[:, 1:] - values[:, :1], 0.0))
    return np.sqrt(np.einsum("nii->ni", covariance)), beyond[:, :, None] * vectors[:, :, 1:].transpose(0, 2, 1)


def seen_from(experiment: Experiment, name: str, places: Array) -> Array:
    """Places (..., 3) m, base frame, from the tracker of a series. InputError where nobody says where that stands."""
    one = [s for s in experiment.stations if s.name == name] or experiment.stations[: len(experiment.stations) == 1]
    if not one or one[0].xyz is None:
        message = (
            "the noise of a displacement along the tracker's beam and across: nobody says where the tracker stands"
        )
        hint = "Say it, about: stations: {front: {xyz_mm: [2500, 0, 800]}}; or state displacement_sigma_mm."
        raise InputError(Problem(message, str(experiment.path), hint=hint))
    return places - one[0].xyz


def gauge_sigma(experiment: Experiment) -> float | None:
    """sd m of one reading of a dial gauge. InputError where the kinds are stated apart and it is not."""
    known = experiment.noise.of("gauge")
    if known is None:
        hint = "State it: noise: {..., gauge_sigma_mm: 0.01}."
        raise InputError(
            Problem("a load is read by a gauge, and nobody states its noise", str(experiment.path), hint=hint)
        )
    return known


def require_position_noise(experiment: Experiment, stations: Sequence[Station]) -> None:
    """InputError where the noise of planned positions is not stated, or depends on where a tracker is that nobody
    places."""
    noise, path = experiment.noise, experiment.path
    if noise.of("position") is None and not noise.of_beam("position"):
        example = "noise: {position_sigma_mm: 0.03}"
        raise InputError(f"{path}: a reading of positions needs its noise, for example {example}")
    placed = {frame.series for frame in experiment.frames} | {s.name for s in stations if s.xyz is not None}
    if (noise.per_distance or noise.of_beam("position")) and any(s.name not in placed for s in stations):
        hint = "stations: {front: {xyz_mm: [2500, 0, 800]}}"
        raise InputError(f"{path}: the noise depends on where the tracker stands, so say it, about: {hint}")
