"""How often a day accuses a reading that is right: the number of clean days in docs/day.md.

    python benchmarks/clean_days.py              # 20 days of 36 states of 3 markers, 2,160 readings
    python benchmarks/clean_days.py --days 100

The days are those of tests/day/test_judge.py, which holds the first seven of them.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "day"))
import day_cell as cell

from qsframework.experiment import example, load_experiment


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--days", type=int, default=20)
    days = parser.parse_args().days
    experiment = load_experiment(example("m900ib") / "experiment.yaml")
    states, odd = 0, 0
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(days):
            said = cell.play(experiment, Path(folder) / str(seed), seed)
            states += len(said)
            odd += sum(judged.mistake is not None for judged in said)
    print(f"{days} days, {states * len(cell.MARKERS)} clean readings in {states} states: {odd} states to be looked at")


if __name__ == "__main__":
    main()
