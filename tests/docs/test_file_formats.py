"""docs/file-formats.md is what the models and columns say now, and tells every key that a program writes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import make_file_formats as formats

from qsframework.experiment import load_experiment, make_plan, read_poses, write_plan
from qsframework.files import measured
from qsframework.report.result_json import diagnosis_json
from qsframework.robot.spec import RobotSpec


def test_the_page_is_current(root: Path) -> None:
    page = (root / "docs" / "file-formats.md").read_text()
    assert formats.page() == page, "run: python docs/make_file_formats.py"


def cells(section: str) -> dict[str, list[str]]:
    """The cells beside each key of a section's table, by the key."""
    head, _, *lines = [line[1:-1].split("|") for line in section.splitlines() if line.startswith("|")]
    names = [name.strip() for name in head]
    rows = [dict(zip(names, map(str.strip, line), strict=True)) for line in lines]
    return {
        bold.strip("*`"): [bold if bold.startswith("*") else "", *(row.get(name, "") for name in formats.HEAD[1:])]
        for row in rows
        for bold in row["key"].split(", ")
    }


def test_every_key_has_its_type_its_default_and_its_meaning(root: Path) -> None:
    page = (root / "docs" / "file-formats.md").read_text()
    _, keys = formats.meanings()
    for title, rows in formats.rows().items():
        section = page.split(f"\n## {title}\n")[1].split("\n## ")[0]
        elsewhere = [key for line in section.splitlines() if line.startswith("As in ") for key in line.split("`")[1::2]]
        shown = cells(section)
        assert sorted([*shown, *elsewhere]) == sorted(row.key for row in rows)
        for row in rows:
            key, *rest = formats.cells(row)
            expected = [key if row.default == formats.REQUIRED else "", *rest, keys[title, row.name]]
            assert row.key in elsewhere or shown[row.key] == expected
    robot = cells(page.split("\n## robot.yaml\n")[1].split("\n## ")[0])
    assert robot["payload_kg"] == ["", "", "", "mass that the wrist may carry"]
    station = cells(page.split("\n## experiment.yaml, stations\n")[1].split("\n## ")[0])
    assert station["clearance_mm"][:3] == ["", "", "5"]
    assert station["xyz_mm"][:3] == ["**`xyz_mm`**", "numbers", ""]
    assert cells(page.split("\n## plan.csv\n")[1].split("\n## ")[0])["q1_deg"][0] == "**`q1_deg`**"
    assert "any unit of the same kind" in " ".join(page.split())
    assert set(measured(RobotSpec)) == {"limits_tolerance", "payload", "gravity"}


def test_what_stands_in_another_table_is_there(root: Path) -> None:
    page = (root / "docs" / "file-formats.md").read_text()
    for where, keys in re.findall(r"^As in ([^:]+): (.*)\.$", page, re.M):
        section = page.split(f"\n## {where}\n")[1].split("\n## ")[0]
        assert set(keys.split("`")[1::2]) <= {*cells(section)}


def test_plan_json_holds_these_keys(root: Path, tmp_path: Path) -> None:
    experiment = load_experiment(root / "examples" / "m900ib" / "table5.yaml")
    poses = read_poses(root / "examples" / "m900ib" / "table5.csv", experiment)
    write_plan(tmp_path / "plan.csv", make_plan(poses, ["weight"] * len(poses)), experiment)
    assert set(json.loads((tmp_path / "plan.json").read_text())) == set(formats.keys_of("plan.json"))


def test_diagnosis_json_holds_these_keys() -> None:
    """The keys of `diagnosis_json`, from its source."""
    import inspect
    import re

    written = re.findall(r'^ {12}"(\w+)":', inspect.getsource(diagnosis_json), re.M)
    assert set(formats.keys_of("diagnosis.json")) == {*written, "format"}
