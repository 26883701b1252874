"""Predicted uncertainties against those of fits and of differences of the settled prediction: a table of docs/model.md.

    python benchmarks/predicted.py             # print the table, and what is off or tied
    python benchmarks/predicted.py --write     # and put it into the page

Of every parameter that can stand in `fit:` - the robot's own and those of every effect that the library has a place
for - beside the joint springs: its sd by the model's sensitivities, that of the fit to readings without noise, and that
of fourth-order differences of the settled prediction, at the same values; from displacements and from positions, the
tracker's frame stated or estimated. And the efficiency of plans with a balancer's value fitted, as certified and by
such differences. What vanishes at a null stands at half its natural size: zero is a kink, or leaves another parameter
without effect. An effect's parameters are estimated together, the weights of a learned law, nearly tied to one another,
one at a time. The fit's sd is that of the readings alone (`--free`).
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from common import replace_between, shelved, table

from qsframework.elastostatics import Model
from qsframework.errors import InputError
from qsframework.estimation import FitOptions, scales
from qsframework.experiment import Experiment, Frame, LoadCase, Readings, load_experiment, observation_model
from qsframework.experiment.simulate import displaced
from qsframework.fits import identify
from qsframework.information.selection import identifiable_names
from qsframework.plans import DesignOptions, design, generate_candidates
from qsframework.plugin import Array, Conditions, Effect, Parameter, Poses, build_effects
from qsframework.plugin.registry import registry

ROBOTS = ("fanuc_m900ib", "fanuc_r2000ic", "kuka_kr600_r2830", "abb_irb760", "ur10", "kuka_kr500_on_kl4000")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "model.md"
START, STOP = "<!-- table of benchmarks/predicted.py -->", "<!-- end of the table of predicted sds -->"
BALANCED = {
    "kuka_kr600_r2830": "gas_balancer[joint_2].pressure",
    "fanuc_m900ib": "gravity_compensator[joint_2].stiffness",
}
READINGS = ("displacements", "positions, frame stated", "positions, frame estimated")
POSES = 30
WITHIN = 0.03
SIGMA = 3e-5
TEXT = """
robot: {robot}
load: {{point_mm: [150, 0, 200]}}
markers:
  m1: {{xyz_mm: [150, 250, 250]}}
  m2: {{xyz_mm: [400, -150, 150]}}
  m3: {{xyz_mm: [-100, -200, 300]}}
noise: {{sigma_mm: 0.03}}
"""
_TRIANGLE = {"joint": "joint_2", "lc_mm": 235, "l2_m": 1.12, "zero_deg": 20}
_ENDS = {f"{end}_{axis}_m": 0.1 for end in ("first", "second") for axis in "xyz"}
_CYLINDER = {"length_mm": 885, "pressure_bar": 90, "volume_l": 12, "piston_area_cm^2": 60, "rod_area_cm^2": 12}
WITH_SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "base_lift": {"direction": "ry"},
    "counterweight": {"link": "link_2", "x_m": 0.1, "y_m": 0.0, "z_m": -0.5},
    "learned": {"at": "joint_3", "by": "torque", "scale_Nm": 900.0, "lowest_Nm": -500.0, "highest_Nm": 900.0},
    "learned_bearing": {"at": "joint_1", "by": "loaded", "scale_Nm": 900.0},
    "learned_shift": {"at": "base_link", "by": "loaded", "scale_N": 900.0},
    "learned_load": {"at": "tool", "by": "force", "scale_N": 900.0, "lowest_N": 100.0, "highest_N": 900.0},
    "learned_load_point": {"at": "tool", "by": "attitude"},
    "learned_offset": {"at": "m1", "by": "loaded*order", "first": 0.0, "last": 1.0},
    "point_spring": {**_ENDS, "first": "link_1", "second": "link_2"},
    "gravity_compensator": _TRIANGLE,
    "compensator_stiffness": _TRIANGLE,
    "gas_balancer": {**_TRIANGLE, **_CYLINDER, "exponent": 1.2},
    "compensator_friction": {**_TRIANGLE, "spring_stiffness_N/m": 1e5, "free_length_m": 0.7},
}
"""Of effects without a place of their own."""
_NEEDS = {
    "base_lift": {"effect": "base_compliance", "direction": "ry"},
    "learned_bearing": {"effect": "offaxis_compliance", "joint": "joint_1", "axes": "all"},
    "learned_shift": {"effect": "base_compliance", "directions": "all"},
}
"""Springs that these bend."""
_BALANCERS = ("gravity_compensator", "compensator_stiffness", "gas_balancer", "compensator_friction", "point_spring")
_HEAVY = 100.0
"""kg of payload from which such balancers suit an arm."""
_FREE = FitOptions(keep_all=True, starts=0, free=True)
_STEP = 5e-3
"""Of differences, of a parameter's size."""
_FORCE = 0.4
"""Share of the payload's weight that hangs at the load point."""
_MARGIN = 0.5
"""rad: transmission angle beyond what loops ask for: a wrong convention of the controller flattens none."""
_LEAST = 1e-9
"""m per natural size: what moves no reading by so much has no sd."""
_TIED = 1e-5
"""Share of a parameter's column below which what the others leave of it is what differences err by: it is tied."""


