"""Result files: fit.json both ways, nominal.yaml with identified values, a URDF with corrected joint origins."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import pydantic

from qsframework.elastostatics import Model
from qsframework.errors import InputError, Problem
from qsframework.estimation.tails import chi2_sf
from qsframework.experiment import Experiment, Frame
from qsframework.files import Document, FileModel, Unit, read_yaml, sha256, validate, write_text
from qsframework.files.formats import check_format
from qsframework.identify.fit import SIGNIFICANT, Fit, Masked
from qsframework.identify.soundness import obeyed, robot_hash
from qsframework.plausible import allowed, beyond
from qsframework.plugin import Array, Context, Geometry, Loop, Parameter, Poses, laws
from qsframework.robot import Robot
from qsframework.robot.corrected import write_corrected_urdf


class EstimateSpec(FileModel):
    """One estimate in fit.json, SI; sd is null where none is quoted."""

    model_config = pydantic.ConfigDict(extra="ignore", frozen=True, strict=True, allow_inf_nan=False)
    value: float
    sd: float | None
    unit: str
    initial: float
    status: str


class MaskedSpec(FileModel):
    """Rows that were masked before the fit, in fit.json."""

    model_config = pydantic.ConfigDict(extra="ignore", frozen=True, strict=True, allow_inf_nan=False)
    kind: str
    rows: list[int]
    words: str
    readings: str


class StoredFrameSpec(FileModel):
    """The base in the frame of a series, in fit.json: rotation matrix by rows, and origin."""

    model_config = pydantic.ConfigDict(extra="ignore", frozen=True, strict=True, allow_inf_nan=False)
    rotation: list[list[float]]
    origin: Annotated[list[float], Unit("m")]


class FitSpec(FileModel):
    """fit.json; keys that are for people only are passed over."""

    model_config = pydantic.ConfigDict(extra="ignore", frozen=True, strict=True, allow_inf_nan=False)
    format: int = 1
    robot: str = ""
    robot_sha256: str = ""
    method: str
    parameters: list[str]
    estimates: dict[str, EstimateSpec]
    covariance: list[list[float]]
    covariance_total: list[list[float]] | None = None  # with the load's stated uncertainty
    sigma: Annotated[float, Unit("m")]
    sigma_source: str
    chi2: float
    dof: int
    model: dict[str, float]
    data_sha256: str
    linear: bool = False
    frames: dict[str, StoredFrameSpec] = pydantic.Field(default_factory=dict[str, "StoredFrameSpec"])
    masked: list[MaskedSpec] | None = None
    masked_rows: list[int] = pydantic.Field(default_factory=list[int])
    unseen: Annotated[list[float] | None, Unit("m")] = None


@dataclass(frozen=True, eq=False, kw_only=True)
class StoredFit:
    """A fit as its file holds it: values (p,), sd (p,) NaN where none is quoted, covariance (p, p), SI.

    model: the values of all parameters of the model, estimated or not; robot, robot_sha256: "" in files that do not
    say it, see `soundness.robot_hash`; unseen: error, m, of the nominal values and of the fit at poses left out, None
    where no pose could be left out
    """

    method: str
    names: tuple[str, ...]
    values: Array
    sd: Array
    covariance: Array
    status: tuple[str, ...]
    sigma: float
    sigma_source: str
    chi2: float
    dof: int
    model: dict[str, float]
    data_sha256: str
    robot: str = ""
    robot_sha256: str = ""
    unseen: tuple[float, float] | None = None
    file: str = ""
    total_covariance: Array | None = None
    """With the stated uncertainty of the campaign's load; None where none was stated."""
    cleaned: tuple[Masked, ...] | None = None
    """What was masked before the fit; None where nobody looked."""
    masked_rows: tuple[int, ...] = ()
    linear: bool = False
    frames: tuple[Frame, ...] = ()

    def model_names(self, experiment: Experiment) -> tuple[str, ...]:
        """The estimated parameters that are the model's, and not a frame's. InputError where it has no such."""
        known = experiment.model().names
        own = tuple(n for n in self.names if not n.startswith("frame"))
        if missing := [n for n in own if n not in known]:
            raise InputError(f"{self.file}: the fit is of another model: {', '.join(missing)} is not in this one")
        return own

    @property
    def whole_covariance(self) -> Array:
        """Covariance (p, p) of the noise and, where it was stated, of the load."""
        return self.covariance if self.total_covariance is None else self.total_covariance

    @property
    def agrees(self) -> bool | None:
        """Whether the residuals agree with their stated noise; None where none was stated."""
        stated = self.sigma_source != "estimated" and self.dof > 0
        return bool(chi2_sf(self.chi2, self.dof) >= SIGNIFICANT) if stated else None

    @property
    def widening(self) -> float:
        """What the variances that the fit promises are multiplied by: chi-square per degree of freedom where the
        residuals do not fit their stated noise, else 1."""
        return self.chi2 / self.dof if self.agrees is False else 1.0

    def x(self, model: Model) -> Array:
        """Values of all parameters of a model (p,). InputError where the fit is of another model.

        A parameter that is estimated by its own name only has its nominal value where the fit has none.
        """
        missing = [p.name for p in model.parameters if p.name not in self.model and not p.by_name]
        if missing:
            words = f"the fit is of another model: it has no {', '.join(missing)}"
            raise InputError(Problem(words, file=self.file or None))
        values = [self.model.get(p.name, p.nominal) for p in model.parameters]
        far = [
            Problem(p.name, self.file or None, found=f"{value:.6g} {p.unit}", allowed=allowed(known, p.unit))
            for p, value in zip(model.parameters, values, strict=True)
            if (known := beyond(value, p.unit)) is not None and abs(value) > known.most
        ]
        if far:
            raise InputError(far)
        return np.array(values)

    def is_of(self, data: Path) -> bool:
        """Whether the readings in a file are those of the fit, by their hash."""
        return sha256(data) in self.data_sha256.split("+")


