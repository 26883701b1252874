"""experiment.yaml: the robot, the load, the markers, the noise and the limits of a campaign."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.arguments import checked
from qsframework.elastostatics import Model, Site, make_model
from qsframework.elastostatics.so3 import from_quaternion
from qsframework.elastostatics.state import site_in
from qsframework.errors import InputError, Problem, nearest, refuse
from qsframework.experiment.columns import WRENCH_NAMES
from qsframework.experiment.constraints import (
    Constraints,
    capacity_problems,
    constraint_problems,
    make_constraints,
)
from qsframework.experiment.frames import Frame
from qsframework.experiment.noise import NoiseModel
from qsframework.experiment.obstacles import read_obstacles
from qsframework.experiment.spec import ExperimentSpec, LoadCaseSpec
from qsframework.experiment.stations import Station
from qsframework.files import Document, read_yaml, validate
from qsframework.files.documents import Key
from qsframework.plugin import Array, Effect, Parameter, Poses
from qsframework.plugin.build import build_effects
from qsframework.plugin.facts import frozen
from qsframework.plugin.registry import registry, suggestion, with_role
from qsframework.plugin.settings import place_fields, plural
from qsframework.plugin.trusted import trusted
from qsframework.robot import Robot, load_robot
from qsframework.robot.kinematics import FLOOR
from qsframework.robot.packages import inside
from qsframework.robot.robot import LinkFrame
from qsframework.robot.spec import read_effects, read_nominal
from qsframework.viewed import Viewed

GEOMETRY = "geometry"
"""In `fit`: the zeros and placements of all joints; their effects need not be listed."""
WORLD = "world"
"""As the link of a marker: the floor, in the base's frame; nothing that the robot does moves it."""
_GEOMETRIC = ("joint zero", "joint placement")
"""Roles of the effects that it stands for."""


@dataclass(frozen=True, eq=False)
class Marker:
    """A reflector fixed to a link of the URDF, or to the floor; xyz (3,) m and the unit normal (3,) in its frame."""

    name: str
    link: str
    xyz: Array
    normal: Array | None = None


@dataclass(frozen=True)
class LoadUncertainty:
    """sd of the load's scale (1 = 100 %), and of its direction, rad, about each axis; one error for all readings."""

    scale: float = 0.0
    direction: float = 0.0


@dataclass(frozen=True, eq=False)
class Gauge:
    """A dial gauge at a marker, and the unit vector (3,), base axes, that it reads along."""

    marker: str
    along: Array


