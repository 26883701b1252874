# ruff: noqa: E402 - threads are set before numpy is imported
"""Plans of positions: predicted uncertainties against Monte Carlo, against FIGAROH and random, and what they cost.

    python benchmarks/positions.py            # print
    python benchmarks/positions.py --write    # and put it into docs/results.md
    python benchmarks/positions.py --quick    # smaller

FIGAROH is asked where it is installed (QSF_FIGAROH_PYTHON names its interpreter). The Monte Carlo refits every draw of
the noise by Gauss-Newton steps with the Jacobian of the truth and the settled prediction, without what holds geometry
weakly, so that both are of the readings alone.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np
from common import memory, show, table
from figaroh import readings as ur10_readings, rms, run as figaroh

from qsframework.errors import QsfError
from qsframework.estimation import scales
from qsframework.experiment import Experiment, Plan, Readings, load_experiment, observation_model, read_readings
from qsframework.experiment.noise import NoiseModel
from qsframework.experiment.observations import start_values
from qsframework.experiment.simulate import planned_readings
from qsframework.experiment.stations import station_frame
from qsframework.fits import identify
from qsframework.information import predicted_sd
from qsframework.plans import DesignOptions, design
from qsframework.plans.certified import relaxed_design
from qsframework.plans.column_generation import Relaxed
from qsframework.plans.criteria import Determinant, Mean
from qsframework.plans.exact import Quotas, exchange
from qsframework.plans.problem import make_problem
from qsframework.plugin import Array, Indices

Row = tuple[str, str, str]
"""What, measured, the goal."""
ROOT = Path(__file__).resolve().parents[1]
ROBOTS = {
    "ur10": ("[80, 0, 60]", "[-60, 60, 90]", "[0, -80, 40]"),
    "fanuc_r2000ic": ("[150, 0, 200]", "[-120, 120, 260]", "[0, -150, 120]"),
    "kuka_kr270": ("[150, 0, 200]", "[-120, 120, 260]", "[0, -150, 120]"),
}
"""Arms of the Monte Carlo, and their markers, mm."""
POSES, DRAWS, STEPS = 30, 2000, 2
CHOSEN, PICKS = 30, 9


def campaign(folder: Path, robot: str, fit: str = "geometry, marker_offset") -> Experiment:
    """Three markers, two stations, a noise that grows with the distance."""
    marks = ", ".join(f"m{k + 1}: {{xyz_mm: {xyz}}}" for k, xyz in enumerate(ROBOTS[robot]))
    path = folder / f"{robot}.yaml"
    path.write_text(
        f"""robot: {robot}
