"""Make examples/day: what a tracker exported on the first five visits of a measuring day, the fifth with a mistake.

    python benchmarks/make_day_example.py [--folder examples/day]

The arm has other springs than its nominal ones, angles 0.03 deg off and a tool 1 mm off, and the tracker stands
somewhere in the hall. On the fifth visit joint 3 stands 2 deg from the plan.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from common import ROOT

from qsf_day.protocol import ProtocolOptions, make_protocol
from qsframework.elastostatics.so3 import exponential
from qsframework.experiment import load_experiment, make_plan, write_plan
from qsframework.experiment.simulate import prior_draws
from qsframework.plugin import Poses

SEED = 8
SIGMA = 3e-5
WISH = ProtocolOptions(cycles=1, half=False, repeat_share=0.0)
READ, WRONG, OFF = 5, 4, 2.0
"""Visits that were read; the one at which joint 3 stands elsewhere, and by how many degrees."""
POSES = (
    (-80, 10, -20, 40, -60, 30),
    (30, 40, -40, -90, 50, -120),
    (110, -10, 0, 120, -45, 90),
    (-20, 55, -15, 10, 75, 150),
    (70, 25, -60, -30, -80, -60),
    (-130, 0, -30, 75, 60, 10),
    (10, -25, 10, -140, 55, 100),
    (-50, 45, -50, 95, -35, -90),
)
EXPERIMENT = """robot: fanuc_m900ib
load: {point_mm: [150, 0, 200]}
markers:
  m1: {xyz_mm: [150, 250, 250]}
  m2: {xyz_mm: [400, -150, 150]}
  m3: {xyz_mm: [150, -150, -250]}
noise: {sigma_mm: 0.03}                    # of a position: the table of a day is one of states
loads:
  - {name: weight, fz_N: -4000}
  - {name: weight_and_side_pull, fz_N: -4000, fy_N: 1500}
"""
README = """# A measuring day

```sh
qsf day examples/day/experiment.yaml examples/day/plan.csv --watch examples/day/exports --once --cycles 1 --no-half --repeat-share 0 -o day
```

```text
visit_4.csv: pose p07, weight_and_side_pull, cycle 1: as expected.
visit_5.csv: pose p06, unloaded, cycle 1: look again (the markers are 56.57 mm from where this pose puts them). q3 is +2.04 deg from the plan (joint_3): look at the pendant.
```

`plan.csv` holds eight poses of a FANUC M-900iB; `exports/` what a tracker exported on the first five visits, a file for
each. Four are as expected. On the fifth joint 3 stood 2 degrees from the plan, and the answer says so. Without
`--watch` the same day has a page: [the measuring day](../../docs/day.md). Simulated by
`benchmarks/make_day_example.py`, with springs, angles, a tool and a tracker's place that no file here states.
"""  # noqa: E501


def write(folder: Path) -> None:
    """Write experiment, plan, exports and README."""
    exports = folder / "exports"
    exports.mkdir(parents=True, exist_ok=True)
    (folder / "experiment.yaml").write_text(EXPERIMENT)
    (folder / "README.md").write_text(README)
    experiment = load_experiment(folder / "experiment.yaml")
    model, controller = experiment.model(), experiment.robot.controller
    pendant, wrench = np.deg2rad(np.array(POSES, dtype=float)), np.zeros((len(POSES), 6))
    wrench[:, 2] = -4000.0
    wrench[::2, 1] = 1500.0
    names = ["weight_and_side_pull" if w[1] else "weight" for w in wrench]
    plan = make_plan(Poses(pendant, controller.to_joints(pendant), wrench), names)
    write_plan(folder / "plan.csv", plan, experiment)
    rng = np.random.default_rng(SEED)
    x = prior_draws(model, 1, rng)[0]
    angles, tool = 5e-4 * rng.standard_normal(6), 1e-3 * rng.standard_normal(3)
    rotation, origin = exponential(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-3.0, 3.0, 3)
    for number, visit in enumerate(make_protocol(experiment, plan, WISH).visits[:READ]):
        there = (visit.pendant + angles + np.deg2rad(OFF) * np.eye(6)[2] * (number == WRONG))[None]
        rows = ["Name,X [mm],Y [mm],Z [mm]"]
        for state in visit.states:
            poses = Poses(there, controller.to_joints(there), state.wrench[None])
            seen = (model.positions(poses, x, state.loaded)[0] + tool) @ rotation.T + origin
            seen += SIGMA * rng.standard_normal(seen.shape)
            kind = "loaded" if state.loaded else "unloaded"
            for marker, xyz in zip(experiment.markers, 1e3 * seen, strict=True):
                rows.append(f"{visit.pose}_{kind}_c{state.cycle}_{marker.name}," + ",".join(f"{v:.4f}" for v in xyz))
        (exports / f"visit_{number + 1}.csv").write_text("\n".join(rows) + "\n")


def main() -> None:
    """Write the example."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=ROOT / "examples" / "day")
    write(parser.parse_args().folder)


if __name__ == "__main__":
    main()
