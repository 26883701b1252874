"""What is said of uncertainties before and after readings of every kind, against campaigns drawn with that noise.

    python benchmarks/stated_noise.py [--campaigns 800] [--nulls 100] [--quick] [--write]

Three tables of docs/results.md. Predicted: the sd of a spring before the readings are fitted, over that
of the fit, over that of drawn fits; draws are balanced, so that chance has no part in them. Coverage: how often the
stated 95 % interval holds the true spring. Nulls: campaigns in which nothing is hidden, of a noise that differs by axis
or grows with the distance, while the files say that it is unknown; how often the diagnosis names anything of the arm.
Noise is drawn here from its definition, not by the library's covariances.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from clean import ROBOTS, plan_of
from common import PAGE, replace_between, shelved, table

from qsframework.diagnoses import diagnose
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Frame, Readings, load_experiment, make_rows, read_readings
from qsframework.experiment.simulate import planned_readings
from qsframework.fits import identify
from qsframework.fits.fit import Fit
from qsframework.plans import generate_candidates
from qsframework.plans.problem import joint_sd
from qsframework.plugin import Array
from qsframework.work import Work, run

START, STOP = "<!-- stated noise -->", "<!-- end of stated noise -->"
ARMS = ("fanuc_r2000ic", "kuka_kr500_r2800_2", "ur10")
LINEAR = FitOptions(linear=True, keep_all=True)
SIGMA = {"displacement": 3e-5, "position": 5e-5, "gauge": 2e-5}
"""m, as the files say it."""
_TEXT = "noise: {displacement_sigma_mm: 0.03, position_sigma_mm: 0.05, gauge_sigma_mm: 0.02}\n"
_FLOOR = "  floor_a: {xyz_mm: [1500, 800, -200], link: world}\n  floor_b: {xyz_mm: [900, -1200, 100], link: world}\n"
_ALONG = np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0], [0.6, 0.8, 0]])


# ---------------------------------------------------------------- files of each kind of reading


def campaign(robot: str, folder: Path, noise: str, floor: bool = False) -> Experiment:
    """The experiment of benchmarks/clean.py for a robot, its springs fitted, with another noise; floor: with two marks
    there, to which draw-wires go."""
    lines = ROBOTS[robot].text(robot).replace("noise: {sigma_mm: 0.03}\n", noise)
    lines = lines.replace("markers:\n", f"markers:\n{_FLOOR if floor else ''}")
    path = folder / "experiment.yaml"
    path.write_text(f"{lines}fit: [joint_compliance]\n")
    return load_experiment(path)


@dataclass(frozen=True)
class Table:
    """One file: its columns beside pose, angles, load and marker, and the cells of pose i and marker k."""

    name: str
    head: str
    cells: Callable[[int, str], list[str]]
    loaded: bool = True
    """Displacements under load; else states, unloaded and loaded."""


def _wires(i: int, marker: str) -> list[str]:
    return [f",,,1,,,,{end}" for end in ("floor_a", "floor_b")]


def _gauges(i: int, marker: str) -> list[str]:
    along = ",".join(f"{v:g}" for v in _ALONG[(i + int(marker[1])) % len(_ALONG)])
    return [f",,,1,{along},"]


def _touches(i: int, marker: str) -> list[str]:
    return [f"0,0,0,at_{i}_{marker}"]


_MOVED = "dx_mm,dy_mm,dz_mm"
_GAUGED = f"{_MOVED},gauge_mm,ux,uy,uz,to_marker"
DISPLACED = Table("displacements", _MOVED, lambda i, m: ["1,1,1"])
GAUGED = Table("gauges", _GAUGED, _gauges)
WIRED = Table("draw-wires", _GAUGED, _wires)
PLACED = Table("positions", "x_mm,y_mm,z_mm,series", lambda i, m: ["1000,1000,1000,S"], loaded=False)
TOUCHED = Table("touches", "x_mm,y_mm,z_mm,point", _touches, loaded=False)
KINDS = {
    "displacements": (DISPLACED,),
    "positions, frame unknown": (PLACED,),
    "gauges": (GAUGED,),
    "touched points": (TOUCHED,),
    "draw-wires": (WIRED,),
    "displacements, gauges, draw-wires": (DISPLACED, GAUGED, WIRED),
    "positions, touched points, gauges": (PLACED, TOUCHED, GAUGED),
}


def files(experiment: Experiment, kind: tuple[Table, ...], poses: int) -> Readings:
    """The readings of a kind without noise: tables as a user writes them, filled with what the arm does."""
    plan = plan_of(experiment, generate_candidates(experiment, 4 * poses, seed=5).pendant[:poses])
    angles = [",".join(f"{a:.9f}" for a in row) for row in np.rad2deg(plan.poses.pendant)]
    forces = [",".join(f"{v:g}" for v in row[:3]) for row in plan.poses.wrench]
    n, folder, paths = plan.poses.pendant.shape[1], experiment.path.parent, list[Path]()
    for one in kind:
        state = "" if one.loaded else ",state"
        joints = ",".join(f"q{k + 1}_deg" for k in range(n))
        rows = [f"pose,{joints},fx_N,fy_N,fz_N,marker{state},{one.head}"]
        for i, (q, force) in enumerate(zip(angles, forces, strict=True)):
            loads = [(force, "")] if one.loaded else [(",,", ",unloaded"), (force, ",loaded")]
            for load, said in loads:
                rows += [f"p{i},{q},{load},{m}{said},{cell}" for m in ("m1", "m2", "m3") for cell in one.cells(i, m)]
        paths.append(folder / f"{one.name}.csv")
        paths[-1].write_text("\n".join(rows) + "\n")
    blank = read_readings(paths, experiment, "positions" if not all(t.loaded for t in kind) else None)
    model, rows_of = experiment.model(), make_rows(blank)
    exact = np.array(blank.value)
    axes = [blank.known[f] or Frame(blank.frames[f], np.eye(3), np.zeros(3)) for f in rows_of.estimated]
    exact[rows_of.keep] = rows_of.predict(model, model.nominal, axes, True)
    return blank.with_values(exact)


# ---------------------------------------------------------------- predicted over fit over draws


def own_sds(readings: Readings) -> Array:
    """What this benchmark draws: the sd (R, 3) m of each coordinate of each row."""
    return np.tile(np.array([SIGMA[k] for k in readings.kind])[:, None], (1, 3))


def balanced(size: int, seed: int) -> Array:
    """Draws (size, size) of as many unit errors, whose mean square is the unit matrix."""
    return np.sqrt(size) * np.linalg.qr(np.random.default_rng(seed).standard_normal((size, size)))[0]


def springs(fit: Fit) -> list[int]:
    """Places of the springs among what was estimated."""
    return [i for i, name in enumerate(fit.names) if name.startswith("joint_compliance")]


def agreed(poses: int, of: tuple[str, str]) -> tuple[str, str, float, float]:
    """Of a robot and a kind of readings the ratios farthest from 1: predicted over the fit's, the fit's over draws'."""
    robot, kind = of
    with tempfile.TemporaryDirectory() as folder:
        experiment = campaign(robot, Path(folder), _TEXT, floor=True)
        exact = files(experiment, KINDS[kind], poses)
        predicted = joint_sd(experiment, [exact])
        there = np.isfinite(exact.value)
        sds, fits = own_sds(exact), list[Fit]()
        for e in balanced(int(there.sum()), 1):
            noise = np.zeros(exact.value.shape)
            noise[there] = e
            fits.append(identify(experiment, exact.with_values(exact.value + sds * noise), options=LINEAR))
    names = [fits[0].names[i] for i in springs(fits[0])]
    truth = experiment.model().nominal[experiment.model().index(names)]
    stated = np.sqrt(np.mean([fit.sd[springs(fit)] ** 2 for fit in fits], axis=0))
    drawn = np.sqrt(np.mean([(fit.values[springs(fit)] - truth) ** 2 for fit in fits], axis=0))
    before = predicted[[experiment.fit_names().index(name) for name in names]]
    return robot, kind, farthest(before / stated), farthest(stated / drawn)


