"""The shape of experiment.yaml."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pydantic

from qsframework.experiment.noise import Source
from qsframework.experiment.obstacles import ObstacleSpec
from qsframework.files import FileModel, Unit

SHORTEST = 1e-9
"""A direction whose numbers are all smaller is none: its length would be rounded away."""


def _three(words: str, zero: bool = True) -> pydantic.AfterValidator:
    """The check of three numbers, which may all be zero or not."""

    def check(value: list[float]) -> list[float]:
        if len(value) != 3 or not (zero or max(map(abs, value)) >= SHORTEST):
            raise ValueError(words)
        return value

    return pydantic.AfterValidator(check)


class LoadSpec(FileModel):
    """Where the force acts: a point in the flange frame, or a hung mass with its centre."""

    point: Annotated[list[float] | None, Unit("m")] = None
    mass: Annotated[float | None, Unit("kg")] = None
    centre: Annotated[list[float] | None, Unit("m")] = None

    @pydantic.model_validator(mode="after")
    def _complete(self) -> LoadSpec:
        place = self.point if self.point is not None else self.centre
        if place is None or len(place) != 3:
            raise ValueError("load needs point_mm: [x, y, z], or mass_kg and centre_mm: [x, y, z]")
        if (self.mass is None) != (self.centre is None):
            raise ValueError("mass and centre belong together")
        if self.point is not None and self.centre is not None:
            raise ValueError("give either the point or the mass and its centre")
        if self.mass is not None and self.mass <= 0:
            raise ValueError("the mass must be positive")
        return self


class MarkerSpec(FileModel):
    """A reflector: xyz in the frame of a link, the flange unless said; `normal` is where its opening looks."""

    xyz: Annotated[list[float], Unit("m"), _three("xyz needs three numbers")]
    link: str | None = None
    normal: Annotated[list[float], _three("normal needs three numbers, not all zero", zero=False)] | None = None


class NoiseSpec(FileModel):
    """sd of one coordinate of a reading: sigma where a campaign has one kind of reading, else each kind by its name.

    sigma is that of a displacement in displacement files and in plans, of a position in files of positions;
    distance_sigma is what the sd of a position grows by per metre between tracker and marker (`distance_sigma_um/m`);
    range_sigma, angle_sigma: of positions along the beam of the tracker and across it, in place of position_sigma;
    repeatability: sd of a coordinate that the markers of a visit share, because the arm comes back elsewhere;
    nest_sigma: of what all reads of a marker at one visit share; source: where the numbers are from: of estimated ones
    a fit takes the ratios and estimates their size
    """

    sigma: Annotated[float | None, Unit("m")] = None
    position_sigma: Annotated[float | None, Unit("m")] = None
    distance_sigma: Annotated[float, Unit("")] = pydantic.Field(default=0.0, ge=0.0)
    range_sigma: Annotated[float | None, Unit("m")] = None
    angle_sigma: Annotated[float | None, Unit("rad")] = None
    displacement_sigma: Annotated[float | None, Unit("m")] = None
    gauge_sigma: Annotated[float | None, Unit("m")] = None
    repeatability: Annotated[float | None, Unit("m")] = None
    nest_sigma: Annotated[float | None, Unit("m")] = None
    source: Source = "stated"

    @pydantic.field_validator(
        "sigma",
        "position_sigma",
        "range_sigma",
        "angle_sigma",
        "displacement_sigma",
        "gauge_sigma",
        "repeatability",
        "nest_sigma",
    )
    @classmethod
    def _positive(cls, value: float | None) -> float | None:
        if value is not None and value <= 0:
            raise ValueError("the noise must be positive; `noise: estimate` takes it from the residuals")
        return value

    @pydantic.model_validator(mode="after")
    def _enough(self) -> NoiseSpec:
        kinds = (self.position_sigma, self.displacement_sigma, self.gauge_sigma, self.range_sigma)
        if (self.range_sigma is None) != (self.angle_sigma is None):
            raise ValueError("range_sigma_mm and angle_sigma_urad belong together: along the beam and across it")
        if self.range_sigma is not None and self.distance_sigma:
            raise ValueError("give angle_sigma_urad or distance_sigma, not both: each grows with the distance")
        if self.sigma is None and all(k is None for k in kinds):
            raise ValueError("needs sigma_mm; `noise: estimate` takes it from the residuals")
        if self.sigma is not None and any(k is not None for k in kinds):
            raise ValueError(
                "give sigma_mm, or position_sigma_mm (range_sigma_mm and angle_sigma_urad), displacement_sigma_mm and "
                "gauge_sigma_mm apart"
            )
        return self


class FrameSpec(FileModel):
    """The robot's base in the frame of a series, where it is known: origin, and a quaternion w, x, y, z."""

    xyz: Annotated[list[float], Unit("m")]
    quat_wxyz: list[float]

    @pydantic.model_validator(mode="after")
    def _sizes(self) -> FrameSpec:
        if len(self.xyz) != 3:
            raise ValueError("xyz needs three numbers")
        if len(self.quat_wxyz) != 4 or abs(sum(v * v for v in self.quat_wxyz) - 1.0) > 1e-3:
            raise ValueError("quat_wxyz needs four numbers w, x, y, z, of length 1")
        return self


