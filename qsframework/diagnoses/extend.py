"""The extended robot as files: robot.yaml with the named effects, their values, sds and evidence; an experiment on it.

folder/experiment.yaml   the campaign with its own effects (load, instrument), on the extended robot
folder/campaign.yaml     the values of these effects
folder/readings.csv      the readings as the audit left them, where it took rows out or found other sigmas
folder/robot/            robot.yaml, nominal.yaml, URDF and what it needs
folder/effects/          effects of the campaign that are files, as robot/effects/ holds those of the arm
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.diagnoses.audit_entries import Audited, audited_readings, noise_entry
from qsframework.elastostatics import Model
from qsframework.errors import InputError, Problem
from qsframework.experiment import Experiment, load_experiment, read_readings
from qsframework.files import read_yaml, write_folder, yaml_text
from qsframework.plugin import Effect, Load, Parameter, Poses, Sensor
from qsframework.plugin.entry import effect_entry
from qsframework.plugin.settings import place_fields
from qsframework.plugin.trusted import file_of
from qsframework.robot.loader import find_robot, robot_files
from qsframework.robot.named_files import entry_effects, named_file
from qsframework.robot.spec import nominal_entry

_HEAD = "Written by qsf diagnose."
_ROBOT, _EFFECTS = Path("robot"), Path("effects")
_FOLDERS = (str(_ROBOT), str(_EFFECTS))
_SAME = 1e-12
"""Relative difference up to which a number in a file is the one in memory."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Extension:
    """What to write: a model on an experiment's robot, `values` of all its parameters and `sds` of the estimated
    ones, SI; evidence: where a value comes from, by parameter; fit: names to estimate from now on; data: readings of
    the extended experiment; notes: lines for the head of its file; poses: where the files must predict the same;
    audited: what an audit found about noise and data, and about_noise: the line above it; further: files of readings
    beside `data`; used: hashes of all readings that the values are from, changed copies added."""

    experiment: Experiment
    model: Model
    values: Mapping[str, float]
    sds: Mapping[str, float]
    evidence: Mapping[str, str]
    fit: tuple[str, ...] = ()
    data: Path | None = None
    notes: tuple[str, ...] = ()
    poses: Poses | None = None
    audited: Audited = field(default_factory=Audited)
    about_noise: str = ""
    further: tuple[Path, ...] = ()
    used: tuple[str, ...] = ()


def write_extension(extension: Extension, folder: str | Path) -> tuple[Path, ...]:
    """Write the extended robot and its experiment into a folder, all or nothing; the paths written.

    InputError where the folder holds other files or the original, where a value lies beyond its bounds, or where the
    experiment has no file to start from. The files are loaded once before they take their place.
    """
    folder = Path(folder)
    _refuse_values(extension)
    source, robot_yaml = check_folder(extension.experiment, folder)
    contents = _contents(extension, folder, source, robot_yaml)
    return write_folder(folder, contents, lambda made: _check(made / "experiment.yaml", extension))


def _refuse_values(extension: Extension) -> None:
    found = [
        f"{p.name} = {extension.values[p.name]:.4g} {p.unit}".strip()
        for p in extension.model.parameters
        if not p.lower <= extension.values[p.name] <= p.upper
    ]
    if found:
        raise InputError(
            f"the extended robot cannot be written: {', '.join(found)} beyond the bounds of what a robot can have. The "
            "model still misses something that this value makes up for"
        )


def check_folder(experiment: Experiment, folder: Path) -> tuple[Path, Path]:
    """The experiment's file and its robot's. InputError where the folder cannot take an extension of them."""
    path = experiment.path
    robot_yaml = find_robot(str(read_yaml(path).data["robot"]), path.parent)
    _refuse_folder(folder, [path, robot_yaml])
    return path, robot_yaml


def _refuse_folder(folder: Path, originals: Sequence[Path]) -> None:
    """InputError unless the folder is new, empty, or holds nothing but what an earlier call wrote."""
    here = folder.resolve()
    if any(original.resolve().is_relative_to(here) for original in originals):
        raise InputError(Problem("holds the original files; name a new folder", file=str(folder)))
    if not here.exists():
        return
    if not here.is_dir():
        raise InputError(Problem("is a file; name a new folder", file=str(folder)))
    inside = [p.relative_to(here) for p in here.rglob("*") if not p.is_dir()]
    ours = here / "experiment.yaml"
    known = ours.is_file() and ours.read_bytes().startswith(f"# {_HEAD}".encode())
    others = [p for p in inside if not known or (p.parts[0] not in _FOLDERS and not _is_own(p.name))]
    if others:
        shown = ", ".join(sorted(str(p) for p in others)[:3])
        raise InputError(Problem(f"holds other files ({shown}); name a new or empty folder", file=str(folder)))