@dataclass(frozen=True)
class Compared:
    """One parameter from one kind of reading: sds predicted and of the fit over that of differences; tied: to others,
    so that there is none."""

    name: str
    reading: str
    predicted: float
    fitted: float
    tied: bool = False

    @property
    def off(self) -> float:
        """The larger of the two ratios' distances from 1."""
        return max(abs(self.predicted - 1.0), abs(self.fitted - 1.0))


def campaign(robot: str) -> Experiment:
    """A robot and three markers about its tool."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "experiment.yaml"
        path.write_text(TEXT.format(robot=robot))
        return load_experiment(path)


def poses_of(experiment: Experiment, count: int = POSES, seed: int = 0) -> Poses:
    """Poses in the middle of the joints' ranges, weights and side pulls; time, warmth and approach as in a day."""
    rng, c = np.random.default_rng(seed), experiment.robot.controller
    middle, half = 0.5 * (c.lower + c.upper), 0.3 * np.minimum(c.upper - c.lower, 2.0 * np.pi)
    pendant = middle + half * rng.uniform(-1.0, 1.0, (40 * count, len(middle)))
    drawn = Poses(pendant, c.to_joints(pendant), np.zeros((len(pendant), 6)))
    pendant = pendant[experiment.model().transmission_margin(drawn) > _MARGIN][:count]
    weight = _FORCE * 9.81 * (experiment.robot.payload or 100.0)
    wrench = np.zeros((count, 6))
    wrench[:, 2] = -weight
    wrench[::3, 0], wrench[1::3, 1] = 0.5 * weight, 0.5 * weight
    time, warm = 600.0 * np.arange(count, dtype=float), 293.0 + rng.uniform(-3.0, 6.0, count)
    side = rng.choice([-1.0, 1.0], (count,))
    states = [Conditions(time + at, warm + 0.5 * (at > 0), side) for at in (0.0, 120.0)]
    return Poses(pendant, c.to_joints(pendant), wrench, *states)


