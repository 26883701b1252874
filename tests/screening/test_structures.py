"""A loop that the arm has not, or that its file leaves out, is named as such."""

from __future__ import annotations

import numpy as np
import pytest

from qsframework.diagnoses import diagnose
from qsframework.errors import InputError
from qsframework.experiment import (
    Experiment,
    Readings,
    as_shown,
    example,
    load_experiment,
    make_plan,
    on_robot,
    simulate,
)
from qsframework.experiment.noise import NoiseModel
from qsframework.plans import generate_candidates
from qsframework.plugin import Poses, find
from qsframework.report.extended import extension_of
from qsframework.report.words.diagnosis import diagnosis_words
from qsframework.robot import alternatives
from qsframework.screening.conventions import check_structures
from tests.diagnose.cases import measured

SIZE = 2.6e-7
"""rad/(N m) of link 1 about y: enough to make an arm without its loop look likelier."""
PULL = np.array([0.0, 800.0, -3000.0, 0.0, 0.0, 0.0])


def campaign(name: str) -> Experiment:
    return load_experiment(example(name) / "experiment.yaml").with_(noise=NoiseModel(3e-5))


def as_measured(experiment: Experiment, structure: str, seed: int = 3) -> Readings:
    """Displacements of an arm of another structure, read with the file of the experiment."""
    other = next(a for a in alternatives(experiment.robot) if a.id == structure)
    real = on_robot(experiment, other.robot)
    pendant = generate_candidates(experiment, 100, seed=1).pendant[:20]
    poses = Poses(pendant, other.robot.controller.to_joints(pendant), np.tile(PULL, (20, 1)))
    return as_shown(simulate(real, make_plan(poses, ["load"] * 20), seed=seed).readings, experiment)


def test_a_structure_is_named_rather_than_a_spring() -> None:
    """A loop that the file leaves out; one that the arm has not: tests/proof/test_independent.py."""
    experiment, structure = campaign("r2000ic"), "loop present: parallelogram[joint_3]"
    found = diagnose(experiment, as_measured(experiment, structure), repeats=1)
    assert [f.name for f in found.findings] == [structure], diagnosis_words(found)
    assert "behaves as if it had parallelogram[joint_3]" in diagnosis_words(found)
    assert found.rms.heldout_extended < 1.3 * 3e-5, "nothing is left for a spring to mend"
    with pytest.raises(InputError, match=r"no extended robot is written.*then diagnose again"):
        extension_of(found)


def test_a_right_structure_is_left_alone() -> None:
    experiment = campaign("m900ib")
    pendant = generate_candidates(experiment, 100, seed=1).pendant[:20]
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), np.tile(PULL, (20, 1)))
    readings = simulate(experiment, make_plan(poses, ["load"] * 20), seed=1).readings
    assert diagnose(experiment, readings, repeats=1).verdict == "none"


def test_a_cause_that_does_more_than_another_structure_is_named_instead() -> None:
    """Link 1 bends: without its loop the arm would fit better than as it is, but the bending fits better still."""
    (effect,) = (e for e in find("link_compliance").places(campaign("m900ib").robot.facts) if e.where == "link_1/ry")
    readings = measured((effect,), {effect.name: SIZE}, seed=2, count=20)
    assert check_structures(campaign("m900ib"), readings)
    found = diagnose(campaign("m900ib"), readings, repeats=1)
    assert all(":" not in f.name for f in found.findings)
    assert found.findings
