# ruff: noqa: E402 - threads are set before numpy is imported
"""Plans of loads and positions for springs and geometry: what the tip is known to afterwards, predicted and real.

    python benchmarks/mixed_plans.py [--arms 100] [--write]

Of three arms. The plan that `qsf design` gives stands beside plans of the same size: for the springs alone, without
what joint 1's frame takes up, as if nothing were known before (`--free`, which is how plans were made before priors
counted), and the best by its predicted tip of 100 random ones. Each plan is judged by arms drawn from what is known
before the readings, springs by their stated sds: readings of the full equilibrium with noise, a fit with what is known
(Gauss-Newton steps from the nominal arm, the Jacobian that of the nominal arm), and the error of the tip of the fitted
arm at fresh poses under the load, after the rigid motion and the offset of the tool that suit best.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np
from common import PAGE, replace_between, shelved, table
from heavy_arm import at_levels, rms, write_experiment, write_robot

from qsframework.elastostatics import equilibrium
from qsframework.errors import NotIdentifiable
from qsframework.estimation import scales
from qsframework.experiment import Experiment, Plan, load_experiment, make_plan, observation_model
from qsframework.experiment.observations import start_values
from qsframework.experiment.prior import priors_of
from qsframework.experiment.simulate import planned_readings
from qsframework.experiment.stations import station_frame
from qsframework.information.sensitivities import covariance_after, plan_columns
from qsframework.plans import design, generate_candidates
from qsframework.plans.options import DesignOptions
from qsframework.plans.tip import tip_rows, unstated
from qsframework.plugin import Array, Poses

START, STOP = "<!-- mixed plans -->", "<!-- end of mixed plans -->"
POSES, ARMS, RANDOM, TARGETS, CANDIDATES = 30, 100, 100, 40, 300
STEPS = 3
NOISE = "noise: {position_sigma_mm: 0.03, displacement_sigma_mm: 0.03}\n"
MIXED = "effects: [{effect: marker_offset, markers: all}]\npositions: {}\n"
FIT = "fit: [joint_compliance, geometry, marker_offset]\n"
ROBOTS = {
    "fanuc_r2000ic": "robot: fanuc_r2000ic\nload: {point_mm: [6.9, 245.3, 319.3]}\n"
    "markers: {m1: {xyz_mm: [150, 0, 200]}, m2: {xyz_mm: [-120, 120, 260]}, m3: {xyz_mm: [0, -150, 120]}}\n"
    "loads: [{name: weight, fz_N: -1500}, {name: side_pull, fz_N: -500, fy_N: 1000}]\n"
    "constraints: {z_min_m: 0.4, of: load_point, collision: true, floor_m: 0.0}\n",
    "ur10": "robot: ur10\nload: {point_mm: [80, 0, 60]}\n"
    "markers: {m1: {xyz_mm: [80, 0, 60]}, m2: {xyz_mm: [-60, 60, 90]}, m3: {xyz_mm: [0, -80, 40]}}\n"
    "loads: [{name: weight, fz_N: -98}, {name: side_pull, fz_N: -20, fx_N: 80}]\n"
    "constraints: {z_min_m: 0.2, of: flange, collision: true, floor_m: -0.1, singularity_margin: 0.02}\n",
}
FIRST = ("joint_offset[joint_1]", "joint_placement[joint_1]")


def campaign(robot: str, folder: Path) -> Experiment:
    """Loads and positions, the springs and all geometry to be estimated, frame and nests unknown."""
    path = folder / "experiment.yaml"
    if robot == "heavy arm":
        write_robot(folder / "robot")
        path = write_experiment(folder)
        text = path.read_text().replace("states: positions\n", "positions: {}\n")
        path.write_text(text)
    else:
        path.write_text(ROBOTS[robot] + NOISE + MIXED + FIT)
    return load_experiment(path)


def plans(experiment: Experiment) -> Iterator[tuple[str, Plan]]:
    """The plan, and those beside it, all of one size."""
    candidates = generate_candidates(experiment, CANDIDATES, seed=0)
    names = experiment.fit_names()
    springs = tuple(n for n in names if n.startswith("joint_compliance"))
    loads = tuple(case for case in experiment.loads if not case.of_positions)
    others = tuple(n for n in names if not n.startswith(FIRST))
    asked: dict[str, tuple[Experiment, bool]] = {
        "design": (experiment, False),
        "springs alone": (experiment.with_(fit=springs, loads=loads, positions=None), False),
        "without joint 1's zero and placement": (experiment.with_(fit=others), False),
        "free": (experiment, True),
    }
    for name, (own, free) in asked.items():
        try:
            yield name, design(own, POSES, candidates=candidates, options=DesignOptions(free=free))
        except NotIdentifiable as error:
            print(f"{name}: {error}")
    rng, cases = np.random.default_rng(0), experiment.cases
    drawn = list[Plan]()
    for _ in range(RANDOM):
        at = rng.choice(len(candidates.pendant), POSES, replace=False)
        load = [cases[k] for k in rng.integers(len(cases), size=POSES)]
        pendant = candidates.pendant[at]
        poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), np.stack([c.wrench for c in load]))
        drawn.append(make_plan(poses, [c.name for c in load]))
    yield f"best of {RANDOM} random", min(drawn, key=lambda plan: predicted(experiment, plan, candidates.pendant))


def predicted(experiment: Experiment, plan: Plan, candidates: Array, at: Poses | None = None) -> float:
    """RMS, m, of the tip after frame and tool once a plan was read and fitted."""
    names, model = experiment.fit_names(), experiment.model()
    S = tip_rows(experiment, at, candidates, names, beside=unstated(experiment, names))
    own, half = covariance_after(model, plan_columns(experiment, plan, names), names)
    lost = sorted({*range(len(names))} - {*own})  # what the plan does not show stays as far off as it was
    sd = np.array([(p.sd or p.scale) / p.scale for p in (model.parameters[i] for i in model.index(names))])
    spread = np.concatenate([S[:, :, own] @ half, S[:, :, lost] * sd[lost]], axis=2)
    return float(np.sqrt(np.square(spread).sum() / len(S)))


def fitter(experiment: Experiment, plan: Plan) -> Callable[[Array, np.random.Generator], Array]:
    """What gives all parameters (q,) of a fit with what is known before of a plan's readings, of an arm with parameters
    (q,)."""
    model, names = experiment.model(), experiment.fit_names()
    own, _ = covariance_after(model, plan_columns(experiment, plan, names), names)
    kept = [n for i, n in enumerate(names) if i in own]
    readings = planned_readings(experiment, plan, start_values(experiment, names))
    o = observation_model(experiment, readings, kept, frames=[station_frame(experiment, f) for f in readings.frames])
    obs, z0 = o.observations(), o.start
    size = np.concatenate([np.full(o.motions, 1e-2), scales(list(o.parameters[o.motions :]))])
    weight, towards = obs.known
    held = weight > 0.0
    rows = np.concatenate([obs.noise.whiten(obs.jacobian(z0) * size), np.diag(weight * size)[held]])
    back, sigma = np.linalg.pinv(rows, rcond=1e-13) * size[:, None], o.rows.flat(o.rows.sigma)

    def fitted(truth: Array, rng: np.random.Generator) -> Array:
        true = observation_model(experiment, planned_readings(experiment, plan, truth), kept, frames=o.frames)
        y, z = true.observations().measured + sigma * rng.standard_normal(len(sigma)), z0
        for _ in range(STEPS):
            off = np.concatenate([obs.noise.whiten(y - obs.predict(z)), (weight * (towards - z))[held]])
            z = z + back @ off
        return o.values(z)

    return fitted


def arms(experiment: Experiment, count: int) -> Array:
    """Parameters (count, q) drawn from what is known before the readings, springs from their stated sds."""
    model, names = experiment.model(), experiment.fit_names()
    known, nests = priors_of(model), [n for n in names if n.startswith("marker_offset")]
    sd = np.array([s if np.isfinite(s) else (p.sd or 0.0) for p, s in zip(model.parameters, known.sd, strict=True)])
    sd[[i for i, n in enumerate(model.names) if n not in names]] = 0.0
    sd[model.index(nests)] = 2e-3
    rng = np.random.default_rng(7)
    x = start_values(experiment, names) + sd * rng.standard_normal((count, len(sd)))
    springs = model.index([n for n in names if n.startswith("joint_compliance")])
    x[:, springs] = np.maximum(x[:, springs], 0.2 * model.nominal[springs])
    return x


def judged(experiment: Experiment, plan: Plan, poses: Poses, count: int) -> float:
    """RMS, m, of the errors of the tip at some poses over the arms, after the best frame and tool."""
    model, rng, found = experiment.model(), np.random.default_rng(3), list[Array]()
    tip, fitted = replace(model, tip=experiment.load_site), fitter(experiment, plan)
    for truth in arms(experiment, count):
        x = fitted(truth, rng)
        real, said = (equilibrium(tip, poses, values, loaded=True) for values in (truth, x))
        found.append(at_levels(said.tip, said.tip_rotation, real.tip)["tool"])
    return rms(np.concatenate(found))


def rows(robot: str, count: int) -> Iterator[tuple[str, str]]:
    with tempfile.TemporaryDirectory() as folder:
        experiment = campaign(robot, Path(folder))
        at = generate_candidates(experiment, CANDIDATES, seed=0).pendant
        fresh = generate_candidates(experiment, TARGETS, seed=5).pendant
        load = experiment.loads[0]
        poses = Poses(fresh, experiment.robot.controller.to_joints(fresh), np.tile(load.wrench, (len(fresh), 1)))
        for name, plan in plans(experiment):
            real, said = judged(experiment, plan, poses, count), predicted(experiment, plan, at, poses)
            loaded = int(np.any(plan.wrench, axis=1).sum())
            yield name, f"{loaded} + {len(plan.pose) - loaded}: {1e3 * said:.4f} / {1e3 * real:.4f}"


def cells(robots: Sequence[str], count: int) -> Iterator[tuple[str, ...]]:
    """One row a plan: poses loaded and bare, the tip predicted and real, mm, for each arm."""
    found = {robot: dict(rows(robot, count)) for robot in robots}
    for plan in dict.fromkeys(name for own in found.values() for name in own):
        yield plan, *(found[robot].get(plan, "identifies too little") for robot in robots)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, default=ARMS, help="how many are drawn")
    parser.add_argument("--robot", default="", help="one of them alone")
    parser.add_argument("--write", action="store_true", help="put the table into docs/results.md")
    a = parser.parse_args()
    robots = [robot for robot in (*ROBOTS, "heavy arm") if a.robot in ("", robot)]
    text = table(("plan", *robots), list(cells(robots, a.arms)))
    print(text)
    if a.write:
        replace_between(PAGE, START, STOP, shelved(text, "mixed plans", False))


if __name__ == "__main__":
    main()
