"""A verdict on positions in a frame that nobody knows, and on displacements, positions and a gauge together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from qsframework.diagnoses import diagnose
from qsframework.elastostatics import Model, make_model
from qsframework.elastostatics.so3 import exponential
from qsframework.experiment import Experiment, Readings, load_experiment
from qsframework.experiment.observations import start_values
from qsframework.experiment.readings import joined
from qsframework.experiment.simulate import displaced
from qsframework.plugin import Array, Effect, Poses, find
from qsframework.plugin.facts import frozen
from qsframework.report.words.diagnosis import diagnosis_words
from tests.diagnose.cases import SIGMA, as_built, campaign, candidates, day_of_positions, measured, poses
from tests.identify.arm import position_readings

UR10 = """
robot: ur10
markers:
  m1: {xyz_mm: [60, 0, 93]}
  m2: {xyz_mm: [-40, 50, 80]}
noise: {sigma_mm: 0.03}
rigid: true
effects:
  - {effect: marker_offset, markers: all}
  - {effect: joint_offset, joints: all}
fit: [marker_offset, joint_offset]
"""


def beside(model: Model, effects: tuple[Effect, ...]) -> Model:
    """The model with more effects."""
    markers = list(zip(model.marker_names, model.markers, strict=True))
    return make_model(model.facts, (*model.effects, *effects), model.parameters, model.tip, markers, model.gravity)


def tracked(experiment: Experiment, model: Model, x: Array, count: int, seed: int) -> Readings:
    """Unloaded positions of both markers, in the frame of a tracker that stands anywhere."""
    rng = np.random.default_rng(seed)
    controller = experiment.robot.controller
    pendant = rng.uniform(controller.lower, controller.upper, (count, 6)) * 0.4
    all_ = Poses(pendant, controller.to_joints(pendant), np.zeros((count, 6)))
    there = model.positions(all_, x) @ exponential(np.array([0.4, -1.1, 2.0])).T + np.array([2.0, -1.0, 0.5])
    seen = there + SIGMA * rng.standard_normal(there.shape)
    return position_readings(all_, np.zeros(count, dtype=bool), seen, SIGMA)


def ur10(folder: Path) -> tuple[Experiment, Model, Array]:
    """The experiment, the arm with an eccentric encoder at joint 3, and its parameters: zeros off, markers off."""
    (folder / "experiment.yaml").write_text(UR10)
    experiment = load_experiment(folder / "experiment.yaml")
    model = beside(experiment.model(), (find("encoder_eccentricity")("joint_3"),))
    known = dict(zip(experiment.model().names, start_values(experiment, experiment.fit_names()), strict=True))
    x = np.array([known.get(name, 0.0) for name in model.names])
    index = model.index(experiment.fit_names())
    scale = np.array([model.parameters[i].scale for i in index])
    x[index] += 0.5 * scale * np.random.default_rng(2).uniform(-1.0, 1.0, len(index))
    return experiment, model, x


def test_an_encoder_error_is_named_from_positions_in_an_unknown_frame(tmp_path: Path) -> None:
    experiment, model, x = ur10(tmp_path)
    hidden = {"encoder_eccentricity[joint_3].sin": 2.0e-4, "encoder_eccentricity[joint_3].cos": -1.0e-4}
    for name, value in hidden.items():
        x[model.names.index(name)] = value
    found = diagnose(experiment, tracked(experiment, model, x, 25, 3), repeats=1)
    assert found.verdict == "explained", diagnosis_words(found)
    assert [f.name for f in found.findings] == ["encoder_eccentricity[joint_3]"], diagnosis_words(found)
    for v in found.findings[0].values:
        assert abs(v.value - hidden[v.name]) < 4.0 * v.sd, v.name
    assert found.findings[0].alternatives == ()
    assert found.rms.heldout_extended < 1.2 * SIGMA < found.rms.heldout_identified


def test_nothing_is_named_from_positions_of_an_arm_as_it_is_modelled(tmp_path: Path) -> None:
    experiment, model, x = ur10(tmp_path)
    found = diagnose(experiment, tracked(experiment, model, x, 25, 4), repeats=1)
    assert (found.verdict, found.findings, found.leftovers) == ("none", (), ()), diagnosis_words(found)
    assert found.audit.unit_source == "stated"


def gauged(model: Model, x: Array, planned: Poses, seed: int) -> Readings:
    """A dial gauge, upright below the first marker."""
    moved = model.predict(planned, x)
    down = moved[:, :1, 2:] + SIGMA * np.random.default_rng([seed, 9]).standard_normal((len(planned), 1, 1))
    value = np.full(moved.shape, np.nan)
    value[:, :1, :1] = down
    plain = displaced(planned, value, SIGMA, [f"g{i}" for i in range(len(planned))])
    upright = np.tile(np.eye(3)[[2, 0, 1]], (len(plain), 1, 1))
    return replace(plain, axes=frozen(upright), use=plain.marker == 0)


def test_a_pedestal_that_gives_is_named_from_three_kinds_of_readings() -> None:
    hidden = find("base_compliance")("ry")
    truth = {hidden.name: 0.3 * hidden.parameters(campaign().robot.facts)[0].typical}
    model, x = as_built((hidden,), truth, np.random.default_rng([5, 7]))
    days = [
        measured((hidden,), truth, seed=5, count=12),
        day_of_positions(model, x, candidates()[40:48], 6, turned=(0.1, -0.2, 2.0), origin=(3.0, 1.0, -0.5)),
        gauged(model, x, poses(7, 10), 8),
    ]
    readings = joined(days)
    assert (readings.is_position[readings.use].sum(), readings.is_gauge[readings.use].sum()) == (72, 10)
    found = diagnose(campaign(), readings, repeats=1)
    assert found.verdict == "explained", diagnosis_words(found)
    assert [f.name for f in found.findings] == [hidden.name], diagnosis_words(found)
    (v,) = found.findings[0].values
    assert abs(v.value - truth[v.name]) < 4.0 * v.sd
    assert found.rms.heldout_gain > 0.0