@dataclass(frozen=True, eq=False)
class LoadCase:
    """A wrench (6,) at the load point, base frame, that a plan may put on a pose; a zero one is a reading of positions.

    `poses` says on how many, `poses_min` on how many at least; loads that say neither share the rest.
    cost: of a pose under this load, in plain poses; change: of bringing the load at all; gauge: what reads the
    displacement, None: the tracker
    """

    name: str
    wrench: Array
    poses: int | None
    poses_min: int | None = None
    _: KW_ONLY
    cost: float = 1.0
    change: float = 0.0
    gauge: Gauge | None = None

    @property
    def of_positions(self) -> bool:
        """Whether positions are read, and no load hangs."""
        return not np.any(self.wrench)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Experiment(Viewed):
    """A campaign: everything that a design, a simulation or a fit needs besides readings."""

    path: Path
    robot: Robot
    load_point: Array
    markers: tuple[Marker, ...]
    noise: NoiseModel
    loads: tuple[LoadCase, ...]
    effects: tuple[Effect, ...]
    parameters: tuple[Parameter, ...]
    fit: tuple[str, ...] | None
    constraints: Constraints
    data: tuple[Path, ...]
    has_load: bool = True
    rigid: bool = False
    load_uncertainty: LoadUncertainty = LoadUncertainty()
    states: str | None = None
    """How files of states are read: "differences", "positions", or as the campaign suggests."""
    frames: tuple[Frame, ...] = ()
    """The base in the frames of series that are known."""
    stations: tuple[Station, ...] = ()
    positions: LoadCase | None = None
    """Readings of positions that a plan may hold beside those under the loads."""

    @property
    def cases(self) -> tuple[LoadCase, ...]:
        """What a plan may read at a pose: displacements under each load, and positions; these alone without a load."""
        alone = () if self.loads or self.has_load else (LoadCase("", np.zeros(6), None),)
        return (*self.loads, *(alone if self.positions is None else (self.positions,)))

    @property
    def plans_positions(self) -> bool:
        """Whether a plan may read positions."""
        return any(case.of_positions for case in self.cases)

    @cached_property
    def _model(self) -> Model:
        effects = (*self.robot.effects, *self.effects)
        return self._model_of(effects, (*self.robot.parameters, *self.parameters))

    def _model_of(self, effects: Sequence[Effect], parameters: Sequence[Parameter]) -> Model:
        markers = [(m.name, self.site(m.link, m.xyz)) for m in self.markers]
        return make_model(self.robot.facts, effects, parameters, self.load_site, markers, self.robot.gravity)

    def rigid_places(self, q: Array) -> Array:
        """Where a rigid nominal arm puts every marker at joint values (N, n): (N, K, 3) m, base frame."""
        return self._model_of((), ()).positions(Poses(q, q, np.zeros((len(q), 6))))

    def model(self) -> Model:
        """The pipeline of this robot and campaign."""
        return self._model

    @property
    def marker_names(self) -> tuple[str, ...]:
        """Names of the markers."""
        return tuple(m.name for m in self.markers)

    @property
    def load_site(self) -> Site:
        """The load point on the last link."""
        return site_in(self.robot.flange, self.load_point)

    def site(self, link: str, xyz: Array) -> Site:
        """A point of a URDF link as a point of the moving link that carries it."""
        return site_in(self.frame_of(link), xyz)

    def frame_of(self, link: str) -> LinkFrame:
        """Where the frame of a URDF link is, or of the floor that the robot stands on."""
        own = self.robot.frames.get(link)
        if link != WORLD:
            return self.robot.frames[link]
        return LinkFrame(FLOOR, frozen(np.eye(4)) if own is None else own.placement)

    def fit_names(self) -> tuple[str, ...]:
        """The parameters to estimate: those that `fit:` names, else every compliance."""
        return self._fit_names

    @cached_property
    def _fit_names(self) -> tuple[str, ...]:
        model = self.model()
        if self.fit is None:
            return self.spring_names()
        return tuple(dict.fromkeys(n for entry in self.fit for n in expand_name(entry, model)))

    def spring_names(self) -> tuple[str, ...]:
        """Every compliance of the model."""
        model = self.model()
        return tuple(dict.fromkeys(model.names[i] for i in model.compliance_rows))

    def fit_parameters(self) -> tuple[Parameter, ...]:
        """The parameters of `fit_names`, with their nominal values."""
        model = self.model()
        return tuple(model.parameters[i] for i in model.index(self.fit_names()))

    def with_(self, **changes: Any) -> Experiment:
        """A copy with some fields changed."""
        return _with_geometry(replace(self, **changes))

    def with_effects(self, effects: Iterable[Effect]) -> Experiment:
        """A copy with further effects, at their nominal values; those that the arm or the campaign has stay."""
        have = {e.name for e in (*self.robot.effects, *self.effects)}
        more = tuple(e for e in effects if e.name not in have)
        own = tuple(p for e in more for p in e.parameters(self.robot.facts))
        return replace(self, effects=(*self.effects, *more), parameters=(*self.parameters, *own))


def _with_geometry(experiment: Experiment) -> Experiment:
    """With the effects that `geometry` in `fit` stands for, where they are not there yet."""
    if GEOMETRY not in (experiment.fit or ()):
        return experiment
    return experiment.with_effects(_geometry(experiment.robot, experiment.effects))