def stored(fit: Fit | StoredFit) -> StoredFit:
    """A fit as its file would hold it; a stored one as it is."""
    if isinstance(fit, StoredFit):
        return fit
    before, after, _ = fit.unseen
    return StoredFit(
        method=fit.method,
        names=fit.names,
        values=np.array([e.value for e in fit.estimates]),
        sd=np.array([e.sd for e in fit.estimates]),
        covariance=fit.covariance,
        status=tuple(e.status for e in fit.estimates),
        sigma=fit.sigma,
        sigma_source=fit.sigma_source,
        chi2=fit.chi2,
        dof=fit.dof,
        model=dict(zip(fit.model.names, fit.x.tolist(), strict=True)),
        data_sha256=fit.data_sha256,
        robot=fit.model.facts.name,
        robot_sha256=robot_hash(fit.model.facts),
        unseen=(before, after) if np.isfinite([before, after]).all() else None,
        total_covariance=fit.total_covariance,
        cleaned=fit.cleaned,
        masked_rows=fit.masked_rows,
        linear=fit.linear,
        frames=fit.frames,
    )


def write_fit(fit: Fit, path: str | Path) -> Path:
    """Write fit.json, all or nothing."""
    return write_text(path, json.dumps(fit.as_json(), indent=2, sort_keys=True, allow_nan=False) + "\n")


def read_fit(path: str | Path) -> StoredFit:
    """Read a fit.json. InputError with all its problems, each with its line."""
    document = read_yaml(path)
    check_format(document)
    spec = validate(document, FitSpec)
    p = len(spec.parameters)
    wrong = [
        Problem(f"parameter {name!r} has no estimate", str(path), document.line("estimates"))
        for name in spec.parameters
        if name not in spec.estimates
    ]
    for key, given in (("covariance", spec.covariance), ("covariance_total", spec.covariance_total)):
        if given is None:
            continue
        if len(given) != p or any(len(row) != p for row in given):
            wrong.append(
                Problem(
                    f"{key} has another size than parameters",
                    str(path),
                    document.line(key),
                    allowed=f"{p} rows of {p} numbers",
                )
            )
        elif not np.allclose(given, np.transpose(given), rtol=1e-6, atol=0.0):
            wrong.append(Problem(f"{key} is not symmetric", str(path), document.line(key)))
    if spec.unseen is not None and len(spec.unseen) != 2:
        found, allowed = f"{len(spec.unseen)} numbers", "2: of the nominal values and of the fit"
        wrong.append(Problem("unseen_mm", str(path), document.line("unseen_mm"), found=found, allowed=allowed))
    if wrong:
        raise InputError(wrong)
    estimates = [spec.estimates[name] for name in spec.parameters]
    return StoredFit(
        method=spec.method,
        names=tuple(spec.parameters),
        values=np.array([e.value for e in estimates]),
        sd=np.array([np.nan if e.sd is None else e.sd for e in estimates]),
        covariance=np.array(spec.covariance).reshape(p, p),
        status=tuple(e.status for e in estimates),
        sigma=spec.sigma,
        sigma_source=spec.sigma_source,
        chi2=spec.chi2,
        dof=spec.dof,
        model=dict(spec.model),
        data_sha256=spec.data_sha256,
        robot=spec.robot,
        robot_sha256=spec.robot_sha256,
        unseen=None if spec.unseen is None else (spec.unseen[0], spec.unseen[1]),
        file=str(path),
        total_covariance=None if spec.covariance_total is None else np.array(spec.covariance_total).reshape(p, p),
        cleaned=None
        if spec.masked is None
        else tuple(Masked(m.kind, tuple(m.rows), m.words, m.readings) for m in spec.masked),
        masked_rows=tuple(spec.masked_rows),
        linear=spec.linear,
        frames=_frames(spec, document),
    )


