"""Identification of the repository's UR10 from absolute positions, side by side with FIGAROH 1.0.2.

    python benchmarks/identify.py [--seeds 5] [--out identify.json] [--write]
    python benchmarks/identify.py one B --seed 0 --model structural|elastic|sag|waves

Both fit the same random half of the readings of examples/ur10 (all rows, nothing masked beforehand) and are
judged on the other half: RMS of the norm of the error. Each run is a process of its own on one thread,
and the two take turns, so that the ratios hold on a busy machine too. `time` is from readings in memory
to the identified parameters; `memory` the peak of the process. Where FIGAROH is not installed the table
says so; QSF_FIGAROH_PYTHON names an interpreter that has it.

structural: tracker frame, marker, placements of all joints. elastic: and the springs of joints 2 and 3.
sag: and, instead of these, gravity_sag, masses unknown. waves: sag, and encoder errors 17 times per turn.
FIGAROH has no counterpart of the last two; they stand beside its elastic model.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from common import show, table

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")
HERE = Path(__file__).resolve().parent
EXAMPLE = HERE.parent / "examples" / "ur10"
GEOMETRY = ["marker_offset", "joint_offset", "joint_placement"]
MODELS = {
    "structural": GEOMETRY,
    "elastic": [*GEOMETRY, "joint_compliance[joint_2]", "joint_compliance[joint_3]"],
    "sag": [*GEOMETRY, "gravity_sag"],
    "waves": [*GEOMETRY, "gravity_sag", "encoder_eccentricity"],
}
AGAINST = {"structural": "structural", "elastic": "elastic", "sag": "elastic", "waves": "elastic"}


def one(series: str, seed: int, model: str) -> dict[str, Any]:
    """Fit one random half, judge on the other."""
    import resource
    from dataclasses import replace

    import numpy as np

    from qsframework.experiment import load_experiment, read_readings
    from qsframework.fits import identify

    experiment = load_experiment(EXAMPLE / "experiment.yaml")
    experiment = experiment.with_(effects=tuple(e for e in experiment.effects if e.effect_name() in MODELS[model]))
    readings = read_readings(EXAMPLE / f"series_{series.lower()}.csv", experiment)
    count = len(readings)
    order = np.random.default_rng(seed).permutation(count)  # as in figaroh.py
    halves = [
        replace(readings, use=np.isin(np.arange(count), part)) for part in (order[: count // 2], order[count // 2 :])
    ]
    clock = time.perf_counter()
    fit = identify(experiment, halves[0], MODELS[model])
    seconds = time.perf_counter() - clock
    predicted, measured = fit.predict(halves[1])
    return {
        "series": series.upper(),
        "seed": seed,
        "model": model,
        "parameters": len(fit.estimates),
        "held_out_mm": fit.error_of(predicted - measured) * 1e3,
        "train_mm": fit.error_of(fit.residuals) * 1e3,
        "masked": list(fit.masked),
        "time_s": seconds,
        "memory_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000,
    }


def own(series: str, seed: int, model: str) -> dict[str, Any]:
    """`one` in a process of its own."""
    command = [sys.executable, str(HERE / "identify.py"), "one", series, "--seed", str(seed), "--model", model]
    out = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(out.stdout.strip().splitlines()[-1])


def theirs(series: str, seed: int, model: str) -> dict[str, Any]:
    """FIGAROH's fit of the same half."""
    sys.path.append(str(HERE))
    from figaroh import run  # benchmarks/figaroh.py

    out = run("identify", series, "--seed", seed, "--model", model)
    if "skipped" not in out:
        out["time_s"] = out["initialize"]["wall_s"] + out["fit"]["wall_s"]
    return out


def median(runs: list[dict[str, Any]], key: str) -> float:
    return statistics.median(r[key] for r in runs)


def compare(series: str, seeds: int) -> tuple[list[list[str]], list[dict[str, Any]]]:
    """The lines of one series and all runs behind them."""
    lines: list[list[str]] = []
    everything: list[dict[str, Any]] = []
    compared: dict[str, list[dict[str, Any]]] = {}
    for model in MODELS:
        ours, fresh = [], AGAINST[model] not in compared
        reference = compared.setdefault(AGAINST[model], [])
        for seed in range(seeds):
            ours.append(own(series, seed, model))
            if fresh:
                reference.append(theirs(series, seed, AGAINST[model]))
        everything += ours + (reference if fresh else [])
        lines.append([f"{series} {model}", *_line(ours, [r for r in reference if "skipped" not in r])])
        print(lines[-1], file=sys.stderr)
        if len(lines[-1][2]) == 0:
            print(reference[0]["skipped"], file=sys.stderr)
    return lines, everything


def _line(ours: list[dict[str, Any]], told: list[dict[str, Any]]) -> list[str]:
    keys = ("held_out_mm", "time_s", "memory_MB")
    error, seconds, size = (median(ours, key) for key in keys)
    if not told:
        return [f"{error:.4f}", "", f"{seconds:.3f}", "", "", f"{size:.0f}", ""]
    their_error, their_seconds, their_size = (median(told, key) for key in keys)
    return [
        f"{error:.4f}",
        f"{their_error:.4f}",
        f"{seconds:.3f}",
        f"{their_seconds:.2f}",
        f"{their_seconds / seconds:.0f}",
        f"{size:.0f}",
        f"{their_size:.0f}",
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("job", nargs="?", choices=["table", "one"], default="table")
    parser.add_argument("series", nargs="?", default="B")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--model", choices=list(MODELS), default="structural")
    parser.add_argument("--seeds", type=int, default=5, help="random halves; at least five are written")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--write", action="store_true", help="write the table to docs/results.md")
    given = parser.parse_args()
    if given.job == "one":
        print(json.dumps(one(given.series, given.seed, given.model)))
        return
    (b, runs_b), (d, runs_d) = compare("B", given.seeds), compare("D", given.seeds)
    head = ["series, model", "held out, mm", "FIGAROH", "clock s", "FIGAROH", "ratio", "memory, MB", "FIGAROH"]
    text = table(head, b + d)
    if not any(line[2] for line in b + d):
        text += "\n\nFIGAROH is not compared here: it is not installed."
    show("identification", text, given.write, given.seeds < 5, given.seeds)
    if given.out:
        given.out.write_text(json.dumps(runs_b + runs_d, indent=1) + "\n")


if __name__ == "__main__":
    main()