markers: {{{marks}}}
noise: {{position_sigma_mm: 0.015, distance_sigma_um/m: 6}}
stations: {{front: {{xyz_mm: [3500, 500, 800]}}, side: {{xyz_mm: [300, -3600, 900]}}}}
effects: [{{effect: marker_offset, markers: all}}]
fit: [{fit}]
rigid: true
"""
    )
    return load_experiment(path)


def drawn(experiment: Experiment, plan: Plan, draws: int) -> tuple[list[str], Array, Array]:
    """Names, predicted sds and sds (p,) of so many draws of the noise, of what a plan identifies."""
    names = experiment.fit_names()
    predicted = predicted_sd(experiment, plan, names, free=True)
    kept = [name for name, sd in zip(names, predicted, strict=True) if np.isfinite(sd)]
    readings = planned_readings(experiment, plan, start_values(experiment, names))
    frames = [station_frame(experiment, f) for f in readings.frames]
    o = observation_model(experiment, readings, kept, frames=frames)
    obs, z0 = o.observations(), o.start
    J, truth = obs.jacobian(z0), obs.predict(z0)
    size = np.concatenate([np.full(o.motions, 1e-2), scales(list(o.parameters[o.motions :]))])
    back = np.linalg.pinv(obs.noise.whiten(J * size), rcond=1e-13) * size[:, None]
    sigma = o.rows.flat(o.rows.sigma)
    rng, out = np.random.default_rng(1), np.empty((draws, len(kept)))
    for i in range(draws):
        y, z = truth + sigma * rng.standard_normal(len(truth)), z0
        for _ in range(STEPS):
            z = z + back @ obs.noise.whiten(y - obs.predict(z))
        out[i] = z[o.motions :]
    return kept, predicted[np.isfinite(predicted)], out.std(axis=0, ddof=1)


def sds(quick: bool) -> list[Row]:
    """Ratios of Monte Carlo and predicted sds."""
    draws, rows, far, count = 200 if quick else DRAWS, list[Row](), 0, 0
    error = 1.0 / np.sqrt(2.0 * draws)
    with tempfile.TemporaryDirectory() as folder:
        for robot in ROBOTS:
            experiment = campaign(Path(folder), robot)
            plan = design(
                experiment, POSES, candidates=200, options=DesignOptions(criterion="D", polish=False, starts=3)
            )
            kept, predicted, found = drawn(experiment, plan, draws)
            ratio = found / predicted
            far, count = far + int((np.abs(ratio - 1.0) > 3.0 * error).sum()), count + len(kept)
            said = f"{ratio.mean():.4f} (each {ratio.min():.3f} to {ratio.max():.3f})"
            rows.append((f"sds of {draws} draws over predicted, mean, `{robot}`, {POSES} poses", said, "0.99 to 1.01"))
            print(rows[-1], flush=True)
    return [*rows, (f"of these beyond 3 standard errors of {error:.1%}", f"{far} of {count}", "0")]


def efficiency(count: int, seed: int) -> Row:
    """FIGAROH's choice, and ours of as many of the same configurations by the same rows."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rows.npz"
        theirs = figaroh("design", count, "--seed", seed, "--save", str(path))
        if "skipped" in theirs:
            raise SystemExit(str(theirs["skipped"]))
        with np.load(path) as saved:
            rows, weights = saved["rows"], saved["weights"]
    rows = rows / np.sqrt((rows**2).mean(axis=(0, 1)))
    chosen = np.argsort(-weights)[: theirs["chosen"]]
    number, p = len(chosen), rows.shape[2]
    quotas = Quotas((np.arange(count),), (number,), np.arange(count))
    ours = exchange(rows, Determinant(), quotas, None, 10, np.random.default_rng(0))
    dets = [np.linalg.slogdet(np.einsum("nkp,nkq->pq", rows[i], rows[i]))[1] for i in (ours, chosen)]
    ratio = float(np.exp((dets[0] - dets[1]) / p))
    return f"D-efficiency over FIGAROH's choice of {number} of {count} configurations, {p} columns", f"{ratio:.3f}", "1"


def held_out(experiment: Experiment, readings: Readings, chosen: Indices) -> float:
    """Error at the readings (mm, RMS of the distance) that a fit of those chosen has not seen."""
    use = np.zeros(len(readings), dtype=bool)
    use[chosen] = True
    fit = identify(experiment, replace(readings, use=use))
    predicted, measured = fit.predict(replace(readings, use=~use))
    return rms(predicted - measured)