class StationSpec(FileModel):
    """Where the tracker stands, about, base frame; cost: of setting it up there, in plain poses."""

    xyz: Annotated[list[float], Unit("m"), _three("xyz needs three numbers, base frame")]
    cost: float = pydantic.Field(default=0.0, ge=0.0)
    clearance: Annotated[float, Unit("m")] = pydantic.Field(default=0.005, ge=0.0)
    incidence_max: Annotated[float | None, Unit("rad")] = pydantic.Field(default=None, gt=0)


class PositionsSpec(FileModel):
    """That a plan may read positions without a load, on how many poses, and what such a pose costs."""

    poses: int | None = pydantic.Field(default=None, ge=1)
    poses_min: int | None = pydantic.Field(default=None, ge=1)
    cost: float = pydantic.Field(default=1.0, gt=0.0)


class GaugeSpec(FileModel):
    """A dial gauge that reads one marker along one direction, base axes."""

    marker: str
    along: Annotated[list[float], _three("along needs three numbers, not all zero", zero=False)]


class LoadUncertaintySpec(FileModel):
    """sd of the load's size, and of its direction about each axis; one error for all readings."""

    scale: Annotated[float, Unit("")] = pydantic.Field(default=0.0, ge=0.0, lt=0.5)
    direction: Annotated[float, Unit("rad")] = pydantic.Field(default=0.0, ge=0.0, lt=0.5)


class LoadCaseSpec(FileModel):
    """A wrench that a design may put on a pose."""

    name: str
    fx: Annotated[float, Unit("N")] = 0.0
    fy: Annotated[float, Unit("N")] = 0.0
    fz: Annotated[float, Unit("N")] = 0.0
    mx: Annotated[float, Unit("N m")] = 0.0
    my: Annotated[float, Unit("N m")] = 0.0
    mz: Annotated[float, Unit("N m")] = 0.0
    poses: int | None = None
    poses_min: int | None = None
    cost: float = 1.0
    change: float = pydantic.Field(default=0.0, ge=0.0)
    gauge: GaugeSpec | None = None

    @pydantic.field_validator("cost")
    @classmethod
    def _costly(cls, value: float) -> float:
        if not 0.0 < value < float("inf"):
            raise ValueError("a cost is a positive number: how many plain poses one pose under this load is worth")
        return value

    @pydantic.field_validator("name")
    @classmethod
    def _named(cls, value: str) -> str:
        if value.strip() != value or not value:
            raise ValueError("needs letters, without blanks around them")
        return value

    def wrench(self) -> list[float]:
        return [self.fx, self.fy, self.fz, self.mx, self.my, self.mz]


class SightSpec(FileModel):
    """From where the tracker looks; all markers must be seen unless a list names some."""

    station: Annotated[list[float], Unit("m"), _three("station needs three numbers, base frame")]
    markers: list[str] | None = None
    clearance: Annotated[float, Unit("m")] = 0.005
    incidence_max: Annotated[float | None, Unit("rad")] = pydantic.Field(default=None, gt=0)

    @pydantic.field_validator("clearance")
    @classmethod
    def _not_negative(cls, value: float) -> float:
        if value < 0:
            raise ValueError("a clearance is not negative")
        return value


