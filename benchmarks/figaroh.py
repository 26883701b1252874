# ruff: noqa: E402 - threads are set before numpy is imported
"""FIGAROH 1.0.2 on the repository's UR10: its choice of configurations, its calibration.

    python benchmarks/figaroh.py design 100 [--save rows.npz] [--among q.npy]
    python benchmarks/figaroh.py identify B --seed 0 [--model structural|elastic|map]

Each prints one line of JSON; `skipped` says why where FIGAROH is not installed (the extra `bench`).
Other benchmarks call `run`, which starts a process of its own, so that peak memory is FIGAROH's.

What is done for FIGAROH, so that it stands at its best: joint axes along z, which it names best; its
cost function replaced by plain differences of positions (its default turns every residual into a
logarithm of a placement, several times slower, with the same norm); its own closed-form start; plots
and reports left out. `elastic` adds what its configuration does not reach: with the whole set of
placement errors and an unknown base it overwrites the six joint compliances by the base's names.
The springs are those of joints 2 and 3, which carry the arm; with all six, weak directions make the
held-out error of some halves twice as large.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.metadata
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")
os.environ.setdefault("MPLBACKEND", "Agg")
HERE = Path(__file__).resolve().parent
if __name__ == "__main__":  # this file has the name of the package that it imports
    sys.path[:] = [p for p in sys.path if Path(p or ".").resolve() != HERE]

import numpy as np

ROOT = HERE.parent
JOINTS = [f"joint_{k}" for k in range(1, 7)]
ELASTIC = ["joint_2", "joint_3"]
PYTHON = "QSF_FIGAROH_PYTHON"
"""Environment variable that names another interpreter, with FIGAROH in it."""


def run(*arguments: str | int, timeout: float = 3600) -> dict[str, Any]:
    """One run in a process of its own, as the dictionary it prints."""
    command = [os.environ.get(PYTHON, sys.executable), str(HERE / "figaroh.py"), *map(str, arguments)]
    try:
        out = subprocess.run(command, capture_output=True, text=True, timeout=timeout)
    except subprocess.TimeoutExpired:
        return {"skipped": f"FIGAROH took longer than {timeout:.0f} s"}
    if out.returncode != 0:
        return {"skipped": "FIGAROH failed: " + (out.stderr.strip().splitlines() or ["no message"])[-1]}
    return json.loads(out.stdout.strip().splitlines()[-1])


def readings(series: str) -> tuple[np.ndarray, np.ndarray]:
    """Joint angles (n, 6) rad and positions (n, 3) m of a series of examples/ur10."""
    with open(ROOT / "examples" / "ur10" / f"series_{series.lower()}.csv") as file:
        lines = [line.rstrip("\n").split(",") for line in file if not line.startswith("#")]
    table = {name: [row[i] for row in lines[1:]] for i, name in enumerate(lines[0])}
    q = np.deg2rad(np.array([table[f"q{k}_deg"] for k in range(1, 7)], float).T)
    return q, np.array([table[f"{a}_mm"] for a in "xyz"], float).T / 1000


def halves(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows to fit and rows held out: a random half each."""
    order = np.random.default_rng(seed).permutation(count)
    return order[: count // 2], order[count // 2 :]


def rms(errors: np.ndarray) -> float:
    """RMS of the norms of position errors (n, 3) m, in mm."""
    return float(np.sqrt((errors**2).sum(axis=1).mean()) * 1000)


def memory() -> float:
    """Peak resident memory of this process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """No talk on stdout, which carries the result."""
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


class Clock:
    """Wall and CPU seconds since it was made or last read."""

    def __init__(self) -> None:
        self.wall, self.cpu = time.perf_counter(), time.process_time()

    def read(self) -> dict[str, float]:
        wall, cpu = time.perf_counter(), time.process_time()
        out = {"wall_s": round(wall - self.wall, 3), "cpu_s": round(cpu - self.cpu, 3)}
        self.wall, self.cpu = wall, cpu
        return out


def prepare(folder: Path, data: str, count: int, model: str) -> tuple[Any, str]:
    """FIGAROH's robot, from the repository's UR10, and the configuration file of a run."""
    import xacro
    from figaroh.tools.load_robot import load_robot

    urdf = folder / "ur10.urdf"
    urdf.write_text(xacro.process_file(str(ROOT / "robots" / "ur10" / "ur10.urdf.xacro")).toxml())
    robot = load_robot(str(urdf), package_dirs=str(folder), load_by_urdf=True)
    marker = {"name": "tmac", "measurable_dof": [True] * 3 + [False] * 3}
    parameters: dict[str, Any] = {"calibration_level": "full_params", "include_non_geometric": False}
    if model == "map":
        parameters["estimation"] = {"method": "map"}
    calibration = {
        "enabled": True,
        "parameters": parameters,
        "kinematics": {"base_frame": "universe", "tool_frame": "link_6"},
        "measurements": {"markers": [marker], "poses": {"base_pose": [0.0] * 6, "tool_pose": [0.0] * 6}},
        "data": {"source_file": data, "number_of_samples": count},
    }
    properties = {"joints": {"active_joints": JOINTS}}
    config = folder / "config.yaml"
    config.write_text(
        json.dumps({"robot": {"name": "ur10", "properties": properties}, "tasks": {"calibration": calibration}})
    )
    return robot, str(config)


def design(count: int, seed: int, save: str | None, among: str | None = None) -> dict[str, Any]:
    """FIGAROH's D-optimal choice among random configurations, or among those of a file, q (N, 6) rad."""
    from figaroh.optimal.base_optimal_calibration import BaseOptimalCalibration

    class Choice(BaseOptimalCalibration):
        def load_candidate_configurations(self) -> None:
            drawn = np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, 6))
            self.q_measured = drawn if among is None else np.load(among)
            self.calib_config["NbSample"] = count
            self._configs = {
                "calibration_joint_names": JOINTS,
                "calibration_joint_configurations": self.q_measured.tolist(),
            }

    with tempfile.TemporaryDirectory() as folder, silence():
        robot, config = prepare(Path(folder), "", count, "structural")
        job, before = Choice(robot, config), memory()
        job.load_candidate_configurations()
        clock = Clock()
        job.calculate_regressor()
        regressor = clock.read()
        parameters = job.R_rearr.shape[1]
        names = job.calib_config["param_name"][:parameters]
        if among is not None:  # real poses leave columns nearly dependent, and its solver divides by zero
            job.R_rearr = np.linalg.qr(job.R_rearr)[0] * np.sqrt(len(job.R_rearr))  # the best choice is the same
            job._subX_list, job._subX_dict = job.sub_info_matrix(job.R_rearr, job.calib_config)
        job.calculate_regressor = lambda: True  # its own choice computes it once more
        job.calculate_optimal_configurations()
        optimum = clock.read()
    rows = job.R_rearr.reshape(count, 3, parameters)
    weights = np.array(job.w_list)
    if save:
        np.savez(save, q=job.q_measured, rows=rows, weights=weights)
    return {
        "candidates": count,
        "parameters": parameters,
        "names": names,
        "regressor": regressor,
        "optimum": optimum,
        "chosen": len(job.optimal_configurations["calibration_joint_configurations"]),
        **quality(rows, weights),
        "memory_before_MB": round(before),
        "memory_MB": round(memory()),
    }


