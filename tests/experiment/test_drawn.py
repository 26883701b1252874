"""A drawn truth: by stated sds, and by typical sizes of the errors that nobody states."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from qsframework.experiment import Experiment, Plan, load_experiment, make_plan, simulate
from qsframework.plugin import Poses

TEXT = """
robot: ur10
rigid: true
markers: {m1: {xyz_mm: [60, 0, 40]}}
noise: {position_sigma_mm: 0.03}
positions: {}
effects: [{effect: marker_offset, markers: all}]
fit: [geometry]
"""


def campaign(folder: Path, text: str = TEXT) -> tuple[Experiment, Plan]:
    (folder / "experiment.yaml").write_text(text)
    experiment = load_experiment(folder / "experiment.yaml")
    pendant = np.zeros((1, 6))
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), np.zeros((1, 6)))
    return experiment, make_plan(poses, [""])


def test_the_geometry_that_is_fitted_is_off_by_its_typical_size(tmp_path: Path) -> None:
    experiment, plan = campaign(tmp_path)
    drawn = [simulate(experiment, plan, truth="drawn", seed=s) for s in range(40)]
    model, values = drawn[0].model, np.array([one.x for one in drawn])
    fitted = model.index(experiment.fit_names())
    typical = np.array([model.parameters[i].typical for i in fitted])
    ratio = values[:, fitted].std(axis=0) / typical
    assert abs(ratio.mean() - 1.0) < 0.1
    assert ratio.min() > 0.5
    others = np.setdiff1d(np.arange(len(model.parameters)), fitted)
    assert not values[:, others].any(), "springs are rigid, markers are not fitted"
    assert not simulate(experiment, plan, truth="nominal", seed=1).x.any()


def test_springs_are_drawn_as_before(tmp_path: Path) -> None:
    """What is fitted beside them changes no draw of what has a stated sd."""
    loose = TEXT.replace("rigid: true\n", "")
    one, plan = campaign(tmp_path, loose)
    other = one.with_(fit=("joint_compliance",))
    springs = one.model().index([n for n in one.model().names if n.startswith("joint_compliance")])
    first, second = (simulate(e, plan, truth="drawn", seed=3).x[springs] for e in (one, other))
    assert np.array_equal(first, second)
    assert not np.array_equal(first, one.model().nominal[springs])