def _frames(spec: FitSpec, document: Document) -> tuple[Frame, ...]:
    """The frames of the file. InputError where one is no rigid motion."""
    out: list[Frame] = []
    for name, f in spec.frames.items():
        R = np.array(f.rotation, dtype=float) if all(len(row) == 3 for row in f.rotation) else np.zeros((0, 3))
        if (
            R.shape != (3, 3)
            or len(f.origin) != 3
            or not np.allclose(R @ R.T, np.eye(3), atol=1e-6)
            or np.linalg.det(R) < 0.0
        ):
            raise InputError(
                Problem(
                    f"frame {name!r} is no rigid motion",
                    str(document.path),
                    document.line("frames"),
                    allowed="rotation: a rotation matrix by rows; origin_m: three numbers",
                )
            )
        out.append(Frame(name, R, np.array(f.origin)))
    return tuple(out)


def write_nominal(fit: Fit, path: str | Path, robot: Robot) -> Path:
    """Write a nominal.yaml of the robot with identified values, sds and their source; the rest as it was.

    Parameters of the campaign (tracker, load, effects of the experiment) are named in a comment, for they are not the
    robot's: `write_campaign` writes them. InputError where an identified value lies beyond its bounds: a robot cannot
    be given it.
    """
    source = _source(fit)
    lines = [f"# {robot.title}: values of {source}."]
    own = {p.name for p in robot.parameters}
    others = [e.name for e in fit.estimates if e.name not in own]
    if others:
        lines.append(f"# Identified too, but not the robot's: {', '.join(others)}")
    return write_text(path, "\n".join([*lines, *_entries(fit, robot.parameters, source)]) + "\n")


def write_campaign(fit: Fit, path: str | Path, robot: Robot) -> tuple[str, ...]:
    """Write the identified values that are not the robot's as an experiment's `nominal:` takes them; their names.

    They are of effects that the experiment has beside its robot. Nothing is written where there are none. InputError
    where an identified value lies beyond its bounds, or where another file stands there.
    """
    own = {p.name for p in robot.parameters}
    rest = [p for p in fit.model.parameters if p.name not in own]
    told = tuple(p.name for p in rest if p.name in fit.names)
    if not told:
        return ()
    path, source = Path(path), _source(fit)
    if path.exists() and not path.read_text(encoding="utf-8", errors="replace").startswith(_CAMPAIGN):
        raise InputError(
            Problem("stands there and was not written by this command; move it, or name another file", str(path))
        )
    effects = zip(fit.model.effects, fit.model.slices, strict=True)
    of = dict.fromkeys(e.effect_name() for e, part in effects if not own.issuperset(fit.model.names[part]))
    head = [
        f"{_CAMPAIGN} on {robot.title}: {source}.",
        f"# Beside an experiment.yaml with `nominal: {path.name}`; its effects must stand there: {', '.join(of)}",
    ]
    write_text(path, "\n".join([*head, *_entries(fit, rest, source)]) + "\n")
    return told


_CAMPAIGN = "# Values of a campaign's effects"


def _source(fit: Fit) -> str:
    """Where the values of a fit are from. InputError where one lies beyond its bounds."""
    beyond = [e.name for e in fit.estimates if not e.lower <= e.value <= e.upper]
    if beyond:
        message = f"{', '.join(beyond)} beyond its bounds: a robot cannot have it. Fit within bounds"
        raise InputError(Problem(message, argument=("bounds", "")))
    return f"identified, {fit.method}" + (f", readings sha256 {fit.data_sha256[:16]}" if fit.data_sha256 else "")


def _entries(fit: Fit, parameters: Sequence[Parameter], source: str) -> list[str]:
    """Lines of a nominal file: identified values with their sds, the others as they were."""
    found = {e.name: e for e in fit.estimates}
    lines: list[str] = []
    for p in parameters:
        if p.name in found:
            e = found[p.name]
            told = source if not e.status else f"{source}; {e.status}"
            lines += _entry(p, e.value, e.sd if e.sd > 0 else None, told)
        elif p.source or p.nominal != 0.0:
            lines += _entry(p, p.nominal, p.sd, p.source)
    return lines


