"""docs/file-formats.md is what the models and columns say now, and tells every key that a program writes."""

from __future__ import annotations

import json
from pathlib import Path

import make_file_formats as formats

from qsframework.experiment import load_experiment, make_plan, read_poses, write_plan
from qsframework.files import measured
from qsframework.report.result_json import diagnosis_json
from qsframework.robot.spec import RobotSpec


def test_the_page_is_current(root: Path) -> None:
    page = (root / "docs" / "file-formats.md").read_text()
    assert formats.page() == page, "run: python docs/make_file_formats.py"


def test_every_key_has_its_unit_and_its_line(root: Path) -> None:
    page = (root / "docs" / "file-formats.md").read_text()
    for title, rows in formats.rows().items():
        section = page.split(f"\n## {title}\n")[1].split("\n## ")[0]
        shown = "".join(line.split(": ")[0] for line in section.splitlines() if line.startswith("- `"))
        assert all(f"`{spelled.split(', ')[0]}`" in shown for _, spelled, _ in rows)
    assert "- `payload_kg`: " in page
    assert "`q1_deg`, `q1_rad`" in page
    assert set(measured(RobotSpec)) == {"limits_tolerance", "payload", "gravity"}


def test_plan_json_holds_these_keys(root: Path, tmp_path: Path) -> None:
    experiment = load_experiment(root / "examples" / "m900ib" / "table5.yaml")
    poses = read_poses(root / "examples" / "m900ib" / "table5.csv", experiment)
    write_plan(tmp_path / "plan.csv", make_plan(poses, ["weight"] * len(poses)), experiment)
    assert set(json.loads((tmp_path / "plan.json").read_text())) == set(formats.keys_of("plan.json"))


def test_diagnosis_json_holds_these_keys() -> None:
    """The keys of `diagnosis_json` and those that the command adds, from its source."""
    import inspect
    import re

    written = re.findall(r'^        "(\w+)":', inspect.getsource(diagnosis_json), re.M)
    assert set(formats.keys_of("diagnosis.json")) == {*written, "separations", "follow_up", "format"}
