"""Correct two drilling targets by a fit, so that the loaded tool reaches them."""

import sys
from pathlib import Path

import numpy as np

from qsframework.experiment import example, load_experiment, read_readings
from qsframework.fits import identify, read_fit, write_fit
from qsframework.uses import compensate, joint_targets

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "qsf-script")  # its own: nothing of yours is replaced
folder.mkdir(exist_ok=True)
experiment = load_experiment(example("r2000ic") / "experiment.yaml")
write_fit(identify(experiment, read_readings(experiment.data, experiment)), folder / "fit.json")

angles = np.deg2rad([[0.0, 10.0, -10.0, 0.0, -60.0, 0.0], [30.0, 20.0, -5.0, 10.0, -45.0, 0.0]])  # as the pendant shows
push = np.array([[0.0, 0.0, -1000.0, 0.0, 0.0, 0.0]] * 2)  # N and N m, base frame
targets = joint_targets(experiment, angles, push)

done = compensate(experiment, read_fit(folder / "fit.json"), targets)
for i, name in enumerate(targets.name):
    turn = np.round(np.rad2deg(done.pendant[i] - angles[i]), 4)
    print(f"{name}: {1e3 * done.uncorrected[i]:.2f} mm off uncorrected, {1e3 * done.sd[i]:.3f} mm expected after it")
    print(f"  add to the angles, deg: {turn.tolist()}")
