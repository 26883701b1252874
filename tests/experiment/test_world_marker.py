"""A nest on the floor, `link: world`: nothing that the robot does moves it, and a tracker that moves is told by it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qsframework.diagnoses.explanations import motions_at
from qsframework.errors import InputError
from qsframework.experiment import Experiment, example, load_experiment, make_plan, make_rows
from qsframework.experiment.simulate import planned_readings
from qsframework.hypotheses.catalogue.causes import find_causes
from qsframework.hypotheses.catalogue.place_motions import places_of
from qsframework.hypotheses.columns import plan_case
from qsframework.plugin import Poses
from tests.diagnose.cases import poses as some_poses

MARKERS = """  nest: {link: world, xyz_mm: [1500, 200, 300]}
  foot: {link: base, xyz_mm: [900, 0, 0]}
"""


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return written(tmp_path_factory.mktemp("world"), MARKERS)


def written(folder: Path, markers: str) -> Experiment:
    file = folder / "experiment.yaml"
    text = (example("m900ib") / "experiment.yaml").read_text()
    base = load_experiment(example("m900ib") / "experiment.yaml").robot.facts.base
    file.write_text(text.replace("noise:", markers.replace("base", base) + "noise:", 1))
    return load_experiment(file)


@pytest.fixture(scope="module")
def poses(experiment: Experiment) -> Poses:
    return some_poses(1, 10)


def test_nothing_that_the_robot_does_moves_it(experiment: Experiment, poses: Poses) -> None:
    model, at = experiment.model(), [m.name for m in experiment.markers].index("nest")
    assert np.array_equal(model.positions(poses)[:, at], np.broadcast_to([1.5, 0.2, 0.3], (len(poses), 3)))
    assert not np.any(model.predict(poses)[:, at])
    assert not np.any(model.sensitivity(poses)[:, at])
    base, _ = find_causes(experiment, experiment.fit_names(), poses)
    stands = [c for c in base if c.name.startswith("base_compliance")]
    case = plan_case(experiment, poses, experiment.fit_names(), stands)
    columns = np.stack([case.metres(i).reshape(len(poses), -1, 3) for i in range(len(stands))])
    foot = [m.name for m in experiment.markers].index("foot")
    assert np.any(columns[:, :, foot]), "a stand that gives moves the foot"
    assert not np.any(columns[:, :, at])


def test_it_tells_a_tracker_that_moves_from_a_base_that_moves(experiment: Experiment, poses: Poses) -> None:
    """Both shift all that is on the robot alike; the nest alone stays where the base goes away under it."""
    names = ["weight"] * len(poses)
    wrench = np.tile(experiment.loads[0].wrench, (len(poses), 1))
    plan = make_plan(Poses(poses.pendant, poses.q, wrench), names)
    rows = make_rows(planned_readings(experiment, plan))
    places = {(p.law.part, p.law.place): p for p in places_of(motions_at(experiment, rows, {}, ()))}
    tracker, base = places["readings", ""].plus, places["shift", experiment.robot.facts.base].plus
    nest = rows.marker == [m.name for m in experiment.markers].index("nest")
    assert np.allclose(tracker[~nest], base[~nest], atol=1e-12)
    assert not np.any(base[nest])
    assert np.allclose(tracker[nest], np.eye(3))


def test_a_misspelt_link_is_offered_the_floor(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no link 'wrold'") as error:
        written(tmp_path, "  nest: {link: wrold, xyz_mm: [1500, 200, 300]}\n")
    assert "world" in str(error.value)