_READINGS = "readings.csv"
_OWN = ("experiment.yaml", "campaign.yaml", _READINGS)


def _is_own(name: str) -> bool:
    """Whether this writes files of such a name."""
    return name in _OWN or (name.startswith("readings_") and name.endswith(".csv"))


def _contents(extension: Extension, folder: Path, source: Path, robot_yaml: Path) -> dict[Path, str | bytes]:
    """What to write, by path in the folder."""
    document, robot = dict(read_yaml(source).data), dict(read_yaml(robot_yaml).data)
    arm, campaign, own, code = _entries(extension, source, robot_yaml)
    readings, named = _readings(extension, folder)
    copies = (hashlib.sha256(text.encode()).hexdigest() for text in readings.values())
    extension = replace(extension, used=(*extension.used, *copies))
    values = _values(extension, lambda e: e.name not in own)
    others = _values(extension, lambda e: e.name in own)
    robot |= {"title": _extended(str(robot["title"])), "effects": arm, "nominal": "nominal.yaml"}
    document |= {"robot": f"./{_ROBOT}", "effects": campaign, "nominal": "campaign.yaml", "fit": list(extension.fit)}
    document["data"] = named if len(named) > 1 else next(iter(named), None)
    if extension.audited.sigma is not None:
        document["noise"] = noise_entry(extension.experiment.noise, extension.audited)
    if not campaign:
        del document["effects"]
    if not others:
        del document["nominal"]
    document = {key: value for key, value in document.items() if value is not None and value != []}
    out: dict[Path, str | bytes] = {Path("experiment.yaml"): _experiment_text(document, extension, readings)}
    out.update({Path(name): text for name, text in readings.items()})
    if others:
        out[Path("campaign.yaml")] = yaml_text(others, f"{_HEAD} Effects of the load and of the instrument.")
    out[_ROBOT / "robot.yaml"] = yaml_text(robot, f"{_HEAD} The robot with the effects that the readings named.")
    out[_ROBOT / "nominal.yaml"] = yaml_text(values, f"{_HEAD} Identified values; the others as they were.")
    out.update({_ROBOT / f: (robot_yaml.parent / f).read_bytes() for f in robot_files(robot_yaml)})
    return out | code


def _readings(extension: Extension, folder: Path) -> tuple[dict[str, str], list[str]]:
    """Files of readings that the audit changed, by name, and what the experiment calls each of its files."""
    sources = [] if extension.data is None else [extension.data, *extension.further]
    changed: dict[str, str] = {}
    named: list[str] = []
    for k, source in enumerate(sources):
        text = audited_readings(source, extension.audited.of(k))
        if text is None:
            named.append(Path(os.path.relpath(source.resolve(), folder.resolve())).as_posix())
            continue
        named.append(_READINGS if k == 0 else f"readings_{k + 1}.csv")
        changed[named[-1]] = text
    return changed, named


def _experiment_text(document: Mapping[str, Any], extension: Extension, readings: Mapping[str, str]) -> str:
    """The experiment's file, with a word on what the audit changed."""
    audited, notes = extension.audited, list(extension.notes)
    if readings and extension.data is not None:
        masked = f"rows {', '.join(map(str, audited.masked))} masked (use 0) as outliers" if audited.masked else ""
        scaled = f"stated sigmas times {audited.factor:.4g}" if audited.factor != 1.0 else ""
        names = ", ".join(source.name for source in (extension.data, *extension.further))
        notes.append(f"{', '.join(readings)}: {names} with {', '.join(filter(None, (masked, scaled)))}.")
    text = yaml_text(document, "\n".join((_HEAD, *notes)))
    if audited.sigma is None:
        return text
    return text.replace("\nnoise:\n", f"\n# {' '.join(extension.about_noise.split())}\nnoise:\n", 1)


_Entries = list[dict[str, Any]]


