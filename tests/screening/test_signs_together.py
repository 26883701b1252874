"""Several joints that count the other way at once, as A1, A4 and A6 of a KUKA against its table."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app

CAMPAIGN = """robot: kuka_kr270
markers: {m1: {xyz_mm: [150, 250, 250]}, m2: {xyz_mm: [400, -150, 150]}, m3: {xyz_mm: [0, 100, -150]}}
noise: {sigma_mm: 0.03}
rigid: true
effects: [{effect: joint_offset, joints: all}]
fit: [joint_offset]
positions: {poses: 20}
"""


def said(*line: object) -> str:
    done = CliRunner().invoke(app, [str(word) for word in line])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return " ".join(done.output.split())


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("signs")
    (folder / "experiment.yaml").write_text(CAMPAIGN)
    files = [folder / name for name in ("experiment.yaml", "plan.csv", "readings.csv")]
    said("design", files[0], "-n", 20, "--candidates", 200, "-o", files[1])
    said("simulate", files[0], files[1], "-o", files[2])
    return folder


@pytest.mark.parametrize("joints", [(1, 4, 6), (4, 6), (1, 4)])
def test_signs_that_are_wrong_together_are_named(joints: tuple[int, ...], place: Path) -> None:
    lines = [x for x in (place / "readings.csv").read_text().splitlines() if not x.startswith("#")]
    rows = list(csv.DictReader(lines))
    for row in rows:
        row.update({f"q{k}_deg": str(-float(row[f"q{k}_deg"])) for k in joints})
    wrong = place / "wrong.csv"
    wrong.write_text("\n".join([lines[0], *(",".join(row.values()) for row in rows)]) + "\n")
    found = said("check", place / "experiment.yaml", wrong)
    assert f"joint sign[{', '.join(f'joint {k}' for k in joints)}]" in found
    assert "count the other way round: the readings then fit to 0.0" in found