def farthest(ratio: Array) -> float:
    """The one farthest from 1."""
    return float(ratio[np.argmax(np.abs(np.log(ratio)))])


# ---------------------------------------------------------------- coverage


@dataclass(frozen=True)
class Case:
    """A noise as it is stated, and as it is: sd m of a coordinate along the axes, shared by the markers of a visit, and
    by the reads of a nest."""

    name: str
    noise: str
    own: tuple[float, float, float] = (3e-5, 3e-5, 3e-5)
    visit: float = 0.0
    nest: float = 0.0
    reads: int = 1
    poses: int = 12


CASES = (
    Case("repeatability stated", "noise: {sigma_mm: 0.03, repeatability_mm: 0.04}\n", visit=4e-5),
    Case("four reads, nests' errors stated", "noise: {sigma_mm: 0.03, nest_sigma_mm: 0.06}\n", nest=6e-5, reads=4),
    Case("four reads, nests' errors unknown", "noise: estimate\n", nest=6e-5, reads=4),
    Case("noise by axis, unknown", "noise: estimate\n", own=(1.5e-5, 2.4e-5, 4.35e-5)),
    Case("sigma estimated at 12 degrees of freedom", "noise: estimate\n", poses=2),
)


def covered(campaigns: int, of: tuple[int, int]) -> tuple[int, int]:
    """Of a case and a seed: intervals that hold the true spring, of how many."""
    case, rng, hits, count = CASES[of[0]], np.random.default_rng(of), 0, 0
    with tempfile.TemporaryDirectory() as folder:
        experiment = campaign("fanuc_r2000ic", Path(folder), case.noise)
        twice = Table("reads", _MOVED, lambda i, m: [f"{k},1,1" for k in range(1, case.reads + 1)])
        exact = files(experiment, (twice,), case.poses)
        if len(make_rows(exact).at) != 9 * case.poses:
            raise SystemExit(f"{case.name}: reads are counted as visits")
        truth = experiment.model().nominal[experiment.model().index(experiment.fit_names())]
        shape = (case.poses, 3, 3)
        for _ in range(campaigns):
            own = np.array(case.own) * rng.standard_normal((case.reads, *shape)).mean(axis=0)
            visit = case.visit * rng.standard_normal((case.poses, 1, 3)) + case.nest * rng.standard_normal(shape)
            fit = identify(experiment, exact.with_values(exact.value + (own + visit).reshape(-1, 3)), options=LINEAR)
            hits += int(np.sum(np.abs(fit.values - truth) < fit.coverage * fit.sd))
            count += len(truth)
    return hits, count