def _entries(
    extension: Extension, source: Path, robot_yaml: Path
) -> tuple[_Entries, _Entries, set[str], dict[Path, str | bytes]]:
    """Entries of the arm and of the campaign, names of the campaign's effects, and the code that entries name."""
    model, document = extension.model, read_yaml(source).data
    facts, markers = extension.experiment.robot.facts, tuple(str(name) for name in document["markers"])
    code: dict[Path, str | bytes] = {}
    arm: _Entries = []
    campaign: _Entries = []
    listed: set[str] = set()
    own: set[str] = set()

    def add(entry: Mapping[str, Any], origin: Path, effects: Sequence[Effect], of_robot: bool) -> None:
        (arm if of_robot else campaign).append(_moved(entry, origin, _ROBOT if of_robot else Path(), code))
        names = {e.name for e in effects}
        listed.update(names)
        own.update(set() if of_robot else names)

    trust = _trusted(model)
    for entry in read_yaml(robot_yaml).data.get("effects", []):
        add(entry, robot_yaml.parent, entry_effects(entry, robot_yaml.parent, facts, markers, trust=trust), True)
    for entry in document.get("effects", []):
        effects = entry_effects(entry, source.parent, facts, markers, trust=trust)
        add(entry, source.parent, effects, all(of_arm(e) for e in effects))
    for effect in model.effects:
        if effect.name not in listed:
            file = file_of(type(effect))
            entry = effect_entry(effect) | ({} if file is None else {"file": file.name})
            add(entry, source.parent if file is None else file.parent, [effect], of_arm(effect))
    return arm, campaign, own, code


def _trusted(model: Model) -> bool:
    """Whether the model has effects from files: then the user has trusted them already."""
    return any(file_of(type(e)) is not None for e in model.effects)


def _moved(entry: Mapping[str, Any], origin: Path, to: Path, code: dict[Path, str | bytes]) -> dict[str, Any]:
    """The entry of a file in the folder `origin` for a file in `to`; the code that it names goes along."""
    if "file" not in entry:
        return dict(entry)
    path = named_file(entry, origin)
    content, there = path.read_bytes(), to / _EFFECTS / path.name
    if code.setdefault(there, content) != content:
        raise InputError(Problem(f"two different effects are files of the name {path.name}", file=str(path)))
    return dict(entry) | {"file": (_EFFECTS / path.name).as_posix()}


def of_arm(effect: Effect) -> bool:
    """Whether an effect belongs to the robot and stays with it; the others are of the load and the instrument.

    The mass of a link is the robot's, though it acts as a load; what sits at a marker is the campaign's.
    """
    places = place_fields(type(effect))
    if isinstance(effect, Load):
        return "link" in places or "joint" in places
    return not isinstance(effect, Sensor) and "marker" not in places


def _values(extension: Extension, wanted: Callable[[Effect], bool]) -> dict[str, Any]:
    """Entries of a nominal file for the effects that are wanted."""
    model = extension.model
    out: dict[str, Any] = {}
    for effect, part in zip(model.effects, model.slices, strict=True):
        if wanted(effect):
            told = (p for p in model.parameters[part] if p.name in extension.sds or not p.modifies or p.nominal)
            out.update({p.name: _entry(extension, p) for p in told})
    return out


def _entry(extension: Extension, p: Parameter) -> dict[str, Any]:
    sd, source = extension.sds.get(p.name, 0.0), extension.evidence.get(p.name, p.source)
    added = p.name not in extension.experiment.model().names
    found = p.identified_by(extension.used, added) if p.name in extension.sds else p
    return nominal_entry(found, extension.values[p.name], sd if sd > 0.0 else p.sd, source)


def _extended(title: str) -> str:
    return title if title.endswith(", extended") else f"{title}, extended"


def _check(path: Path, extension: Extension) -> None:
    """The written experiment loads, has the values of the extension, predicts what it predicts, reads its readings."""
    experiment, values = load_experiment(path, trust=_trusted(extension.model)), extension.values
    model = experiment.model()
    written = dict(zip(model.names, (float(v) for v in model.nominal), strict=True))
    lost = sorted(set(written) ^ set(values))
    lost += [n for n in values if n in written and abs(written[n] - values[n]) > _SAME * abs(values[n])]
    if not lost and extension.poses is not None:
        x = np.array([values[n] for n in extension.model.names])
        expected = extension.model.predict(extension.poses, x)
        if np.abs(model.predict(extension.poses) - expected).max() > 1e3 * _SAME * np.abs(expected).max():
            lost = ["its markers, its load or its gravity"]
    if lost:
        raise InputError(
            f"the extended robot would lose {', '.join(lost)}: the experiment in memory is not the one in "
            f"{extension.experiment.path}"
        )
    if experiment.data:
        read_readings(experiment.data, experiment)