def on_real_poses(draws: int, candidates: int) -> list[dict[str, float]]:
    """Thirty of the real poses chosen by us, by FIGAROH and at random, and the errors at all others."""
    experiment = load_experiment(ROOT / "examples" / "ur10" / "experiment.yaml")
    experiment = experiment.with_(fit=("marker_offset", "joint_offset", "joint_placement", "gravity_sag"))
    readings = read_readings(ROOT / "examples" / "ur10" / "series_d.csv", experiment)
    planned = experiment.with_(noise=NoiseModel(3e-4))
    q, _ = ur10_readings("D")
    out: list[dict[str, float]] = []
    for draw in range(draws):
        rng = np.random.default_rng(100 + draw)
        some = np.sort(rng.choice(len(q), candidates, replace=False))
        pendant = readings.poses.pendant[readings.plus[some]]
        plan = design(planned, CHOSEN, candidates=pendant, options=DesignOptions(criterion="D", polish=False, starts=5))
        at = [int(np.argmin(np.abs(pendant - p).max(axis=1))) for p in plan.pendant]
        with tempfile.TemporaryDirectory() as folder:
            path, rows = Path(folder) / "q.npy", Path(folder) / "rows.npz"
            np.save(path, q[some])
            theirs = figaroh("design", candidates, "--among", str(path), "--save", str(rows))
            if "skipped" in theirs:
                raise SystemExit(str(theirs["skipped"]))
            weights = np.load(rows)["weights"]
        best = np.argsort(-weights)[:CHOSEN]
        found: dict[str, float] = {}
        for who, chosen in (("ours", np.array(at)), ("figaroh", best)):
            found[who] = held_out(experiment, readings, some[chosen])
        random: list[float] = []
        for _ in range(PICKS):
            try:
                random.append(held_out(experiment, readings, rng.choice(some, CHOSEN, replace=False)))
            except QsfError:
                random.append(float("inf"))
        found["random"] = float(np.median(random))
        out.append(found)
        print(draw, found, flush=True)
    return out


def against(quick: bool) -> list[Row]:
    """The two comparisons."""
    rows = [efficiency(count, 0) for count in ((100,) if quick else (100, 200, 300))]
    real = on_real_poses(2 if quick else 10, 100)
    for who, what in (("figaroh", "FIGAROH's"), ("random", f"the median of {PICKS} random choices")):
        wins = sum(one["ours"] <= one[who] for one in real)
        means = [float(np.mean([one[w] for one in real])) for w in ("ours", who)]
        said = f"{wins} of {len(real)} draws, mean {means[0]:.3f} and {means[1]:.3f} mm"
        rows.append((f"held-out error (3D RMS) of {CHOSEN} of 100 real poses not above {what}", said, "9 of 10"))
    return rows


def cost(quick: bool) -> list[Row]:
    """Rows and the relaxed design of many candidates from two stations."""
    count = 10_000 if quick else 100_000
    with tempfile.TemporaryDirectory() as folder:
        experiment = campaign(Path(folder), "ur10")
        path = Path(folder) / "wide.yaml"
        path.write_text(
            experiment.path.read_text()
            .replace("markers: all}]", MORE)
            .replace("fit: [", "fit: [gravity_sag, encoder_eccentricity, ")
        )
        experiment = load_experiment(path)
        lower, upper = (np.array(e) for e in (experiment.robot.controller.lower, experiment.robot.controller.upper))
        pendant = np.random.default_rng(0).uniform(np.maximum(lower, -np.pi), np.minimum(upper, np.pi), (count, 6))
        start = time.process_time()
        problem = make_problem(experiment, pendant, 30)
        wanted = problem.wanted.tolist()
        rule = Mean(Determinant("D", "", np.eye(problem.reading.width)[:, wanted]))
        relaxed: Relaxed = relaxed_design(problem, rule, DesignOptions(criterion="D"), 0, lambda b: None)[0]
        whole = time.process_time() - start
    what = f"{count:,} candidates x {len(experiment.markers)} markers x {len(problem.names)} parameters x 2 stations"
    said = f"{whole:.1f} s CPU, {memory():.0f} MB, certified to {np.floor(1e6 * relaxed.efficiency) / 1e6:.6f}"
    return [(what, said, "20 s, 1,000 MB")]


MORE = (
    "markers: all}, {effect: gravity_sag, joints: [joint_2, joint_3]}, "
    "{effect: encoder_eccentricity, joints: [joint_2, joint_3], waves_per_turn: [1]}]"
)


def main() -> None:
    """Print the sections; put them into the page with --write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", choices=["cost", "sds", "figaroh"])
    given = parser.parse_args()
    parts = {"cost": cost, "sds": sds, "figaroh": against}
    rows = [row for name in ([given.only] if given.only else parts) for row in parts[name](given.quick)]
    text = table(("what", "measured", "goal"), [list(row) for row in rows])
    show("positions", text, given.write and not given.only, given.quick, None)


if __name__ == "__main__":
    main()