# ---------------------------------------------------------------- nulls


def named(robot: str, of: tuple[str, int]) -> list[str]:
    """Of a kind of noise and a seed: what the diagnosis names of an arm in which nothing is hidden."""
    kind, seed = of
    rng = np.random.default_rng([seed, 11])
    with tempfile.TemporaryDirectory() as folder:
        stated = campaign(robot, Path(folder), "noise: {sigma_mm: 0.03}\n")
        experiment = campaign(robot, Path(folder), "noise: estimate\n")
        pool = generate_candidates(experiment, 600, seed=5).pendant
        plan = plan_of(experiment, pool[rng.choice(len(pool), 24, replace=False)])
        exact = planned_readings(stated, plan)
        sd = 3e-5 * np.tile([0.5, 0.8, 1.45], (len(exact.value), 1))
        if kind == "grows with the distance":
            places = experiment.rigid_places(plan.poses.q).reshape(-1, 3) - [4.0, 1.0, 0.5]
            sd = 1e-5 * np.tile(np.linalg.norm(places, axis=1)[:, None], (1, 3))
        readings = exact.with_values(exact.value + sd * rng.standard_normal(exact.value.shape))
        told = diagnose(experiment, replace(readings, stated=False))
    return [] if told.verdict == "none" else [told.verdict, *(f.name for f in told.findings)]


NULLS = ("by axis, .5 : .8 : 1.45", "grows with the distance")


# ---------------------------------------------------------------- the page


def tables(campaigns: int, nulls: int, arms: tuple[str, ...], work: Work) -> Iterator[str]:
    """The three tables."""
    asked = [(robot, kind) for robot in arms for kind in KINDS]
    rows = list[tuple[str, ...]]()
    each = list(run(agreed, 6, asked, work))
    for kind in KINDS:
        ratios = np.array([[a, b] for _, k, a, b in each if k == kind])
        shown = (f"{farthest(column):.4f}" for column in ratios.T)
        rows.append((kind, "0.97 to 1.03", *shown))
    yield "### Predicted\n\n" + table(("readings", "goal", "predicted over fit", "fit over draws"), rows)
    every = [(robot, kind, f"{a:.4f}", f"{b:.4f}") for robot, kind, a, b in each]
    yield "### Predicted\n\n" + table(("robot", "readings", "predicted over fit", "fit over draws"), every)
    parts = [(k, seed) for k in range(len(CASES)) for seed in (0, 1)]
    hits, lines = list(run(covered, campaigns // 2, parts, work)), list[tuple[str, ...]]()
    for k, case in enumerate(CASES):
        inside, count = np.sum(hits[2 * k : 2 * k + 2], axis=0)
        lines.append((case.name, "94 to 96.5 %", f"{100 * inside / count:.1f} %", str(count)))
    yield "### Coverage\n\n" + table(("noise", "goal", "measured", "intervals"), lines)
    nothing = [(kind, seed) for kind in NULLS for seed in range(nulls)]
    said = list(run(named, ARMS[0], nothing, work))
    print(*(f"{kind}, {seed}: {names}" for (kind, seed), names in zip(nothing, said, strict=True) if names), sep="\n")
    alarms = {kind: sum(bool(s) for (k, _), s in zip(nothing, said, strict=True) if k == kind) for kind in NULLS}
    rows = [(kind, "<= 2 %", str(alarms[kind]), str(nulls)) for kind in NULLS]
    yield "### Nothing hidden\n\n" + table(("noise", "goal", "something said", "of"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=800)
    parser.add_argument("--nulls", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--write", action="store_true")
    a = parser.parse_args()
    sizes = (40, 2, ARMS[-1:]) if a.quick else (a.campaigns, a.nulls, ARMS)
    parts = list[str]()
    for one in tables(*sizes, Work(jobs=a.jobs)):
        print(one, flush=True)
        parts.append(one)
    text = "\n\n".join(parts)
    if a.write and not a.quick:
        replace_between(PAGE, START, STOP, shelved(text, "stated noise", False))


if __name__ == "__main__":
    main()