def quality(rows: np.ndarray, weights: np.ndarray) -> dict[str, float]:
    """log det of the weighted information, and how far from the optimum it can be (equivalence theorem)."""
    weights = np.maximum(weights, 0) / np.maximum(weights, 0).sum()
    information = np.einsum("i,ijk,ijl->kl", weights, rows, rows, optimize=True)
    worst = np.einsum("ijk,kl,ijl->i", rows, np.linalg.inv(information), rows, optimize=True).max()
    return {
        "log_det": float(np.linalg.slogdet(information)[1]),
        "efficiency_at_least": float(rows.shape[2] / worst),
    }


def write_data(path: Path, q: np.ndarray, y: np.ndarray) -> str:
    """The readings as FIGAROH reads them."""
    np.savetxt(path, np.hstack([y, q]), delimiter=",", header=",".join(["x1", "y1", "z1", *JOINTS]), comments="")
    return str(path)


def calibration(robot: Any, config: str, model: str) -> Any:
    """FIGAROH's calibration with the unknown base and tool point, not yet run."""
    from figaroh.calibration.base_calibration import BaseCalibration
    from figaroh.calibration.calibration_tools import calc_updated_fkm

    class Fit(BaseCalibration):
        def cost_function(self, var: np.ndarray) -> np.ndarray:
            return self.PEE_measured - calc_updated_fkm(self.model, self.data, var, self.q_measured, self.calib_config)

        def create_param_list(self, q: np.ndarray | None = None) -> bool:
            super().create_param_list(q)
            if model == "elastic":
                self.calib_config["param_name"] += [f"k_RZ_{joint}" for joint in ELASTIC]
                self.calib_config["non_geom"] = True
                self.eliminate_absorbed_parameters()
            return True

    job = Fit(robot, config)
    job.calib_config.update(known_baseframe=False, known_tipframe=False)
    return job