def _entry(p: Parameter, value: float, sd: float | None, source: str) -> list[str]:
    suffix = f"_{p.unit}" if p.unit else ""
    out = [f"{p.name}:", f"  value{suffix}: {value!r}"]
    out += [] if sd is None else [f"  sd{suffix}: {float(sd)!r}"]
    return out + ([f"  source: {json.dumps(source)}"] if source else [])


def write_urdf(robot: Robot, model: Model, x: Array, path: str | Path) -> tuple[str, ...]:
    """Write the robot's URDF with the joint origins that joint placements and offsets of x give.

    Returns the names of geometry effects that no origin can hold, because they change with the pose.
    """
    constant = constant_geometry(model, x)
    refuse_through_loops(model, x, constant.angles)
    write_corrected_urdf(robot, constant.twists, constant.angles, Path(path))
    return constant.left


@dataclass(frozen=True, eq=False)
class ConstantGeometry:
    """Errors of geometry that are the same at every pose: angles (n,) rad, twists (n, 6) of the placements, m and rad.

    left: the names of the effects of geometry that change with the pose
    """

    angles: Array
    twists: Array
    left: tuple[str, ...]


def constant_geometry(model: Model, x: Array) -> ConstantGeometry:
    """The errors of geometry at parameters x that every pose shares. InputError where two effects turn one joint."""
    count, n = 2, model.facts.n
    q = np.linspace(0.1, 0.9, count * n).reshape(count, n)
    poses = Poses(q, q, np.zeros((count, 6)))
    angles, twists = np.zeros(n), np.zeros((n, 6))
    left: list[str] = []
    for effect, own in model.of_kind(Geometry, x):
        term = laws.geometry(effect, own, Context(model.facts, poses, loaded=False))
        moved = np.zeros((count, n, 6)) if term.twists is None else term.twists
        if not (np.allclose(term.angles[0], term.angles[1]) and np.allclose(moved[0], moved[1])):
            left.append(effect.name)
            continue
        _add(twists, moved[0], effect.name)
        angles += term.angles[0]
    return ConstantGeometry(angles, twists, tuple(left))


def refuse_through_loops(model: Model, x: Array, angles: Array) -> None:
    """InputError where offsets (n,) of actuators pass through a closed loop."""
    closed = {j for loop, _ in model.of_kind(Loop, x) for j in loop.joints(model.facts)}
    through = [j for j in closed if j in model.facts.joints and angles[model.facts.joint_index(j)] != 0.0]
    if through:
        raise InputError(
            f"{', '.join(sorted(through))}: an actuator's offset passes through a closed loop, which no URDF origin "
            "can hold. Set it on the controller instead"
        )


def _add(twists: Array, more: Array, name: str) -> None:
    """Small placements add up; two effects that turn one joint are refused, for their order would matter."""
    both = np.any(twists, axis=1) & np.any(more, axis=1)
    if np.any(both):
        raise InputError(f"{name} moves a joint's placement that another effect moves already")
    twists += more


def result_files(
    fit: Fit, robot: Robot, nominal: Path | None, urdf: Path | None, anyway: bool = False
) -> Sequence[str]:
    """Write the files that are asked for; what to tell about them. InputError for a fit that is not to be trusted,
    unless `anyway`."""
    said: list[str] = []
    if nominal is not None or urdf is not None:
        said += (f"note: {note}" for note in obeyed(stored(fit), robot, fit.model.parameters, anyway))
    if nominal is not None:
        beside = nominal.with_name(f"{nominal.stem}_campaign{nominal.suffix}")
        others = write_campaign(fit, beside, robot)
        own = {p.name for p in robot.parameters}
        count = sum(name in own for name in fit.names)
        path = write_nominal(fit, nominal, robot)
        said.append(f"nominal values: {path}, with {count} of {len(fit.names)} identified values")
        if others:
            said.append(
                f"not the robot's: {len(others)} identified values, in {beside}; an experiment with their effects "
                f"takes them as `nominal: {beside.name}`"
            )
        if count + len(others) < len(fit.names):
            said.append(
                f"not in these files: {len(fit.names) - count - len(others)} of the tracker's frame; fit.json "
                "holds them (frames)"
            )
    if urdf is not None:
        left = write_urdf(robot, fit.model, fit.x, urdf)
        effects = zip(fit.model.effects, fit.model.slices, strict=True)
        moved = {
            n for e, part in effects if isinstance(e, Geometry) and e.name not in left for n in fit.model.names[part]
        }
        what = (
            "corrected URDF"
            if moved & set(fit.names)
            else "URDF, in which nothing is corrected (no joint origin was identified)"
        )
        said.append(f"{what}: {urdf}" + (f"; not in it: {', '.join(left)}" if left else ""))
    return said
