"""Files of a fit's values: nominal.yaml of a robot and of a campaign, a URDF with corrected joint origins."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.elastostatics import Model
from qsframework.errors import InputError, Problem
from qsframework.files import write_text, yaml_text
from qsframework.fits.columns import sd_of
from qsframework.fits.estimate import EstimateState
from qsframework.fits.fit import Fit
from qsframework.fits.soundness import check_fit
from qsframework.plugin import Array, Context, Geometry, Loop, Parameter, Poses, laws
from qsframework.robot import Robot
from qsframework.robot.corrected import write_corrected_urdf
from qsframework.robot.spec import nominal_entry


def write_nominal(fit: Fit, path: str | Path, robot: Robot) -> Path:
    """Write a nominal.yaml of the robot with identified values, sds and their source; the rest as it was.

    Parameters of the campaign (tracker, load, effects of the experiment) are named in a comment, for they are not the
    robot's: `write_campaign` writes them. InputError where an identified value lies beyond its bounds: a robot cannot
    be given it.
    """
    source = _source(fit)
    comment = f"{robot.title}: values of {source}."
    own = {p.name for p in robot.parameters}
    others = [e.name for e in fit.estimates if e.name not in own]
    if others:
        comment += f"\nIdentified too, but not the robot's: {', '.join(others)}"
    return write_text(path, yaml_text(_entries(fit, robot.parameters, source), comment))


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
    if path.exists() and not path.read_text(encoding="utf-8", errors="replace").startswith(f"# {_CAMPAIGN}"):
        raise InputError(
            Problem("stands there and was not written by this command; move it, or name another file", str(path))
        )
    effects = zip(fit.model.effects, fit.model.slices, strict=True)
    of = dict.fromkeys(e.effect_name() for e, part in effects if not own.issuperset(fit.model.names[part]))
    comment = (
        f"{_CAMPAIGN} on {robot.title}: {source}.\n"
        f"Beside an experiment.yaml with `nominal: {path.name}`; its effects must stand there: {', '.join(of)}"
    )
    write_text(path, yaml_text(_entries(fit, rest, source), comment))
    return told


_CAMPAIGN = "Values of a campaign's effects"


def _source(fit: Fit) -> str:
    """Where the values of a fit are from. InputError where one lies beyond its bounds."""
    beyond = [e.name for e in fit.estimates if e.beyond > 0.0]
    if beyond:
        message = f"{', '.join(beyond)} beyond its bounds: a robot cannot have it. Fit within bounds"
        raise InputError(Problem(message, argument=("bounds", "")))
    used = ", ".join(one[:16] for one in fit.account.hashes)
    return f"identified, {fit.method}" + (f", readings sha256 {used}" if used else "")


def _entries(fit: Fit, parameters: Sequence[Parameter], source: str) -> dict[str, dict[str, Any]]:
    """Entries of a nominal file: identified values, known to noise, load and what was held; the others as they were."""
    found = {e.name: e for e in fit.estimates}
    out: dict[str, dict[str, Any]] = {}
    for p in parameters:
        if p.name in found:
            e = found[p.name]
            sd, told = sd_of(fit, e), source if e.state is EstimateState.FINE else f"{source}; {e.state.value}"
            out[p.name] = nominal_entry(p.identified_by(fit.account.hashes), e.value, sd if sd > 0.0 else None, told)
        elif p.source or p.nominal != 0.0 or p.earlier:
            out[p.name] = nominal_entry(p, p.nominal, p.sd, p.source)
    return out


def write_urdf(robot: Robot, model: Model, x: Array, path: str | Path) -> tuple[str, ...]:
    """Write the robot's URDF with the joint origins that joint placements and offsets of x give.

    Returns the names of geometry effects that no origin can hold, because they change with the pose.
    """
    angles, twists, varying = constant_geometry(model, x)
    refuse_through_loops(model, x, angles)
    write_corrected_urdf(robot, twists, angles, Path(path))
    return varying


def constant_geometry(model: Model, x: Array) -> tuple[Array, Array, tuple[str, ...]]:
    """The errors of geometry at parameters x that every pose shares. InputError where two effects turn one joint.

    Returns: angles (n,) rad, twists (n, 6) of the placements, m and rad, and the names of the effects of geometry that
    change with the pose.
    """
    count, n = 2, model.facts.n
    q = np.linspace(0.1, 0.9, count * n).reshape(count, n)
    poses = Poses(q, q, np.zeros((count, 6)))
    angles, twists = np.zeros(n), np.zeros((n, 6))
    varying: list[str] = []
    for effect, own in model.of_kind(Geometry, x):
        term = laws.geometry(effect, own, Context(model.facts, poses, loaded=False))
        moved = np.zeros((count, n, 6)) if term.twists is None else term.twists
        if not (np.allclose(term.angles[0], term.angles[1]) and np.allclose(moved[0], moved[1])):
            varying.append(effect.name)
            continue
        _add(twists, moved[0], effect.name)
        angles += term.angles[0]
    return angles, twists, tuple(varying)


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


def result_files(fit: Fit, robot: Robot, nominal: Path | None, anyway: bool = False) -> list[str]:
    """Write the nominal.yaml that is asked for; lines on what it holds. InputError for a rejected fit, unless
    `anyway`."""
    if nominal is None:
        return []
    lines = [f"note: {note}" for note in check_fit(fit, robot, anyway=anyway)]
    campaign = nominal.with_name(f"{nominal.stem}_campaign{nominal.suffix}")
    others = write_campaign(fit, campaign, robot)
    names = {p.name for p in robot.parameters}
    count = sum(name in names for name in fit.names)
    path = write_nominal(fit, nominal, robot)
    lines.append(f"nominal values: {path}, with {count} of {len(fit.names)} identified values")
    if others:
        lines.append(
            f"not the robot's: {len(others)} identified values, in {campaign}; an experiment with their effects "
            f"takes them as `nominal: {campaign.name}`"
        )
    if count + len(others) < len(fit.names):
        lines.append(
            f"not in these files: {len(fit.names) - count - len(others)} of the tracker's frame; fit.json "
            "holds them (frames)"
        )
    return lines
