"""`fit:` of a parameter whose effect the experiment lacks says which effect to add, and following it works."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from qsframework.errors import InputError
from qsframework.experiment import load_experiment
from qsframework.plugin.registry import registry

TEXT = """
robot: {robot}
markers:
  m1: {{xyz_mm: [100, 0, 200]}}
load: {{point_mm: [150, 0, 200]}}
noise: {{sigma_mm: 0.03}}
"""


def followed(path: Path, robot: str, name: str) -> str:
    """ "there" where the robot has the effect already, "added" where the advice was followed, else what is needed."""
    file = path / "experiment.yaml"
    text = TEXT.format(robot=robot)
    file.write_text(f"{text}fit: [{name}]\n")
    try:
        load_experiment(file).fit_names()
    except InputError as error:
        said = str(error)
    else:
        return "there"
    advice = re.search(r"effects: (\[\{.*\}\])", said)
    if advice is None:
        assert f"{name} is an effect that this experiment lacks. Add it to effects: " in said, said
        return said.partition("Add it to effects: ")[2]
    file.write_text(f"{text}effects: {advice.group(1)}\nfit: [{name}]\n")
    names = load_experiment(file).fit_names()
    assert names
    assert all(n.startswith(name) for n in names)
    return "added"


@pytest.mark.parametrize("robot", ["fanuc_m900ib", "ur10"])
def test_every_effect_is_advised_and_the_advice_works(tmp_path: Path, robot: str) -> None:
    outcomes = {name: followed(tmp_path, robot, name) for name, kind in registry().items() if kind.role != "learned"}
    added = [name for name, outcome in outcomes.items() if outcome == "added"]
    assert {"joint_offset", "joint_placement", "marker_offset", "encoder_eccentricity"} <= set(added)
    assert not [name for name, outcome in outcomes.items() if outcome == ""]