def _geometry(robot: Robot, effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """The zeros and placements of all joints that neither the robot nor these effects have."""
    present = {e.name for e in (*robot.effects, *effects)}
    kinds = [kind for role in _GEOMETRIC for kind in with_role(role)]
    wanted = [e for kind in kinds for e in build_effects({"joints": "all"}, robot.facts, effect=kind)]
    return tuple(e for e in wanted if e.name not in present)


def expand_name(entry: str, model: Model) -> tuple[str, ...]:
    """The parameters that the name of an effect, an instance or a parameter stands for; exact names only.

    `geometry` stands for the zeros and placements of all joints. A parameter that is estimated only `by_name` needs
    its own name.
    """
    if entry == GEOMETRY:
        return tuple(n for role in _GEOMETRIC for n in model.of_role(role))
    names: list[str] = []
    known: list[str] = []
    for effect, part in zip(model.effects, model.slices, strict=True):
        own = model.names[part]
        known += [effect.effect_name(), effect.name, *own]
        if entry in (effect.effect_name(), effect.name):
            names += [p.name for p in model.parameters[part] if not p.by_name]
        elif entry in own:
            names.append(entry)
    if not names:
        allowed = [*dict.fromkeys(known), GEOMETRY]
        hint = _effect_to_add(entry, model) or suggestion(entry, allowed)
        raise InputError(Problem(f"fit: no parameter {entry!r}", allowed=", ".join(allowed), hint=hint))
    return tuple(names)


def _effect_to_add(entry: str, model: Model) -> str | None:
    """What to add to the effects of an experiment that lacks the one that an entry of `fit:` is a parameter of."""
    name = re.split(r"[\[.]", entry)[0]
    kind = registry().get(name)
    if kind is None or name in {e.effect_name() for e in model.effects}:
        return None
    lacks = f"{name} is an effect that this experiment lacks"
    places = {plural(field): "all" for field in place_fields(kind)}
    try:
        built = build_effects(places, model.facts, model.marker_names, kind)
    except InputError as error:
        return f"{lacks}. Add it to effects: {error.problems[0].message}"
    if not any(e.parameters(model.facts) for e in built):
        return f"{lacks}. Add it to effects: at places of your own, for on this robot it fits no place by itself"
    written = "".join(f", {field}: {value}" for field, value in places.items())
    return f"{lacks}. Add to it: effects: [{{effect: {name}{written}}}]"


@checked
def load_experiment(path: str | Path, *, trust: bool | None = None) -> Experiment:
    """Read an experiment.yaml.

    Args:
        path: the file.
        trust: whether effects that it or its robot names by `file:` may run their code; None: as the command was given,
            by default not.

    Returns:
        The campaign: robot, loads, markers, noise and the parameters to estimate.

    Raises:
        InputError: with all its problems, each with file and line.
    """
    path = Path(path)
    document = read_yaml(path)
    spec = validate(document, ExperimentSpec)
    try:
        robot = load_robot(spec.robot, beside=path.parent, trust=trust)
    except InputError as error:
        raise _at(document, error, "robot") from None
    problems: list[Problem] = []
    markers = _markers(document, spec, robot, problems)
    names = tuple(m.name for m in markers)
    effects, found = read_effects(document, spec.effects, robot.facts, names, trust=trusted(trust))
    effects += _geometry(robot, effects) if GEOMETRY in (spec.fit or ()) else ()
    robot, parameters = _nominal(path, spec, effects, robot, problems, complete=not found)
    obstacles, wrong = read_obstacles(document, spec.constraints.obstacles, robot)
    problems += [*found, *constraint_problems(document, spec, robot), *wrong, *_load_problems(document, spec, robot)]
    refuse(problems)
    experiment = _with_geometry(
        Experiment(
            path=path,
            robot=robot,
            load_point=frozen(spec.load.point or spec.load.centre or np.zeros(3)),
            markers=markers,
            noise=_noise(spec),
            loads=_loads(spec, robot),
            effects=effects,
            parameters=parameters,
            fit=None if spec.fit is None else tuple(spec.fit),
            constraints=make_constraints(spec.constraints, obstacles),
            data=tuple(path.parent / name for name in ([spec.data] if isinstance(spec.data, str) else spec.data or ())),
            has_load="load" in spec.model_fields_set,
            rigid=spec.rigid,
            load_uncertainty=LoadUncertainty(spec.load_uncertainty.scale, spec.load_uncertainty.direction),
            states=spec.states,
            stations=tuple(
                Station(name, frozen(own.xyz), own.cost, own.clearance, own.incidence_max)
                for name, own in spec.stations.items()
            ),
            positions=_positions(spec),
            frames=tuple(
                Frame(name, from_quaternion(np.array(f.quat_wxyz)), frozen(f.xyz)) for name, f in spec.frames.items()
            ),
        )
    )
    _check_model(document, experiment)
    return experiment


def _noise(spec: ExperimentSpec) -> NoiseModel:
    if isinstance(spec.noise, str):
        return NoiseModel(None, source="estimated")
    n = spec.noise
    return NoiseModel(
        n.displacement_sigma if n.sigma is None else n.sigma,
        position=n.position_sigma,
        displacement=n.displacement_sigma,
        gauge=n.gauge_sigma,
        repeatability=n.repeatability,
        per_distance=n.distance_sigma,
        range=n.range_sigma,
        angle=n.angle_sigma or 0.0,
        nest=n.nest_sigma or 0.0,
        source=n.source,
    )


def _positions(spec: ExperimentSpec) -> LoadCase | None:
    """The readings of positions that `positions:` states."""
    own = spec.positions
    return None if own is None else LoadCase("", frozen(np.zeros(6)), own.poses, own.poses_min, cost=own.cost)


def _nominal(
    path: Path, spec: ExperimentSpec, effects: tuple[Effect, ...], robot: Robot, problems: list[Problem], complete: bool
) -> tuple[Robot, tuple[Parameter, ...]]:
    """The robot, and the parameters of the campaign's own effects, with the values of its `nominal` file."""
    own = {p.name: p for e in effects for p in e.parameters(robot.facts)}
    if spec.nominal is None:
        return robot, tuple(own.values())
    every = {p.name: p for p in robot.parameters} | own
    try:
        if not inside(path.parent / spec.nominal, path.parent):
            raise InputError(Problem(f"nominal: {spec.nominal[:80]!r} is outside the experiment's folder", str(path)))
        document = read_yaml(path.parent / spec.nominal)
        every, found = read_nominal(document, every, (*robot.effects, *effects), robot.facts, complete)
        problems += found
    except InputError as error:
        problems += error.problems
    robot = replace(robot, parameters=tuple(every[p.name] for p in robot.parameters))
    return robot, tuple(every[name] for name in own)


def _markers(document: Document, spec: ExperimentSpec, robot: Robot, problems: list[Problem]) -> tuple[Marker, ...]:
    out: list[Marker] = []
    for name, entry in spec.markers.items():
        link = entry.link or robot.facts.flange
        links = (*robot.frames, WORLD)
        if link not in links:
            message, allowed, hint = f"marker {name!r}: no link {link!r}", ", ".join(links), nearest(link, links)
            problems.append(document.problem(message, "markers", name, allowed=allowed, hint=hint))
            continue
        normal = None if entry.normal is None else frozen(np.array(entry.normal) / np.linalg.norm(entry.normal))
        out.append(Marker(name, link, frozen(entry.xyz), normal))
    return tuple(out)


def _loads(spec: ExperimentSpec, robot: Robot) -> tuple[LoadCase, ...]:
    """The wrenches of `loads:`, or the weight of the hung mass."""
    if spec.load.mass is not None:
        weight = np.concatenate([spec.load.mass * robot.gravity, np.zeros(3)])
        return (LoadCase("mass", frozen(weight), None),)

    def gauge(load: LoadCaseSpec) -> Gauge | None:
        if load.gauge is None:
            return None
        along = np.array(load.gauge.along)
        return Gauge(load.gauge.marker, frozen(along / np.linalg.norm(along)))

    return tuple(
        LoadCase(
            own.name, frozen(own.wrench()), own.poses, own.poses_min, cost=own.cost, change=own.change, gauge=gauge(own)
        )
        for own in spec.loads
    )


def _load_problems(document: Document, spec: ExperimentSpec, robot: Robot) -> list[Problem]:
    problems = capacity_problems(document, spec, robot)
    loads = spec.loads
    if loads and "load" not in spec.model_fields_set:
        message = "`loads` act somewhere: say where with `load`, for example load: {point_mm: [150, 0, 200]}"
        problems.append(document.problem(message, "loads"))
    if spec.load.mass is not None and loads:
        message = "load: a mass is a load by itself; give the mass or the list `loads`, not both"
        problems.append(document.problem(message, "load"))
    names, markers = [load.name for load in loads], list(spec.markers)
    for i, load in enumerate(loads):
        name, at = f"load {load.name!r}", ("loads", i)
        if names.index(load.name) != i:
            problems.append(document.problem(f"{name} stands here twice", *at))
        if not np.any(load.wrench()):
            hint = "For springs from the arm's own weight leave `loads` out and read `positions: {poses: 20}`."
            problems.append(document.problem(f"{name} is zero", *at, allowed=", ".join(WRENCH_NAMES), hint=hint))
        if load.gauge is not None and load.gauge.marker not in markers:
            message, hint = (
                f"{name}: its gauge is at no marker {load.gauge.marker!r}",
                nearest(load.gauge.marker, markers),
            )
            problems.append(document.problem(message, *at, allowed=", ".join(markers), hint=hint))
        if load.poses is not None and load.poses < 1:
            problems.append(document.problem(f"{name}: poses must be 1 or more", *at))
        if load.poses_min is not None and (load.poses_min < 1 or load.poses is not None):
            problems.append(document.problem(f"{name}: poses_min must be 1 or more, and goes without poses", *at))
    return problems


def _check_model(document: Document, experiment: Experiment) -> None:
    """Effects that do not fit together, and names in `fit`, are problems of the file."""
    try:
        model = experiment.model()
    except InputError as error:
        raise _at(document, error, "effects") from None
    problems: list[Problem] = []
    for i, entry in enumerate(experiment.fit or ()):
        try:
            expand_name(entry, model)
        except InputError as error:
            problems += _at(document, error, "fit", i).problems
    refuse(problems)


def _at(document: Document, error: InputError, *keys: Key) -> InputError:
    """The problems of an error at the entry of a document that led to it, where they name no file."""
    file, line = str(document.path), document.line(*keys)
    return InputError([replace(p, file=p.file or file, line=p.line or line) for p in error.problems])
