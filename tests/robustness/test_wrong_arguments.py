"""Wrong arguments of the front door's verbs: an error says which one, what it is and how to get what is wanted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import qsframework as qsf
from qsframework.experiment import Experiment, Plan, Readings, make_plan
from qsframework.plans import DesignOptions
from qsframework.plugin import Poses

ROOT = Path(__file__).parents[2]
POSE, PULL = np.deg2rad([[0.0, 20, -10, 30, 40, 0]]), np.array([[0.0, 0, -4000, 0, 0, 0]])


def campaign(folder: Path, robot: str) -> Experiment:
    path = folder / "experiment.yaml"
    path.write_text(
        f"robot: {robot}\nload: {{point_mm: [0, 0, 200]}}\nmarkers:\n  m1: {{xyz_mm: [150, 250, 250]}}\n"
        "noise: {sigma_mm: 0.03}\nloads:\n  - {name: weight, fz_N: -2000}\n"
    )
    return qsf.load_experiment(path)


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    experiment = campaign(tmp_path_factory.mktemp("own"), "fanuc_m900ib")
    q = experiment.robot.controller.to_joints(POSE)
    plan = make_plan(Poses(POSE, q, PULL), ["weight"], robot="fanuc_m900ib")
    other = campaign(tmp_path_factory.mktemp("other"), "kuka_kr270")
    readings = qsf.simulate(experiment, plan).readings
    return {"ex": experiment, "plan": plan, "readings": readings, "other": other}


WRONG: dict[str, tuple[Callable[[Any, Plan, Readings], object], str]] = {
    "a path for readings": (
        lambda ex, plan, r: qsf.identify(ex, "readings.csv"),  # pyright: ignore[reportArgumentType]
        "readings: found 'readings.csv' (str); allowed: Readings. Read them with read_readings(path, experiment).",
    ),
    "a list of readings": (
        lambda ex, plan, r: qsf.identify(ex, [r, r]),  # pyright: ignore[reportArgumentType]
        "readings: found list; allowed: Readings.",
    ),
    "none": (
        lambda ex, plan, r: qsf.diagnose(ex, None),  # pyright: ignore[reportArgumentType]
        "readings: found None; allowed: Readings.",
    ),
    "readings for a plan": (
        lambda ex, plan, r: qsf.forecast(ex, r),  # pyright: ignore[reportArgumentType]
        "plan: found Readings; allowed: Plan or Poses. Make it with design(experiment, poses)",
    ),
    "a text for a count": (
        lambda ex, plan, r: qsf.design(ex, poses="12"),  # pyright: ignore[reportArgumentType]
        "poses: found '12' (str); allowed: a whole number",
    ),
    "too few poses": (lambda ex, plan, r: qsf.design(ex, poses=-3), "poses must be 1 or more, found -3"),
    "no candidates": (
        lambda ex, plan, r: qsf.design(ex, poses=3, candidates=0),
        "candidates must be 1 or more, found 0",
    ),
    "a level that is none": (
        lambda ex, plan, r: qsf.find_mistakes(ex, r, level=5.0),
        "level must be between 0 and 0.5, found 5",
    ),
    "home of three joints": (
        lambda ex, plan, r: qsf.make_programme(ex, plan, home=np.zeros(3)),
        "home: of another shape; found (3,); allowed: (6,)",
    ),
    "not numbers": (
        lambda ex, plan, r: qsf.simulate(ex, plan, x="nominal"),  # pyright: ignore[reportArgumentType]
        "x: found 'nominal' (str); allowed: an array of numbers",
    ),
    "a text for options": (
        lambda ex, plan, r: qsf.identify(ex, r, options="priors"),  # pyright: ignore[reportArgumentType]
        "options: found 'priors' (str); allowed: FitOptions",
    ),
    "a text for an option": (
        lambda ex, plan, r: DesignOptions(starts="many"),  # pyright: ignore[reportArgumentType]
        "starts: found 'many' (str); allowed: a whole number",
    ),
    "degrees": (
        lambda ex, plan, r: qsf.joint_targets(ex, np.rad2deg(POSE), PULL),
        "inside in degrees; angles are in rad",
    ),
    "one load of two": (lambda ex, plan, r: qsf.joint_targets(ex, np.vstack([POSE, POSE]), PULL), "a row of each"),
    "a point in mm": (
        lambda ex, plan, r: qsf.stiffness(ex.robot, POSE[0], PULL[0], [150.0, 0.0, 200.0]),
        "point: too far for a tool; found 250 m",
    ),
    "a force in mN": (
        lambda ex, plan, r: qsf.stiffness(ex.robot, POSE[0], 1000.0 * PULL[0]),
        "wrench: beyond any test of the arm; found 4000000 N",
    ),
    "a text for a number": (lambda ex, plan, r: qsf.units.to_si("1", "mm"), "value: found '1' (str)"),
    "tied to nothing": (
        lambda ex, plan, r: qsf.FitOptions(tied="one"),  # pyright: ignore[reportArgumentType]
        "tied to nothing: one",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_argument_is_told_in_words(given: dict[str, Any], name: str) -> None:
    ask, words = WRONG[name]
    with pytest.raises(qsf.InputError) as error:
        ask(given["ex"], given["plan"], given["readings"])
    assert words in str(error.value)


def test_plans_and_readings_of_another_robot_are_refused(given: dict[str, Any]) -> None:
    asked: tuple[Callable[[Experiment], object], ...] = (
        lambda other: qsf.identify(other, given["readings"]),
        lambda other: qsf.simulate(other, given["plan"]),
        lambda other: qsf.make_programme(other, given["plan"]),
        lambda other: qsf.design(other, 3, taken=[given["readings"]]),
    )
    for ask in asked:
        with pytest.raises(qsf.InputError, match="of another robot; found fanuc_m900ib; allowed: kuka_kr270"):
            ask(given["other"])


def test_one_name_is_a_list_of_one_and_lists_are_arrays(given: dict[str, Any]) -> None:
    assert qsf.FitOptions(fixed="joint_1").fixed == ("joint_1",)  # pyright: ignore[reportArgumentType]
    targets = qsf.joint_targets(given["ex"], POSE[0].tolist(), PULL[0].tolist())
    assert targets.pendant.shape == (1, 6)
    assert targets.robot == "fanuc_m900ib"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, r"identify\(\) missing 2 required positional arguments: 'experiment' and 'readings'"),
        ({"experiment": 1, "readngs": 2}, r"identify\(\) got an unexpected keyword argument 'readngs'"),
    ],
)
def test_a_missing_or_unknown_argument_is_told_with_the_verb(given: dict[str, Any], words: str) -> None:
    with pytest.raises(TypeError, match=words):
        qsf.identify(**given)
