"""plan.json says its format; a plan with a proof of a newer format is refused, not half read."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.cli.commands import write_json
from qsframework.errors import InputError
from qsframework.experiment import load_experiment, make_plan, read_plan, read_poses, write_plan


def test_a_proof_of_another_format_is_refused(root: Path, tmp_path: Path) -> None:
    experiment = load_experiment(root / "examples" / "m900ib" / "table5.yaml")
    poses = read_poses(root / "examples" / "m900ib" / "table5.csv", experiment)
    poses = replace(poses, wrench=np.tile([0.0, 0.0, -2000.0, 0.0, 0.0, 0.0], (len(poses), 1)))
    write_plan(tmp_path / "plan.csv", make_plan(poses, ["weight"] * len(poses), seed=7), experiment)
    beside = tmp_path / "plan.json"
    content = json.loads(beside.read_text())
    assert content["format"] == 1
    beside.write_text(json.dumps(content | {"format": 2, "seed": "of another kind"}))
    with pytest.raises(InputError, match=r"of a format that this qsframework does not read.*update this one"):
        read_plan(tmp_path / "plan.csv", experiment)
    del content["format"]
    beside.write_text(json.dumps(content))
    assert read_plan(tmp_path / "plan.csv", experiment).seed == 7


def test_results_say_their_format_and_lists_of_names_hold_names_alone(tmp_path: Path) -> None:
    write_json(tmp_path / "result.json", {"value": 1.5})
    assert json.loads((tmp_path / "result.json").read_text()) == {"format": 1, "value": 1.5}
    write_json(tmp_path / "names.json", {"ur10": "UR10"}, names=True)
    assert json.loads((tmp_path / "names.json").read_text()) == {"ur10": "UR10"}