def with_effects(experiment: Experiment, effects: Sequence[Effect]) -> Experiment:
    """The same with effects; all values that vanish at a null are half the natural size off."""

    def away(parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
        null = {p.name for p in parameters if p.null is not None and p.nominal == p.null}
        return tuple(replace(p, nominal=p.nominal + 0.5 * p.typical * (p.name in null)) for p in parameters)

    own = away([p for e in effects for p in e.parameters(experiment.robot.facts)])
    robot = replace(experiment.robot, parameters=away(experiment.robot.parameters))
    return experiment.with_(robot=robot, effects=tuple(effects), parameters=own)


def predict(experiment: Experiment, poses: Poses, x: Array, reading: str) -> Array:
    """Displacements (N, K, 3) m, or positions (2 N, K, 3) of the loaded and the unloaded states."""
    model = experiment.model()
    if reading == READINGS[0]:
        return model.predict(poses, x)
    return np.concatenate([model.positions(poses, x, on) for on in (True, False)])


def size_of(model: Model, name: str) -> float:
    """A parameter's value, or its natural size where that is zero."""
    (i,) = model.index([name])
    return abs(model.parameters[i].nominal) or model.parameters[i].typical


def columns(experiment: Experiment, poses: Poses, names: Sequence[str], reading: str) -> tuple[Array, Array]:
    """Derivatives (m, p) by the model and by differences of its predictions; m per unit of each parameter's size."""
    model, out = experiment.model(), list[Array]()
    x, size = model.nominal, np.array([size_of(model, n) for n in names])
    for i, s in zip(model.index(names), size, strict=True):
        h = _STEP * s * (np.arange(len(x)) == i)
        near, far = (
            predict(experiment, poses, x + k * h, reading) - predict(experiment, poses, x - k * h, reading)
            for k in (1.0, 2.0)
        )
        out.append((8.0 * near - far).ravel() / (12.0 * _STEP))
    if reading == READINGS[0]:
        slope = model.sensitivity(poses, x, names)
    else:
        slope = np.concatenate([model.position_sensitivity(poses, x, names, on) for on in (True, False)])
    return slope.reshape(-1, len(names)) * size, np.stack(out, axis=1)


def frame_columns(there: Array) -> Array:
    """Derivatives (m, 6) of positions (N, K, 3) by shifts and turns of the frame that they are told in."""
    turns = np.stack([np.cross(axis, there.reshape(-1, 3)) for axis in np.eye(3)], axis=-1)
    return np.concatenate([np.tile(np.eye(3), (len(turns), 1)), turns.reshape(-1, 3)], axis=1)


def readings_of(experiment: Experiment, poses: Poses, reading: str) -> Readings:
    """Readings without noise at the nominal values."""
    value = predict(experiment, poses, experiment.model().nominal, reading)
    count, markers = len(poses), value.shape[1]
    moved = displaced(poses, np.zeros((count, markers, 3)), SIGMA, [f"p{i}" for i in range(count)])
    if reading == READINGS[0]:
        return moved.with_values(value.reshape(-1, 3))
    known = Frame("", np.eye(3), np.zeros(3)) if reading == READINGS[1] else None
    none = np.full(2 * len(moved), -1)
    twice = {k: np.tile(getattr(moved, k), 2) for k in ("marker", "use", "file")}
    return replace(
        moved,
        **twice,
        plus=np.repeat(np.arange(2 * count), markers),
        minus=none,
        frame=none + 1,
        frames=("",),
        known=(known,),
        value=value.reshape(-1, 3),
        sigma=np.tile(moved.sigma, (2, 1)),
        minus_sigma=np.tile(moved.minus_sigma, (2, 1)),
        line=np.arange(2 * len(moved)) + 2,
        to=none,
    )


def fitted_sds(experiment: Experiment, poses: Poses, names: Sequence[str], reading: str) -> dict[str, float]:
    """sds of a fit by the readings alone; what these do not tell apart is not there."""
    asked, readings = experiment.with_(fit=tuple(names)), readings_of(experiment, poses, reading)
    told, _ = identifiable_names(observation_model(asked, readings), known=False)
    fit = identify(asked.with_(fit=tuple(told)), readings, None, _FREE)
    return {e.name: e.sd for e in fit.estimates if e.name in names}


def compare(
    experiment: Experiment,
    poses: Poses,
    names: Sequence[str],
    beside: Sequence[str],
    readings: Sequence[str] = READINGS,
) -> Iterator[Compared]:
    """Each parameter, estimated together with the others, from every kind of reading."""
    model = experiment.model()
    for reading in readings:
        asked = [*beside, *(n for n in names if n not in beside)]
        A, B = columns(experiment, poses, asked, reading)
        moves = dict(zip(asked, np.linalg.norm(B, axis=0) > _LEAST, strict=True))
        sds = fitted_sds(experiment, poses, [n for n in asked if moves[n]], reading)
        yield from (Compared(n, reading, math.nan, math.nan, tied=True) for n in names if moves[n] and n not in sds)
        kept = [k for k, n in enumerate(asked) if n in sds]
        there = predict(experiment, poses, model.nominal, reading)
        frame = frame_columns(there) if reading == READINGS[2] else np.zeros((there.size, 0))
        here, exact = (sds_of(np.hstack([M[:, kept], frame]))[: len(kept)] for M in (A, B))
        whole = np.linalg.norm(B, axis=0)
        for k, own, by_differences in zip(kept, here, exact, strict=True):
            if (name := asked[k]) in names:
                fitted = sds[name] / (SIGMA * size_of(model, name)) / by_differences
                tied = bool(by_differences * whole[k] > 1.0 / _TIED)
                yield Compared(name, reading, float(own / by_differences), float(fitted), tied)


def sds_of(A: Array) -> Array:
    """sds (p,) of parameters by readings of unit noise with derivatives (m, p)."""
    size = np.linalg.norm(A, axis=0)
    return np.linalg.norm(np.linalg.inv(np.linalg.qr(A / size, mode="r")), axis=1) / size


def effects_for(experiment: Experiment) -> Iterator[tuple[Effect, ...]]:
    """Every effect of the library at all its places that the robot has not got, with what it needs beside it."""
    robot = experiment.robot
    have, markers = {e.name for e in robot.effects}, tuple(m.name for m in experiment.markers)
    for kind, cls in registry().items():
        places: tuple[Effect, ...] = cls.places(robot.facts, markers)
        yield from ((e,) for e in places if e.name not in have)
        if places or kind not in WITH_SETTINGS or (kind in _BALANCERS and (robot.payload or 0.0) < _HEAVY):
            continue
        try:
            effects = build_effects({"effect": kind, **WITH_SETTINGS[kind]}, robot.facts, markers)
        except InputError:
            continue
        more = build_effects(_NEEDS[kind], robot.facts) if kind in _NEEDS else ()
        yield from ((e, *more) for e in effects if e.name not in have)


def of_its_own(plain: Experiment, poses: Poses) -> Iterator[Compared]:
    """The joint springs, and each other parameter of the robot beside them."""
    springs, own = springs_of(plain), with_effects(plain, ())
    yield from compare(own, poses, springs, springs)
    for p in plain.robot.parameters:
        if p.name not in springs:
            yield from compare(own, poses, [p.name], springs)


def of_effects(plain: Experiment, poses: Poses, effects: Sequence[Effect]) -> Iterator[Compared]:
    """The parameters of further effects beside the joint springs."""
    names = [p.name for e in effects for p in e.parameters(plain.robot.facts)]
    for group in [[n] for n in names] if effects[0].name.startswith("learned") else [names]:
        yield from compare(with_effects(plain, effects), poses, group, springs_of(plain))


def springs_of(plain: Experiment) -> list[str]:
    """The compliances of the joints."""
    return [p.name for p in plain.robot.parameters if p.name.startswith("joint_compliance")]


def of_robot(name: str) -> list[Compared]:
    """All parameters of a robot and of the library's effects on it; what is tied or off is printed."""
    plain, out = campaign(name), list[Compared]()
    poses = poses_of(plain)
    for part in (of_its_own(plain, poses), *(of_effects(plain, poses, effects) for effects in effects_for(plain))):
        for c in part:
            out.append(c)
            if c.tied or not c.off <= WITHIN:
                print(f"{name}: {c.name} from {c.reading}: {'tied' if c.tied else c.off}", flush=True)
    return out


def rows(found: Mapping[str, Sequence[Compared]]) -> str:
    """One row a robot and kind of reading."""
    lines: list[tuple[object, ...]] = []
    for robot, compared in found.items():
        for reading in READINGS:
            own = [c for c in compared if c.reading == reading and not c.tied]
            ties = sum(c.tied for c in compared if c.reading == reading)
            worst = [max((abs(getattr(c, k) - 1.0) for c in own), default=0.0) for k in ("predicted", "fitted")]
            lines.append(
                (robot, reading, len(own), *(f"{100 * w:.2f} %" if w >= 1e-4 else "< 0.01 %" for w in worst), ties)
            )
    head = ("robot", "readings", "parameters", "predicted, at most off", "fit, at most off", "ties")
    return table(head, lines)


def planned(robot: str, balancer: str) -> Experiment:
    """Joint springs and a value of the balancer are to be fitted, under a weight and a side pull."""
    plain = campaign(robot)
    wrenches = {"weight": (0.0, 0.0, -4e3), "side pull": (0.0, 1.5e3, -4e3)}
    loads = tuple(LoadCase(name, np.array([*f, 0.0, 0.0, 0.0]), None) for name, f in wrenches.items())
    return plain.with_(loads=loads, fit=("joint_compliance", balancer))


def by_differences(experiment: Experiment, poses: Poses) -> Array:
    """Information (N, p, p) of each pose, per unit of the scales that criteria use, from differences of predictions."""
    model, names = experiment.model(), experiment.fit_names()
    size = scales([model.parameters[i] for i in model.index(names)]) / [size_of(model, n) for n in names]
    _, slopes = columns(experiment, poses, names, READINGS[0])
    A = (slopes * size / SIGMA).reshape(len(poses), -1, len(names))
    return np.asarray(np.einsum("nki,nkj->nij", A, A))


def best_relaxed(M: Array, criterion: str) -> Array:
    """Information (p, p) of the best weights of candidates (N, p, p), by multiplying them with their scores."""
    w = np.full(len(M), 1.0 / len(M))
    for _ in range(5000):
        C = np.linalg.inv(np.tensordot(w, M, 1))
        G, most = (C, float(len(C))) if criterion == "D" else (C @ C, float(np.trace(C)))
        score = np.einsum("nij,ij->n", M, G) / most
        if score.max() < 1.0 + 1e-4:
            break
        w *= score if criterion == "D" else np.sqrt(score)
        w /= w.sum()
    return np.asarray(np.tensordot(w, M, 1))


def efficiency(experiment: Experiment, criterion: str, candidates: int, poses: int = 12) -> tuple[float, float]:
    """What a plan is certified for, and its efficiency by differences of predictions against the relaxed optimum of
    the same candidates. Polished plans are no longer held to these: both may be above 1."""
    drawn = generate_candidates(experiment, candidates, seed=0)
    plan = design(experiment, poses, candidates=drawn, options=DesignOptions(criterion=criterion, repeats=True))
    pendant, q = drawn.pendant, experiment.robot.controller.to_joints(drawn.pendant)
    every = [Poses(pendant, q, np.tile(load.wrench, (len(q), 1))) for load in experiment.loads]
    best = poses * best_relaxed(np.concatenate([by_differences(experiment, p) for p in every]), criterion)
    own = by_differences(experiment, plan.repeated()).sum(axis=0)
    here, there = (np.linalg.inv(M) for M in (own, best))
    shrunk = np.linalg.det(there) / np.linalg.det(here)
    exact = shrunk ** (1.0 / len(here)) if criterion == "D" else np.trace(there) / np.trace(here)
    assert plan.certificate is not None
    return plan.certificate.efficiency, float(exact)


def plans() -> str:
    """One row a plan of 12 poses out of 1,000 candidates under two loads, each allowed again."""
    lines = list[tuple[object, ...]]()
    for robot, balancer in BALANCED.items():
        for criterion in "DA":
            certified, exact = efficiency(planned(robot, balancer), criterion, 1000)
            lines.append(
                (robot, f"`{balancer}`", criterion, *(f"{v:.4f}" for v in (certified, exact, exact / certified)))
            )
    return table(("robot", "fitted beside the joints", "criterion", "certified", "by differences", "ratio"), lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the tables of docs/model.md")
    parser.add_argument("--robots", nargs="*", default=ROBOTS)
    chosen = parser.parse_args()
    predicted = rows({name: of_robot(name) for name in chosen.robots})
    text = f"### Predicted sds\n\n{predicted}\n\n### Plans\n\n{plans()}"
    print(text)
    if chosen.write:
        replace_between(PAGE, START, STOP, shelved(text, "model"))


if __name__ == "__main__":
    main()