class ConstraintsSpec(FileModel):
    """What planned poses keep."""

    x_min: Annotated[float | None, Unit("m")] = None
    x_max: Annotated[float | None, Unit("m")] = None
    y_min: Annotated[float | None, Unit("m")] = None
    y_max: Annotated[float | None, Unit("m")] = None
    z_min: Annotated[float | None, Unit("m")] = None
    z_max: Annotated[float | None, Unit("m")] = None
    axis1_distance_min: Annotated[float | None, Unit("m")] = None
    flip_margin: Annotated[float | None, Unit("N m")] = None
    of: str = "wrist_centre"
    joint_limits: Annotated[dict[str, list[float]], Unit("rad")] = pydantic.Field(default_factory=dict)
    joint_travel: Annotated[dict[str, list[float]], Unit("m", "joint_limits")] = pydantic.Field(default_factory=dict)
    joint_margin: Annotated[float | None, Unit("rad")] = None
    collision: bool | None = None
    clearance: Annotated[float, Unit("m")] = 0.0
    tool_radius: Annotated[float | None, Unit("m")] = None
    floor: Annotated[float | None, Unit("m")] = None
    obstacles: dict[str, ObstacleSpec] | str = pydantic.Field(
        default_factory=dict[str, ObstacleSpec],
        examples=["{table: {box_m: [1, 1, 0.8], at_m: [2, 0, 0.4]}}", "cell.yaml"],
    )
    sight: SightSpec | None = None
    singularity_margin: float | None = None
    load_capacity: bool = True
    joint_values: Annotated[dict[str, list[float]], Unit("rad")] = pydantic.Field(default_factory=dict)
    joint_places: Annotated[dict[str, list[float]], Unit("m", "joint_values")] = pydantic.Field(default_factory=dict)

    @pydantic.field_validator("axis1_distance_min", "clearance", "tool_radius", "singularity_margin", "joint_margin")
    @classmethod
    def _distance(cls, value: float | None) -> float | None:
        if value is not None and value < 0:
            raise ValueError("a distance, a radius or a margin is not negative")
        return value

    @pydantic.model_validator(mode="after")
    def _ranges(self) -> ConstraintsSpec:
        for axis in "xyz":
            low, high = getattr(self, f"{axis}_min"), getattr(self, f"{axis}_max")
            if low is not None and high is not None and low >= high:
                raise ValueError(f"{axis}_min must be below {axis}_max")
        nothing = self.collision is False and not self.obstacles
        if nothing and self.clearance > 0:
            raise ValueError("a clearance has no use with `collision: false` and without obstacles")
        if nothing and self.tool_radius is not None and self.floor is None:
            raise ValueError("a tool_radius has no use with `collision: false`, without floor_m and obstacles")
        return self


class ExperimentSpec(FileModel):
    """experiment.yaml."""

    robot: str
    data: str | list[str] | None = None
    states: Literal["differences", "positions"] | None = None  # how files of states are read
    load: LoadSpec = LoadSpec.model_construct()  # left out: the readings are of unloaded states
    markers: dict[str, MarkerSpec] = pydantic.Field(examples=["{m1: {xyz_mm: [150, 0, 200]}}"])
    frames: dict[str, FrameSpec] = pydantic.Field(default_factory=dict[str, FrameSpec])
    stations: dict[str, StationSpec] = pydantic.Field(default_factory=dict[str, StationSpec])
    positions: PositionsSpec | None = None  # planned beside the loads; without a load a plan has nothing else
    noise: NoiseSpec | Literal["estimate"] = pydantic.Field(examples=["{sigma_mm: 0.03}", "estimate"])
    load_uncertainty: LoadUncertaintySpec = LoadUncertaintySpec()
    loads: list[LoadCaseSpec] = pydantic.Field(default_factory=list[LoadCaseSpec])
    constraints: ConstraintsSpec = ConstraintsSpec()
    effects: list[dict[str, Any]] = pydantic.Field(default_factory=list[dict[str, Any]])
    nominal: str | None = None  # a file of values of these effects and of the robot, beside the experiment
    fit: list[str] | None = None
    rigid: bool = False

    @pydantic.field_validator("markers")
    @classmethod
    def _some(cls, value: dict[str, MarkerSpec]) -> dict[str, MarkerSpec]:
        if not value:
            raise ValueError("at least one marker is needed")
        if not all(name.strip() == name != "" for name in value):
            raise ValueError("a marker needs a name without blanks around it")
        return value

    @pydantic.field_validator("fit")
    @classmethod
    def _something(cls, value: list[str] | None) -> list[str] | None:
        if value is not None and not value:
            raise ValueError("names no parameter; leave it out to fit every compliance")
        return value