def identify(series: str, seed: int, model: str) -> dict[str, Any]:
    """FIGAROH's calibration of a random half of a series, its error on the other half."""
    from figaroh.calibration.calibration_tools import calc_updated_fkm

    q, y = readings(series)
    train, test = halves(len(q), seed)
    with tempfile.TemporaryDirectory() as folder, silence():
        data = write_data(Path(folder) / "train.csv", q[train], y[train])
        robot, config = prepare(Path(folder), data, len(train), model)
        job, before, clock = calibration(robot, config, model), memory(), Clock()
        job.initialize()
        start = clock.read()
        result, excluded = job.solve_optimisation()
        fit = clock.read()
        errors = []
        for part in (train, test):
            settings = dict(job.calib_config, NbSample=len(part))
            found = calc_updated_fkm(job.model, job.data, result.x, q[part], settings)
            errors.append(rms(found.reshape(3, -1).T - y[part]))
    names = job.calib_config["param_name"]
    return {
        "series": series.upper(),
        "seed": seed,
        "model": model,
        "readings": len(train),
        "parameters": len(names),
        "train_mm": errors[0],
        "held_out_mm": errors[1],
        "initialize": start,
        "fit": fit,
        "converged": bool(result.success),
        "excluded": len(excluded),
        "values": {n: float(v) for n, v in zip(names, result.x, strict=True)},
        "memory_before_MB": round(before),
        "memory_MB": round(memory()),
    }


def main() -> None:
    """Print one line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    jobs = parser.add_subparsers(dest="job", required=True)
    one = jobs.add_parser("design")
    one.add_argument("candidates", type=int)
    one.add_argument("--seed", type=int, default=0)
    one.add_argument("--save", help="a .npz file for the candidates q, their rows (N, 3, p) and the weights")
    one.add_argument("--among", help="a .npy file of as many configurations, q (N, 6) rad")
    two = jobs.add_parser("identify")
    two.add_argument("series", choices=["B", "D", "b", "d"])
    two.add_argument("--seed", type=int, default=0)
    two.add_argument("--model", choices=["structural", "elastic", "map"], default="structural")
    given = parser.parse_args()
    try:
        version = importlib.metadata.version("figaroh")
    except importlib.metadata.PackageNotFoundError:
        print(json.dumps({"skipped": "FIGAROH is not installed: pip install -c requirements.lock -e '.[bench]'"}))
        return
    if given.job == "design":
        out = design(given.candidates, given.seed, given.save, given.among)
    else:
        out = identify(given.series, given.seed, given.model)
    print(json.dumps({"figaroh": version, **out}))


if __name__ == "__main__":
    main()
